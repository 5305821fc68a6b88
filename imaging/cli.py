"""`famjax measure`, and its options.

What a test machine's log says of each picture is added by what mounts the command, as logs are none of
this package's.
"""

import dataclasses
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.units import factor, parse_quantity
from famjax.console import (
    Columns,
    Jobs,
    Signed,
    Units,
    parse_columns,
    print_json,
    print_rows,
    progress,
)

from .errors import ImagingError

if TYPE_CHECKING:
    from .campaign import Table
    from .recipe import Recipe

AddLog = Callable[["Table"], "Table"]
"""Adds columns of a test machine's log to a table."""

_SHOWN = 20  # pictures on the console
_PRINTED = re.compile(r"path|error|(length|mean_diameter|distance)(_stderr)?_(in|mm|m)")


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class RecipeOptions:
    """Recipe entries from the options; None if not given.

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
        Width and height of the camera's frame, which a crop offset is counted in, `5568,3712`.
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
    k1: Annotated[float | None, Signed] = None
    tone: Literal["srgb"] | None = None
    tape_diameter: str | None = None
    tape_hue: str | None = None
    recipe: Path | None = None
    braid_angle: bool | None = None
    orientation: Literal["vertical", "horizontal", "auto"] | None = None


_UNSAID = RecipeOptions()


def measure(
    *photos: str,
    how: RecipeOptions = _UNSAID,
    log: Path | None = None,
    log_offset: Annotated[str | None, Signed] = None,
    column: Columns = (),
    rest_length: str | None = None,
    diameter: str | None = None,
    jobs: Jobs = None,
    units: Units = "metric",
    output: Path = Path("famjax-measure"),
    overlays: int = 12,
    rescaled: bool = False,
    json_: bool = False,
    read_log: Annotated[Callable[..., Any] | None, Parameter(parse=False)] = None,
) -> int:
    """Measure the shape of a muscle in photographs, each picture with its errors.

    Writes `measurements.csv` (one row per picture), `measurements.nc` (with the profiles),
    `recipe.toml` (all choices) and `overlays/`. A stopped campaign goes on when it is run again. Exit
    code 3 when some pictures could not be measured, or not be matched to the log: they are in the table
    with the reason.

    Parameters
    ----------
    photos
        Files, folders and patterns such as `'stroke/*.jpg'`, all pictures of one size.
    how
        How to measure.
    log
        Of the test machine, CSV with columns such as `time_s,displacement_in,force_lbf,
        pressure_psi`: each picture gets force and pressure; the clocks are matched by the motion.
    log_offset
        What the machine's clock is ahead of the first picture, `12s`, within 10 s; needed where the
        motion repeats itself.
    column
        Which column of the log is which where the names do not say it, `force="Kraft [N]"`, by name or
        number, with the unit, repeatable; `pressure=-` leaves one aside. Also `decimal=,` and, of absolute
        pressures, `atmosphere=101.3kPa`.
    rest_length
        Against which contraction is counted, `9.28in`; the longest measured picture unless given. A scale
        with which no picture could show that muscle is refused.
    diameter
        Nominal diameter of the braid at rest, `0.875in`, against which the scale is checked.
    jobs
        Number of processes; unless given one for each core, where that saves time.
    units
        Of CSV, plots and output: us (in, lbf, psi), metric (mm, N, kPa) or si.
    output
        Folder for the files, created if missing.
    overlays
        Number of pictures drawn with what was found in them, for a check by eye.
    rescaled
        The ruler's picture has another size than the others on purpose: its scale is taken as it is.
    json_
        Print one JSON object to standard output and nothing else there.
    read_log
        Reads the log by its path, `offset` and `columns`; returns an `AddLog`.
    """
    # Idle threads of OpenBLAS spin, and its matrices here are small; NumPy reads this when it loads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from .pictures import as_document, expand, measure_pictures
    from .recipe import recipe_text

    try:
        with progress("measuring") as show:
            expand(photos)  # a picture that is not there is said before what its recipe lacks
            recipe, provenance = command_recipe(how)
            add_log = None
            if log is not None and read_log is not None:
                add_log = read_log(
                    log, offset=None if log_offset is None else parse_quantity(log_offset, "time"),
                    columns=parse_columns(column),
                )  # fmt: skip
            rest, nominal = (
                None if one is None else parse_quantity(one, "length")
                for one in (rest_length, diameter)
            )
            outcome = measure_pictures(
                photos, recipe=recipe, provenance=provenance, add_log=add_log, rest_length=rest,
                executor="auto" if jobs is None else jobs, system=units, output=output,
                overlays=overlays, rescaled=rescaled, diameter=nominal, progress=show,
            )  # fmt: skip
    except (InputError, OSError) as error:
        # What a picture was refused for has a name, which the documentation explains.
        named = type(error) not in (InputError, ImagingError)
        print(f"famjax: {type(error).__name__ + ': ' if named else ''}{error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(
            f"famjax: stopped; what was measured is kept in {output}. Run the same command again to go on",
            file=sys.stderr,
        )
        return 130
    document = as_document(outcome, units)
    if json_:
        print_json(document)
    else:
        print(recipe_text(recipe))
        _print(document)
    return 0 if outcome.complete else 3


def _print(document: dict[str, Any]) -> None:
    """Figures of the first pictures with their standard errors, reasons, notes and files."""
    shown = document["rows"][:_SHOWN]
    keys = [key for key in shown[0] if _PRINTED.fullmatch(key)]
    print_rows(
        f"{len(shown)} of {document['pictures']}", [{k: row[k] for k in keys} for row in shown]
    )
    print(f"{document['ok']} of {document['pictures']} pictures measured")
    for note in document["notes"]:
        print(f"note: {note}")
    print("written:", ", ".join(document["files"]))


def command_recipe(options: RecipeOptions) -> tuple["Recipe", dict[str, str]]:
    """The recipe from the options, and the origin of its entries for the table.

    Args:
        options: which override those of a recipe's file. A `scale` is `226.63 px/in` or
            `226.63+-0.02 px/in`; lengths have their unit.

    Raises:
        ImagingError: no scale or two, or an option that cannot be read.
    """
    from .camera import Tone
    from .pictures import picture_recipe

    lengths = {"pitch": options.pitch, "placement_stderr": options.ruler_placement}
    reading: dict[str, Any] = {
        name: parse_quantity(text, "length") for name, text in lengths.items() if text is not None
    }
    if options.expected_px_per_in is not None:
        reading["expected_px_per_m"] = options.expected_px_per_in * factor("px/in", "scale")
    readers: dict[str, Callable[[Any, str], Any]] = {
        **dict.fromkeys(
            ("distance", "tape_diameter"), lambda text, _: parse_quantity(text, "length")
        ),
        "crop_offset": lambda text, name: _numbers(text, name, "1459,531"),
        "frame_size": lambda text, name: _numbers(text, name, "5568,3712", int),
        "tape_hue": lambda text, name: _numbers(text.removesuffix("deg"), name, "355deg")[0],
        "tone": lambda _text, _: Tone.srgb(),
        **dict.fromkeys(("k1", "braid_angle", "orientation"), lambda given, _: given),
    }
    choices = {
        name: read(given, name.replace("_", " "))
        for name, read in readers.items()
        if (given := getattr(options, name)) is not None
    }
    return picture_recipe(
        ruler=options.ruler, recipe=options.recipe, scale=options.scale, reading=reading,
        choices=choices,
    )  # fmt: skip


def _numbers(
    text: str, name: str, such_as: str, kind: Callable[[str], float] = float
) -> tuple[float, ...]:
    try:
        found = tuple(map(kind, text.split(",")))
    except ValueError:
        found = ()
    if len(found) != such_as.count(",") + 1:
        many = "two numbers in px" if "," in such_as else "an angle"
        raise ImagingError(f"the {name} is {many}, {such_as}, got {text!r}")
    return found
