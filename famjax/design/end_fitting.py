"""Swaged end-fittings: a tube pressed by a die onto braid and bladder, on a stepped inner fitting.

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

import jax
import jax.numpy as jnp

from .._types import Real, RealArray, as_real
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
    """Change of compression [1/m] per error of the fitting's RADIUS, by autodiff of the rule.

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
    radius = jnp.broadcast_to(
        as_real(fitting_diameter) / 2,
        jnp.broadcast_shapes(*map(jnp.shape, (bore, fitting_diameter))),
    )
    return jax.jvp(
        lambda radius: braid_compression(bore, 2 * radius, thickness),
        (radius,),
        (jnp.ones_like(radius),),
    )[1]


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
        braid_sensitivity: change of the braid's compression per error of the radius [1/m].
        bladder_sensitivity: the same of the bladder's.
    """

    tube: CatalogueTube
    bladder: CatalogueBladder
    braid: CatalogueBraid
    diameter_on_braid: float
    diameter_on_bladder: float
    bore_stretch: float
    feasible: bool
    braid_sensitivity: float
    bladder_sensitivity: float


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
    fittings = []
    for tube in catalogue.tubes:
        bore = swaged_bore(tube.outer_diameter, tube.thickness, tube.swage_reduction)
        on_braid = fitting_diameter_on_braid(bore, braid.thickness, braid_compression)
        for bladder in bladders:
            on_bladder = fitting_diameter_on_bladder(
                bore, braid.thickness, bladder.thickness, bladder_compression
            )
            stretch = float(on_bladder) / bladder.bore - 1
            fittings.append(
                EndFitting(
                    tube=tube,
                    bladder=bladder,
                    braid=braid,
                    diameter_on_braid=float(on_braid),
                    diameter_on_bladder=float(on_bladder),
                    bore_stretch=stretch,
                    feasible=float(on_bladder) > 0 and stretch <= allowed_bore_stretch,
                    braid_sensitivity=float(
                        compression_sensitivity(bore, on_braid, braid.thickness)
                    ),
                    bladder_sensitivity=float(
                        compression_sensitivity(bore, on_bladder, bladder.thickness)
                    ),
                )
            )
    return fittings
