"""The shape that balances bladder, pressure and threads: modes, local densities, guarded Newton steps.

Along the material coordinate Z a muscle has radius r, slope s = r', pull F, and the radial part p of
its meridional force. The shape is the stationary point of the integral over Z of

    G = p s - mu sqrt(m^2 + p^2) + W,    m = P pi r^2 + F,    mu^2 = (B (1 + e))^2 - (2 pi N r)^2

where W is the strain energy of bladder and threads per Z, and e the strain of the threads. Eliminating
p gives the energy, G = W - m z' with z'^2 = mu^2 - s^2; with p, nothing is singular where a
shoulder is steep. r is a sum of modes; p and e are unknown at the quadrature stations, where they are
eliminated one by one. F is the multiplier of the length, the integral of z' = mu m / sqrt(m^2 + p^2).
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float

from ._arrays import RealArray
from .braids import AbstractBraid
from .geometries import Bladder
from .materials import AbstractMaterial

MAX_STEPS = 16
_PARTS = np.array([1.0, 0.5, 0.25, 0.1, 0.0])  # of a Newton step
_NEAREST = 0.1  # part of its distance to a bound that a step must leave
_STEEPEST = 0.7  # slope of the first guess at a fitting, in that of a meridian across the axis
_STIFF = 1e6  # with which a reduced Hessian resists a change of the length


class Rule(NamedTuple):
    """Stations along the muscle and the modes of the radius there.

    Attributes:
        x: stations, 0 to 1, shape (stations,).
        weights: in Z, shape (stations,).
        values, slopes: of every mode and its derivative in Z, shape (stations, modes). The first two
            modes are hats, those of the radii at the fittings.
    """

    x: np.ndarray
    weights: np.ndarray
    values: np.ndarray
    slopes: np.ndarray

    def half(self) -> "Rule":
        """The first half of the stations, which stand for both halves of a symmetric muscle."""
        count = (self.x.size + 1) // 2
        weights = 2 * self.weights[:count]
        weights[self.x.size // 2 :] /= 2  # the middle stands for itself
        return Rule(self.x[:count], weights, self.values[:count], self.slopes[:count])


@functools.cache
def rule_of(order: int) -> Rule:
    """The rule of integrated Legendre polynomials up to an order."""
    nodes, weights = np.polynomial.legendre.leggauss(3 * order // 2 + 4)
    return Rule((1 + nodes) / 2, weights / 2, *modes(order, nodes))


def modes(order: int, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes of the radius and their derivatives in Z at places -1 to 1."""
    legendre = np.polynomial.legendre.legvander(at, order)
    norm = np.sqrt(2 * (2 * np.arange(2, order + 1) - 1))
    values = [(1 - at) / 2, (1 + at) / 2, (legendre[:, 2:] - legendre[:, :-2]) / norm]
    half = np.full(at.size, 0.5)
    slopes = [-half, half, legendre[:, 1:-1] * norm / 2]
    return np.column_stack(values), 2 * np.column_stack(slopes)


class Part(eqx.Module):
    """What a muscle is made of: braid, bladder and law."""

    braid: AbstractBraid
    bladder: Bladder
    material: AbstractMaterial

    @property
    def elastic(self) -> bool:
        """Whether the threads stretch."""
        return self.braid.threads_tension(0.0) is not None

    def place(self, radius: RealArray, stretch: RealArray) -> tuple[RealArray, ...]:
        """Meridian per Z [m], squared [m2], and outer radius of the bladder [m]."""
        around = 2 * jnp.pi * self.braid.turns * radius
        thread = self.braid.rest_thread_length * (1 + stretch)
        squared = (thread - around) * (thread + around)
        inset = 0.0 if self.bladder.embedded else self.braid.thickness
        return jnp.sqrt(squared), squared, radius - inset

    def strains(self, radius: RealArray, stretch: RealArray) -> tuple[RealArray, RealArray]:
        """Strains [-] of the bladder along the meridian and around, at mid-wall."""
        meridian, _, outer = self.place(radius, stretch)
        return self.bladder.axial_strain(meridian), self.bladder.hoop_strain(meridian, outer)

    def resistances(
        self, radius: RealArray, stretch: RealArray, pressure: RealArray
    ) -> Float[Array, "3"]:
        """Energy per Z and strain [J] for the strains of bladder and threads."""
        axial, hoop = self.strains(radius, stretch)
        stress = self.material.stresses(axial, hoop, pressure)
        volume, tension = self.bladder.volume, self.braid.threads_tension(stretch)
        threads = jnp.zeros_like(volume) if tension is None else tension
        return jnp.stack([
            volume * stress[0] / (1 + axial),
            volume * stress[1] / (1 + hoop),
            threads * self.braid.rest_thread_length,
        ])  # fmt: skip


