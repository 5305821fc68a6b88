"""Convex fits in a sweep: all orders, pressure dependences and constraints for one force map together.

For a known geometry F = F_0 + sum_n E_n c_n, so each fit is a convex programme with two unknowns for every
order, E_n at the lowest and at the highest pressure. A law with fixed dependence uses only the first of
these; a law with free dependence has a separate programme for each pressure.

A constraint along the paths, g(s) = sum_n E_n phi_n(s) >= 0 for all s in [0, 1], is imposed at stations.
The point at which an optimum violates the constraint most becomes a further station, until no violation
remains (exchange). Piecewise cubics approximate phi_n to rounding error, so the minima of g are found in
closed form.

The mean RMSE is minimised by reweighting: each step minimises a sum of squares that has the gradient of
the mean RMSE at the previous point and an equal or larger curvature.

References:
    Chambers 2021, equation 7.6.
    Weiszfeld 1937 (reweighted sums of norms).
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

from .convex import Optimum, Status, bucket, solve_qp
from .data import ForceData
from .families import assembled
from .model_families import ModelSource
from .posing import path_end_at
from .response import Constraint, MapInputs, MuscleFamily, linear_response

_PRESSURES = 200  # maximum per map; the cost grows with the square
_STATIONS = 17  # positions on each path at which a constraint is posed initially
_SPARE = 4  # rows of each path for points between its stations
_STEPS = 60
_CELLS = 128  # cells of a path at first, and the largest number
_MOST_CELLS = 1024
_EXACT = 1e-11  # violation relative to the largest coefficient
_ROUNDED = 1e-8  # relative to |c_p|: smoothing of the corner of a norm
_SETTLED = 1e-11  # residual of the optimality conditions at which the steps end
_TINY = float(np.finfo(float).tiny)

_THIRDS = np.array([0.0, 1 / 3, 2 / 3, 1.0, 0.5])
_TO_CUBIC = np.linalg.inv(np.vander(_THIRDS[:4], increasing=True))
_MIDDLE = np.vander(_THIRDS[4:], 4, increasing=True)
_linear = quick_jit(linear_response)


@functools.cache
def _programs() -> Callable[..., Optimum]:
    return jax.jit(jax.vmap(solve_qp), compiler_options=bulk_options())


def _in_chunks(call: Callable[..., Any], size: int, *given: np.ndarray) -> Any:
    """Apply a function to arrays of any length, `size` rows at a time, with one compiled program."""
    count, found = len(given[0]), []
    for first in range(0, count, size):
        rows = np.minimum(np.arange(first, first + size), count - 1)
        found.append(call(*(one[rows] for one in given)))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *found)


class LinearMuscle:
    """Muscle with a polynomial law: F = F_0 + sum_n E_n c_n, and its constraints.

    Args:
        geometry: geometry of the muscle.
        deadband: P_d [Pa].
        terms: force terms in addition to braid and bladder, or None.
        order: highest order of the law.
    """

    def __init__(
        self, geometry: famjax.geometries.AbstractGeometry, deadband: float,
        terms: famjax.terms.SumOfTerms | None, order: int,
    ) -> None:  # fmt: skip
        law = famjax.PolynomialMaterial(np.zeros(order))
        free = tuple(f"E_{n + 1}" for n in range(order))
        self.order, self.rest_length = order, float(geometry.rest_length)
        self.shortest_length = float(geometry.length_range()[0])
        source = ModelSource(as_arrays(assembled(geometry, law, deadband, terms)))
        self._family = MuscleFamily((), free, source, None, np.asarray(self.rest_length))

    def columns(
        self, length: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
    ) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... order"]]:
        """Return F_0 [N] and c_n [N/Pa] at lengths [m] and pressures [Pa], which are broadcast together."""
        none = np.zeros(1), np.zeros(1), np.zeros((1, 0))
        at = [1.0 * one for one in np.broadcast_arrays(length, pressure)]
        force, columns = _in_chunks(
            lambda *points: self._response("none", *points, *none)[:2],
            1024, *(one.ravel() for one in at),
        )  # fmt: skip
        return force.reshape(at[0].shape), columns.reshape(*at[0].shape, self.order)

    def rows(
        self,
        constraint: Constraint,
        pressure: Float[np.ndarray, " cells"],
        path_end: Float[np.ndarray, " cells"],
        s: Float[np.ndarray, "cells k"],
    ) -> Float[np.ndarray, "cells k order"]:
        """Return phi_n [-] at relative positions s on paths from rest to their ends [m]."""
        rest = np.array([self.rest_length]), np.zeros(1)
        return _in_chunks(
            lambda *paths: self._response(constraint, *rest, *paths).rows.reshape(
                len(paths[0]), s.shape[1], self.order
            ),
            256, pressure, path_end, s,
        )  # fmt: skip

    def _response(self, constraint: Constraint, length: np.ndarray, *others: np.ndarray) -> Any:
        at = MapInputs(length, others[0], np.zeros_like(length), *others[1:])
        return _linear(self._family, constraint, at, np.zeros(0), np.zeros(self.order), at.force)


class PathTable(NamedTuple):
    """phi_n along paths as cubics on equal cells: sum_k cubic_k t^k with t = cells s - cell.

    Attributes:
        cubic: coefficients, shape (paths, cells, 4, order).
    """

    cubic: Float[np.ndarray, "paths cells 4 order"]

    @classmethod
    def of(
        cls, evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray], paths: int, cells: int
    ) -> "PathTable":
        """Approximate functions by cubics to rounding error, halving the cells until both agree.

        Args:
            evaluate: maps paths, shape (m,), and positions, shape (m, k), to phi_n, shape (m, k, order).
            paths: number of paths.
            cells: initial number of cells of each path.
        """
        path, cell = (one.ravel() for one in np.indices((paths, cells)))
        values = evaluate(path, (cell[:, None] + _THIRDS) / cells)
        cubic = _TO_CUBIC @ values[:, :4]
        off = np.abs(_MIDDLE @ cubic - values[:, 4:])
        # Beyond the geometry's limits the values are nan, and halving does not help.
        rough = off > 1e-10 * np.nan_to_num(np.abs(values)).max(axis=(0, 1))
        if rough.any() and cells < _MOST_CELLS:
            return cls.of(evaluate, paths, 2 * cells)
        return cls(cubic.reshape(paths, cells, *cubic.shape[1:]))

    def at(
        self, path: Int[np.ndarray, "*#batch"], s: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch order"]:
        """Return phi_n at positions on paths."""
        cells = self.cubic.shape[1]
        cell = np.minimum(np.nan_to_num(cells * s).astype(int), cells - 1)
        t = (cells * s - cell)[..., None, None]
        return (t ** np.arange(4) @ self.cubic[path, cell])[..., 0, :]

    def weakest(
        self, E: Float[np.ndarray, "*batch paths order"]
    ) -> tuple[Float[np.ndarray, "*batch paths"], Float[np.ndarray, "*batch paths"]]:
        """Return the smallest g = sum_n E_n phi_n [Pa] on each path, and its position."""
        paths, cells = self.cubic.shape[:2]
        flat = self.cubic.reshape(paths, -1, E.shape[-1])
        c = np.moveaxis((flat @ E[..., None]).reshape(*E.shape[:-1], cells, 4), -1, 0)
        # c_1 + 2 c_2 t + 3 c_3 t^2 rises through zero at the minimum of g; no cancellation.
        root, up = np.sqrt(np.maximum(c[2] ** 2 - 3 * c[3] * c[1], 0.0)), c[2] > 0
        over = np.where(up, c[2] + root, 3 * c[3])
        inside = np.where(up, -c[1], root - c[2]) / np.where(over == 0, 1.0, over)
        t = np.stack([0 * inside, np.clip(inside, 0.0, 1.0), 0 * inside + 1], axis=-1)
        c0, c1, c2, c3 = c[..., None]
        g = c0 + t * (c1 + t * (c2 + t * c3))
        g, t = (one.reshape(*E.shape[:-1], 3 * cells) for one in (g, t))
        best = g.argmin(axis=-1)[..., None]
        value, t = (np.take_along_axis(one, best, axis=-1)[..., 0] for one in (g, t))
        return value, np.minimum((best[..., 0] // 3 + t) / cells, 1.0)


@dataclasses.dataclass(frozen=True)
class Design:
    """Linear problem shared by all fits to a map, with the same padded number of readings at each pressure.

    Attributes:
        muscle: the muscle, for any coefficients.
        pressure: levels [Pa], increasing, shape (pressures,).
        force, length: force [N] and length [m] of the loaded readings, shape (pressures, readings).
        weight: 1/std, or 1; 0 for padding, shape (pressures, readings).
        path_end: shortest length [m] of each path, shape (pressures,).
        A, target: c_n [N/Pa] and F - F_0 [N] at the readings, shapes (pressures, readings, order) and
            (pressures, readings).
        factor: triangular factor of the weighted [A target], shape (pressures, order + 1, order + 1).
        tables: constraints along the paths, by name.
    """

    muscle: LinearMuscle
    pressure: Float[np.ndarray, " pressures"]
    force: Float[np.ndarray, "pressures readings"]
    length: Float[np.ndarray, "pressures readings"]
    weight: Float[np.ndarray, "pressures readings"]
    path_end: Float[np.ndarray, " pressures"]
    A: Float[np.ndarray, "pressures readings order"]
    target: Float[np.ndarray, "pressures readings"]
    factor: Float[np.ndarray, "pressures rows rows"]
    tables: dict[str, PathTable]

    @classmethod
    def of(cls, muscle: LinearMuscle, data: ForceData) -> "Design":
        """Set up the problem of a force map.

        The path at a pressure runs from rest to the longest length at which the muscle is slack, or
        to the shortest length if no reading is slack.

        Raises:
            InputError: the path at a pressure does not extend below the rest length, there are more than
                200 pressures, or the force is undefined at a reading.
        """
        loaded, level, rest = data.loaded, data.pressures.level, muscle.rest_length
        pressure = np.unique(level[loaded])
        if pressure.size > _PRESSURES:
            raise InputError(
                f"a sweep needs a path for each pressure and accepts at most {_PRESSURES} pressures; the "
                f"map has {pressure.size}. Group the pressures with a line in the file, such as "
                "`# level: pressure_tolerance_kPa = 5`, or fit one law to all readings with `famjax fit`"
            )
        path_end = np.array([path_end_at(data, float(one)) for one in pressure])
        short = np.flatnonzero(path_end >= rest)
        if short.size:
            raise InputError(
                f"at {pressure[short[0]] / 1e3:.5g} kPa no reading is shorter than the rest length of "
                f"{rest * 1e3:.5g} mm, so there is no actuation path: remove the readings at that pressure"
            )
        at = [np.flatnonzero(loaded & (level == one)) for one in pressure]
        size = max(rows.size for rows in at)
        padded = np.stack([np.pad(rows, (0, size - rows.size), mode="edge") for rows in at])
        there = np.arange(size) < np.array([rows.size for rows in at])[:, None]
        std = np.ones_like(data.force) if data.force_std is None else data.force_std
        length, weight = data.length[padded], np.where(there, 1 / std[padded], 0.0)
        braid, A = muscle.columns(length, pressure[:, None])
        lost = np.argwhere(there & ~(np.isfinite(braid) & np.isfinite(A).all(axis=-1)))
        if lost.size:
            k, n = lost[0]
            raise InputError(
                f"the force must be defined at every loaded reading; it is undefined (nan) at {len(lost)} "
                f"of them, first at {length[k, n] * 1e3:.5g} mm and {pressure[k] / 1e3:.5g} kPa: "
                "the geometry does not cover that state, or a force term is nan there"
            )
        target = data.force[padded] - braid
        rows = np.concatenate([A, target[..., None]], axis=-1) * weight[..., None]
        factor = np.linalg.qr(np.pad(rows, ((0, 0), (0, muscle.order + 1), (0, 0))), mode="r")

        def table(constraint: Constraint, cells: int) -> PathTable:
            def evaluate(path: np.ndarray, s: np.ndarray) -> np.ndarray:
                return muscle.rows(constraint, pressure[path], path_end[path], s)

            return PathTable.of(evaluate, pressure.size, cells)

        # The tangent of the law is a cubic up to order 4.
        tables = {"slope": table("slope", 1), "drucker": table("drucker", _CELLS)}
        return cls(
            muscle, pressure, data.force[padded], length, weight, path_end, A, target,
            np.asarray(factor), tables,
        )  # fmt: skip

    @property
    def there(self) -> Bool[np.ndarray, "pressures readings"]:
        """True for readings, false for padding."""
        return self.weight > 0

    def residual(
        self, E: Float[np.ndarray, "*fits pressures order"]
    ) -> Float[np.ndarray, "*fits pressures readings"]:
        """Model minus measured [N]; zero for padding."""
        return np.where(self.there, (self.A @ E[..., None])[..., 0] - self.target, 0.0)


class Fits(NamedTuple):
    """Certified optima of several fits.

    Attributes:
        coefficients: E_n [Pa] at each pressure, shape (..., pressures, order); nan unless OPTIMAL.
        objective: minimum of the objective.
        kkt_residual, duality_gap: certificate of optimality, as relative values.
        status: a `Status`.
    """

    coefficients: Float[np.ndarray, "*fits pressures order"]
    objective: Float[np.ndarray, "*fits"]
    kkt_residual: Float[np.ndarray, "*fits"]
    duality_gap: Float[np.ndarray, "*fits"]
    status: Int[np.ndarray, "*fits"]


class _Programmes(NamedTuple):
    """Programmes along a leading axis; unknown 2 n + j is coefficient n at pressure end j.

    Attributes:
        constraint: names of the constraints, shape (b,).
        basis: weights of the two ends at each pressure, zero to exclude a pressure, shape
            (b, pressures, 2).
        used: true for unknowns of the law, shape (b, 2 order).
        keep: 0 for a held-out pressure, shape (b, pressures).
    """

    constraint: np.ndarray
    basis: Float[np.ndarray, "b pressures 2"]
    used: Bool[np.ndarray, "b n"]
    keep: Float[np.ndarray, "b pressures"]


def fits_of(
    of: Design,
    dependence: str,
    orders: tuple[int, ...],
    constraints: tuple[str, ...],
    objective: str,
) -> tuple[Fits, Float[np.ndarray, "orders constraints pressures"]]:
    """Solve the fits with one dependence on pressure; the axes of the result are (orders, constraints).

    Args:
        of: the linear problem.
        dependence: "fixed", "linear" or "free". With "free" there is a programme for each pressure, in
            which RMSE and sum of squares have the same minimum.
        orders: orders of the law.
        constraints: some of `response.CONSTRAINTS`.
        objective: "sum_of_squares" or "mean_rmse".

    Returns:
        The fits, and the sum of squares [N^2] at each pressure when that pressure is left out; nan if
        the law does not predict other pressures.
    """
    count, linear, free = len(of.target), dependence == "linear", dependence == "free"
    keeps = np.eye(count) if free else np.concatenate([np.ones((1, count)), 1 - np.eye(count)])
    shape = len(constraints), len(orders), len(keeps)
    kind, order, left = (axis.ravel() for axis in np.indices(shape))
    share = (of.pressure - of.pressure[0]) / max(of.pressure[-1] - of.pressure[0], 1.0) * linear
    basis = np.stack([1 - share, share], axis=-1)
    bases = basis * (keeps if free else np.ones_like(keeps))[left][..., None]
    used = (np.arange(of.muscle.order) < np.array(orders)[order, None])[..., None] & [True, linear]
    given = _Programmes(
        np.array(constraints)[kind], bases, used.reshape(kind.size, -1), keeps[left]
    )
    goal = "sum_of_squares" if free else objective
    found = _in_chunks(
        lambda *some: _optima(of, _Programmes(*some), goal), min(64, bucket(kind.size, 16)), *given
    )
    found = Fits(*(np.swapaxes(v.reshape(*shape, *v.shape[1:]), 0, 1) for v in found))
    E, own = found.coefficients, np.arange(count)
    left_out = np.full((len(orders), len(constraints), count), np.nan)
    if free:
        value = found.objective.sum(axis=-1)
        if objective == "mean_rmse":
            value = np.sqrt(2 * found.objective / of.there.sum(axis=1)).mean(axis=-1)
        return Fits(E[..., own, own, :], value, *(v.max(axis=-1) for v in found[2:])), left_out
    if count > 1 + linear:
        left_out = (of.residual(E[..., 1 + own, own, :]) ** 2).sum(axis=-1)
    return Fits(*(leaf[:, :, 0] for leaf in found)), left_out


class _Norms(NamedTuple):
    """Weighted residuals r_p = W_p x - c_p at each pressure, and their shares in the mean RMSE."""

    W: Float[np.ndarray, "b pressures rows n"]
    c: Float[np.ndarray, "b pressures rows"]
    share: Float[np.ndarray, " pressures"]

    @classmethod
    def of(cls, of: Design, given: _Programmes) -> "_Norms":
        order, keep = of.muscle.order, given.keep[:, :, None]
        W = of.factor[:, :, :order, None] * given.basis[:, :, None, None, :]
        W = W.reshape(len(keep), -1, order + 1, 2 * order) * keep[..., None]
        share = 1 / (np.sqrt(of.there.sum(axis=1)) * len(of.target))
        return cls(W * given.used[:, None, None], of.factor[:, :, order] * keep, share)

    def at(self, x: np.ndarray, rounding: float) -> tuple[np.ndarray, np.ndarray]:
        """Return r_p, and sqrt(|r_p|^2 + (rounding |c_p|)^2), which is positive."""
        r = (self.W @ x[:, None, :, None])[..., 0] - self.c
        norm = np.sqrt((r**2).sum(axis=-1) + rounding**2 * (self.c**2).sum(axis=-1))
        return r, np.where(norm > 0, norm, 1.0)

    def model(self, x: np.ndarray, loose: float, rounding: float) -> tuple[np.ndarray, np.ndarray]:
        """Return A and b of a sum of squares with the gradient of sum_p share_p |r_p| at x.

        Its curvature is (1 - loose) times that of the norms plus `loose` times share_p / |r_p|, that of the
        sum of squares that bounds them from above. With loose = 1, every step reduces the mean RMSE.
        """
        r, norm = self.at(x, rounding)
        square = (r**2).sum(axis=-1)
        along = np.sqrt(1 - (1 - loose) * square / norm**2)[..., None]
        unit = r / np.sqrt(np.where(square > 0, square, 1.0))[..., None]
        weight = np.sqrt(self.share / norm)[..., None]
        bent = ((1 - along) * unit)[..., None] * (unit[..., None, :] @ self.W)
        A = weight[..., None] * (self.W - bent)
        return A, (A @ x[:, None, :, None])[..., 0] - weight * r / along

    def certificate(
        self, x: np.ndarray, G: np.ndarray, multipliers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the mean RMSE, relative residual of its optimality conditions, and relative duality gap.

        The residual is relative to the data: a change in the readings by this much makes the point optimal.
        Any u_p with |u_p| <= share_p and sum_p W_p^T u_p = G^T l, l >= 0, gives the lower bound
        -sum_p u_p c_p on the optimum. The gap is sum_p share_p |r_p| - u_p r_p + x (G^T l + the residual
        of the conditions).
        """
        r, norm = self.at(x, _ROUNDED)
        u = (self.share / norm)[..., None] * r
        value = (self.share * np.linalg.norm(r, axis=-1)).sum(axis=1)
        G = G.reshape(len(x), -1, x.shape[1])
        pull = (multipliers[:, None, : G.shape[1]] @ G)[:, 0]
        left = (u[..., None, :] @ self.W)[..., 0, :].sum(axis=1) - pull
        size = np.linalg.norm(self.c, axis=-1)
        reach = self.share * np.maximum(1.0, size / norm)
        most = (reach[..., None] * np.linalg.norm(self.W, axis=2)).sum(axis=1)
        gap = value - (u * r).sum(axis=(1, 2))
        gap = gap + np.abs((left * x).sum(axis=1)) + np.abs((pull * x).sum(axis=1))
        residual = np.abs(left / np.maximum(most, _TINY)).max(axis=1)
        least = (self.share * size).sum(axis=1) * _ROUNDED + _TINY
        return value, residual, gap / np.maximum(value, least)


