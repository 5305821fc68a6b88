"""Swaged end-fittings: a tube pressed by a die onto braid and bladder, and what the tube bears.

The fitting has two steps. On one lies the braid alone, on the other the bladder with the braid over
it. After the die the gap between fitting and tube, on each side, is what is left of the layers:

    on the braid:    d = D_bore - 2 t_braid (1 - c_braid)
    on the bladder:  d = D_bore - 2 t_braid - 2 t_bladder (1 - c_bladder)
    D_bore = D_tube - reduction - 2 t_tube

These are equations 2.6 and 2.7 of the reference work: the die leaves the wall of the tube as it is,
and over the far softer rubber the braid is not compressed. For the 7/8 in muscle they give 0.8387
in and 0.7475 in where 0.838 in and 0.748 in are published, within a thousandth of an inch. A wall
that keeps its section thickens by 0.0018 in (`swaged_thickness`), which on each side is 0.17 of the
braid: measure the bore of a swaged tube before trusting the sizes.

References:
    Chambers 2021, chapter 2, tables 2.4 and 2.5.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable

import jax.numpy as jnp

from .. import units
from .._arrays import Real, RealArray, as_real
from .catalogue import Catalogue, CatalogueBladder, CatalogueBraid, CatalogueTube


def swaged_bore(outer_diameter: Real, thickness: Real, reduction: Real) -> RealArray:
    """Bore D_bore [m] of a tube after the die, D - reduction - 2 t, its wall taken as unchanged.

    Args:
        outer_diameter: D [m], before swaging.
        thickness: wall t [m]; give `swaged_thickness` for a wall that keeps its section.
        reduction: of the outer diameter [m], in the die.

    Returns:
        D_bore [m], broadcast shape.

    >>> print(f"{swaged_bore(1.0, 0.058, 0.027):.3f}")  # inches
    0.857
    """
    return as_real(outer_diameter) - reduction - 2 * thickness


def swaged_thickness(outer_diameter: Real, thickness: Real, reduction: Real) -> RealArray:
    """Wall [m] of a tube after the die if its section is kept, the tube not growing longer.

    t' (D' - t') = t (D - t) with D' = D - reduction: the upper bound of the wall.

    Args:
        outer_diameter: D [m], before swaging.
        thickness: t [m], before swaging.
        reduction: of the outer diameter [m].

    Returns:
        t' [m], broadcast shape; nan where the section does not fit the die.
    """
    section = thickness * (as_real(outer_diameter) - thickness)
    swaged = as_real(outer_diameter) - reduction
    return jnp.asarray(2 * section / (swaged + jnp.sqrt(swaged**2 - 4 * section)))


def fitting_diameter_on_braid(
    bore: Real, braid_thickness: Real, braid_compression: Real
) -> RealArray:
    """Diameter d [m] of the fitting under the braid alone, D_bore - 2 t_braid (1 - c_braid).

    Args:
        bore: D_bore [m], of the tube after swaging.
        braid_thickness: t_braid [m], two threads crossing.
        braid_compression: c_braid [-], the share by which the braid is thinned, in [0, 1).

    Returns:
        d [m], broadcast shape.

    References:
        Chambers 2021, equation 2.6.

    >>> print(f"{fitting_diameter_on_braid(0.857, 0.011, 0.17):.4f}")  # inches; 0.838 published
    0.8387
    """
    return jnp.asarray(bore - 2 * braid_thickness * (1 - braid_compression))


def fitting_diameter_on_bladder(
    bore: Real, braid_thickness: Real, bladder_thickness: Real, bladder_compression: Real
) -> RealArray:
    """Diameter d [m] of the fitting under bladder and braid, the braid not compressed.

    d = D_bore - 2 t_braid - 2 t_bladder (1 - c_bladder)

    Args:
        bore: D_bore [m], of the tube after swaging.
        braid_thickness: t_braid [m].
        bladder_thickness: t_bladder [m], at rest.
        bladder_compression: c_bladder [-], the share by which the bladder is thinned, in [0, 1).

    Returns:
        d [m], broadcast shape.

    References:
        Chambers 2021, equation 2.7.

    >>> print(f"{fitting_diameter_on_bladder(0.857, 0.011, 0.0625, 0.30):.4f}")  # 0.748 published
    0.7475
    """
    return jnp.asarray(
        bore - 2 * braid_thickness - 2 * bladder_thickness * (1 - bladder_compression)
    )


def braid_compression(bore: Real, fitting_diameter: Real, braid_thickness: Real) -> RealArray:
    """Compression c [-] of the braid on a fitting as machined, 1 - (D_bore - d) / (2 t_braid).

    The inverse of `fitting_diameter_on_braid`. Negative where the braid is loose.
    """
    return 1 - (as_real(bore) - fitting_diameter) / (2 * braid_thickness)


def bladder_compression(
    bore: Real, fitting_diameter: Real, braid_thickness: Real, bladder_thickness: Real
) -> RealArray:
    """Compression c [-] of the bladder on a fitting as machined; negative where it is loose.

    The inverse of `fitting_diameter_on_bladder`.
    """
    return braid_compression(bore - 2 * braid_thickness, fitting_diameter, bladder_thickness)


def compression_sensitivity(bore: Real, fitting_diameter: Real, thickness: Real) -> RealArray:
    """Change of compression [1/m] per error of the fitting's RADIUS.

    A thousandth of an inch on the radius changes the compression of the 0.011 in braid by 0.09, as
    published; on the diameter by half of that.

    Args:
        bore: [m], of the tube after swaging, less the layers that are not compressed.
        fitting_diameter: [m].
        thickness: [m], of the layer that is compressed.

    Returns:
        dc/dr [1/m], broadcast shape: 1 / thickness, whatever the diameters.

    References:
        Chambers 2021, chapter 2.

    >>> print(f"{0.001 * compression_sensitivity(0.857, 0.838, 0.011):.3f}")  # inches
    0.091
    """
    return jnp.broadcast_arrays(1 / as_real(thickness), bore, fitting_diameter)[0]


@dataclasses.dataclass(frozen=True)
class EndFitting:
    """One sizing of the inner fitting.

    Attributes:
        tube: swage tube.
        bladder: rubber tube.
        braid: sleeve.
        diameter_on_braid: [m], of the step under the braid.
        diameter_on_bladder: [m], of the step under bladder and braid.
        bore_stretch: [-], by how much the fitting must stretch the bladder's bore to enter it;
            negative where it goes in with clearance.
        feasible: True where the fitting has a positive diameter and goes into the bore with no more
            stretch than was allowed.
    """

    tube: CatalogueTube
    bladder: CatalogueBladder
    braid: CatalogueBraid
    diameter_on_braid: float
    diameter_on_bladder: float
    bore_stretch: float
    feasible: bool


def size_end_fittings(
    catalogue: Catalogue,
    braid: CatalogueBraid,
    bladder_diameter: float,
    *,
    braid_compression: float = 0.17,
    bladder_compression: float = 0.30,
    allowed_bore_stretch: float = 0.0,
) -> list[EndFitting]:
    """The inner fitting for every tube and every bladder of one diameter in the catalogue.

    Args:
        catalogue: from `load_catalogue`.
        braid: sleeve.
        bladder_diameter: outer diameter [m] of the bladder.
        braid_compression: c_braid [-]; 0.17 for the reference work's first muscle, 0.27 for every
            later one.
        bladder_compression: c_bladder [-]; 0.30 in the reference work.
        allowed_bore_stretch: [-], by how much the fitting may stretch the bladder's bore.

    Returns:
        One sizing per tube and bladder thickness, in the order of the catalogue.

    Raises:
        ValueError: no bladder of that diameter, or a compression outside [0, 1).
    """
    for name, share in (("braid", braid_compression), ("bladder", bladder_compression)):
        if not 0 <= share < 1:
            raise ValueError(f"the compression of the {name} must be in [0, 1), got {share}")
    bladders = [b for b in catalogue.bladders if abs(b.diameter / bladder_diameter - 1) < 1e-9]
    if not bladders:
        offered = ", ".join(f"{d:.6g}" for d in sorted({b.diameter for b in catalogue.bladders}))
        raise ValueError(
            f"the catalogue has no bladder of diameter {bladder_diameter:.6g} m; it has {offered} m"
        )
    found = []
    for tube, bladder in itertools.product(catalogue.tubes, bladders):
        bore = swaged_bore(tube.outer_diameter, tube.thickness, tube.swage_reduction)
        on_bladder = float(
            fitting_diameter_on_bladder(
                bore, braid.thickness, bladder.thickness, bladder_compression
            )
        )
        stretch = on_bladder / bladder.bore - 1
        found.append(
            EndFitting(
                tube=tube,
                bladder=bladder,
                braid=braid,
                diameter_on_braid=float(
                    fitting_diameter_on_braid(bore, braid.thickness, braid_compression)
                ),
                diameter_on_bladder=on_bladder,
                bore_stretch=stretch,
                feasible=on_bladder > 0 and stretch <= allowed_bore_stretch,
            )
        )
    return found


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


ASSUMED: dict[str, tuple[float, str]] = {
    "modulus": (68.9e9, "68.9 GPa, of aluminium 6061-T6 (Aluminum Association, typical)"),
    "yield_stress": (276e6, "276 MPa, of aluminium 6061-T6 (Aluminum Association, typical)"),
    "supported_length": (1.85 * units.INCH, "1.85 in, left free by the reference work's support"),
    "free_length": (3.10 * units.INCH, "3.10 in, as in the reference work"),
}
"""Values in SI used where the catalogue gives none, and what they are; the reference work does not
print the metal."""


@dataclasses.dataclass(frozen=True)
class TubeStrength:
    """What a swage tube bears between pinned ends, unswaged.

    The support is taken as rigid and its end as the same kind of end as before, so that it multiplies
    Euler's load by (L / L')^2: 2.81 for the reference work's tube, 3.10 in long, of which its support
    leaves 1.85 in free. That is the most that a support can do; one that only stiffens the tube gains
    1.14 (`stepped_column_gain`). The work says that it "approximately doubles" the load.

    Attributes:
        tube: row of the catalogue.
        modulus: Young's modulus [Pa].
        yield_stress: [Pa].
        free_length: L [m], without support.
        supported_length: L' [m], with it.
        buckling_load: Euler's load [N] without support.
        supported_buckling_load: Euler's load [N] with it.
        yield_load: [N], at which the section yields.
        assumed: which of the first four numbers are from `ASSUMED`.
    """

    tube: CatalogueTube
    modulus: float
    yield_stress: float
    free_length: float
    supported_length: float
    buckling_load: float
    supported_buckling_load: float
    yield_load: float
    assumed: tuple[str, ...]

    @property
    def gain(self) -> float:
        """Euler's load with the support over that without [-]."""
        return self.supported_buckling_load / self.buckling_load

    @property
    def yields_first(self) -> bool:
        """True if the bare tube is crushed before it buckles, so that a support gains nothing."""
        return self.yield_load < self.buckling_load