def _full(state: RealArray) -> RealArray:
    """Radius, slope, pull, radial force and stretch of the threads, which may be none."""
    return state if state.shape[-1] == 5 else jnp.concatenate([state, jnp.zeros_like(state[:1])])


def _lagrangian(state: RealArray, held: RealArray, part: Part, pressure: RealArray) -> RealArray:
    """G with W to first order, whose derivatives per strain are held."""
    radius, slope, force, across, stretch = _full(state)
    along = pressure * jnp.pi * radius**2 + force
    meridian, *_ = part.place(radius, stretch)
    strains = jnp.stack([*part.strains(radius, stretch), stretch])
    return across * slope - meridian * jnp.sqrt(along**2 + across**2) + held @ strains


def _gradient(state: RealArray, part: Part, pressure: RealArray) -> RealArray:
    full = _full(state)
    held = part.resistances(full[0], full[4], pressure)
    return jax.grad(_lagrangian)(state, held, part, pressure)


def _hessian(
    state: RealArray, part: Part, pressure: RealArray
) -> tuple[Float[Array, "n n"], RealArray]:
    """Second derivatives of G, and beside them its first."""

    def both(state: RealArray) -> tuple[RealArray, RealArray]:
        first = _gradient(state, part, pressure)
        return first, first

    return jax.jacfwd(both, has_aux=True)(state)


def _room(
    state: RealArray, part: Part, pressure: RealArray
) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
    """Distances to bounds: r, m and mu^2 above 0; and whether there is a bore, and the law known."""
    radius, _, force, _, stretch = _full(state)
    meridian, squared, outer = part.place(radius, stretch)
    fits = part.bladder.fits(meridian, outer)
    known = jnp.all(jnp.isfinite(part.resistances(radius, stretch, pressure)))
    return jnp.stack([radius, pressure * jnp.pi * radius**2 + force, squared]), fits & known


Unknowns = tuple[Float[Array, " _"], Float[Array, "_ _"]]
"""Modes of the radius and the pull, of order one; p and e at the stations."""


