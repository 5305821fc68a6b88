"""The figures that say whether a measurement can be trusted, and what they may be."""

import dataclasses
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


@dataclasses.dataclass(frozen=True)
class Limits:
    """The worst quality that still is a measurement.

    Attributes:
        eta_value: least separability of muscle and cloth.
        eta_hue: least separability of tape and braid.
        blur_px: largest blur of the outline [px].
        blur_ratio: largest blur of the tapes' edges along the axis over that of the outline, which
            a way of 5 px during the exposure reaches with a lens of 0.9 px.
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
    blur_ratio: float = 1.75
    outlier_fraction: float = 0.2
    residual_rms: float = 1.5
    kappa: float = 5.9
    axis_deviation: float = 0.15
    axis_kink: float = 0.05
    misfit: float = 0.02
    tape_sd_px: float = 3.0
    saturated: float = 0.2
    tape_hue_deg: float = 40.0
    scale_contradiction: float = 0.005


@dataclasses.dataclass(frozen=True)
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
        outlier_fraction: part of stray rows.
        residual_rms: scatter of the edge about its smooth curve [px].
        tape_sd_px: scatter of the tapes' edges about straight ones [px].
        tape_blur_px: blur of the tapes' edges along the axis, the larger [px].
        saturated: saturated part of the muscle.
        tape_hue_deg: hue of the tapes [deg].
        tape_hue_error_deg: its distance from the recipe's; 0 where the recipe gives none.
    """

    eta_value: float
    eta_hue: float
    blur_px: float
    kappa: float
    axis_deviation: float
    axis_kink: float
    misfit: float
    outlier_fraction: float
    residual_rms: float
    tape_sd_px: float
    tape_blur_px: float
    saturated: float
    tape_hue_deg: float
    tape_hue_error_deg: float = 0.0

    def failures(self, limits: Limits) -> tuple[ImagingError, ...]:
        """The errors that the limits call for; empty for a good measurement."""
        blurred = self.tape_blur_px / max(self.blur_px, 1.0)
        checks = (
            (self.saturated > limits.saturated, Overexposed, "saturated", limits.saturated,
             "expose shorter: where the light is cut off there is no edge to find"),
            (self.eta_value < limits.eta_value, NoMuscle, "eta_value", limits.eta_value,
             "muscle and cloth must differ in brightness: give more light, or darker cloth"),
            (self.eta_hue < limits.eta_hue, AmbiguousHue, "eta_hue", limits.eta_hue,
             "tape and braid must differ in colour: use another tape, or give its hue"),
            (self.tape_hue_error_deg > limits.tape_hue_deg, AmbiguousHue, "tape_hue_error_deg",
             limits.tape_hue_deg, "the tapes found have another hue than the recipe's tape"),
            (self.blur_px > limits.blur_px, Defocused, "blur_px", limits.blur_px,
             "focus on the muscle's limb, and take the picture again"),
            (blurred > limits.blur_ratio, MotionBlurred, "blur_ratio", limits.blur_ratio,
             "the tapes' edges are smeared along the axis: expose shorter, or move slower"),
            (self.outlier_fraction > limits.outlier_fraction, DamagedImage, "outlier_fraction",
             limits.outlier_fraction, "too many rows have no edge near the others: is the picture "
             "damaged, or something in front of the muscle?"),
            (self.residual_rms > limits.residual_rms, DamagedImage, "residual_rms",
             limits.residual_rms, "the outline must be smooth: is the picture damaged, or the "
             "muscle's edge covered?"),
            (self.kappa > limits.kappa, Underexposed, "kappa", limits.kappa,
             "a limb is as dark as the cloth: light the muscle from both sides"),
            (self.axis_deviation > limits.axis_deviation, NoMuscle, "axis_deviation",
             limits.axis_deviation, "the two sides must mirror each other: is one in the shade, or "
             "covered?"),
            (self.axis_kink > limits.axis_kink, DamagedImage, "axis_kink", limits.axis_kink,
             "the two sides must mirror each other all along: is something in front of one, or "
             "beside it?"),
            (self.misfit > limits.misfit, DamagedImage, "misfit", limits.misfit,
             "the mean edge must look like that of a lit body behind a lens: is another edge behind "
             "it, or does the camera sharpen?"),
            (self.tape_sd_px > limits.tape_sd_px, AmbiguousHue, "tape_sd_px", limits.tape_sd_px,
             "the tapes' edges must be straight rings: is a tape torn, or covered?"),
        )  # fmt: skip
        values = {**dataclasses.asdict(self), "blur_ratio": blurred}
        return tuple(
            error(text, **_figures(name, values[name], limit))
            for failed, error, name, limit, text in checks
            if failed
        )


def _figures(name: str, value: float, limit: float) -> dict[str, Any]:
    return {name: float(value), "limit": float(limit)}
