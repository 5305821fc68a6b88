"""How many pixels a metre takes in the mid-plane, and how well that is known."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..camera.pinhole import apparent_diameter


@dataclasses.dataclass(frozen=True)
class RulerReading:
    """How the photograph of a ruler is to be read, see `calibrate_ruler`.

    Attributes:
        pitch: from mark to mark [m]; None reads it off the numbers.
        expected_px_per_m: the scale to within a quarter [px/m]; None expects that of the only marks.
        placement_stderr: standard error of the ruler's place in depth [m]; None where it is not known.

    Raises:
        ValueError: a figure outside its range.
    """

    pitch: float | None = None
    expected_px_per_m: float | None = None
    placement_stderr: float | None = None

    def __post_init__(self) -> None:
        if self.pitch is not None and not (np.isfinite(self.pitch) and self.pitch > 0):
            raise ValueError(f"pitch must be finite and > 0, got {self.pitch} m")
        expected = self.expected_px_per_m
        if expected is not None and not (np.isfinite(expected) and expected > 0):
            raise ValueError(f"expected_px_per_m must be finite and > 0, got {expected} px/m")
        placed = self.placement_stderr
        if placed is not None and not (np.isfinite(placed) and placed >= 0):
            raise ValueError(f"placement_stderr must be finite and >= 0, got {placed} m")


@dataclasses.dataclass(frozen=True)
class Scale:
    """The scale in the plane of the muscle's axis.

    Attributes:
        px_per_m: [px/m], > 0.
        stderr: its standard error [px/m], >= 0. What the picture of a ruler cannot show, the
            ruler's distance from the muscle's plane, is not in it unless it was given.
        coefficients: (a, b, c) of px(n) = (a + b n) / (1 + c n), n in metres along the ruler, or
            None where the scale is no ruler's.
        tilt_deg: of the ruler in depth [deg].
        residual_px: root mean square of the marks about the fit [px].
        marks: number of marks used.
        source: "ruler", "manual" or "diameter".
        k1: radial distortion of the lens that the ruler's marks show, 0 where they show none.
        k1_stderr: its standard error; None where none was looked for.
        pitch: of the ruler's marks [m]; None without a ruler.
        placement_stderr: the stated standard error of the ruler's place in depth [m]; None where none
            was stated.

    Raises:
        ValueError: a scale that is not positive or a standard error that is negative.
    """

    px_per_m: float
    stderr: float
    coefficients: tuple[float, float, float] | None = None
    tilt_deg: float = 0.0
    residual_px: float = 0.0
    marks: int = 0
    source: str = "manual"
    k1: float = 0.0
    k1_stderr: float | None = None
    pitch: float | None = None
    placement_stderr: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.px_per_m) and self.px_per_m > 0):
            raise ValueError(f"a scale is finite and > 0, got {self.px_per_m} px/m")
        if not (np.isfinite(self.stderr) and self.stderr >= 0):
            raise ValueError(f"the scale's standard error is >= 0, got {self.stderr} px/m")

    @classmethod
    def manual(cls, px_per_m: float, stderr: float = 0.0) -> "Scale":
        """A scale that is known from elsewhere."""
        return cls(float(px_per_m), float(stderr))

    @classmethod
    def from_diameter(
        cls,
        width_px: float,
        diameter: float,
        *,
        distance: float = 1.524,
        width_stderr_px: float = 0.0,
        diameter_stderr: float = 0.0,
    ) -> "Scale":
        """The scale at which a cylinder of known diameter has the width that is seen.

        px_per_m = w / D_app, with the apparent diameter of `apparent_diameter`: the camera sees
        the tangent lines, not the diameter.

        Args:
            width_px: w between the edges of the cylinder, upright and near the optical axis [px].
            diameter: D [m].
            distance: camera to the axis [m].
            width_stderr_px: standard error of w [px].
            diameter_stderr: standard error of D [m].
        """
        if not (width_px > 0 and diameter > 0):
            raise ValueError(f"width and diameter must be > 0, got {width_px} px and {diameter} m")
        px_per_m = width_px / float(apparent_diameter(diameter, distance))
        relative = np.hypot(width_stderr_px / width_px, diameter_stderr / diameter)
        return cls(px_per_m, float(px_per_m * relative), source="diameter")

    @property
    def relative_stderr(self) -> float:
        """Standard error over the scale."""
        return self.stderr / self.px_per_m

    def at(self, position: ArrayLike) -> Array:
        """Local scale of the ruler [px/m] at positions along it [px]; a constant without a ruler.

        d px / d n of the projective fit, (b - a c) / (1 + c n)^2 at n = (px - a) / (b - c px).
        """
        px = np.asarray(position, float)
        if self.coefficients is None:
            return np.full(px.shape, self.px_per_m)
        a, b, c = self.coefficients
        n = (px - a) / (b - c * px)
        return np.abs(b - a * c) / (1 + c * n) ** 2