class Balance(eqx.Module):
    """A muscle at one length and pressure, and the scales of its unknowns.

    Attributes:
        part: what it is made of.
        ends: radius [m] at both fittings, shape (2,).
        length: L [m]; where a load is given, a guess of it.
        pressure: P [Pa].
        load: F [N] that is given in place of the length, or None.
        force_scale: [N], a constant.
        order: of the polynomials.
        symmetric: whether both halves are alike, so that the shape is found in one of them.
        halved: whether the stations are those of the first half of a symmetric muscle.
    """

    part: Part
    ends: Float[Array, "2"]
    length: RealArray
    pressure: RealArray
    load: RealArray | None
    force_scale: RealArray
    order: int = eqx.field(static=True)
    symmetric: bool = eqx.field(static=True, default=False)
    halved: bool = eqx.field(static=True, default=False)

    @property
    def rule(self) -> Rule:
        """Stations and modes."""
        whole = rule_of(self.order)
        return whole.half() if self.halved else whole

    def both_halves(self, y: "Unknowns") -> "Unknowns":
        """Unknowns of the whole muscle from those of its first half."""
        outer, inner = y
        middle = self.rule.x.size % 2  # a station lies there
        # p is odd about the middle, the stretch of the threads even.
        sign = np.array([-1.0, 1.0])[: inner.shape[1]].astype(outer.dtype)
        return outer, jnp.concatenate([inner, sign * inner[::-1][middle:]])

    @property
    def radius_scale(self) -> RealArray:
        """Mean radius [m] of the fittings, a constant."""
        return jax.lax.stop_gradient(jnp.mean(self.ends))

    @property
    def energy_scale(self) -> RealArray:
        """Force times radius [J]."""
        return self.force_scale * self.radius_scale

    @property
    def odd(self) -> np.ndarray:
        """Which unknowns, modes and pull, are odd about the middle: those that half a muscle lacks."""
        return np.append((np.arange(2, self.order + 1) % 2 == 1) & self.halved, False)

    @property
    def scales(self) -> Float[Array, " unknowns"]:
        """Scales of the modes of the radius [m] and of the pull [N]."""
        return jnp.where(
            np.arange(self.order) == self.order - 1, self.force_scale, self.radius_scale
        )

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """Radius, slope and pull at the stations: of the fittings' radii, and of modes and pull."""
        rule, dtype = self.rule, self.ends.dtype
        both = np.stack([rule.values, rule.slopes, np.zeros_like(rule.values)], axis=1)
        pull = np.broadcast_to([[0.0], [0.0], [1.0]], (rule.x.size, 3, 1))
        linear = np.concatenate([both[..., 2:], pull], axis=-1)
        return both[..., :2].astype(dtype), linear.astype(dtype)

    def outer(self, y: Float[Array, " unknowns"]) -> Float[Array, "stations 3"]:
        """Radius, slope and pull at the stations."""
        fixed, linear = self.columns()
        return jnp.asarray(fixed) @ self.ends + jnp.asarray(linear) @ (self.scales * y)

    def states(self, y: Unknowns) -> RealArray:
        """Radius, slope, pull, p and perhaps e at the stations."""
        return jnp.concatenate([self.outer(y[0]), y[1]], axis=1)

    def each(self, function: Callable[..., Any], y: Unknowns) -> Any:
        """A function of (state, part, pressure) at the stations."""
        return jax.vmap(lambda state: function(state, self.part, self.pressure))(self.states(y))

    def guess(self) -> Unknowns:
        """A shorter cylinder, rounded towards the fittings.

        The radius r of -(d r')' d + r = r_cylinder, with d so long that no slope is steeper than
        the threads allow.
        """
        scale, part = self.radius_scale, self.part
        B, N = part.braid.rest_thread_length, part.braid.turns
        cosine = jnp.sqrt(jnp.maximum(1 - (self.length / B) ** 2, 0.01))
        radius = jnp.maximum(B * cosine / (2 * jnp.pi * N), 0.3 * scale)
        across = jnp.sqrt(B**2 - (2 * jnp.pi * N * scale) ** 2)
        width = jnp.maximum(
            jnp.max(jnp.abs(radius - self.ends)) / (_STEEPEST * across), radius / self.length
        )
        w, values, slopes = (one.astype(self.ends.dtype) for one in self.rule[1:])
        matrix = (values.T * w) @ values + width**2 * (slopes.T * w) @ slopes
        right = values.T @ w * radius - matrix[:, :2] @ self.ends
        odd = self.odd[:-1]
        own = jnp.where(odd[:, None] == odd, matrix[2:, 2:], 0.0)
        radii = jnp.linalg.solve(own, jnp.where(odd, 0.0, right[2:])) / scale
        meridian, *_ = part.place(radius, jnp.zeros_like(radius))
        gaylord = meridian**2 / (2 * jnp.pi * N**2) - jnp.pi * radius**2
        pushed = self.pressure * jnp.pi * jnp.min(self.ends) ** 2 / self.force_scale
        pull = self.pressure * gaylord / self.force_scale
        outer = jnp.append(radii, jnp.maximum(pull, 1e-3 - 0.9 * pushed))
        radius, slope, force = self.outer(outer).T
        along = self.pressure * jnp.pi * radius**2 + force
        meridian, *_ = part.place(radius, jnp.zeros_like(radius))
        share = jnp.clip(slope / meridian, -0.9, 0.9)
        across = along * share / jnp.sqrt(1 - share**2)
        inner = jnp.stack([across, *([jnp.zeros_like(across)] * part.elastic)], axis=1)
        return jax.lax.stop_gradient((outer, inner))


Matrix = Float[Array, "modes modes"]


def residual(y: Unknowns, balance: Balance) -> Unknowns:
    """The imbalance, scaled to order one."""
    g, w = balance.each(_gradient, y), balance.rule.weights.astype(y[0].dtype)[:, None]
    outer = jnp.tensordot(w * g[:, :3], balance.columns()[1], 2).at[-1].add(balance.length)
    outer = jnp.where(balance.odd, y[0], outer * balance.scales / balance.energy_scale)
    if balance.load is not None:
        outer = outer.at[-1].set(y[0][-1] - balance.load / balance.force_scale)
    return outer, g[:, 3:] / balance.radius_scale


def newton(y: Unknowns, balance: Balance) -> tuple[Unknowns, Matrix]:
    """Newton's step, and its matrix once p and e are eliminated at every station."""
    (h, g), eliminated = balance.each(_hessian, y), []
    for k in range(g.shape[1] - 1, 2, -1):  # e, then p
        row, pivot = h[:, k], h[:, k, k, None]
        eliminated.append((row[:, :k], pivot[:, 0], g[:, k]))
        g = g - row * g[:, k, None] / pivot
        h = h - row[:, :, None] * (row / pivot)[:, None, :]
    linear, w = balance.columns()[1], balance.rule.weights.astype(y[0].dtype)[:, None]
    right = jnp.tensordot(w * g[:, :3], linear, 2).at[-1].add(balance.length)
    curved = jnp.einsum("qab,qbj->qaj", w[:, :, None] * h[:, :3, :3], linear)
    scales, odd = balance.scales, balance.odd
    matrix = jnp.tensordot(linear, curved, ((0, 1), (0, 1))) * scales * scales[:, None]
    # Over both halves odd and even do not mix.
    matrix = jnp.where(odd[:, None] == odd, matrix / balance.energy_scale, 0.0)
    right, system = jnp.where(odd, y[0], right * scales / balance.energy_scale), matrix
    if balance.load is not None:
        right = right.at[-1].set(y[0][-1] - balance.load / balance.force_scale)
        system = matrix.at[-1].set(np.eye(right.size)[-1])
    step = -jnp.linalg.solve(system, right)
    whole = linear @ (scales * step)
    for row, pivot, first in reversed(eliminated):
        one = -(first + jnp.sum(row * whole, axis=1)) / pivot
        whole = jnp.concatenate([whole, one[:, None]], axis=1)
    return (step, whole[:, 3:]), matrix


