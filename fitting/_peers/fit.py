"""Fits of peers: variable projection, with many starts and many subsets of a map in one call."""

import dataclasses
import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import famjax

from .._convex.qp import solve_qp
from .._data.force_data import ForceData
from .._errors import InputError
from .._search.box import minimise_in_box
from .._search.quick_jit import QUICK_COMPILATION
from .._search.search import latin_hypercube
from .cross_validation import CrossValidation, check_groups, group_labels, held_out_errors
from .families import peer_families
from .family import Model, PeerFamily

_CHUNK = 16  # fits of one compiled call
_MAX_STEPS = 150
_RIDGE = 1e-9  # of columns of unit length
_DEPENDENT = 1e-7  # part of a column of unit length that the others do not explain
_FOLD_STARTS = 8  # of the refits; the first is the fit to the whole map
_AS_GOOD = 1e-3  # parts of the cost by which two refits may differ and be called equally good
_DISAGREE = 0.01  # parts of the largest force by which they then may predict different forces
_AT_BOUND = 1e-9  # parts of the interval, or of the largest value, within which a bound is reached


@dataclasses.dataclass(frozen=True)
class PeerFit:
    """A peer fitted to a force map.

    Attributes:
        name: in the registry.
        family: parameters with units and bounds.
        values: parameters [SI] by name.
        at_bound: names of the parameters that ended on a bound.
        predicted: force [N] at the loaded readings, shape (points,).
        converged: whether the best descent ended at a stationary point.
        determined: whether the readings determine all linear parameters; if not, the values are
            the smallest that fit.
    """

    name: str
    family: PeerFamily
    values: dict[str, float]
    at_bound: tuple[str, ...]
    predicted: Float[np.ndarray, " points"]
    converged: bool
    determined: bool

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self.family.build({name: jnp.asarray(v) for name, v in self.values.items()})

    def force(self, length: famjax.Real, pressure: famjax.Real) -> Float[Array, "..."]:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        return self.model.force(length, pressure)


class _Readings(eqx.Module):
    """The loaded readings of a force map [m, Pa, N]."""

    length: Float[Array, " points"]
    pressure: Float[Array, " points"]
    force: Float[Array, " points"]


class _Ends(eqx.Module):
    """Where the fits of a batch ended, in SI."""

    nonlinear: Float[Array, "*batch p"]
    linear: Float[Array, "*batch q"]
    cost: Float[Array, "*batch"]
    converged: Bool[Array, "*batch"]
    determined: Bool[Array, "*batch"]
    predicted: Float[Array, "*batch points"]


