"""What stands before the camera: a muscle of known shape with its tapes, and a ruler beside it."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from famjax.boundary.units import factor

INCH = factor("in", "length")
TAN = (0.72, 0.58, 0.33)  # aramid thread, linear RGB
BLUE_HUE = 222.0  # [deg]

Profile = Callable[[NDArray[np.float64]], ArrayLike]


@dataclasses.dataclass(frozen=True)
class Tape:
    """A coloured tape around one fitting.

    Attributes:
        hue: [deg], of the encoded colour; 0 and 360 are red.
        saturation: of the encoded colour [-]; 0 is grey tape.
        value: of the encoded colour [-], its reflectance.
        width: along the axis [m].
        diameter: [m]; None takes the braid's diameter at its end.
    """

    hue: float = BLUE_HUE
    saturation: float = 0.85
    value: float = 0.62
    width: float = 0.5 * INCH
    diameter: float | None = None

    def __post_init__(self) -> None:
        colour = 0 <= self.saturation <= 1 and 0 <= self.value <= 1
        size = self.width > 0 and (self.diameter is None or self.diameter > 0)
        if not (colour and size):
            raise ValueError(
                "a tape has saturation and value in [0, 1], a width > 0 and a diameter > 0 or "
                f"None; got {self}"
            )


@dataclasses.dataclass(frozen=True)
class MuscleScene:
    """A muscle: a body of revolution of woven thread between two taped fittings.

    Attributes:
        profile: D(x) [m], a function of x = z/L in [0, 1], upper tape's edge to lower; or a pair of
            arrays (x, D), joined by a cubic spline.
        length: L, between the inner edges of the tapes along the axis [m].
        x0: distance of the axis from the optical axis, positive to the right [m].
        y0: middle of the braid along the axis, from the foot of the optical axis, downwards [m].
        roll: turn of the axis in the picture [rad], positive clockwise.
        bow: largest deviation of the axis from the straight line between its ends [m] to the right
            (half a sine wave); `bow_depth` the same, away from the camera.
        strands: strands of each of the two helix families, a multiple of 4.
        turns: turns of a strand about the axis over the length [-].
        albedo: reflectance of the threads, linear RGB.
        albedo_spread: standard deviation of the reflectance from strand to strand, relative [-].
        flecks: part of the crossings that are of black thread [-].
        relief: height of a yarn's crest over the valley beside it [m]. The profile is that of the
            mean outline: between the crests that a calliper touches and the valleys.
        sheen: part of the light that fabric adds at grazing sight, sheen (1 - n_z)^3 [-].
        sparkle: part of the crossings that shine three times as bright [-].
        weave_seed: seed of the strands' reflectances, flecks and sparkles.
        upper, lower: the tapes; None leaves the fitting bare.
        third: a tape that should not be there, with the position x of its middle; a tape without
            a diameter lies close around the braid, or around the rod where x is outside of [0, 1].
        rod_diameter: the black rods that hold the muscle [m].

    Raises:
        ValueError: a length that is not positive, strands that do not weave.
    """

    profile: Profile | tuple[ArrayLike, ArrayLike]
    length: float
    x0: float = 0.0
    y0: float = 0.0
    roll: float = 0.0
    bow: float = 0.0
    bow_depth: float = 0.0
    strands: int = 36
    turns: float = 1.09
    albedo: tuple[float, float, float] = TAN
    albedo_spread: float = 0.12
    flecks: float = 0.0
    relief: float = 0.002 * INCH
    sheen: float = 0.0
    sparkle: float = 0.04
    weave_seed: int = 0
    upper: Tape | None = dataclasses.field(default_factory=Tape)
    lower: Tape | None = dataclasses.field(default_factory=Tape)
    third: tuple[Tape, float] | None = None
    rod_diameter: float = 0.5 * INCH

    def __post_init__(self) -> None:
        if not self.length > 0 or self.strands < 4 or self.strands % 4:
            raise ValueError(
                "a braid has a length > 0 and a multiple of 4 strands in each direction; got "
                f"length = {self.length} m, strands = {self.strands}"
            )

    def diameter(self, x: ArrayLike) -> NDArray[np.float64]:
        """Diameter D [m] at x = z/L [-], that of the nearer end outside of [0, 1].

        Raises:
            ValueError: a profile that is not positive and finite.
        """
        from scipy.interpolate import CubicSpline  # noqa: PLC0415 - keeps the import cheap

        x = np.clip(np.asarray(x, float), 0, 1)
        profile = self.profile if callable(self.profile) else CubicSpline(*self.profile)
        D = np.asarray(profile(x), float) + np.zeros_like(x)
        if not np.all(D > 0):
            worst = int(np.argmin(D))
            raise ValueError(
                f"a profile is positive; it is {D.flat[worst]:.4g} m at x = {x.flat[worst]:.3f}"
            )
        return D
