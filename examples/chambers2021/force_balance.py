"""Terms of the force balance for the four geometries, as functions of pressure and contraction."""

import dataclasses
import functools
from collections.abc import Callable, Mapping

import jax.numpy as jnp
import numpy as np
from beside_print import printed
from jaxtyping import Array, Float
from numpy.typing import ArrayLike
from specimen import NONE, PRESSURES, Change, muscles, open_turns

from famjax import Muscle
from famjax.braids import gaylord_force
from famjax.compile_options import quick_jit
from famjax.terms import VirtualWork, bladder_axial_force, bladder_hoop_force

PRINTED_FREE = 0.353
"""Contraction used in tables 6.1 and 6.2."""

GRID = 101
"""Number of points from rest to a free contraction, used for extremes and means."""

OWN, TESTED = slice(0, GRID), slice(GRID, 2 * GRID)
"""Columns of `Terms` from rest to the geometry's own free contraction, and from rest to the tested one."""

PRINTED, LAST = 2 * GRID, 2 * GRID + 1
"""Columns of `Terms` at `PRINTED_FREE` and at the last measured profile."""

ORDERS = 4


@dataclasses.dataclass(frozen=True)
class Terms:
    """All terms in the force balance, by pressure (rows) and contraction (columns), in psi, in and lbf."""

    contraction: Float[np.ndarray, "pressures columns"]
    values: dict[str, Float[np.ndarray, "pressures columns"]]

    def at(self, quantity: str, row: int, state: str) -> float:
        """Return a quantity at one pressure and state; extremes are in magnitude, but keep their sign."""
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
        """Return the quantity at all contractions of the highest pressure."""
        return self.values[quantity][-1]


_POINTS = 1024
"""States per call of the compiled balance."""

_KNOWN = 0.367
"""Largest contraction with a known shape: 0.35, plus an extrapolation by a twentieth of that."""


def balance(
    muscle: Muscle, contraction: ArrayLike, pressure: ArrayLike
) -> dict[str, Float[np.ndarray, "..."]]:
    """Compute the terms in the force balance and the mean powers of the strains, with broadcast shape.

    Each geometry needs only one compiled program, whatever the number of states.

    Args:
        muscle: muscle in inches and psi.
        contraction: (L0 - L) / L0 [-].
        pressure: gauge pressure [psi].

    Returns:
        Quantities by name, in inches, degrees, psi and lbf.
    """
    c, P = np.broadcast_arrays(np.asarray(contraction, float), np.asarray(pressure, float))
    calls = -(-c.size // _POINTS)
    # Repeated states fill up the last call.
    states = [np.resize(values, (calls, _POINTS)) for values in (c, P)]
    found = [_balance(muscle, *state) for state in zip(*states, strict=True)]
    return {
        name: np.concatenate([np.asarray(one[name]) for one in found])[: c.size].reshape(c.shape)
        for name in found[0]
    }


@quick_jit
def _balance(
    muscle: Muscle, contraction: Float[Array, " n"], pressure: Float[Array, " n"]
) -> dict[str, Float[Array, " n"]]:
    length = muscle.rest_length * (1 - contraction)
    at = muscle.geometry.dimensions_with_rates(length, pressure)
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
        "-P dV/dL at constant pressure": VirtualWork().force(at, pressure),
        "-P dV/dL at constant thread length": VirtualWork(at_thread_length=True).force(
            at, pressure
        ),
        **moments,
    }


def free_contraction(muscle: Muscle, pressure: ArrayLike) -> Float[np.ndarray, " n"]:
    """Return the smallest contraction with zero force at each pressure [psi].

    The range up to `_KNOWN` is subdivided. Then the first part in which the force falls through zero is
    subdivided repeatedly, until its ends are adjacent floating-point numbers. `Muscle.free_contraction`
    returns the same result; this function needs no compiled program other than that of the balance.

    Raises:
        RuntimeError: the force does not fall through zero at some pressure.
    """
    P = np.asarray(pressure, float)[:, None]
    share = np.linspace(0, 1, _POINTS // P.size)
    first, last = np.zeros_like(P), np.full_like(P, _KNOWN)
    while np.any(np.nextafter(first, last) < last):
        c = first + (last - first) * share
        force = balance(muscle, c, P)["total force"]
        falls = (force[:, :-1] > 0) & (force[:, 1:] <= 0)
        if not falls.any(axis=1).all():
            raise RuntimeError(
                "the force must fall through zero at every pressure, but at some it does not"
            )
        cell = falls.argmax(axis=1)[:, None]
        first, last = (np.take_along_axis(c, at, axis=1) for at in (cell, cell + 1))
    return last[:, 0]


@functools.cache
def free_contractions() -> dict[str, Float[np.ndarray, " pressures"]]:
    """Return the free contraction of each geometry at `PRESSURES`, where its own force is zero."""
    return {name: free_contraction(muscle, PRESSURES) for name, muscle in muscles().items()}


@functools.cache
def terms(change: Change = NONE, further: float = 0.0) -> dict[str, Terms]:
    """Compute the terms of each geometry for a changed specimen.

    `further` shifts all contractions except those up to the geometry's own free contraction.
    """
    tested = np.array(printed()["tested"]["free_contraction"])[:, None] + further
    last = printed()["profile_100psi"][-1]["contraction"]
    share = np.linspace(0, 1, GRID)
    places = np.broadcast_to([PRINTED_FREE + further, last], (len(PRESSURES), 2))
    found = {}
    for name, muscle in muscles(change).items():
        own = free_contractions()[name][:, None]
        contraction = np.hstack([own * share, tested * share, places])
        found[name] = Terms(contraction, balance(muscle, contraction, np.array(PRESSURES)[:, None]))
    return found


def open_changes() -> tuple[Change, ...]:
    """Return the changes within the uncertainty of the printed B0, N and profiles; see `WHY`."""
    rmse = dict(
        zip(*(printed()["fourier_terms"][key] for key in ("terms", "rmse_in")), strict=True)
    )
    return Change(0.0005), Change(turns=open_turns()), Change(diameter=rmse[3])


WHY = (
    "the effects of changing the free contraction by 0.001 (it is printed as 35.3 % and as 0.354), B0 "
    "by half a unit in the last digit, N within the range consistent with table 5.1, and the profiles "
    "by 0.005 in (the RMSE of three terms in table 4.2)"
)


def spread(value: Callable[[Mapping[str, Terms]], float]) -> float:
    """Return the tolerance of a figure: the sum of the effects named in `WHY`."""
    first = value(terms())
    others = [terms(NONE, 0.001), *(terms(change) for change in open_changes())]
    return sum(abs(value(of) - first) for of in others)