def reduced_hessian(matrix: Matrix) -> Float[Array, "free free"]:
    """Second derivatives of the energy with respect to the modes, penalising a change of length."""
    across = matrix[:-1, -1]
    give = jnp.maximum(-matrix[-1, -1], 0.0) + 1 / _STIFF
    return matrix[:-1, :-1] + jnp.outer(across, across) / give


class Point(eqx.Module):
    """State of the solver.

    Attributes:
        size: of the last step.
        part: of Newton's step that was taken.
        aim: pull to which a whole step would go, in the balance's scale.
        matrix: of that step.
        rooms: distances to the bounds before it; see `_room`.
        kept: whether a bore was left and the law known.
        first: the first guess.
    """

    size: RealArray
    part: RealArray
    aim: RealArray
    matrix: Matrix
    rooms: Float[Array, "_ 3"]
    kept: Bool[Array, ""]
    first: Unknowns


class GuardedNewton(optx.AbstractRootFinder):
    """Newton's method for `residual`, with steps that stay where r, m and mu are above 0.

    Where it fails it returns the first guess, at which derivatives are finite; the last point is in
    `stats`.
    """

    rtol: float
    atol: float
    norm: Callable[[Any], RealArray] = eqx.field(static=True, default=optx.max_norm)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> Point:
        del fn, options, f_struct, aux_struct, tags
        far = jnp.full((), jnp.inf, y[0].dtype)
        one = jnp.ones_like(far)
        rooms = jnp.zeros((args.rule.x.size, 3), far.dtype)
        matrix = jnp.zeros((y[0].size, y[0].size), far.dtype)
        return Point(far, one, one, matrix, rooms, jnp.asarray(True), y)

    def step(self, fn, y, args, options, state, tags):
        del fn, options, tags
        step, matrix = newton(y, args)

        def moved(part: RealArray) -> Unknowns:
            return jax.tree.map(lambda a, b: a + part * b, y, step)

        parts = jnp.asarray(_PARTS, y[0].dtype)
        rooms, each = jax.vmap(lambda part: args.each(_room, moved(part)))(parts)
        kept = jnp.all(each, axis=1)
        allowed = kept & jnp.all(rooms > _NEAREST * rooms[-1], axis=(1, 2)) & kept[-1]
        part = parts[jnp.argmax(allowed.at[-1].set(True))]  # the last part is 0
        size = self.norm(step[0])
        aim = y[0][-1] + step[0][-1]
        return moved(part), Point(size, part, aim, matrix, rooms[-1], kept[-1], state.first), None

    def terminate(self, fn, y, args, options, state, tags):
        del fn, args, options, tags
        stuck = (state.part == 0) | jnp.isnan(state.size)
        near = state.size < self.atol + self.rtol * self.norm(y[0])
        failed = optx.RESULTS.where(
            stuck, optx.RESULTS.nonlinear_divergence, optx.RESULTS.successful
        )
        return near & (state.part == 1), failed

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        del fn, args, options, tags
        found = result == optx.RESULTS.successful
        kept = jax.tree.map(lambda a, b: jnp.where(found, a, b), y, state.first)
        return kept, aux, {"last": y, "point": state}


class Solved(eqx.Module):
    """Result of the solver.

    Attributes:
        y: the unknowns, of the first guess where none balance.
        found: whether they balance.
        last: unknowns at which the solver stopped.
        point: how it stood there; of the first half alone where the muscle is symmetric.
    """

    y: Unknowns
    found: Bool[Array, ""]
    last: Unknowns
    point: Point


def solve(balance: Balance) -> Solved:
    """The balance of a muscle, its derivatives by the implicit function theorem."""
    tolerance = float(jnp.finfo(balance.ends.dtype).eps) ** 0.5
    sought = dataclasses.replace(balance, halved=balance.symmetric)
    solution = optx.root_find(
        residual,
        GuardedNewton(rtol=tolerance, atol=tolerance),
        sought.guess(),
        args=sought,
        max_steps=MAX_STEPS,
        throw=False,
    )
    y, last = solution.value, solution.stats["last"]
    if balance.symmetric:
        y, last = balance.both_halves(y), balance.both_halves(last)
    return Solved(y, solution.result == optx.RESULTS.successful, last, solution.stats["point"])