def tube_strengths(catalogue: Catalogue) -> list[TubeStrength]:
    """Buckling and yield load of every swage tube of the catalogue.

    A number that the catalogue does not give is taken from `ASSUMED`.

    Args:
        catalogue: from `load_catalogue`.

    Returns:
        One strength per tube, in the order of the catalogue.
    """
    return [_strength(tube) for tube in catalogue.tubes]


def _strength(tube: CatalogueTube) -> TubeStrength:
    assumed = tuple(name for name in ASSUMED if getattr(tube, name) is None)
    of = {name: ASSUMED[name][0] if name in assumed else getattr(tube, name) for name in ASSUMED}
    size = tube.outer_diameter, tube.thickness
    buckling, supported = (
        float(euler_load(of["modulus"], tube_second_moment(*size), of[length]))
        for length in ("free_length", "supported_length")
    )
    return TubeStrength(
        tube, **of, buckling_load=buckling, supported_buckling_load=supported,
        yield_load=float(yield_load(of["yield_stress"], *size)), assumed=assumed,
    )  # fmt: skip


def assumption_notes(strengths: Iterable[TubeStrength]) -> list[str]:
    """A sentence for each number that was assumed for some tube, and how to replace it."""
    assumed = {name for strength in strengths for name in strength.assumed}
    return [
        f"The {name.replace('_', ' ')} of swage tubes is assumed where the catalogue gives none: "
        f"{what}. Write it into a catalogue of your own."
        for name, (_, what) in ASSUMED.items()
        if name in assumed
    ]
