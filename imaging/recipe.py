"""The recipe: all choices from a photograph to figures, with its TOML file and limits of quality."""

import dataclasses
import functools
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np

from famjax.boundary.toml_file import Form, from_entries, read_toml, to_entries, toml_text

from . import errors
from .camera import Camera, Scale, Tone


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quality:
    """Quality figures of one measurement; nan where the method has none.

    Attributes:
        eta_value, eta_hue: separability of muscle and cloth, of tape and braid, 0 to 1.
        blur_px: standard deviation of the spread of light across the outline [px].
        kappa: strength of the limb's root against its step, the larger of both sides [px^-0.5]; 0
            for a plateau, above 2 where the limb is nearly as dark as the cloth.
        axis_deviation: root mean square of the mid-line about a straight one, over the mean radius.
        axis_kink: largest deviation of the mid-line from a smooth one, over the mean radius.
        misfit: of the limb model to the mean edge, over the step; halo and sharpening leave one.
        flank: excess of the mean edge over the model inside of it, over the step; a smeared edge has one.
        rim: brightness of the limb over that of what lies inside of it, see `EdgeProfile`; more than 1
            is gloss, or a lamp behind the muscle.
        outlier_fraction: part of stray rows.
        residual_rms: scatter of the edge about its smooth curve [px].
        tape_sd_px: scatter of the tapes' edges about straight ones [px].
        tape_blur_px: blur of the tapes' edges along the axis, the larger [px].
        saturated: saturated part of the muscle.
        tape_hue_deg: hue of the tapes [deg].
        tape_hue_error_deg: its distance from the recipe's, by itself or beside the braid as white,
            whichever is smaller; 0 where the recipe gives none.
    """

    eta_value: float
    eta_hue: float
    blur_px: float = math.nan
    kappa: float = math.nan
    axis_deviation: float = math.nan
    axis_kink: float = math.nan
    misfit: float = math.nan
    flank: float = math.nan
    rim: float = math.nan
    outlier_fraction: float = math.nan
    residual_rms: float = math.nan
    tape_sd_px: float = math.nan
    tape_blur_px: float = math.nan
    saturated: float
    tape_hue_deg: float
    tape_hue_error_deg: float = 0.0

    def check(self) -> None:
        """Refuse quality worse than the limits of `_CHECKS`.

        Raises:
            ImagingError: of the class that the first figure beyond its limit calls for.
        """
        across, along = max(self.blur_px, 1.0), max(self.tape_blur_px, 1.0)
        values = vars(self) | {"blur_ratio": max(self.tape_blur_px / across, self.blur_px / along)}
        for name, limit, error, text in _CHECKS:
            value = float(values[name])
            if value < limit if name in _LEAST else value > limit:
                figures: dict[str, Any] = {name: value, "limit": limit}
                raise error(text, **figures)


_LEAST = {"eta_value", "eta_hue"}
"""Figures that a limit bounds from below; the others are bounded from above."""

_SMEARED = (
    "edges must be as sharp as the lens makes them, along the axis as across it; these are smeared: expose "
    "shorter, or hold the muscle still, check the focus, wind tapes with a straight edge further in than a "
    "steep shoulder, and take the picture again"
)
_ALIKE = (
    "the two sides must be smooth and mirror each other: is the picture damaged, one side in the shade, "
    "or something in front of the muscle or beside it?"
)
_CHECKS: tuple[tuple[str, float, type[errors.ImagingError], str], ...] = (
    ("saturated", 0.2, errors.Overexposed, "expose shorter: where light is cut off there is no edge"),
    ("eta_value", 0.7, errors.NoMuscle, "muscle and cloth must differ in brightness: give more light, or "
     "darker cloth"),
    ("eta_hue", 0.75, errors.AmbiguousHue, "tape and braid must differ in colour: use another tape, or "
     "give its hue"),
    ("tape_hue_error_deg", 40.0, errors.AmbiguousHue, "the tapes found have another hue than the recipe's"),
    ("kappa", 5.9, errors.Underexposed, "a limb is as dark as the cloth: light the muscle from both sides; "
     "if it is lit, it moved: expose shorter, and take the picture again"),
    ("blur_ratio", 1.6, errors.MotionBlurred, _SMEARED),
    ("blur_px", 3.5, errors.Defocused, "focus on the muscle's limb, and take the picture again"),
    ("tape_blur_px", 1.25 * 3.5, errors.MotionBlurred, _SMEARED),
    ("flank", 0.2, errors.MotionBlurred, _SMEARED),
    ("outlier_fraction", 0.2, errors.DamagedImage, _ALIKE),
    ("residual_rms", 1.5, errors.DamagedImage, _ALIKE),
    ("axis_deviation", 0.15, errors.NoMuscle, _ALIKE),
    ("axis_kink", 0.05, errors.DamagedImage, _ALIKE),
    ("misfit", 0.02, errors.DamagedImage, "the mean edge must look like that of a lit body behind a lens: "
     "is its background like it in places? put a dark cloth behind it; or does the camera sharpen?"),
    ("tape_sd_px", 5.0, errors.AmbiguousHue, "the tapes' edges must be straight rings: is a tape torn, or "
     "covered?"),
)  # fmt: skip
"""Figures of `Quality`, the worst that is still accepted, and what a worse one is refused for.

`blur_ratio` is the blur of the tapes' edges along the axis over that of the outline across it, or the
reverse: a way of 4 px during the exposure reaches it with a lens of 1 px. The tapes' edges are softer by
themselves, by a quarter. A way of 25 px reaches the limit of `flank`. The limb of a larger `kappa` is lost
in the cloth. Sound pictures have a `misfit` of 0.005 at most, ones sharpened by an unsharp mask of 2 about
0.012.
"""


