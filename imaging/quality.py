"""The figures that say whether a measurement can be trusted, and what they may be."""

import dataclasses
import math
from typing import Any

from .errors import (
    AmbiguousHue,
    DamagedImage,
    Defocused,
    ImagingError,
    MotionBlurred,
    NoMuscle,
    Overexposed,
    Underexposed,
)

_SOFTER = 1.25  # blur of a tape's edge over that of the outline, by the same lens


@dataclasses.dataclass(frozen=True)
class QualityLimits:
    """The worst quality that still is a measurement.

    Attributes:
        eta_value: least separability of muscle and cloth.
        eta_hue: least separability of tape and braid.
        blur_px: largest blur of the outline [px]; that of the tapes' edges, which are softer by
            themselves, may be a quarter larger.
        blur_ratio: largest blur of the tapes' edges along the axis over that of the outline across
            it, or the reverse; a way of 4 px during the exposure reaches it with a lens of 1 px.
        flank: largest excess of the mean edge over the model's, see `EdgeProfile`; a way of 25 px
            during the exposure reaches it.
        outlier_fraction: largest part of stray rows.
        residual_rms: largest scatter of the edge about its smooth curve [px].
        kappa: largest strength of the limb's root [px^-0.5]; the limb of a larger one is lost in
            the cloth.
        axis_deviation: largest deviation of the mid-line from a straight one, over the mean radius.
        axis_kink: the same from a smooth one.
        misfit: largest misfit of the limb model, over the step; sound pictures have 0.005 at most,
            ones sharpened by an unsharp mask of 2 about 0.012.
        tape_sd_px: largest scatter of a tape's edge about a straight one [px].
        saturated: largest saturated part of the muscle.
        tape_hue_deg: largest distance from the recipe's hue [deg].
        scale_contradiction: largest relative difference between the tapes' diameter in the picture
            and the recipe's; a ruler 7.6 mm off the muscle's plane makes 0.005 at 60 in.
    """

    eta_value: float = 0.7
    eta_hue: float = 0.75
    blur_px: float = 3.5
    blur_ratio: float = 1.5
    flank: float = 0.2
    outlier_fraction: float = 0.2
    residual_rms: float = 1.5
    kappa: float = 5.9
    axis_deviation: float = 0.15
    axis_kink: float = 0.05
    misfit: float = 0.02
    tape_sd_px: float = 5.0
    saturated: float = 0.2
    tape_hue_deg: float = 40.0
    scale_contradiction: float = 0.005


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

    def check(self, limits: QualityLimits) -> None:
        """Refuse what is worse than the limits.

        Raises:
            ImagingError: of the class that the first figure beyond its limit calls for.
        """
        ratio = max(
            self.tape_blur_px / max(self.blur_px, 1.0), self.blur_px / max(self.tape_blur_px, 1.0)
        )
        values = vars(self) | {"blur_ratio": ratio}
        allowed = vars(limits) | {
            "tape_hue_error_deg": limits.tape_hue_deg, "tape_blur_px": _SOFTER * limits.blur_px,
        }  # fmt: skip
        for name, error, text in _CHECKS:
            value, limit = float(values[name]), float(allowed[name])
            if value < limit if name in _LEAST else value > limit:
                figures: dict[str, Any] = {name: value, "limit": limit}
                raise error(text, **figures)


_LEAST = {"eta_value", "eta_hue"}
"""Figures that a limit bounds from below; the others are bounded from above."""

_CHECKS: tuple[tuple[str, type[ImagingError], str], ...] = (
    ("saturated", Overexposed,
     "expose shorter: where the light is cut off there is no edge to find"),
    ("eta_value", NoMuscle,
     "muscle and cloth must differ in brightness: give more light, or darker cloth"),
    ("eta_hue", AmbiguousHue,
     "tape and braid must differ in colour: use another tape, or give its hue"),
    ("tape_hue_error_deg", AmbiguousHue,
     "the tapes found have another hue than the recipe's tape"),
    ("blur_ratio", MotionBlurred,
     "edges must be as sharp along the axis as across it; these are smeared in one direction: expose "
     "shorter, or hold the muscle still, and take the picture again"),
    ("blur_px", Defocused, "focus on the muscle's limb, and take the picture again"),
    ("tape_blur_px", MotionBlurred,
     "the tapes' edges must be sharp as well; these are smeared: expose shorter, or hold the muscle "
     "still, check the focus, and take the picture again"),
    ("flank", MotionBlurred,
     "the muscle's edges must rise within the blur of a lens; these go on to rise: expose shorter, or "
     "hold the muscle still, check the focus, and take the picture again"),
    ("outlier_fraction", DamagedImage,
     "too many rows have no edge near the others: is the picture damaged, or something in front "
     "of the muscle?"),
    ("residual_rms", DamagedImage,
     "the outline must be smooth: is the picture damaged, or the muscle's edge covered?"),
    ("kappa", Underexposed,
     "a limb is as dark as the cloth: light the muscle from both sides; if it is lit, it moved: expose "
     "shorter, and take the picture again"),
    ("axis_deviation", NoMuscle,
     "the two sides must mirror each other: is one in the shade, or covered?"),
    ("axis_kink", DamagedImage,
     "the two sides must mirror each other all along: is something in front of one, or beside it?"),
    ("misfit", DamagedImage,
     "the mean edge must look like that of a lit body behind a lens: is another edge behind it, or "
     "does the camera sharpen?"),
    ("tape_sd_px", AmbiguousHue,
     "the tapes' edges must be straight rings: is a tape torn, or covered?"),
)  # fmt: skip