def fit_peer(name: str, data: ForceData, *, starts: int = 32, seed: int = 0) -> PeerFit:
    """The peer of that name that fits the loaded readings of a map best, by least squares.

    Parameters in which the force is linear are solved for, by orthogonal factorisation or, where
    they are bounded, by the convex core; of those that the readings leave open, the smallest are
    taken. The others are sought in their box from many starts.

    Args:
        name: one of `peer_families(data)`.
        data: the force map; slack readings are censored. Readings count with 1/std, if given.
        starts: number of starts.
        seed: of the starts.

    Returns:
        The fit.

    Raises:
        InputError: an unknown name, no starts, too few readings, or a model that has no force at
            a reading.
        RuntimeError: float64 is off.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "fits need float64, and JAX computes in float32 by default. Put this line before any "
            'other use of JAX: jax.config.update("jax_enable_x64", True)'
        )
    if starts < 1:
        raise InputError(f"at least one start is needed, got {starts}")
    registry = peer_families(data)
    if name not in registry:
        raise InputError(f"unknown peer {name!r}; known for this map: {', '.join(registry)}")
    family = registry[name]
    points = int(data.loaded.sum())
    if points < len(family.parameters):
        raise InputError(
            f"{family.label} has {len(family.parameters)} parameters and the map {points} loaded "
            "readings: give more readings or choose a peer with fewer parameters"
        )
    box_starts = _starts(family, starts, seed)
    weights = np.tile(_weights(data), (len(box_starts), 1))
    ends = _fit_all(family, data, weights, box_starts)
    if not np.isfinite(ends.cost).any():
        raise InputError(
            f"{family.label} has no finite force at some reading, wherever it was started: its "
            "form may not hold for a muscle longer than at rest; check lengths and rest length"
        )
    best = int(np.nanargmin(ends.cost))
    nonlinear, linear = np.asarray(ends.nonlinear)[best], np.asarray(ends.linear)[best]
    values = dict(zip(_names(family), (*nonlinear.tolist(), *linear.tolist()), strict=True))
    return PeerFit(
        name=name,
        family=family,
        values=values,
        at_bound=_bounds_reached(family, values),
        predicted=np.asarray(ends.predicted)[best],
        converged=bool(np.asarray(ends.converged)[best]),
        determined=bool(np.asarray(ends.determined)[best]),
    )


def cross_validate_peer(
    fit: PeerFit, data: ForceData, groups: str = "pressure", *, seed: int = 0
) -> CrossValidation:
    """The errors of a peer at each pressure or length when refitted to the others.

    What `cross_validate` does, with all refits in the compiled call of the fit. The readings left
    out have no weight. One start is the fit to the whole map; as that has seen them, refits from
    the other starts come first wherever they are as good.

    Args:
        fit: of the whole map.
        data: the same map.
        groups: "pressure" or "length".
        seed: of the starts.

    Returns:
        The errors; nan where no refit had a finite force.

    Raises:
        InputError: other groups, or fewer than two of them.
    """
    if groups not in {"pressure", "length"}:
        raise InputError(f"a peer is cross-validated by pressure or length, got {groups!r}")
    check_groups(data, groups)
    labels = group_labels(data, groups)[data.loaded]
    levels = np.unique(labels)
    starts = _fold_starts(fit, seed)
    without = _weights(data) * (labels != levels[:, None])
    many = np.repeat(without, len(starts), axis=0)
    ends = _fit_all(fit.family, data, many, np.tile(starts, (len(levels), 1)))
    predicted, ambiguous = np.full(labels.size, math.nan), []
    for row, level in enumerate(levels):
        held = labels == level
        fold = slice(row * len(starts), (row + 1) * len(starts))
        cost, force = np.asarray(ends.cost)[fold], np.asarray(ends.predicted)[fold][:, held]
        good = np.flatnonzero(cost <= (1 + _AS_GOOD) * np.nanmin(cost, initial=math.inf))
        if good.size:
            predicted[held] = force[good[-1]]
            apart = np.ptp(force[good], axis=0).max() > _DISAGREE * data.max_force
            if apart or not np.asarray(ends.determined)[fold][good].all():
                ambiguous.append(float(level))
    errors = held_out_errors(data, "length" if groups == "length" else "pressure", predicted)
    return dataclasses.replace(errors, ambiguous=tuple(ambiguous))


def _fold_starts(fit: PeerFit, seed: int) -> Float[np.ndarray, "starts p"]:
    """The fit's own point of the unit box, then others."""
    searched = fit.family.nonlinear
    if not searched:
        return np.zeros((1, 0))
    place = [(fit.values[p.name] - p.low) / (p.high - p.low) for p in searched]
    others = latin_hypercube(len(searched), _FOLD_STARTS - 1, seed)
    return np.vstack([np.clip(place, 0, 1), others])  # rounding only can have left the box


def _starts(family: PeerFamily, count: int, seed: int) -> Float[np.ndarray, "starts p"]:
    """Starts in the unit box; a single one where nothing is searched."""
    searched = len(family.nonlinear)
    return latin_hypercube(searched, count if searched else 1, seed)


def _names(family: PeerFamily) -> tuple[str, ...]:
    return tuple(p.name for p in (*family.nonlinear, *family.linear))


def _weights(data: ForceData) -> Float[np.ndarray, " points"]:
    if data.force_std is None:
        return np.ones(int(data.loaded.sum()))
    return 1 / data.force_std[data.loaded]


def _bounds_reached(family: PeerFamily, values: dict[str, float]) -> tuple[str, ...]:
    largest = max((abs(values[p.name]) for p in family.linear), default=0.0)
    reached = []
    for p in family.parameters:
        margin = _AT_BOUND * (largest if p.linear else p.high - p.low)
        distances = (abs(values[p.name] - end) for end in (p.low, p.high) if math.isfinite(end))
        if min(distances, default=math.inf) <= margin:
            reached.append(p.name)
    return tuple(reached)