def _optima(of: Design, given: _Programmes, objective: str) -> Fits:
    """Solve programmes, adding violated points between stations, until all are finished."""
    count, n = given.used.shape
    norms, smooth = _Norms.of(of, given), objective == "mean_rmse"
    G, x = _posed(of, given), np.zeros((count, n))
    length = np.linalg.norm(norms.W, axis=(1, 2))
    alone = np.linalg.norm(norms.c, axis=(1, 2))[:, None] / np.where(length > 0, length, np.inf)
    least_size = np.maximum(1e-3 * alone.max(axis=1, initial=0.0), _TINY)
    done = np.zeros(count, bool)
    status = last = np.full(count, int(Status.STALLED))
    certificate = np.full((3, count), np.nan)
    for step in range(400 if smooth else _STEPS):
        rounding = max(0.1**step, _ROUNDED)  # the first steps see a smoother function
        A, b = norms.W, norms.c
        if smooth and step:
            # Safe steps first and last; the others use nearly the true curvature.
            A, b = norms.model(x, 0.1 if 6 <= step < _STEPS else 1.0, rounding)
        best = _optimum(A, b, given.used, G)
        last = best.status
        new, still = np.where(done[:, None], x, best.x), np.ones(count, bool)
        now: Any = best.objective, best.kkt_residual, best.duality_gap
        if smooth:
            now = norms.certificate(new, G, best.multipliers)
            still = (now[1] <= _SETTLED) & (rounding <= _ROUNDED)
        violation = _pose_weakest(of, given, new, G, step % _SPARE, least_size)
        now = np.stack([now[0], np.maximum(now[1], violation), now[2]])
        certificate = np.where(done, certificate, now)
        ended = ~done & ((still & (violation <= _EXACT)) | (last != int(Status.OPTIMAL)))
        status = np.where(ended, last, status)
        x, done = new, done | ended
        if done.all():
            break
    # Steps that stop at rounding are judged by their certificate.
    status = np.where(done, status, last)
    wrong = (status == int(Status.OPTIMAL)) & ~(certificate[1] < 1e-9)
    status = np.where(wrong, int(Status.STALLED), status)
    E = np.where((status == int(Status.OPTIMAL))[:, None, None], _coefficients(given, x), np.nan)
    least, residual, gap = certificate
    return Fits(E, least, residual, gap, status)