REFERENCE_DISTANCE = 1.524  # m, 60 in
_RESOLUTION = 0.0093  # m, 83 px at 226.63 px/in: a quarter of the smallest feature of a profile


@dataclasses.dataclass(frozen=True)
class Recipe:
    """Options for measuring the photographs of one camera set-up.

    Attributes:
        scale: in the mid-plane.
        distance: camera to the muscle's axis [m]; None takes that of which the tapes' edges are arcs.
        centre: where the optical axis meets the picture (u, v) [px]; None takes the middle of the
            frame, and with it of a picture that is not a crop.
        crop_offset: column and row in the frame of the picture's first pixel [px]; None for an
            uncropped picture, or a crop about the middle of the frame.
        frame_size: width and height of the frame that was cropped [px]; needed with `crop_offset`
            unless `centre` is given.
        k1: radial distortion of the lens, as in `Camera`; None takes what the ruler shows, or 0.
        tone: the camera's tone curve; None takes sRGB, with what another may do in the errors.
        orientation: of the muscle in the picture; "auto" turns it where needed. A horizontal
            one is turned a quarter turn clockwise before it is measured.
        tape_hue: of the tapes [deg]; None finds it.
        tape_diameter: known diameter of the tapes on the fittings [m]; the scale is checked against it.
        braid_angle: measure it from the weave as well, which takes as long again.

    Raises:
        ImagingError: an option that is not known, a figure outside its range, or half of a crop.
    """

    scale: Scale
    distance: float | None = None
    centre: tuple[float, float] | None = None
    crop_offset: tuple[float, float] | None = None
    frame_size: tuple[int, int] | None = None
    k1: float | None = None
    tone: Tone | None = None
    orientation: Literal["vertical", "horizontal", "auto"] = "vertical"
    tape_hue: float | None = None
    tape_diameter: float | None = None
    braid_angle: bool = False

    def __post_init__(self) -> None:
        for name in ("distance", "tape_diameter"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise errors.ImagingError(f"{name} must be finite and > 0, got {value} m")
        if self.tape_hue is not None and not 0 <= self.tape_hue <= 360:
            raise errors.ImagingError(f"tape_hue must be 0 to 360 deg, got {self.tape_hue}")
        if self.orientation not in (known := ("vertical", "horizontal", "auto")):
            raise errors.ImagingError(f"orientation is one of {known}, got {self.orientation!r}")
        if self.crop_offset is not None and self.frame_size is None and self.centre is None:
            raise errors.ImagingError(
                "a crop_offset needs the frame_size that was cropped, or the centre"
            )
        for name in ("centre", "crop_offset"):  # floats, as a recipe's file gives them back
            place = getattr(self, name)
            object.__setattr__(self, name, place and tuple(map(float, place)))

    def camera(self, width: int, height: int) -> Camera:
        """The camera for a picture of this size [px].

        Raises:
            ImagingError: the crop does not lie in the frame.
        """
        centre = (width - 1) / 2, (height - 1) / 2
        if self.centre is not None:
            centre = self.centre
        elif self.crop_offset is not None and self.frame_size is not None:
            (u, v), (frame_width, frame_height) = self.crop_offset, self.frame_size
            if u < 0 or v < 0 or u + width > frame_width or v + height > frame_height:
                raise errors.ImagingError(
                    f"the pictures, {width} x {height} px at crop_offset {self.crop_offset}, must lie "
                    f"in the frame of {frame_width} x {frame_height} px"
                )
            centre = (frame_width - 1) / 2 - u, (frame_height - 1) / 2 - v
        k1 = self.scale.k1 if self.k1 is None else self.k1
        return Camera(self.scale.px_per_m, self.camera_distance, centre, k1)

    @property
    def camera_distance(self) -> float:
        """The stated distance, or the reference work's 60 in [m]."""
        return REFERENCE_DISTANCE if self.distance is None else self.distance

    @property
    def tone_curve(self) -> Tone:
        """The stated tone curve, or sRGB."""
        return Tone.srgb() if self.tone is None else self.tone

    @property
    def smoothing_px(self) -> float:
        """Resolution along the axis [px]."""
        return max(8.0, _RESOLUTION * self.scale.px_per_m)


_FORMAT = "famjax recipe 1"


_FORM = Form(
    kinds=dict.fromkeys(("distance", "tape_diameter", "pitch", "placement_stderr"), "length"),
    keys={"tape_hue": "tape_hue_deg", "stderr": "stderr_px_per_m"},
    codecs={
        Tone: (
            lambda tone: "srgb" if tone == Tone.srgb() else tone.table.tolist(),
            lambda entry: Tone.srgb() if entry == "srgb" else Tone(np.array(entry, float)),
        )
    },
)


def recipe_text(recipe: Recipe) -> str:
    """All choices of a recipe in SI, as TOML.

    A field that is None is left out if that is its default, and "none" if it is not.
    """
    return toml_text({"format": _FORMAT, **to_entries(recipe, _FORM)})


def write_recipe(recipe: Recipe, path: str | Path) -> Path:
    """Write a recipe that `read_recipe` reads back to the same bits."""
    Path(path).write_text(recipe_text(recipe), encoding="utf-8")
    return Path(path)


def read_recipe(path: str | Path) -> Recipe:
    """The recipe in a TOML file; lengths may have any known unit, `distance_in = 60`.

    Raises:
        ImagingError: no such file, not TOML, an unknown key, unit or format, a missing scale, or a value
            that cannot be.
    """
    error = functools.partial(errors.ImagingError, path=path)
    given = dict(read_toml(path, "recipe", error, where=""))
    if (found := given.pop("format", _FORMAT)) != _FORMAT:
        raise error(f"a recipe has the format {_FORMAT!r}, got {found!r}")
    return from_entries(Recipe, given, _FORM, error=error)
