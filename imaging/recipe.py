"""Recipes: measurement settings, their TOML file, and the quality limits."""

import dataclasses
import math
from pathlib import Path
from typing import Any, Literal

from famjax.boundary.toml_file import Form, to_entries, toml_text

from . import errors
from .camera import Camera, Scale, Tone


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quality:
    """Quality figures of one measurement; nan if not available.

    Attributes:
        eta_value, eta_hue: separability of muscle and cloth and of tape and braid, 0 to 1.
        blur_px: standard deviation of the edge's blur across the outline [px].
        kappa: strength of the limb's root relative to its step, the larger of the two sides [px^-0.5]; 0
            for a plateau, above 2 if the limb is nearly as dark as the cloth.
        axis_deviation: RMS deviation of the mid-line from a straight line, relative to the mean radius.
        axis_kink: largest deviation of the mid-line from a cubic, relative to the mean radius. Rendered
            muscles have at most 0.025; an object that covers a sixth of the radius gives 0.07 or more.
        misfit: misfit of the limb model to the mean edge, relative to the step; raised by halo and
            sharpening.
        flank: excess of the mean edge over the model inside the edge, relative to the step; raised by
            smear.
        rim: brightness of the limb relative to the area inside it, see `EdgeProfile`. Values above 1
            indicate gloss or a lamp behind the muscle.
        outlier_fraction: fraction of rows rejected as outliers.
        residual_rms: RMS residual of the edge about its smooth curve [px].
        tape_sd_px: scatter of the tape edges about straight lines [px].
        tape_blur_px: blur of the tape edges along the axis, the larger of the two [px].
        saturated: saturated fraction of the muscle.
    """

    eta_value: float
    eta_hue: float
    blur_px: float
    kappa: float
    axis_deviation: float
    axis_kink: float
    misfit: float
    flank: float
    rim: float
    outlier_fraction: float
    residual_rms: float
    tape_sd_px: float
    tape_blur_px: float
    saturated: float

    def check(self) -> None:
        """Raise the error assigned to the first figure beyond its limit.

        Raises:
            ImagingError: one of its subclasses.
        """
        across, along = max(self.blur_px, 1.0), max(self.tape_blur_px, 1.0)
        values = vars(self) | {"blur_ratio": max(self.tape_blur_px / across, self.blur_px / along)}
        for name, limit, error, text in _CHECKS:
            value = float(values[name])
            if value < limit if name in _LEAST else value > limit:
                figures: dict[str, Any] = {name: value, "limit": limit}
                raise error(text, **figures)


_LEAST = {"eta_value", "eta_hue"}
"""Figures with a lower limit; all others have an upper limit."""

_SMEARED = (
    "edges must be equally sharp along and across the axis; these are smeared: use a shorter exposure or "
    "hold the muscle still, check the focus, wind straight-edged tapes away from steep shoulders, and "
    "retake the picture"
)
_ALIKE = (
    "the two sides must be smooth and symmetric: check for a damaged picture, one side in shadow, or an "
    "object in front of or next to the muscle"
)
_CHECKS: tuple[tuple[str, float, type[errors.ImagingError], str], ...] = (
    ("saturated", 0.2, errors.Overexposed, "clipped pixels hide the edges: use a shorter exposure"),
    ("eta_value", 0.7, errors.NoMuscle, "muscle and cloth must differ in brightness: use more light or a "
     "darker cloth"),
    ("eta_hue", 0.75, errors.AmbiguousHue, "tape and braid must differ in colour: use tape of another "
     "colour"),
    ("kappa", 5.9, errors.Underexposed, "a limb is as dark as the cloth: light the muscle from both sides. "
     "If both sides were lit, the muscle moved: use a shorter exposure and retake the picture"),
    ("blur_ratio", 1.6, errors.MotionBlurred, _SMEARED),
    ("blur_px", 3.5, errors.Defocused, "the muscle is out of focus: focus on its limb and "
     "retake the picture"),
    ("tape_blur_px", 4.0, errors.MotionBlurred, _SMEARED),
    ("flank", 0.2, errors.MotionBlurred, _SMEARED),
    ("outlier_fraction", 0.2, errors.DamagedImage, _ALIKE),
    ("residual_rms", 1.5, errors.DamagedImage, _ALIKE),
    ("axis_deviation", 0.15, errors.NoMuscle, _ALIKE),
    ("axis_kink", 0.05, errors.DamagedImage, _ALIKE),
    ("misfit", 0.02, errors.DamagedImage, "the mean edge must match the model of a lit body: put a dark "
     "cloth behind the muscle if parts of the background resemble it, and switch off sharpening"),
    ("tape_sd_px", 5.0, errors.AmbiguousHue, "the tape edges must be straight rings: check for a torn or "
     "covered tape"),
)  # fmt: skip
"""Figures of `Quality`, their limits, and the error for a value beyond the limit.

`blur_ratio` is the larger ratio between the tape edges' blur along the axis and the outline's blur across
it. With a lens blur of 1 px, a motion of 4 to 6 px during the exposure reaches its limit; one of 25 px
reaches that of `flank`. Tape edges are a quarter softer than the outline even without motion. With a larger
`kappa` the limb merges with the cloth. `misfit` is at most 0.005 in good pictures and about 0.012 after an
unsharp mask of strength 2.
"""


