"""A safe muscle as a table that small targets can hold, and how far the table is from the model."""

import dataclasses
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._arrays import RealArray
from ..boundary.errors import InputError
from ..compile_options import quick_jit
from ..continuation import SafeMuscle, slopes
from ..muscle import AbstractMuscle
from .plain import TabulatedPull

CLOSE = 5e-8
"""Largest error of the interpolation along either axis, of the largest force in the region."""

_MOST = {"length": 257, "pressure": 65}
_FIRST = {"length": 9, "pressure": 2}
_INSIDE = np.array([0.2, 0.5, 0.8])  # where the error in a cell is looked for
_AT_ONCE = 2048
_STATES = 4000
_LIMIT = 2.0  # highest pressure that the inverse looks at, of the highest of the region
_STEEP = 0.01  # of the mean area: below it a pressure is not determined by the force

Numbers = Float[np.ndarray, "..."]


@dataclasses.dataclass(frozen=True)
class TableErrors:
    """How far a table is from its model, at random states.

    Attributes:
        largest_force: in the region [N]; forces are given in parts of it.
        force: largest difference of force in the region [-].
        force_beyond: the same from no length to twice the longest, from no pressure to twice the
            highest [-].
        pressure: largest error of the inverse [Pa] over all of these states between the stops, where
            the muscle pulls with more than the blend into slack and its area F_P is above a
            hundredth of the mean: elsewhere the force hardly tells the pressure.
        states: number of them in each.
    """

    largest_force: float
    force: float
    force_beyond: float
    pressure: float
    states: int


def tabulated(muscle: SafeMuscle) -> dict[str, Any]:
    """The table of a safe muscle's static map, as `TabulatedPull` takes it: plain lists, SI.

    Nodes are put where they are needed: a cell is halved as long as the cubic between its ends is
    off by more than `CLOSE` of the largest force, anywhere along the other axis. A model that is
    affine in the pressure needs two pressures.

    Args:
        muscle: the safe muscle. Its hysteresis is left out.

    Raises:
        InputError: more nodes would be needed than a table may have, or JAX is in float32.
    """
    check_float64()
    inside = muscle.continued
    model, region = inside.muscle, inside.region
    ends: dict[str, Numbers] = {
        name: np.asarray(getattr(region, name), float) for name in ("length", "pressure")
    }
    nodes = {name: np.linspace(low, high, _FIRST[name]) for name, (low, high) in ends.items()}
    scale = float(np.abs(_slopes(model, *np.meshgrid(*nodes.values()))[0]).max())
    while True:
        split = {name: _too_wide(model, nodes, name, CLOSE * scale) for name in nodes}
        if not any(wide.any() for wide in split.values()):
            break
        for name, wide in split.items():
            middles = 0.5 * (nodes[name][1:] + nodes[name][:-1])
            nodes[name] = np.sort(np.concatenate([nodes[name], middles[wide]]))
            if len(nodes[name]) > _MOST[name]:
                raise InputError(
                    f"the model is not smooth enough for a table: more than {_MOST[name]} "
                    f"{name}s would be needed for {CLOSE:g} of the largest force; export the model "
                    "itself, --to jax or --to mjx"
                )
    L, P = np.meshgrid(nodes["length"], nodes["pressure"], indexing="ij")
    values = _slopes(model, L, P)
    names = ("force_N", "stiffness_N_per_m", "area_m2", "mixed_m")
    return {
        "length_m": nodes["length"].tolist(),
        "pressure_Pa": nodes["pressure"].tolist(),
        **{name: value.tolist() for name, value in zip(names, values, strict=True)},
        "stops_m": np.asarray(inside.stops, float).tolist(),
        "stop_stiffness_N_per_m": float(inside.stop_stiffness),
        "stop_onset_m": float(inside.stop_onset),
        "length_ends_per_m": np.asarray(inside.length_ends, float).tolist(),
        "pressure_ends_per_Pa": np.asarray(inside.pressure_ends, float).tolist(),
        "slack_width_N": float(muscle.slack_width),
        "pressure_limit_Pa": _LIMIT * float(ends["pressure"][1]),
    }