def _fit_all(family: PeerFamily, data: ForceData, weights: np.ndarray, starts: np.ndarray) -> _Ends:
    """Fits with these weights from these starts, in chunks so that one compilation serves all."""
    loaded = data.loaded
    readings = _Readings(
        *(jnp.asarray(c[loaded]) for c in (data.length, data.pressure, data.force))
    )
    chunks: list[_Ends] = []
    for first in range(0, len(starts), _CHUNK):
        rows = np.minimum(np.arange(first, first + _CHUNK), len(starts) - 1)
        ended = _fit_chunk(family, readings, jnp.asarray(weights[rows]), jnp.asarray(starts[rows]))
        kept = slice(min(_CHUNK, len(starts) - first))
        chunks.append(jax.tree.map(lambda leaf, kept=kept: np.asarray(leaf)[kept], ended))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *chunks)


@functools.partial(jax.jit, static_argnums=0, compiler_options=QUICK_COMPILATION)
def _fit_chunk(
    family: PeerFamily,
    readings: _Readings,
    weights: Float[Array, "batch points"],
    starts: Float[Array, "batch p"],
) -> _Ends:
    low = jnp.asarray([p.low for p in family.nonlinear], starts.dtype)
    high = jnp.asarray([p.high for p in family.nonlinear], starts.dtype)

    def one(weights: Float[Array, " points"], start: Float[Array, " p"]) -> _Ends:
        def residual(u: Float[Array, " p"]) -> Float[Array, " points"]:
            *_, predicted = _project(family, readings, weights, low + u * (high - low))
            return weights * (predicted - readings.force)

        end = minimise_in_box(residual, start, max_steps=_MAX_STEPS)
        nonlinear = low + end.u * (high - low)
        linear, determined, predicted = _project(family, readings, weights, nonlinear)
        return _Ends(nonlinear, linear, end.cost, end.converged, determined, predicted)

    return jax.vmap(one)(weights, starts)


def _project(
    family: PeerFamily,
    readings: _Readings,
    weights: Float[Array, " points"],
    nonlinear: Float[Array, " p"],
) -> tuple[Float[Array, " q"], Bool[Array, ""], Float[Array, " points"]]:
    """The best linear parameters, whether they are determined, and the force [N] with them."""
    names = [p.name for p in family.linear]
    given = dict(zip((p.name for p in family.nonlinear), nonlinear, strict=True))

    def force(linear: Float[Array, " q"]) -> Float[Array, " points"]:
        model = family.build({**given, **dict(zip(names, linear, strict=True))})
        return model.force(readings.length, readings.pressure)

    zero = jnp.zeros(len(names), weights.dtype)
    offset = force(zero)
    if not names:
        return zero, jnp.array(True), offset
    columns = jax.jacfwd(force)(zero)  # the force is affine in them: this is all there is
    A, b = weights[:, None] * columns, weights * (readings.force - offset)
    linear, determined = _solve(family, A, b)
    return linear, determined, offset + columns @ linear


def _solve(
    family: PeerFamily, A: Float[Array, "points q"], b: Float[Array, " points"]
) -> tuple[Float[Array, " q"], Bool[Array, ""]]:
    """The least-squares solution, within the bounds of the linear parameters if they have any."""
    size = jnp.linalg.norm(A, axis=0)
    size = jnp.where(size > 0, size, 1.0)
    if not family.nonlinear:
        solution, _, rank, _ = jnp.linalg.lstsq(A / size, b)
        return solution / size, rank == A.shape[1]
    # Far below any reading's weight: what a subset of the readings leaves open stays small.
    A = jnp.concatenate([A / size, _RIDGE * jnp.eye(size.shape[0], dtype=A.dtype)])
    b = jnp.concatenate([b, jnp.zeros_like(size)])
    limits = np.array([[p.low, -p.high] for p in family.linear]).T.ravel()
    bounded = np.flatnonzero(np.isfinite(limits))
    if bounded.size:
        unit = np.eye(size.shape[0])
        rows = jnp.asarray(np.concatenate([unit, -unit])[bounded])
        scaled = jnp.asarray(limits[bounded]) * jnp.tile(size, 2)[bounded]
        return solve_qp(A, b, rows, scaled).x / size, jnp.array(True)
    Q, R = jnp.linalg.qr(A)
    smallest = jnp.min(jnp.abs(jnp.diagonal(R)))
    return jax.scipy.linalg.solve_triangular(R, Q.T @ b) / size, smallest > _DEPENDENT
