"""The terms of the force balance of the four geometries, over pressure and contraction."""

import dataclasses
import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from chambers_reference import PRESSURES, muscles, printed
from jaxtyping import Array, Float

from famjax import Muscle, bladder_axial_force, bladder_hoop_force, gaylord_force

PRINTED_FREE = 0.353
"""Contraction of tables 6.1 and 6.2."""

GRID = 101
"""Points from rest to a free contraction, over which extremes and means are taken."""

OWN, TESTED = slice(0, GRID), slice(GRID, 2 * GRID)
"""Columns of `Terms` from rest to the geometry's own and to the tested free contraction."""

PRINTED, LAST = 2 * GRID, 2 * GRID + 1
"""Columns of `Terms` at `PRINTED_FREE` and at the last profile measured."""

ORDERS = 4


@dataclasses.dataclass(frozen=True)
class Terms:
    """Everything in the balance, over pressure (rows) and contraction (columns); psi, in, lbf."""

    contraction: Float[np.ndarray, "pressures columns"]
    values: dict[str, Float[np.ndarray, "pressures columns"]]

    def at(self, quantity: str, row: int, state: str) -> float:
        """The quantity at one pressure and state; at an extreme of its size, with its sign."""
        values = self.values[quantity][row]
        size = np.abs(values[OWN])
        column = {
            "rest": 0,
            "free": OWN.stop - 1,
            "tested free": TESTED.stop - 1,
            "maximum": int(size.argmax()),
            "minimum": int(size.argmin()),
        }[state]
        return float(values[column])

    def at_100_psi(self, quantity: str) -> Float[np.ndarray, " columns"]:
        """The quantity at all contractions of the highest pressure."""
        return self.values[quantity][-1]


@eqx.filter_jit
def balance(
    muscle: Muscle, contraction: Float[Array, "..."], pressure: Float[Array, "..."]
) -> dict[str, Float[Array, "..."]]:
    """The terms of the force balance, strains and their moments included, broadcast shape."""
    length = muscle.geometry.rest_length * (1 - contraction)
    at = muscle.geometry.dimensions(length, pressure)
    axial, hoop = muscle.material.stresses(
        at.axial_strain[..., None], at.hoop_strain, pressure[..., None]
    )
    axial, hoop = (jnp.sum(at.station_weights * stress, axis=-1) for stress in (axial, hoop))
    axial_force = bladder_axial_force(axial, at.bladder_volume, at.length)
    hoop_force = bladder_hoop_force(hoop, at.thickness, at.length, at.radius, at.turns)
    gaylord = gaylord_force(pressure, at.radius, at.braid_angle)
    moments = {
        f"{name} strain {n}": jnp.sum(at.station_weights * strain**n, axis=-1)
        for name, strain in (
            ("axial", jnp.abs(at.axial_strain[..., None])),
            ("hoop", at.hoop_strain),
        )
        for n in range(1, ORDERS + 1)
    }
    return {
        "diameter": 2 * at.radius,
        "braid angle": jnp.rad2deg(at.braid_angle),
        "bladder thickness": at.thickness,
        "longitudinal stress": axial,
        "circumferential stress": hoop,
        "longitudinal bladder force": axial_force,
        "circumferential bladder force": hoop_force,
        "bladder force": axial_force + hoop_force,
        "Gaylord force": gaylord,
        "total force": gaylord + axial_force + hoop_force,
        **moments,
    }


@eqx.filter_jit
def free_contraction(muscle: Muscle, pressure: Float[Array, " n"]) -> Float[Array, " n"]:
    """Contraction of zero force at each pressure [psi]."""
    return muscle.free_contraction(pressure)


@functools.cache
def free_contractions() -> dict[str, Float[np.ndarray, " pressures"]]:
    """Free contraction of each geometry at `PRESSURES`: where its own model's force is zero."""
    pressures = jnp.array(PRESSURES)
    return {name: np.asarray(free_contraction(m, pressures)) for name, m in muscles().items()}


@functools.cache
def terms() -> dict[str, Terms]:
    """The terms of each geometry."""
    tested = np.array(printed()["tested"]["free_contraction"])[:, None]
    last = printed()["profile_100psi"][-1]["contraction"]
    share = np.linspace(0, 1, GRID)
    places = np.broadcast_to([PRINTED_FREE, last], (len(PRESSURES), 2))
    found = {}
    for name, muscle in muscles().items():
        own = free_contractions()[name][:, None]
        contraction = np.hstack([own * share, tested * share, places])
        pressures = np.broadcast_to(np.array(PRESSURES)[:, None], contraction.shape)
        values = balance(muscle, jnp.asarray(contraction), jnp.asarray(pressures))
        found[name] = Terms(contraction, {key: np.asarray(v) for key, v in values.items()})
    return found
