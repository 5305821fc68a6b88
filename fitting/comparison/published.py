"""The registry of peers that are fitted, name to family.

The bounds are wide, so that every peer is shown at its best: a braid's diameter and angle are fit
parameters here and need not be those of a buildable muscle.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

import famjax
from famjax import peers

from ..data import ForceData
from .peer_family import Model, PeerContext, PeerFamily, PeerParameter, Values

_DEADBAND = PeerParameter("deadband_pressure", "Pa", -200e3, 200e3)
"""Below zero where the rest length was taken too long: the two lie on one ridge."""
_CONTRACTION = 0.25  # scale of contraction of models that leave it free


def peer_families(data: ForceData) -> dict[str, PeerFamily]:
    """Every peer with the parameters and bounds that it has for a force map, by name.

    Args:
        data: its specimen and ranges place the bounds.

    Returns:
        The registry. Maps of one specimen and range share it, and what was compiled for it.
    """
    return _registry(PeerContext.of(data))


@functools.lru_cache(maxsize=32)
def _registry(at: PeerContext) -> dict[str, PeerFamily]:
    makers = (_braids, _ends, _muscles, _pressure_laws, _sarosi, _martens, _festo, _surfaces)
    return {
        name: dataclasses.replace(family, origin=(name, at))
        for maker in makers
        for name, family in maker(at).items()
    }


def _linear(name: str, unit: str, low: float = -math.inf) -> PeerParameter:
    return PeerParameter(name, unit, low, linear=True)


def _optional(values: Values, *names: str) -> tuple:
    """The values of these names, zero for those that a variant does not have."""
    return tuple(values.get(name, jnp.zeros(())) for name in names)


def _braids(at: PeerContext) -> dict[str, PeerFamily]:
    def gaylord(values: Values) -> Model:
        return peers.Gaylord(
            at.braid(values), *_optional(values, "deadband_pressure", "force_offset")
        )

    def davis(values: Values) -> Model:
        braid = at.braid(values)
        around = 2 * math.pi * braid.turns**2
        tension = at.pressures[1] * at.rest * braid.rest_thread_length / around
        return peers.Gaylord(
            famjax.braids.CompliantBraid.of(braid, values["thread_strain"] / tension)
        )

    offset = _linear("force_offset", "N")
    strain = PeerParameter("thread_strain", "", 0.0, 0.5)
    wall = PeerParameter("wall_thickness", "m", 0.0, 2 * at.specimen.wall_thickness)
    return {
        "gaylord": PeerFamily("Gaylord 1958", at.geometry, gaylord),
        "gaylord_deadband": PeerFamily("Gaylord, deadband", (*at.geometry, _DEADBAND), gaylord),
        "gaylord_offset": PeerFamily("Gaylord, force offset", (*at.geometry, offset), gaylord),
        "davis": PeerFamily(
            "Davis 2003, stretching braid",
            (*at.geometry, strain),
            davis,
            "thread_strain is that at rest and the highest pressure, of unstretched geometry",
        ),
        "chou_hannaford": PeerFamily(
            "Chou & Hannaford 1996, wall",
            (*at.geometry, wall),
            lambda values: peers.ChouHannaford(at.braid(values), values["wall_thickness"]),
        ),
    }


def _ends(at: PeerContext) -> dict[str, PeerFamily]:
    def tondu(values: Values) -> peers.TonduLopez:
        rise, deadband = _optional(values, "k_rise", "deadband_pressure")
        return peers.TonduLopez(at.braid(values), at.rest, values["k_far"], rise, deadband)

    def kerscher(values: Values) -> Model:
        held = jnp.asarray(at.specimen.nominal_diameter or at.geometry[0].low)
        factors = (values[f"factor_{name}"] for name in ("rise", "rate", "far"))
        return peers.Kerscher(tondu({**values, "braid_diameter": held}), *factors)

    far, rise = PeerParameter("k_far", "", 0.5, 3.0), PeerParameter("k_rise", "", 0.0, 20.0)
    factor = (
        PeerParameter("factor_rate", "", 0.0, 100.0),
        _linear("factor_rise", ""),
        _linear("factor_far", ""),
    )
    return {
        "tondu_lopez": PeerFamily("Tondu & Lopez 2000, k", (*at.geometry, far), tondu),
        "tondu_lopez_deadband": PeerFamily(
            "Tondu & Lopez, k, deadband", (*at.geometry, far, _DEADBAND), tondu
        ),
        "tondu_lopez_pressure": PeerFamily("Tondu & Lopez, k(P)", (*at.geometry, far, rise), tondu),
        "kerscher": PeerFamily(
            "Kerscher 2006",
            (at.geometry[1], far, rise, *factor),
            kerscher,
            "the braid's diameter is held, as its factor scales the section",
        ),
    }


def _muscles(at: PeerContext) -> dict[str, PeerFamily]:
    def ferraresi(values: Values) -> famjax.Muscle:
        deadband = _optional(values, "deadband_pressure")
        return peers.ferraresi(at.cylinder(values), values["E_1"], *deadband)

    def mooney(values: Values) -> Model:
        constants = (values[name] for name in ("C10", "C01", "deadband_pressure"))
        return peers.klute_hannaford(at.cylinder(values), *constants)

    modulus = _linear("E_1", "Pa")
    delayed = (*at.geometry, _DEADBAND)
    return {
        "ferraresi": PeerFamily("Ferraresi 2001", (*at.geometry, modulus), ferraresi),
        "ferraresi_deadband": PeerFamily("Ferraresi, deadband", (*delayed, modulus), ferraresi),
        "kothera": PeerFamily(
            "Kothera 2009, deadband",
            (*delayed, modulus),
            lambda values: peers.Kothera(ferraresi(values)),
        ),
        "klute_hannaford": PeerFamily(
            "Klute & Hannaford 2000, deadband",
            (*delayed, _linear("C10", "Pa"), _linear("C01", "Pa")),
            mooney,
        ),
    }


def _pressure_laws(at: PeerContext) -> dict[str, PeerFamily]:
    if at.pressures[0] == at.pressures[1]:
        return {}

    def family(label: str, order: int, low: float = -math.inf) -> PeerFamily:
        names = [[f"E_{n}_{end}" for n in range(1, order + 1)] for end in ("low", "high")]

        def robinson(values: Values) -> Model:
            nodes = jnp.stack([jnp.stack([values[name] for name in row]) for row in names])
            delay = values["deadband_pressure"]
            return peers.robinson(at.cylinder(values), np.array(at.pressures), nodes, delay)

        coefficients = (_linear(name, "Pa", low) for row in names for name in row)
        low_kPa, high_kPa = (f"{pressure / 1e3:.4g}" for pressure in at.pressures)
        note = f"E_n_low and E_n_high belong to {low_kPa} and {high_kPa} kPa"
        return PeerFamily(label, (*at.geometry, _DEADBAND, *coefficients), robinson, note)

    return {
        "robinson_1": family("Robinson 2015, order 1", 1),
        "robinson_2": family("Robinson 2015, order 2", 2),
        "pillsbury_2": family("Pillsbury 2015, order 2, positive", 2, 0.0),
    }


def _sarosi(at: PeerContext) -> dict[str, PeerFamily]:
    units = {"a1": "m2", "a2": "N", "a4": "m2", "a5": "m2", "a6": "N"}
    rate = PeerParameter("a3", "", -300.0, -1.0)

    def family(names: Sequence[str], complete: Callable[[Values], Values]) -> PeerFamily:
        def sarosi(values: Values) -> Model:
            return peers.Sarosi(at.rest, **values, **complete(values))

        linear = (_linear(name, units[name]) for name in names)
        return PeerFamily(f"Sarosi 2012, {len(names) + 1} parameters", (rate, *linear), sarosi)

    def relaxed(values: Values) -> Values:
        return {"a1": jnp.zeros(()), "a6": -values["a2"]}

    def newton_per_bar(_: Values) -> Values:
        return {"a1": jnp.asarray(1 / famjax.units.BAR)}

    return {
        "sarosi_4": family(("a2", "a4", "a5"), relaxed),
        "sarosi_5": family(("a2", "a4", "a5", "a6"), newton_per_bar),
        "sarosi_6": family(tuple(units), lambda _: {}),
    }


def _martens(at: PeerContext) -> dict[str, PeerFamily]:
    nominal = at.specimen.nominal_diameter
    units = {"c0": "Pa", "c1": "Pa/m", "c2": "Pa/m2", "c3": "Pa/m3"}
    moduli = tuple(_linear(name, unit) for name, unit in units.items())

    def martens(values: Values) -> Model:
        return peers.Martens.from_rest(
            diameter=values.get("braid_diameter", jnp.asarray(nominal)),
            braid_angle=values["braid_angle"],
            length=at.rest,
            wall_thickness=at.specimen.wall_thickness,
            coefficients=jnp.stack([values[name] for name in units]),
        )

    free = PeerFamily("Martens & Boblan 2017, diameter", (*at.geometry, *moduli), martens)
    if nominal is None:
        return {"martens_diameter": free}
    held = PeerFamily("Martens & Boblan 2017", (at.geometry[1], *moduli), martens)
    return {"martens": held, "martens_diameter": free}


def _festo(at: PeerContext) -> dict[str, PeerFamily]:
    P, F = at.pressures[1], at.largest_force
    bolen = (
        _linear("largest_force", "N"),
        PeerParameter("c0", "", 0.0, 5.0),
        PeerParameter("c1", "", 0.1, 50.0),
        PeerParameter("c2", "", 0.0, 20.0),
    )
    hunt = (
        PeerParameter("offset_pressure", "Pa", -2 * P, 4 * P),
        PeerParameter("tangent_pressure", "Pa", 1e-3 * P, 5 * P),
        PeerParameter("tangent_slope", "", 0.1, 10.0),
        PeerParameter("tangent_angle", "rad", 0.0, 1.5),
        PeerParameter("contraction_per_force", "1/N", -_CONTRACTION / F, -1e-6 * _CONTRACTION / F),
        PeerParameter("pressure_per_force", "Pa/N", 0.05 * P / F, 3 * P / F),
    )

    def build_hunt(values: Values) -> Model:
        given = dict(values)
        angle = given.pop("tangent_angle")
        offset = -angle / given["tangent_slope"]
        return peers.Hunt(at.rest, _CONTRACTION, tangent_offset=offset, **given)

    note = f"the contraction scale is held at {_CONTRACTION}; other constants absorb it"
    return {
        "hunt": PeerFamily("Hunt 2017", hunt, build_hunt, note),
        "bolen": PeerFamily(
            "Bolen 2026",
            bolen,
            lambda values: peers.Bolen(at.rest, _CONTRACTION, **values),
            note,
        ),
    }


def _surfaces(at: PeerContext) -> dict[str, PeerFamily]:
    springs = {"k0": "N/m", "k1": "N/m/Pa2", "k2": "N/m2/Pa", "k3": "N/m3"}
    areas, forces = ("a0", "a1", "a2"), ("b0", "b1", "b2", "b3", "b4")
    slack = PeerParameter("slack_length", "m", 0.2 * at.rest, at.rest)

    def stacked(values: Values, names: tuple[str, ...]) -> jnp.ndarray:
        return jnp.stack([values[name] for name in names])

    def polynomial(degree: int) -> PeerFamily:
        names = tuple(f"c_{i}{j}" for i, j in peers.PolynomialSurface.terms(degree))
        return PeerFamily(
            f"polynomial of degree {degree}",
            tuple(_linear(name, "N") for name in names),
            lambda values: peers.PolynomialSurface(at.rest, stacked(values, names), degree),
            "pressure in MPa",
        )

    return {
        "wickramatunge": PeerFamily(
            "Wickramatunge 2010",
            (slack, *(_linear(name, unit) for name, unit in springs.items())),
            lambda values: peers.Wickramatunge(
                values["slack_length"], stacked(values, tuple(springs))
            ),
        ),
        "hildebrandt": PeerFamily(
            "Hildebrandt 2002",
            (*(_linear(name, "m2") for name in areas), *(_linear(name, "N") for name in forces)),
            lambda values: peers.Hildebrandt(
                at.rest, stacked(values, areas), stacked(values, forces)
            ),
        ),
        **{f"polynomial_{degree}": polynomial(degree) for degree in (3, 4, 5)},
    }