REFERENCE_DISTANCE = 1.524  # m, 60 in
_RESOLUTION = 0.0093  # m, 83 px at 226.63 px/in: a quarter of the smallest feature of a profile


@dataclasses.dataclass(frozen=True)
class Recipe:
    """Settings for measuring photographs taken with one camera set-up.

    Attributes:
        scale: scale in the mid-plane.
        distance: distance from camera to the muscle's axis [m]; None estimates it from the curvature of
            the tape edges.
        centre: position (u, v) of the optical axis in the picture [px]; None for the middle of the
            frame.
        crop_offset: column and row of the picture's first pixel in the camera frame [px]; None for an
            uncropped picture or a centred crop.
        frame_size: width and height of the uncropped frame [px]; required with `crop_offset` unless
            `centre` is given.
        k1: radial distortion of the lens, see `Camera`; None uses the ruler's estimate, or 0.
        tone: the camera's tone curve; None assumes sRGB and allows for other curves in the errors.
        orientation: orientation of the muscle in the picture; "auto" detects it. A horizontal muscle
            is rotated clockwise by a quarter turn before the measurement.
        tape_diameter: known diameter of the tapes on the fittings [m], used to check the scale.
        braid_angle: also measure the braid angle from the weave; doubles the computing time.

    Raises:
        ImagingError: an unknown option, a value outside its range, or an incomplete crop.
    """

    scale: Scale
    distance: float | None = None
    centre: tuple[float, float] | None = None
    crop_offset: tuple[float, float] | None = None
    frame_size: tuple[int, int] | None = None
    k1: float | None = None
    tone: Tone | None = None
    orientation: Literal["vertical", "horizontal", "auto"] = "vertical"
    tape_diameter: float | None = None
    braid_angle: bool = False

    def __post_init__(self) -> None:
        for name in ("distance", "tape_diameter"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise errors.ImagingError(f"{name} must be finite and > 0, got {value} m")
        if self.orientation not in (known := ("vertical", "horizontal", "auto")):
            raise errors.ImagingError(
                f"orientation must be one of {known}, got {self.orientation!r}"
            )
        if self.crop_offset is not None and self.frame_size is None and self.centre is None:
            raise errors.ImagingError(
                "a crop_offset requires the frame_size of the uncropped frame, or the centre"
            )
        for name in ("centre", "crop_offset"):  # floats, as read back from a recipe file
            place = getattr(self, name)
            object.__setattr__(self, name, place and tuple(map(float, place)))

    def camera(self, width: int, height: int) -> Camera:
        """Return the camera for a picture of this size [px].

        Raises:
            ImagingError: the crop extends beyond the frame.
        """
        centre = (width - 1) / 2, (height - 1) / 2
        if self.centre is not None:
            centre = self.centre
        elif self.crop_offset is not None and self.frame_size is not None:
            (u, v), (frame_width, frame_height) = self.crop_offset, self.frame_size
            if u < 0 or v < 0 or u + width > frame_width or v + height > frame_height:
                raise errors.ImagingError(
                    f"the pictures, {width} x {height} px at crop_offset {self.crop_offset}, must lie "
                    f"within the frame of {frame_width} x {frame_height} px"
                )
            centre = (frame_width - 1) / 2 - u, (frame_height - 1) / 2 - v
        k1 = self.scale.k1 if self.k1 is None else self.k1
        return Camera(self.scale.px_per_m, self.camera_distance, centre, k1)

    @property
    def camera_distance(self) -> float:
        """Stated distance, or 60 in as in the reference work [m]."""
        return REFERENCE_DISTANCE if self.distance is None else self.distance

    @property
    def tone_curve(self) -> Tone:
        """Stated tone curve, or sRGB."""
        return Tone.srgb() if self.tone is None else self.tone

    @property
    def smoothing_px(self) -> float:
        """Resolution along the axis [px]."""
        return max(8.0, _RESOLUTION * self.scale.px_per_m)


_FORM = Form(
    kinds=dict.fromkeys(("distance", "tape_diameter", "pitch", "placement_stderr"), "length"),
    keys={"stderr": "stderr_px_per_m"},
)


def recipe_text(recipe: Recipe) -> str:
    """Return the recipe as TOML, in SI.

    A field that is None is omitted if None is its default, and written as "none" otherwise.
    """
    tone = recipe.tone
    entries = to_entries(dataclasses.replace(recipe, tone=None), _FORM)
    if tone is not None:
        entries["tone"] = "srgb" if tone == Tone.srgb() else tone.table.tolist()
    return toml_text({"format": "famjax recipe 1", **entries})


def write_recipe(recipe: Recipe, path: str | Path) -> Path:
    """Write a recipe to a TOML file."""
    Path(path).write_text(recipe_text(recipe), encoding="utf-8")
    return Path(path)