def _optimum(
    A: Float[np.ndarray, "b pressures rows n"],
    b: Float[np.ndarray, "b pressures rows"],
    used: Bool[np.ndarray, "b n"],
    G: Float[np.ndarray, "b pressures points n"],
) -> Optimum:
    """Minimise |A x - b| with G x >= 0; unused unknowns are zero."""
    count, n = used.shape
    rows = np.concatenate([A, b[..., None]], axis=-1).reshape(count, -1, n + 1)
    absent = np.pad(np.eye(n) * ~used[:, None], ((0, 0), (0, 0), (0, 1)))
    R: Any = np.linalg.qr(np.concatenate([rows, absent], axis=1), mode="r")
    G = G.reshape(count, -1, n)
    G = np.pad(G, ((0, 0), (0, bucket(G.shape[1], 32) - G.shape[1]), (0, 0)))
    found = _programs()(R[..., :-1], R[..., -1], G, np.zeros(G.shape[:2]))
    return jax.tree.map(np.asarray, found)


def _posed(of: Design, given: _Programmes) -> Float[np.ndarray, "b pressures points n"]:
    """Return the initial rows of the constraints, with zero rows for later points."""
    (count, n), paths = given.used.shape, len(of.target)
    G = np.zeros((count, paths, _STATIONS + _SPARE, n))
    positive = given.constraint == "positive"
    G.reshape(count, -1, n)[positive, :n] = np.eye(n) * given.used[positive, None]
    stations = np.tile(np.linspace(0, 1, _STATIONS), (paths, 1))
    for name, table in of.tables.items():
        mine = given.constraint == name
        phi = table.at(np.arange(paths)[:, None], stations)
        G[mine, :, :_STATIONS] = _rows(given, mine, phi[None])
    return G


def _rows(
    given: _Programmes, mine: Bool[np.ndarray, " b"], phi: Float[np.ndarray, "#m pressures k order"]
) -> Float[np.ndarray, "m pressures k n"]:
    """Return the rows of phi_n for the unknowns of the selected programmes."""
    rows = phi[..., None] * given.basis[mine][:, :, None, None, :]
    return rows.reshape(*rows.shape[:3], given.used.shape[1]) * given.used[mine][:, None, None]


def _coefficients(
    given: _Programmes, x: Float[np.ndarray, "b n"]
) -> Float[np.ndarray, "b pressures order"]:
    """Return E_n [Pa] at each pressure."""
    return given.basis @ x.reshape(len(x), -1, 2).swapaxes(1, 2)


def _pose_weakest(
    of: Design,
    given: _Programmes,
    x: Float[np.ndarray, "b n"],
    G: Float[np.ndarray, "b pressures points n"],
    slot: int,
    least_size: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " b"]:
    """Add the weakest point of each path as a row, and return the largest violation.

    The violation is relative to the largest coefficient, or to `least_size` [Pa] for a law that nearly
    vanishes.
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