def check_float64() -> None:
    """Refuse to export what float32 has rounded.

    Raises:
        InputError: JAX is in float32.
    """
    if not jax.config.read("jax_enable_x64"):
        raise InputError(
            "a muscle is exported in float64: call jax.config.update('jax_enable_x64', True) before "
            "anything of JAX"
        )


def table_errors(muscle: SafeMuscle, pull: TabulatedPull) -> TableErrors:
    """How far a table is from the muscle it was made of; see `TableErrors`.

    Args:
        muscle: the safe muscle.
        pull: its table.
    """
    (L0, L1), (P0, P1) = (
        np.asarray(getattr(muscle.region, name), float) for name in ("length", "pressure")
    )
    rng = np.random.default_rng(0)
    half = _STATES // 2
    L = np.concatenate([rng.uniform(L0, L1, half), rng.uniform(0, 2 * L1, half)])
    P = np.concatenate([rng.uniform(P0, P1, half), rng.uniform(0, _LIMIT * P1, half)])
    force = np.asarray(_force(muscle, jnp.asarray(L), jnp.asarray(P)))
    states = [*zip(L.tolist(), P.tolist(), strict=True)]
    off = np.abs(np.array([pull.force(*state) for state in states]) - force)
    largest = float(force[:half].max())
    area = np.array([pull.area(*state) for state in states])
    invertible = (force > pull.slack_width) & (area > _STEEP * area[:half].mean())
    invertible &= (pull.stops[0] < L) & (pull.stops[1] > L)
    back = [
        abs(pull.pressure(length, one) - pressure)
        for (length, pressure), one, one_to_one in zip(
            states, force.tolist(), invertible, strict=True
        )
        if one_to_one
    ]
    return TableErrors(
        largest_force=largest,
        force=float(off[:half].max()) / largest,
        force_beyond=float(off[half:].max()) / largest,
        pressure=max(back, default=math.nan),
        states=half,
    )


def _too_wide(
    model: AbstractMuscle, nodes: dict[str, Numbers], name: str, most: float
) -> np.ndarray:
    """Which cells along one axis are too wide for a cubic."""
    along, other = nodes[name], nodes["pressure" if name == "length" else "length"]
    across = np.concatenate([other, 0.5 * (other[1:] + other[:-1])])
    width = np.diff(along)

    def asked(values: Numbers) -> tuple[Numbers, ...]:
        pair = np.meshgrid(values, across, indexing="ij")
        return _slopes(model, *(pair if name == "length" else pair[::-1]))

    ends = asked(along)
    between = asked((along[:-1, None] + width[:, None] * _INSIDE).ravel())[0]
    force, slope = ends[0], ends[1 if name == "length" else 2]
    u, h = _INSIDE[:, None], width[:, None, None]
    rise = (force[1:] - force[:-1])[:, None]
    p, q = h * slope[:-1, None], h * slope[1:, None]
    cubic = force[:-1, None] + u * (p + u * (3 * rise - 2 * p - q + u * (p + q - 2 * rise)))
    off = np.abs(cubic - between.reshape(cubic.shape))
    if not np.isfinite(off).all():
        raise InputError("the model has no finite force somewhere in its region: nothing to export")
    return off.max(axis=(1, 2)) > most


def _slopes(model: AbstractMuscle, length: Numbers, pressure: Numbers) -> tuple[Numbers, ...]:
    """Force, stiffness, area and mixed slope at states of one shape, in chunks of one size."""
    L, P = np.ravel(length), np.ravel(pressure)
    spare = -len(L) % _AT_ONCE
    chunks = (np.pad(one, (0, spare), mode="edge").reshape(-1, _AT_ONCE) for one in (L, P))
    found = [
        np.stack(_slopes_of_chunk(model, jnp.asarray(one), jnp.asarray(at)))
        for one, at in zip(*chunks, strict=True)
    ]
    return tuple(np.concatenate(found, axis=1)[:, : len(L)].reshape(4, *np.shape(length)))


_slopes_of_chunk = quick_jit(slopes)


@quick_jit
def _force(muscle: SafeMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    return muscle.force(length, pressure)
