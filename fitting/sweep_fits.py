"""The convex fits of a sweep: all orders, dependences and constraints of one force map together.

At a known geometry F = F_0 + sum_n E_n c_n, so each fit is a convex programme of two unknowns for every
order: E_n at the lowest and at the highest pressure. A law that is fixed in pressure has the first of
them; one that is free in pressure is a programme for each pressure.

A constraint along the paths, g(s) = sum_n E_n phi_n(s) >= 0 for all s in [0, 1], is posed at stations.
Where an optimum violates it most between them, it is posed as well, until nothing is violated (exchange).
Cubics that follow phi_n to rounding give the minima of g without search.

The mean RMSE is minimised by Newton's method: each step is a sum of squares with the gradient of the mean
RMSE at the last point, and nearly its curvature.

References:
    Chambers 2021, equation 7.6.
    Hettich & Kortanek 1993, SIAM Review 35, 380-429 (exchange).
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

import famjax
from famjax.boundary.errors import InputError
from famjax.compile_options import as_arrays, bulk_options, quick_jit
from famjax.parameters import Declared

from .convex import Optimum, Status, bucket, solve_qp
from .data import ForceData
from .families import assembled
from .model_families import ModelFamily
from .posing import path_end_at
from .response import Constraint, MapInputs, linear_response

_PRESSURES = 200  # of a map at most: the work grows with the square of them
_POINTS = 1024  # readings that one call of the linear model takes
_CELLS = 32  # of each path that one call samples
_SMALL = 1e-10  # of the largest value: a cubic this near to a function is the function
_NARROWEST = 1e-9  # width of a cell within which a corner of a function is a point
_STATIONS = 17  # of each path at which a constraint is posed from the start
_SPARE = 4  # rows of each path for points between its stations
_TOGETHER = 64  # programmes that a compiled program takes
_STEPS = 60
_EXACT = 1e-11  # violation per largest coefficient, and relative change by the last step
_VANISHED = 1e-3  # of the coefficient that alone would carry the force
_CERTIFIED = 1e-9  # largest residual of the optimality conditions of an exact optimum
_SHORTENED = np.array([1.0, 0.5, 0.25, 0.1, 0.02])  # parts of a step that are tried
_ROUNDED = 1e-8  # of |c_p|: the norm below which the corner of a norm is rounded off
_ALIKE = 1e-13  # relative change of an objective that is rounding
_LOOSE, _LEAST = 0.1, 1e-4  # share of the majorant in the curvature: at first, and at least

_THIRDS = np.array([0.0, 1 / 3, 2 / 3, 1.0, 0.5])
_TO_CUBIC = np.linalg.inv(np.vander(_THIRDS[:4], increasing=True))
_MIDDLE = np.vander(_THIRDS[4:], 4, increasing=True)
_linear = quick_jit(linear_response)


@functools.cache
def _programs() -> Callable[..., Optimum]:
    return jax.jit(jax.vmap(solve_qp), compiler_options=bulk_options())


@dataclasses.dataclass(frozen=True)
class Readings:
    """Loaded readings by pressure, padded to one length, and the actuation paths.

    Attributes:
        pressure: levels [Pa], increasing, shape (pressures,).
        force, length: [N, m], shape (pressures, readings).
        weight: 1/std, 1 without, 0 where there is no reading; shape (pressures, readings).
        path_end: shortest length [m] of each path, shape (pressures,).
    """

    pressure: Float[np.ndarray, " pressures"]
    force: Float[np.ndarray, "pressures readings"]
    length: Float[np.ndarray, "pressures readings"]
    weight: Float[np.ndarray, "pressures readings"]
    path_end: Float[np.ndarray, " pressures"]

    @classmethod
    def of(cls, data: ForceData, rest_length: float) -> "Readings":
        """The readings of a force map.

        The path at a pressure runs from rest to the longest length at which the muscle is slack there,
        or, where no reading is slack, to the shortest length.

        Raises:
            InputError: a pressure has no loaded reading that is shorter than the rest length, or there
                are more than 200 pressures.
        """
        loaded, pressure = data.loaded, data.pressures.level
        levels = np.unique(pressure[loaded])
        if levels.size > _PRESSURES:
            raise InputError(
                f"a sweep follows the path of each pressure, and takes {_PRESSURES} pressures at most; "
                f"the map has {levels.size}. Interpolate the readings to some pressures, or say which "
                "of them are one, by a line of the file such as `# level: pressure_tolerance_kPa = 5`; "
                "one law is fitted to all of the readings by `famjax fit` and `fitting.identify`"
            )
        ends = np.array([path_end_at(data, float(level)) for level in levels])
        short = np.flatnonzero(ends >= rest_length)
        if short.size:
            raise InputError(
                f"at {levels[short[0]] / 1e3:.5g} kPa no reading is shorter than the rest length of "
                f"{rest_length * 1e3:.5g} mm, so that no actuation path begins there: leave that "
                "pressure out"
            )
        at = [np.flatnonzero(loaded & (pressure == level)) for level in levels]
        size = max(indices.size for indices in at)
        padded = np.stack([np.pad(one, (0, size - one.size), mode="edge") for one in at])
        there = np.arange(size) < np.array([one.size for one in at])[:, None]
        std = np.ones_like(data.force) if data.force_std is None else data.force_std
        weight = np.where(there, 1 / std[padded], 0.0)
        return cls(levels, data.force[padded], data.length[padded], weight, ends)

    @property
    def there(self) -> Bool[np.ndarray, "pressures readings"]:
        """Which of the padded readings are readings."""
        return self.weight > 0


class LinearMuscle:
    """F = F_0 + sum_n E_n c_n of a muscle with a polynomial law, and what must not become negative.

    Args:
        geometry: of the muscle.
        deadband: P_d [Pa].
        terms: force terms besides braid and bladder, or None.
        order: highest of the law.
    """

    def __init__(
        self,
        geometry: famjax.geometries.AbstractGeometry,
        deadband: float,
        terms: famjax.terms.SumOfTerms | None,
        order: int,
    ) -> None:
        law = famjax.PolynomialMaterial(np.zeros(order))
        free = tuple(Declared("Pa", f"E_{n + 1}", linear=True) for n in range(order))
        self.order, self.rest_length = order, float(geometry.rest_length)
        self.shortest_length = float(geometry.length_range()[0])
        self._family = as_arrays(ModelFamily(assembled(geometry, law, deadband, terms), free))

    def columns(
        self, length: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
    ) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... order"]]:
        """F_0 [N] and c_n [N/Pa] at lengths [m] and pressures [Pa], broadcast shape."""
        shape = np.broadcast_shapes(np.shape(length), np.shape(pressure))
        points = [np.broadcast_to(v, shape).ravel().astype(float) for v in (length, pressure)]
        size, found, none = points[0].size, [], np.zeros(1)
        for first in range(0, size, _POINTS):
            count = min(_POINTS, size - first)
            at = [np.pad(v[first : first + count], (0, _POINTS - count), "edge") for v in points]
            given = self._response("none", *at, none, none, np.zeros((1, 0)))
            found.append((given.force[:count], given.columns[:count]))
        force, columns = (np.concatenate(each) for each in zip(*found, strict=True))
        return force.reshape(shape), columns.reshape(*shape, self.order)

    def rows(
        self,
        constraint: Constraint,
        path_pressure: Float[np.ndarray, " paths"],
        path_end: Float[np.ndarray, " paths"],
        s: Float[np.ndarray, "paths k"],
    ) -> Float[np.ndarray, "paths k order"]:
        """phi_n [-] at shares s of the paths from rest to their ends [m]."""
        at = np.array([self.rest_length]), np.zeros(1)
        found = self._response(constraint, *at, path_pressure, path_end, s)
        return np.asarray(found.rows).reshape(*s.shape, self.order)

    def _response(self, constraint: Constraint, length: np.ndarray, *others: np.ndarray) -> Any:
        pressure, *paths = others
        none = np.zeros_like(length)
        at = MapInputs(length, pressure, none, *paths)
        return _linear(self._family, constraint, at, np.zeros(0), np.zeros(self.order), none)


class PathTable(NamedTuple):
    """phi_n along paths as cubics in cells: sum_k cubic_k ((s - start)/width)^k.

    Attributes:
        start: of each cell, 2 for none, shape (paths, cells).
        width: of each cell, shape (paths, cells).
        cubic: coefficients, shape (paths, cells, 4, order).
    """

    start: Float[np.ndarray, "paths cells"]
    width: Float[np.ndarray, "paths cells"]
    cubic: Float[np.ndarray, "paths cells 4 order"]

    @classmethod
    def of(
        cls, evaluate: Callable[[Float[np.ndarray, "paths k"]], np.ndarray], paths: int
    ) -> "PathTable":
        """The cubics that follow functions to rounding; cells are halved until they do.

        Args:
            evaluate: phi_n at positions of each path, shape (paths, k, order).
            paths: number of paths.
        """
        edges = np.arange(_CELLS) / _CELLS
        pending = [[(low, 1 / _CELLS) for low in edges] for _ in range(paths)]
        found: list[list[tuple[float, float, np.ndarray]]] = [[] for _ in range(paths)]
        size: Any = 0.0
        while any(pending):
            now = np.array([(some + [(0.0, 1.0)] * _CELLS)[:_CELLS] for some in pending])
            at = now[..., :1] + now[..., 1:] * _THIRDS
            values = evaluate(at.reshape(paths, -1)).reshape(*at.shape, -1)
            size = np.maximum(size, np.abs(values).max(axis=(1, 2)))
            cubics = _TO_CUBIC @ values[:, :, :4]
            off = np.abs(_MIDDLE @ cubics - values[:, :, 4:])[:, :, 0]
            # Where the geometry ends the values are not numbers, and no halving helps.
            rough = (off > _SMALL * size[:, None]).any(axis=-1) & (now[..., 1] > _NARROWEST)
            for path, some in enumerate(pending):
                sampled, pending[path] = some[:_CELLS], some[_CELLS:]
                for k, (low, wide) in enumerate(sampled):
                    if rough[path, k]:
                        pending[path] += [(low, wide / 2), (low + wide / 2, wide / 2)]
                    else:
                        found[path].append((low, wide, cubics[path, k]))
        most = max(len(some) for some in found)
        start, width = np.full((paths, most), 2.0), np.ones((paths, most))
        cubic = np.zeros((paths, most, *found[0][0][2].shape))
        for path, some in enumerate(found):
            some.sort(key=lambda cell: cell[0])
            for k, (low, wide, one) in enumerate(some):
                start[path, k], width[path, k], cubic[path, k] = low, wide, one
        return cls(start, width, cubic)

    @classmethod
    def of_slope(cls, at_end: Float[np.ndarray, "paths order"]) -> "PathTable":
        """The law's own tangent, phi_n(s) = s^(n - 1) phi_n(1): a cubic up to the fourth order."""
        paths, order = at_end.shape
        cubic = np.zeros((paths, 1, 4, order))
        cubic[:, 0, np.arange(order), np.arange(order)] = at_end
        return cls(np.zeros((paths, 1)), np.ones((paths, 1)), cubic)

    def at(
        self, path: Int[np.ndarray, "*#batch"], s: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch order"]:
        """phi_n at positions of paths."""
        cell = (self.start[path] <= s[..., None]).sum(axis=-1) - 1
        t = (s - self.start[path, cell]) / self.width[path, cell]
        return (t[..., None, None] ** np.arange(4) @ self.cubic[path, cell])[..., 0, :]

    def weakest(
        self, E: Float[np.ndarray, "*batch paths order"]
    ) -> tuple[Float[np.ndarray, "*batch paths"], Float[np.ndarray, "*batch paths"]]:
        """The smallest g = sum_n E_n phi_n [Pa] of each path, and where it is."""
        cells = self.start.shape[1]
        flat = self.cubic.reshape(len(self.start), -1, E.shape[-1])
        c = (flat @ E[..., None]).reshape(*E.shape[:-1], cells, 4)
        # c_1 + 2 c_2 t + 3 c_3 t^2 rises through zero where g has its minimum. Nothing cancels.
        square = c[..., 2] ** 2 - 3 * c[..., 3] * c[..., 1]
        root = np.sqrt(np.maximum(square, 0.0))
        up = c[..., 2] > 0
        over = np.where(up, c[..., 2] + root, 3 * c[..., 3])
        t = np.where(up, -c[..., 1], root - c[..., 2]) / np.where(over == 0, 1.0, over)
        t = np.clip(np.where((square > 0) & (over != 0), t, 0.0), 0.0, 1.0)
        inside = c[..., 0] + t * (c[..., 1] + t * (c[..., 2] + t * c[..., 3]))
        ends = c[..., 0], c.sum(axis=-1)
        least = np.minimum(np.minimum(*ends), inside)
        t = np.where(least == inside, t, np.where(least == ends[0], 0.0, 1.0))
        least = np.where(self.start > 1, np.inf, least)
        best = least.argmin(axis=-1)[..., None]
        value, t = (np.take_along_axis(one, best, axis=-1)[..., 0] for one in (least, t))
        paths = np.arange(len(self.start))
        s = self.start[paths, best[..., 0]] + t * self.width[paths, best[..., 0]]
        return value, np.minimum(s, 1.0)


@dataclasses.dataclass(frozen=True)
class Design:
    """The linear problem that all fits of a force map share.

    Attributes:
        muscle: of any coefficients.
        readings: of the map.
        A, target: c_n [N/Pa] and F - F_0 [N] at the readings, shapes (pressures, readings, order) and
            (pressures, readings).
        factor: triangle of [A target], weighted, shape (pressures, order + 1, order + 1).
        basis: shares of the coefficients at the lowest and the highest pressure, (pressures, 2).
        tables: of the constraints along the paths, by name.
    """

    muscle: LinearMuscle
    readings: Readings
    A: Float[np.ndarray, "pressures readings order"]
    target: Float[np.ndarray, "pressures readings"]
    factor: Float[np.ndarray, "pressures rows rows"]
    basis: Float[np.ndarray, "pressures 2"]
    tables: dict[str, PathTable]

    @classmethod
    def of(cls, muscle: LinearMuscle, readings: Readings) -> "Design":
        """The problem of some readings.

        Raises:
            InputError: the muscle has no force at a reading.
        """
        pressure, weight = readings.pressure, readings.weight[..., None]
        braid, A = muscle.columns(readings.length, pressure[:, None])
        known = np.isfinite(braid) & np.isfinite(A).all(axis=-1)
        lost = np.argwhere(readings.there & ~known)
        if lost.size:
            k, n = lost[0]
            raise InputError(
                f"the muscle must have a force at every loaded reading; it has none at {len(lost)} of "
                f"them, first at {readings.length[k, n] * 1e3:.5g} mm and {pressure[k] / 1e3:.5g} kPa: "
                "the geometry does not reach it, or a force term is no number there"
            )
        target, order = readings.force - braid, muscle.order
        rows = np.concatenate([A, target[..., None]], axis=-1) * weight
        rows = np.pad(rows, ((0, 0), (0, order + 1), (0, 0)))
        share = (pressure - pressure[0]) / max(pressure[-1] - pressure[0], 1.0)
        paths = pressure, readings.path_end
        at_end = muscle.rows("slope", *paths, np.ones((pressure.size, 1)))[:, 0]
        drucker = PathTable.of(lambda s: muscle.rows("drucker", *paths, s), pressure.size)
        return cls(
            muscle, readings, A, target, np.asarray(np.linalg.qr(rows, mode="r")),
            np.stack([1 - share, share], axis=-1),
            {"slope": PathTable.of_slope(at_end), "drucker": drucker},
        )  # fmt: skip


class Fits(NamedTuple):
    """Certified optima, along the axes of what was asked for.

    Attributes:
        coefficients: E_n [Pa] at each pressure, shape (..., pressures, order); nan unless OPTIMAL.
        objective: its minimum.
        kkt_residual, duality_gap: certificate, relative.
        condition: of the columns, see `convex.Optimum`.
        status: a `Status`.
    """

    coefficients: Float[np.ndarray, "*fits pressures order"]
    objective: Float[np.ndarray, "*fits"]
    kkt_residual: Float[np.ndarray, "*fits"]
    duality_gap: Float[np.ndarray, "*fits"]
    condition: Float[np.ndarray, "*fits"]
    status: Int[np.ndarray, "*fits"]


def coupled_fits(
    of: Design,
    dependences: tuple[str, ...],
    orders: tuple[int, ...],
    constraints: tuple[str, ...],
    objective: str,
) -> tuple[Fits, Float[np.ndarray, "*fits pressures"]]:
    """The fits of laws that are fixed or linear in pressure.

    Args:
        of: the linear problem.
        dependences: "fixed" and "linear", or one of them.
        orders: of the law.
        constraints: some of `response.CONSTRAINTS`.
        objective: "sum_of_squares" or "mean_rmse".

    Returns:
        The fits, axes (dependences, orders, constraints). And the sum of squares [N^2] at each pressure
        while it was left out; nan where the law says nothing of another pressure.
    """
    count = len(of.target)
    shape = len(constraints), len(dependences), len(orders), count + 1
    kind, form, order, left = (axis.ravel() for axis in np.indices(shape))
    linear = np.array([name == "linear" for name in dependences])[form]
    bases = np.stack([np.tile([1.0, 0.0], (count, 1)), of.basis])[1 * linear]
    keeps = np.concatenate([np.ones((1, count)), 1 - np.eye(count)])[left]
    used = (
        _used(of, np.array(orders)[order])
        & np.stack([np.ones_like(linear), linear], axis=-1)[:, None]
    )
    whole = _Programmes(np.array(constraints)[kind], bases, used.reshape(len(kind), -1), keeps)
    found = _solved(of, whole, objective)
    found = Fits(*(np.moveaxis(v.reshape(*shape, *v.shape[1:]), 0, 2) for v in found))
    E = found.coefficients[:, :, :, 1:]
    own = E[..., np.arange(count), np.arange(count), :]
    square = (_residual(of, own) ** 2).sum(axis=-1)
    known = count > 1 + (np.array(dependences) == "linear")
    return (
        Fits(*(leaf[:, :, :, 0] for leaf in found)),
        np.where(known[:, None, None, None], square, np.nan),
    )


def free_fits(
    of: Design, orders: tuple[int, ...], constraints: tuple[str, ...], objective: str
) -> Fits:
    """The fits of laws that are free in pressure, axes (orders, constraints).

    At one pressure the RMSE is smallest where the sum of squares is.
    """
    count = len(of.target)
    shape = len(constraints), len(orders), count
    kind, order, at = (axis.ravel() for axis in np.indices(shape))
    alone = np.eye(count)[at]
    used = _used(of, np.array(orders)[order]) & np.array([True, False])
    whole = _Programmes(
        np.array(constraints)[kind],
        alone[..., None] * [1.0, 0.0],
        used.reshape(len(kind), -1),
        alone,
    )
    found = _solved(of, whole, "sum_of_squares")
    found = Fits(*(np.swapaxes(v.reshape(*shape, *v.shape[1:]), 0, 1) for v in found))
    value = found.objective.sum(axis=-1)
    if objective == "mean_rmse":
        value = np.sqrt(2 * found.objective / of.readings.there.sum(axis=1)).mean(axis=-1)
    worst = (leaf.max(axis=-1) for leaf in found[2:])
    E = found.coefficients[..., np.arange(count), np.arange(count), :]
    return Fits(E, value, *worst)


def _used(of: Design, order: Int[np.ndarray, " b"]) -> Bool[np.ndarray, "b order 1"]:
    return (np.arange(of.muscle.order) < order[:, None])[..., None]


def _residual(
    of: Design, E: Float[np.ndarray, "*fits pressures order"]
) -> Float[np.ndarray, "*fits pressures readings"]:
    """Model minus measured [N]; zero where there is no reading."""
    return np.where(of.readings.there, (of.A @ E[..., None])[..., 0] - of.target, 0.0)


class _Programmes(NamedTuple):
    """Programmes along a leading axis; unknown 2 n + j is coefficient n at end j of the pressures.

    Attributes:
        constraint: names, shape (b,).
        basis: of the coefficients at the pressures; zero where a pressure has no part, (b, pressures, 2).
        used: unknowns that the law has, shape (b, 2 order).
        keep: 0 for a pressure that is left out, shape (b, pressures).
    """

    constraint: np.ndarray
    basis: Float[np.ndarray, "b pressures 2"]
    used: Bool[np.ndarray, "b n"]
    keep: Float[np.ndarray, "b pressures"]


def _solved(of: Design, whole: _Programmes, objective: str) -> Fits:
    """The optima of programmes, some of them at a time."""
    found, count = [], len(whole.used)
    size = min(_TOGETHER, bucket(count, 16))
    for first in range(0, count, size):
        every = np.minimum(np.arange(first, first + size), count - 1)
        fits = _optima(of, _Programmes(*(leaf[every] for leaf in whole)), objective)
        found.append([leaf[: count - first] for leaf in fits])
    return Fits(*(np.concatenate(leaves) for leaves in zip(*found, strict=True)))


def _optima(of: Design, given: _Programmes, objective: str) -> Fits:
    """The optima of programmes: steps, and rows for points between stations, until both end."""
    order, count, smooth = of.muscle.order, len(given.used), objective == "mean_rmse"
    n, basis, keep = 2 * order, given.basis, given.keep[:, :, None]
    W = of.factor[:, :, :order, None] * basis[:, :, None, None, :]
    W = W.reshape(count, -1, order + 1, n) * keep[..., None] * given.used[:, None, None]
    c = of.factor[:, :, order] * keep
    share = 1 / (np.sqrt(of.readings.there.sum(axis=1)) * len(of.target))
    absent = np.eye(n) * ~given.used[:, None]
    G, x = _posed(of, given), np.zeros((count, n))
    least_size = _VANISHED * _carrying_alone(W, c)
    loose, done, outside = np.full(count, _LOOSE), *np.zeros((2, count), bool)
    status = last = np.full(count, int(Status.STALLED))
    condition, value, kkt_residual, gap = np.full((4, count), np.nan)
    for step in range(_STEPS):
        A, b, first = W, c, step == 0
        if smooth and not first:
            share_of_majorant = np.where(outside, 1.0, loose)
            A, b = _newton_model(W, c, x, share, share_of_majorant, _rounding(step))
        best = _optimum(A, b, absent, G)
        last = best.status
        new = np.where(done[:, None], x, best.x)
        change = _length(W, new - x) / np.maximum(_length(W, new), np.finfo(float).tiny)
        still = np.full(count, not smooth) | ((change <= _EXACT) & (_rounding(step) <= _ROUNDED))
        if smooth and not first:
            part = _best_part(W, c, x, new, share, _rounding(step))
            part = np.where(outside | ~np.isfinite(change), 1.0, part)
            factor = np.where(part < 1, 10.0, 0.1)
            loose = np.where(outside, loose, np.clip(loose * factor, _LEAST, 1.0))
            new = x + part[:, None] * (new - x)
        optimal = best.status == int(Status.OPTIMAL)
        certificate = best.objective, best.kkt_residual, best.duality_gap
        if smooth:
            certificate = _certificate(W, c, new, share, G, best.multipliers)
        violation = _pose_weakest(of, given, new, G, step % _SPARE, least_size)
        ended = ~done & ((still & (violation <= _EXACT)) | ~optimal)
        value, kkt_residual, gap = (
            np.where(done, old, one)
            for old, one in zip((value, kkt_residual, gap), certificate, strict=True)
        )
        kkt_residual = np.where(done, kkt_residual, np.maximum(kkt_residual, violation))
        condition = best.condition if first else condition
        status = np.where(ended, best.status, status)
        x, done, outside = new, done | ended, violation > _EXACT
        if done.all():
            break
    # The last steps move by rounding: the certificate tells.
    status = np.where(done, status, last)
    wrong = (status == int(Status.OPTIMAL)) & ~(kkt_residual < _CERTIFIED)
    status = np.where(wrong, int(Status.STALLED), status)
    E = np.where((status == int(Status.OPTIMAL))[:, None, None], _coefficients(given, x), np.nan)
    # The unknowns that a law has not are columns of unit length.
    on = given.used.sum(axis=1)
    condition = np.sqrt(on * (condition**2 / n - (n - on)))
    return Fits(E, value, kkt_residual, gap, condition, status)


def _optimum(
    A: Float[np.ndarray, "b pressures rows n"],
    b: Float[np.ndarray, "b pressures rows"],
    absent: Float[np.ndarray, "b n n"],
    G: Float[np.ndarray, "b pressures points n"],
) -> Optimum:
    """The minimisers of |A x - b| with G x >= 0; what a law has not is zero."""
    count, n = len(A), A.shape[-1]
    rows = np.concatenate([A, b[..., None]], axis=-1).reshape(count, -1, n + 1)
    none = np.pad(absent, ((0, 0), (0, 0), (0, 1)))
    R: Any = np.linalg.qr(np.concatenate([rows, none], axis=1), mode="r")
    G = G.reshape(count, -1, n)
    G = np.pad(G, ((0, 0), (0, bucket(G.shape[1], 32) - G.shape[1]), (0, 0)))
    found = _programs()(R[..., :-1], R[..., -1], G, np.zeros(G.shape[:2]))
    return jax.tree.map(np.asarray, found)


def _posed(of: Design, given: _Programmes) -> Float[np.ndarray, "b pressures points n"]:
    """Rows that hold from the start, and rows of zeros to be filled."""
    count, n = given.used.shape
    paths = len(of.target)
    G = np.zeros((count, paths, _STATIONS + _SPARE, n))
    positive = given.constraint == "positive"
    G.reshape(count, -1, n)[positive, :n] = np.eye(n) * given.used[positive, None]
    stations = np.tile(np.linspace(0, 1, _STATIONS), (paths, 1))
    for name, table in of.tables.items():
        phi = table.at(np.arange(paths)[:, None], stations)
        mine = given.constraint == name
        G[mine, :, :_STATIONS] = _rows(given, mine, phi[None])
    return G


def _rows(
    given: _Programmes, mine: Bool[np.ndarray, " b"], phi: Float[np.ndarray, "#m pressures k order"]
) -> Float[np.ndarray, "m pressures k n"]:
    """phi_n as rows on the unknowns of some programmes."""
    rows = phi[..., None] * given.basis[mine][:, :, None, None, :]
    return rows.reshape(*rows.shape[:3], given.used.shape[1]) * given.used[mine][:, None, None]


def _coefficients(
    given: _Programmes, x: Float[np.ndarray, "b n"]
) -> Float[np.ndarray, "b pressures order"]:
    """E_n [Pa] at the pressures."""
    return given.basis @ x.reshape(len(x), -1, 2).swapaxes(1, 2)


def _pose_weakest(
    of: Design,
    given: _Programmes,
    x: Float[np.ndarray, "b n"],
    G: Float[np.ndarray, "b pressures points n"],
    slot: int,
    least_size: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " b"]:
    """The largest violation per largest coefficient; the weakest point of each path becomes a row.

    Of a law that all but vanishes it is per `least_size` [Pa].
    """
    violation, E = np.zeros(len(x)), _coefficients(given, x)
    size = np.maximum(np.abs(E).max(axis=(1, 2), initial=0.0), least_size)
    paths = np.arange(len(of.target))
    for name, table in of.tables.items():
        mine = given.constraint == name
        least, s = table.weakest(E[mine])
        own = np.nan_to_num(-least / size[mine, None])
        violation[mine] = own.max(axis=1, initial=0.0)
        rows = _rows(given, mine, table.at(paths, s)[:, :, None])[:, :, 0]
        old = G[mine, :, _STATIONS + slot]
        G[mine, :, _STATIONS + slot] = np.where((own > _EXACT)[..., None], rows, old)
    return violation


def _carrying_alone(W: np.ndarray, c: np.ndarray) -> Float[np.ndarray, " b"]:
    """The largest coefficient [Pa] by which one unknown alone would carry the force."""
    length = np.linalg.norm(W, axis=(1, 2))
    alone = np.linalg.norm(c, axis=(1, 2))[:, None] / np.where(length > 0, length, np.inf)
    return np.maximum(alone.max(axis=1, initial=0.0), np.finfo(float).tiny)


def _rounding(step: int) -> float:
    """Of |c_p|: the first steps see a smoother function."""
    return max(0.1**step, _ROUNDED)


def _norms(
    W: np.ndarray, c: np.ndarray, x: np.ndarray, rounding: float
) -> tuple[np.ndarray, np.ndarray]:
    """r_p = W_p x - c_p, and sqrt(|r_p|^2 + (rounding |c_p|)^2)."""
    r = (W @ x[:, None, :, None])[..., 0] - c
    return r, np.sqrt((r**2).sum(axis=-1) + rounding**2 * (c**2).sum(axis=-1))


def _length(W: np.ndarray, x: np.ndarray) -> Float[np.ndarray, " b"]:
    """|W x| over all pressures."""
    return np.linalg.norm(W @ x[:, None, :, None], axis=(1, 2))[:, 0]


def _newton_model(
    W: Float[np.ndarray, "b pressures rows n"],
    c: Float[np.ndarray, "b pressures rows"],
    x: Float[np.ndarray, "b n"],
    share: Float[np.ndarray, " pressures"],
    loose: Float[np.ndarray, " b"],
    rounding: float,
) -> tuple[Float[np.ndarray, "b pressures rows n"], Float[np.ndarray, "b pressures rows"]]:
    """A and b of the sum of squares with the gradient of sum_p share_p |r_p| at x.

    Its curvature is (1 - loose) times that of the norms, and `loose` times their majorant, share_p / |r_p|.
    """
    r, norm = _norms(W, c, x, rounding)
    positive = np.where(norm > 0, norm, 1.0)
    along = np.sqrt(1 - (1 - loose)[:, None] * (r**2).sum(axis=-1) / positive**2)[..., None]
    size = np.linalg.norm(r, axis=-1, keepdims=True)
    unit = r / np.where(size > 0, size, 1.0)
    weight = np.sqrt(share / positive)[..., None]
    A = W - (1 - along)[..., None] * unit[..., None] * (unit[..., None, :] @ W)
    A = weight[..., None] * A
    return A, (A @ x[:, None, :, None])[..., 0] - weight * r / along


def _best_part(
    W: np.ndarray, c: np.ndarray, x: np.ndarray, new: np.ndarray, share: np.ndarray, rounding: float
) -> Float[np.ndarray, " b"]:
    """The largest part of each step that leads lowest, but for rounding."""
    rounding = rounding if rounding > _ROUNDED else 0.0
    tried = np.array([
        (share * _norms(W, c, x + part * (new - x), rounding)[1]).sum(axis=1)
        for part in _SHORTENED
    ])  # fmt: skip
    return _SHORTENED[np.argmax(tried <= (1 + _ALIKE) * tried.min(axis=0), axis=0)]


def _certificate(
    W: np.ndarray,
    c: np.ndarray,
    x: Float[np.ndarray, "b n"],
    share: np.ndarray,
    G: np.ndarray,
    multipliers: Float[np.ndarray, "b m"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean RMSE, residual of its optimality conditions, and duality gap, both relative.

    The residual is in parts of the data: readings that differ by so much have their optimum there.
    Any u_p with |u_p| <= share_p and sum_p W_p^T u_p = G^T l, l >= 0, bounds the optimum: it is no less
    than -sum_p u_p c_p. The gap is sum_p share_p |r_p| - u_p r_p + x (G^T l + what is left of the
    conditions).
    """
    r, norm = _norms(W, c, x, _ROUNDED)
    u = (share / np.where(norm > 0, norm, 1.0))[..., None] * r
    value = (share * _norms(W, c, x, 0.0)[1]).sum(axis=1)
    G = G.reshape(len(x), -1, x.shape[1])
    pull = (multipliers[:, None, : G.shape[1]] @ G)[:, 0]
    left = (u[..., None, :] @ W)[..., 0, :].sum(axis=1) - pull
    size, tiny = np.linalg.norm(c, axis=-1), np.finfo(float).tiny
    reach = share * np.maximum(1.0, size / np.where(norm > 0, norm, 1.0))
    most = (reach[..., None] * np.linalg.norm(W, axis=2)).sum(axis=1)
    scale = (share * size).sum(axis=1) * _ROUNDED
    gap = value - (u * r).sum(axis=(1, 2))
    gap = gap + np.abs((left * x).sum(axis=1)) + np.abs((pull * x).sum(axis=1))
    residual = np.abs(left / np.maximum(most, tiny)).max(axis=1)
    return value, residual, gap / np.maximum(value, scale + tiny)
