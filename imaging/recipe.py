"""Recipes: the measurement settings, the TOML file that stores them, and the quality limits."""

import dataclasses
import math
from pathlib import Path
from typing import Any, Literal

from famjax.boundary.toml_file import Form, to_entries, toml_text

from . import errors
from .camera import Camera, Scale, Tone


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quality:
    """Quality figures for one measurement; a figure that is not available is nan.

    Attributes:
        eta_value, eta_hue: separability of muscle from cloth, and of tape from braid, 0 to 1.
        blur_px: standard deviation of the blur across the outline [px].
        kappa: ratio of the square-root term to the step in the limb model (see `find_outline`), the larger
            of the two sides [px^-0.5]. It is 0 if the brightness is constant inside the edge, and above 2
            if the limb is nearly as dark as the cloth.
        axis_deviation: RMS deviation of the mid-line from a straight line, relative to the mean radius.
        axis_kink: largest deviation of the mid-line from a cubic, relative to the mean radius. It is at
            most 0.025 in rendered pictures, and at least 0.07 if an object covers a sixth of the radius.
        misfit: RMS difference between the mean edge and the limb model, relative to the step. Halos and
            sharpening increase it.
        flank: excess brightness of the mean edge over the model just inside the edge, relative to the
            step. Motion blur increases it.
        rim: brightness of the limb divided by that of the area inside it, see `EdgeProfile`. Values above
            1 indicate gloss or a lamp behind the muscle.
        outlier_fraction: fraction of rows rejected as outliers.
        residual_rms: RMS deviation of the edge from its smoothed curve [px].
        tape_sd_px: scatter of the tape edges about straight lines [px].
        tape_blur_px: blur of the tape edges along the axis, the larger of the two [px].
        saturated: fraction of the muscle's pixels that are saturated.
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
        """Check that every figure is within its limit.

        Raises:
            ImagingError: a figure is beyond its limit; the subclass names the cause.
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
    "the edges must be equally sharp along and across the axis, but they are smeared: use a shorter "
    "exposure or hold the muscle still, check the focus, use tapes with straight edges, keep them away "
    "from steep shoulders, and retake the picture"
)
_ALIKE = (
    "the two sides of the muscle must be smooth and symmetric: check for a damaged picture, one side in "
    "shadow, or an object in front of or next to the muscle"
)
_CHECKS: tuple[tuple[str, float, type[errors.ImagingError], str], ...] = (
    ("saturated", 0.2, errors.Overexposed, "saturated pixels hide the edges: use a shorter exposure"),
    ("eta_value", 0.7, errors.NoMuscle, "muscle and cloth must differ in brightness: use more light or a "
     "darker cloth"),
    ("eta_hue", 0.75, errors.AmbiguousHue, "tape and braid must differ in colour: use tape of a different "
     "colour"),
    ("kappa", 5.9, errors.Underexposed, "one edge of the muscle is as dark as the cloth: light both "
     "sides. If both sides were lit, the muscle moved: use a shorter exposure and retake the picture"),
    ("blur_ratio", 1.6, errors.MotionBlurred, _SMEARED),
    ("blur_px", 3.5, errors.Defocused, "the muscle is out of focus: focus on its outline and "
     "retake the picture"),
    ("tape_blur_px", 4.0, errors.MotionBlurred, _SMEARED),
    ("flank", 0.2, errors.MotionBlurred, _SMEARED),
    ("outlier_fraction", 0.2, errors.DamagedImage, _ALIKE),
    ("residual_rms", 1.5, errors.DamagedImage, _ALIKE),
    ("axis_deviation", 0.15, errors.NoMuscle, _ALIKE),
    ("axis_kink", 0.05, errors.DamagedImage, _ALIKE),
    ("misfit", 0.02, errors.DamagedImage, "the mean edge must match the model of a lit body: put a dark "
     "cloth behind the muscle if the background resembles it, and switch off sharpening in the camera"),
    ("tape_sd_px", 5.0, errors.AmbiguousHue, "the edge of each tape must be straight: check for a torn or "
     "covered tape"),
)  # fmt: skip
"""Fields of `Quality`, their limits, and the error raised when a value exceeds its limit.

`blur_ratio` compares the blur of the tape edges along the axis with the blur of the outline across it: the
larger blur divided by the smaller. With a lens blur of 1 px, the limit of `blur_ratio` is reached if the
muscle moves 4 to 6 px during the exposure, and the limit of `flank` if it moves 25 px. Even without motion,
tape edges are a quarter softer than the outline. Above the limit of `kappa`, the limb merges with the
cloth. `misfit` is at most 0.005 in good pictures and about 0.012 after an unsharp mask of strength 2.
"""


REFERENCE_DISTANCE = 1.524  # m, 60 in
_RESOLUTION = 0.0093  # m, 83 px at 226.63 px/in: a quarter of the smallest feature of a profile


@dataclasses.dataclass(frozen=True)
class Recipe:
    """Settings for measuring photographs taken with one camera set-up.

    Attributes:
        scale: scale in the plane of the muscle's axis.
        distance: distance from the camera to the muscle's axis [m]; if None, it is estimated from the
            curvature of the tape edges.
        centre: position (u, v) of the optical axis in the picture [px]; None for the middle of the
            frame.
        crop_offset: column and row of the picture's first pixel in the camera frame [px]; None for an
            uncropped picture or a centred crop.
        frame_size: width and height of the uncropped frame [px]; required with `crop_offset` unless
            `centre` is given.
        k1: radial distortion of the lens, see `Camera`; if None, the estimate from the ruler is used, or 0
            without a ruler.
        tone: the camera's tone curve; if None, sRGB is assumed and the standard errors allow for other
            curves.
        orientation: orientation of the muscle in the picture; "auto" detects it. A picture of a horizontal
            muscle is rotated a quarter turn clockwise before the measurement.
        tape_diameter: known diameter of the tapes on the fittings [m], used to check the scale.
        braid_angle: True to measure the braid angle from the weave as well; this doubles the computing
            time.

    Raises:
        ImagingError: a value is out of range, or the crop is not fully described.
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
                "crop_offset requires frame_size (the size of the uncropped frame) or centre"
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
                    f"within the camera frame of {frame_width} x {frame_height} px"
                )
            centre = (frame_width - 1) / 2 - u, (frame_height - 1) / 2 - v
        k1 = self.scale.k1 if self.k1 is None else self.k1
        return Camera(self.scale.px_per_m, self.camera_distance, centre, k1)

    @property
    def camera_distance(self) -> float:
        """Stated camera distance [m], or 1.524 m (60 in) if none was stated."""
        return REFERENCE_DISTANCE if self.distance is None else self.distance

    @property
    def tone_curve(self) -> Tone:
        """Stated tone curve; sRGB if none was stated."""
        return Tone.srgb() if self.tone is None else self.tone

    @property
    def smoothing_px(self) -> float:
        """Resolution of the smoothing along the axis [px]."""
        return max(8.0, _RESOLUTION * self.scale.px_per_m)


_FORM = Form(
    kinds=dict.fromkeys(("distance", "tape_diameter", "pitch", "placement_stderr"), "length"),
    keys={"stderr": "stderr_px_per_m"},
)


def recipe_text(recipe: Recipe) -> str:
    """Return the recipe as TOML text, in SI units.

    A field that is None is omitted if its default is None, and written as "none" otherwise.
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
