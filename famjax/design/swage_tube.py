"""Swage tubes: buckling when pushed through the die, and what those of a catalogue bear."""

import dataclasses
import math
from collections.abc import Iterable

import equinox as eqx
import jax.numpy as jnp

from .. import units
from .._types import Real, RealArray, as_real
from .catalogue import Catalogue, CatalogueError, CatalogueTube


def tube_second_moment(outer_diameter: Real, thickness: Real) -> RealArray:
    """Second moment of area I [m4] of a tube, pi/8 t (D - t) (D^2 - 2 D t + 2 t^2).

    The same as pi/64 (D^4 - d^4), without its cancellation in a thin wall.

    Args:
        outer_diameter: D [m].
        thickness: wall t [m], 0 < t <= D / 2.

    Returns:
        I [m4], broadcast shape.
    """
    D, t = as_real(outer_diameter), as_real(thickness)
    return jnp.pi / 8 * t * (D - t) * (D**2 - 2 * D * t + 2 * t**2)


def euler_load(
    modulus: Real, second_moment: Real, length: Real, end_factor: Real = 1.0
) -> RealArray:
    """Euler's buckling load [N] of a straight elastic column, pi^2 E I / (K L)^2.

    Yielding is neglected, and in a short column comes first: compare the load over the section with
    the yield strength.

    Args:
        modulus: E [Pa], of the column's material.
        second_moment: I [m4].
        length: L [m], free to bend.
        end_factor: K [-]; 1 for two pinned ends, 0.5 for two clamped ones, 2 for one end free.

    Returns:
        Load [N], broadcast shape.

    References:
        Euler 1744; Timoshenko & Gere 1961, Theory of Elastic Stability, chapter 2.
    """
    return jnp.asarray(jnp.pi**2 * modulus * second_moment / as_real(end_factor * length) ** 2)


def yield_load(yield_stress: Real, outer_diameter: Real, thickness: Real) -> RealArray:
    """Load [N] at which a straight tube yields over its section, pi t (D - t) sigma_y.

    Buckling is neglected: the tube bears the smaller of this and `euler_load`, and in between, where
    the two are alike, somewhat less than either.

    Args:
        yield_stress: sigma_y [Pa], of the tube's material.
        outer_diameter: D [m].
        thickness: wall t [m], 0 < t <= D / 2.

    Returns:
        Load [N], broadcast shape.
    """
    return jnp.asarray(jnp.pi * thickness * (as_real(outer_diameter) - thickness) * yield_stress)


class TubeBuckling(eqx.Module):
    """Buckling of a swage tube pushed through the die.

    Attributes:
        unsupported_load: Euler's load [N] of the bare tube.
        supported_load: Euler's load [N] of what the support leaves free.
        gain: supported over unsupported load [-].
        supported_stress: supported load over the tube's section [Pa]. Above the yield strength the
            tube is crushed before it buckles, and Euler's load says nothing.
    """

    unsupported_load: RealArray
    supported_load: RealArray
    gain: RealArray
    supported_stress: RealArray


def tube_buckling(
    *,
    modulus: Real,
    outer_diameter: Real,
    thickness: Real,
    length: Real,
    supported_length: Real,
    end_factor: Real = 1.0,
) -> TubeBuckling:
    """Buckling of the swage tube with and without a support that shortens its free length.

    The support is taken as rigid and its end as the same kind of end as before, so that the gain
    is (L / L')^2: 2.81 for the reference work's tube, 3.10 in long, of which its support leaves
    1.85 in free. That is what a support can do at most; one that only stiffens the tube gains
    1.14 (`stepped_column_gain`). The work says that it "approximately doubles" the load.

    Check `supported_stress`: the reference work's tube, of a metal with E = 10e6 psi and 1.85 in
    free between pins, would need 3.2e6 psi to buckle. It yields long before.

    Args:
        modulus: Young's modulus E [Pa] of the tube; of the catalogue row, or a handbook's.
        outer_diameter: D [m].
        thickness: wall t [m].
        length: L [m], free length without the support.
        supported_length: L' [m], free length with it, <= L.
        end_factor: K [-]; see `euler_load`.

    Returns:
        Loads [N], gain [-] and stress [Pa], each of the broadcast shape.

    References:
        Chambers 2021, chapter 2.
    """
    second_moment = tube_second_moment(outer_diameter, thickness)
    unsupported = euler_load(modulus, second_moment, length, end_factor)
    supported = euler_load(modulus, second_moment, supported_length, end_factor)
    section = yield_load(1.0, outer_diameter, thickness)
    return TubeBuckling(unsupported, supported, supported / unsupported, supported / section)


