"""The options of `famjax measure` that say how pictures are measured."""

import dataclasses
from pathlib import Path
from typing import Literal

from cyclopts import Parameter


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class RecipeOptions:
    """What the options say of the recipe; None where they say nothing.

    Parameters
    ----------
    ruler
        Photograph of a ruler in the plane of the muscle's axis, from the same camera.
    distance
        Camera to muscle with its unit; unless given, that of which the tapes' edges are arcs, with its
        error.
    pitch
        Of the ruler's marks; unless given, it is read off the marks from number to number.
    expected_px_per_in
        The scale to within a quarter, for a ruler with different marks on its two edges.
    ruler_placement
        Standard error of the ruler's distance from the plane of the muscle's axis, `0.01in`; no
        picture shows it, and it enters the errors of all figures.
    crop_offset
        Column and row of the pictures' first pixel in the camera's frame, `1459,531`.
    frame_size
        Width and height of the camera's frame, which a crop offset is counted in; `5568,3712`, the
        reference work's camera, unless given.
    scale
        Instead of a ruler: `"226.63+-0.02 px/in"` in the plane of the muscle's axis.
    k1
        Radial distortion of the lens; unless given, what the ruler's marks show of it.
    tone
        srgb: the camera's style is neutral, its contrast and sharpening off. Unless given, what
        another style may do is in the errors.
    tape_diameter
        Known diameter of the tapes on the fittings, against which the scale is checked.
    tape_hue
        Colour of the tapes, `355deg`; the colour that covers less unless given.
    recipe
        A `recipe.toml`, which the options override.
    braid_angle
        Measure the braid angle from the weave as well: profile, mean, error, turns.
    n_threads
        Threads of both families of the braid; counted in the picture unless given.
    turns
        Of a thread about the axis over the length, for atan(L / (pi N D)) beside the braid angle.
    orientation
        Of the muscle in the pictures.
    """

    ruler: Path | None = None
    distance: str | None = None
    pitch: str | None = None
    expected_px_per_in: float | None = None
    ruler_placement: str | None = None
    crop_offset: str | None = None
    frame_size: str | None = None
    scale: str | None = None
    k1: float | None = None
    tone: Literal["srgb"] | None = None
    tape_diameter: str | None = None
    tape_hue: str | None = None
    recipe: Path | None = None
    braid_angle: bool | None = None
    n_threads: int | None = None
    turns: float | None = None
    orientation: Literal["vertical", "horizontal", "auto"] | None = None