def stepped_column_gain(inserted: float, stiffening: float) -> float:
    """Euler's load of a column that is stiffer at one end, over that of the plain one; both pinned.

    The least root of alpha cot(alpha a) + beta cot(beta b) = 0, where b = `inserted`, a = 1 - b,
    alpha = pi sqrt(gain) and beta = alpha / sqrt(stiffening).

    Args:
        inserted: part of the length over which the support is inserted [-], in (0, 1).
        stiffening: second moment of area there over the plain one [-], >= 1.

    Returns:
        Gain [-], from 1 to `stiffening`.

    References:
        Timoshenko & Gere 1961, Theory of Elastic Stability, article 2.14.

    >>> print(f"{stepped_column_gain(1.25 / 3.10, 1.756):.2f}")  # the reference work's tube
    1.14
    """
    low, high = 1.0, stiffening  # the restraint falls from low to high
    while low < (middle := (low + high) / 2) < high:
        low, high = (
            (middle, high) if _restraint(middle, inserted, stiffening) > 0 else (low, middle)
        )
    return high


def support_stiffness(gain: float, inserted: float, stiffening: float) -> float:
    """Stiffness against sideways motion of the support's inner end that multiplies Euler's load.

    The column of `stepped_column_gain`, held where the support ends by a spring k:

        k = P g / (a b g - 1),  g = alpha cot(alpha a) + beta cot(beta b)

    in units of the length and of the plain column's load, with P the gain.

    Args:
        gain: load over that of the plain column [-], above `stepped_column_gain` and below that of
            the weaker part alone between pins, 1 / a^2 or `stiffening` / b^2.
        inserted: part of the length over which the support is inserted [-], in (0, 1).
        stiffening: second moment of area there over the plain one [-], >= 1.

    Returns:
        k L / P_Euler [-]; P_Euler and L are of the plain column.

    Raises:
        ValueError: no spring gives that gain.

    >>> print(f"{support_stiffness(2.0, 1.25 / 3.10, 1.756):.2f}")
    5.37
    """
    g = _restraint(gain, inserted, stiffening)
    most = min(1 / (1 - inserted) ** 2, stiffening / inserted**2)
    if not (g < 0 and 1 < gain < most):
        least = stepped_column_gain(inserted, stiffening)
        raise ValueError(
            f"the gain of a support that yields sideways must be in ({least:.4g}, {most:.4g}), "
            f"got {gain:.4g}"
        )
    return gain * g / ((1 - inserted) * inserted * g - 1)


def _restraint(gain: float, inserted: float, stiffening: float) -> float:
    """The sum g of `support_stiffness`: negative where the plain joint alone does not hold."""
    alpha = math.pi * math.sqrt(gain)
    beta = alpha / math.sqrt(stiffening)
    return alpha / math.tan(alpha * (1 - inserted)) + beta / math.tan(beta * inserted)


ASSUMED: dict[str, tuple[float, str]] = {
    "modulus": (68.9e9, "68.9 GPa, of aluminium 6061-T6 (Aluminum Association, typical)"),
    "yield_stress": (276e6, "276 MPa, of aluminium 6061-T6 (Aluminum Association, typical)"),
    "supported_length": (1.85 * units.INCH, "1.85 in, left free by the reference work's support"),
    "free_length": (
        3.10 / 1.85,
        "3.10 / 1.85 times the supported one, as in the reference work",
    ),
}
"""What is taken, in SI, where neither the catalogue nor the user says: a value and what it is.

The free length is a multiple of the supported one. The reference work does not print the metal.
"""


@dataclasses.dataclass(frozen=True)
class TubeOptions:
    """What the user says of the swage tubes, before the catalogue; None: nothing.

    Attributes:
        modulus: Young's modulus [Pa].
        yield_stress: [Pa].
        free_length: [m], free to bend without a support.
        supported_length: [m], free to bend with it.
    """

    modulus: float | None = None
    yield_stress: float | None = None
    free_length: float | None = None
    supported_length: float | None = None


@dataclasses.dataclass(frozen=True)
class TubeStrength:
    """What a swage tube bears between pinned ends, unswaged.

    Attributes:
        tube: row of the catalogue.
        modulus: Young's modulus [Pa].
        yield_stress: [Pa].
        free_length: [m], without support.
        supported_length: [m], with it.
        unsupported_load: Euler's load [N] without support.
        supported_load: Euler's load [N] with it.
        yield_load: [N], at which the section yields.
        assumed: which of the first four numbers are from `ASSUMED`.
    """

    tube: CatalogueTube
    modulus: float
    yield_stress: float
    free_length: float
    supported_length: float
    unsupported_load: float
    supported_load: float
    yield_load: float
    assumed: tuple[str, ...]

    @property
    def gain(self) -> float:
        """Euler's load with the support over that without [-]."""
        return self.supported_load / self.unsupported_load

    @property
    def yields_first(self) -> bool:
        """Whether the bare tube is crushed before it buckles, so that a support gains nothing."""
        return self.yield_load < self.unsupported_load


def tube_strengths(catalogue: Catalogue, options: TubeOptions | None = None) -> list[TubeStrength]:
    """Buckling and yield load of every swage tube of the catalogue.

    A number is taken from the options, else from the catalogue, else from `ASSUMED`.

    Args:
        catalogue: from `load_catalogue`.
        options: in SI; None for none.

    Returns:
        One strength per tube, in the order of the catalogue.

    Raises:
        CatalogueError: the supported length exceeds the free one.
    """
    return [_strength(tube, options or TubeOptions()) for tube in catalogue.tubes]


def _strength(tube: CatalogueTube, options: TubeOptions) -> TubeStrength:
    known = {
        name: getattr(tube, name) if getattr(options, name) is None else getattr(options, name)
        for name in ASSUMED
    }
    assumed = tuple(name for name, value in known.items() if value is None)
    of = {name: ASSUMED[name][0] if name in assumed else known[name] for name in known}
    if "free_length" in assumed:
        of["free_length"] *= of["supported_length"]
    if of["supported_length"] > of["free_length"]:
        raise CatalogueError(
            f"{tube.name}: a support leaves less of the tube free, but its supported_length, "
            f"{of['supported_length']:.4g} m, exceeds the free_length, {of['free_length']:.4g} m"
        )
    found = tube_buckling(
        modulus=of["modulus"],
        outer_diameter=tube.outer_diameter,
        thickness=tube.thickness,
        length=of["free_length"],
        supported_length=of["supported_length"],
    )
    return TubeStrength(
        tube=tube,
        **of,
        unsupported_load=float(found.unsupported_load),
        supported_load=float(found.supported_load),
        yield_load=float(yield_load(of["yield_stress"], tube.outer_diameter, tube.thickness)),
        assumed=assumed,
    )


def assumption_notes(strengths: Iterable[TubeStrength]) -> list[str]:
    """A sentence for each number that was assumed for some tube: what it is, how to replace it."""
    assumed = {name for strength in strengths for name in strength.assumed}
    return [
        f"The {name.replace('_', ' ')} of swage tubes is assumed where the catalogue names none: "
        f"{what}. Write it into the catalogue, or give it as an option of the tube."
        for name, (_, what) in ASSUMED.items()
        if name in assumed
    ]
