"""Solve the equilibrium of the bladder, pressure and threads with radial modes and guarded Newton steps.

At the material coordinate Z, r is the radius of the muscle, s = r' is the slope, F is the axial force
and p is the radial component of the meridional force. The equilibrium shape is the stationary point of
the integral over Z of

    G = p s - mu sqrt(m^2 + p^2) + W,    m = P pi r^2 + F,    mu^2 = (B (1 + e))^2 - (2 pi N r)^2

where W is the strain energy of the bladder and threads per unit Z, and e is the strain of the
threads. Eliminating p yields the energy, G = W - m z' with z'^2 = mu^2 - s^2. Keeping p as an
unknown avoids a singularity at steep shoulders. The radius r is a sum of modes. The unknowns p and
e are defined at the quadrature stations and are eliminated at each station. F is the Lagrange
multiplier of the constraint on the length, which is the integral of z' = mu m / sqrt(m^2 + p^2).
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
_PARTS = np.array([1.0, 0.5, 0.25, 0.1, 0.0])  # fractions of a Newton step
_NEAREST = 0.1  # fraction of the distance to a bound that a step must leave
_STEEPEST = 0.7  # largest slope of the first guess, relative to a radial meridian
_STIFF = 1e6  # penalty of a reduced Hessian on a change of the length


class Rule(NamedTuple):
    """Quadrature stations in one section, and the modes of the radius at these stations.

    Attributes:
        x: positions of the stations in the section, 0 to 1, shape (stations,).
        weights: quadrature weights in Z, shape (stations,).
        values, slopes: value of every mode and its derivative with respect to Z, shape (stations, modes).
            The first modes are hat functions, one for each section boundary, including both fittings.
    """

    x: np.ndarray
    weights: np.ndarray
    values: np.ndarray
    slopes: np.ndarray

    def half(self) -> "Rule":
        """Return the first half of the stations, with doubled weights, for a symmetric muscle."""
        count = (self.x.size + 1) // 2
        weights = 2 * self.weights[:count]
        weights[self.x.size // 2 :] /= 2  # a station in the middle is not doubled
        return Rule(self.x[:count], weights, self.values[:count], self.slopes[:count])


@functools.cache
def rules(shares: tuple[float, ...], order: int) -> tuple[Rule, ...]:
    """Return the quadrature rule for each section; the modes are integrated Legendre polynomials."""
    nodes, weights = np.polynomial.legendre.leggauss(3 * order // 2 + 4)
    return tuple(
        Rule((1 + nodes) / 2, weights * share / 2, *modes(shares, order, i, nodes))
        for i, share in enumerate(shares)
    )


def modes(
    shares: tuple[float, ...], order: int, section: int, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the modes of the radius and their Z-derivatives at positions from -1 to 1 in a section."""
    borders, bubbles = len(shares) + 1, order - 1
    values = np.zeros((at.size, borders + len(shares) * bubbles))
    slopes = np.zeros_like(values)
    values[:, section], values[:, section + 1] = (1 - at) / 2, (1 + at) / 2
    slopes[:, section], slopes[:, section + 1] = -0.5, 0.5
    legendre = np.polynomial.legendre.legvander(at, order)
    own = slice(borders + section * bubbles, borders + (section + 1) * bubbles)
    norm = np.sqrt(2 * (2 * np.arange(2, order + 1) - 1))
    values[:, own] = (legendre[:, 2:] - legendre[:, :-2]) / norm
    slopes[:, own] = legendre[:, 1:-1] * norm / 2
    return values, slopes * 2 / shares[section]


class Part(eqx.Module):
    """Braid, bladder and material of a section, each described as if the section were the whole muscle."""

    braid: AbstractBraid
    bladder: Bladder
    material: AbstractMaterial

    @property
    def elastic(self) -> bool:
        """True if the threads stretch."""
        return self.braid.threads_tension(0.0) is not None

    def place(self, radius: RealArray, stretch: RealArray) -> tuple[RealArray, ...]:
        """Return the meridian length per unit Z [m], its square [m2] and the bladder's outer radius [m]."""
        around = 2 * jnp.pi * self.braid.turns * radius
        thread = self.braid.rest_thread_length * (1 + stretch)
        squared = (thread - around) * (thread + around)
        inset = 0.0 if self.bladder.embedded else self.braid.thickness
        return jnp.sqrt(squared), squared, radius - inset

    def strains(self, radius: RealArray, stretch: RealArray) -> tuple[RealArray, RealArray]:
        """Return the bladder's mid-wall strains [-] along the meridian and around the axis."""
        meridian, _, outer = self.place(radius, stretch)
        return self.bladder.axial_strain(meridian), self.bladder.hoop_strain(meridian, outer)

    def resistances(self, strains: Float[Array, "3"], pressure: RealArray) -> Float[Array, "3"]:
        """Return the derivatives of W [J] with respect to the axial, hoop and thread strains."""
        axial, hoop, stretch = strains
        stress = self.material.stresses(axial, hoop, pressure)
        volume, tension = self.bladder.volume, self.braid.threads_tension(stretch)
        threads = jnp.zeros_like(volume) if tension is None else tension
        return jnp.stack([
            volume * stress[0] / (1 + axial),
            volume * stress[1] / (1 + hoop),
            threads * self.braid.rest_thread_length,
        ])  # fmt: skip

    def tapered(self, other: Bladder | None, x: np.ndarray) -> "Part":
        """Return the section at stations x from 0 to 1; the bladder tapers linearly to another bladder."""
        far = self.bladder if other is None else other
        bladder = jax.tree.map(lambda a, b: a + (b - a) * x.astype(a.dtype), self.bladder, far)
        return Part(self.braid, bladder, self.material)


def full(state: RealArray) -> RealArray:
    """Return the state (radius, slope, axial force, radial force p, strain e), with e = 0 if missing."""
    return state if state.shape[-1] == 5 else jnp.concatenate([state, jnp.zeros_like(state[:1])])


def _lagrangian(state: RealArray, held: RealArray, part: Part, pressure: RealArray) -> RealArray:
    """Return G with W linearised in the strains; `held` contains the derivatives of W."""
    radius, slope, force, across, stretch = full(state)
    along = pressure * jnp.pi * radius**2 + force
    meridian, *_ = part.place(radius, stretch)
    strains = jnp.stack([*part.strains(radius, stretch), stretch])
    return across * slope - meridian * jnp.sqrt(along**2 + across**2) + held @ strains


def _gradient(state: RealArray, part: Part, pressure: RealArray) -> RealArray:
    radius, *_, stretch = full(state)
    strains = jnp.stack([*part.strains(radius, stretch), stretch])
    return jax.grad(_lagrangian)(state, part.resistances(strains, pressure), part, pressure)


def _hessian(
    state: RealArray, part: Part, pressure: RealArray
) -> tuple[Float[Array, "n n"], RealArray]:
    """Return the second and first derivatives of G."""

    def both(state: RealArray) -> tuple[RealArray, RealArray]:
        first = _gradient(state, part, pressure)
        return first, first

    return jax.jacfwd(both, has_aux=True)(state)


def _room(
    state: RealArray, part: Part, pressure: RealArray
) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
    """Return r, m and mu^2, which must stay > 0, and True if the bore is open and stresses are finite."""
    radius, _, force, _, stretch = full(state)
    meridian, squared, outer = part.place(radius, stretch)
    fits = part.bladder.fits(meridian, outer)
    strains = jnp.stack([*part.strains(radius, stretch), stretch])
    known = jnp.all(jnp.isfinite(part.resistances(strains, pressure)))
    return jnp.stack([radius, pressure * jnp.pi * radius**2 + force, squared]), fits & known


Unknowns = tuple[Float[Array, " _"], tuple[Float[Array, "_ _"], ...]]
"""Amplitudes of the modes and axial force, scaled to order one; p and e at each section's stations."""


class Balance(eqx.Module):
    """Equilibrium equations for a muscle at one length and pressure, and the scales of the unknowns.

    Attributes:
        parts: sections, each with the dimensions of the bladder at its stations.
        ends: radius [m] at both fittings, shape (2,).
        length: L [m]; only an initial guess if a load is specified.
        pressure: P [Pa].
        load: F [N] if it is specified instead of the length; otherwise None.
        force_scale: scale of forces [N], treated as a constant in derivatives.
        shares: fraction of Z in each section.
        order: degree of the polynomials in each section.
        symmetric: True if both halves of the muscle are equal, so that only one is solved.
        halved: True if the stations cover only the first half of a symmetric muscle.
    """

    parts: tuple[Part, ...]
    ends: Float[Array, "2"]
    length: RealArray
    pressure: RealArray
    load: RealArray | None
    force_scale: RealArray
    shares: tuple[float, ...] = eqx.field(static=True)
    order: int = eqx.field(static=True)
    symmetric: bool = eqx.field(static=True, default=False)
    halved: bool = eqx.field(static=True, default=False)

    @property
    def rules(self) -> tuple[Rule, ...]:
        """Stations and modes in every section."""
        whole = rules(self.shares, self.order)
        return (whole[0].half(),) if self.halved else whole

    def half(self) -> "Balance":
        """Return the equations for the first half of a symmetric muscle."""
        count = self.rules[0].half().x.size
        parts = tuple(
            Part(one.braid, jax.tree.map(lambda leaf: leaf[:count], one.bladder), one.material)
            for one in self.parts
        )
        return dataclasses.replace(self, parts=parts, halved=True)

    def both_halves(self, y: "Unknowns") -> "Unknowns":
        """Return the unknowns of the whole muscle from those of its first half."""
        outer, (inner,) = y
        middle = self.rules[0].x.size % 2  # 1 if a station lies there
        # p is odd about the middle, the stretch of the threads even.
        sign = np.array([-1.0, 1.0])[: inner.shape[1]].astype(outer.dtype)
        return outer, (jnp.concatenate([inner, sign * inner[::-1][middle:]]),)

    @property
    def radius_scale(self) -> RealArray:
        """Mean radius [m] of the fittings, treated as a constant in derivatives."""
        return jax.lax.stop_gradient(jnp.mean(self.ends))

    @property
    def energy_scale(self) -> RealArray:
        """Force scale times radius scale [J]."""
        return self.force_scale * self.radius_scale

    @property
    def free(self) -> np.ndarray:
        """Indices of the modes that do not change the radius at the fittings."""
        modes = np.arange(self.rules[0].values.shape[1])
        return np.delete(modes, [0, len(self.shares)])

    @property
    def odd(self) -> np.ndarray:
        """Mask of the modes that are odd about the middle, which are zero in a symmetric muscle."""
        degree = np.arange(2, self.free.size + 2)
        return np.append((degree % 2 == 1) & self.halved, False)

    @property
    def scales(self) -> Float[Array, " unknowns"]:
        """Scales of the modes [m] and of the axial force [N]."""
        pull = np.arange(self.free.size + 1) == self.free.size
        return jnp.where(pull, self.force_scale, self.radius_scale)

    def columns(self, rule: Rule) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrices that map end radii and unknowns to radius, slope and force at stations."""
        both = np.stack([rule.values, rule.slopes, np.zeros_like(rule.values)], axis=1)
        free, size = self.free, self.free.size
        linear = np.zeros((rule.x.size, 3, size + 1))
        linear[..., :size], linear[:, 2, size] = both[..., free], 1.0
        dtype = self.ends.dtype
        return both[..., [0, len(self.shares)]].astype(dtype), linear.astype(dtype)

    def outer(self, rule: Rule, y: Float[Array, " unknowns"]) -> Float[Array, "stations 3"]:
        """Return radius, slope and axial force at the stations in a section."""
        fixed, linear = self.columns(rule)
        return jnp.asarray(fixed) @ self.ends + jnp.asarray(linear) @ (self.scales * y)

    def states(self, y: Unknowns) -> list[RealArray]:
        """Return radius, slope, force, p and, for elastic threads, e at the stations in each section."""
        outer = [self.outer(rule, y[0]) for rule in self.rules]
        return [jnp.concatenate(pair, axis=1) for pair in zip(outer, y[1], strict=True)]

    def each(self, function: Callable[..., Any], y: Unknowns) -> list[Any]:
        """Evaluate a function of (state, part, pressure) at the stations in each section."""

        def at(part: Part, states: RealArray) -> Any:
            def one(state: RealArray, bladder: Bladder) -> Any:
                return function(state, Part(part.braid, bladder, part.material), self.pressure)

            return jax.vmap(one)(states, part.bladder)

        return [at(*pair) for pair in zip(self.parts, self.states(y), strict=True)]

    def guess(self) -> Unknowns:
        """Return a first guess: cylinders with the same contraction and with rounded ends.

        The radius solves -(d r')' d + r = r_cylinder, where d is large enough for the threads to follow
        the slope.
        """
        dtype, scale = self.ends.dtype, self.radius_scale
        rests = [jnp.mean(part.bladder.rest_length) for part in self.parts]
        ratio = self.length / sum(s * rest for s, rest in zip(self.shares, rests, strict=True))
        size = self.rules[0].values.shape[1]
        matrix, right, pulls = jnp.zeros((size, size), dtype), jnp.zeros(size, dtype), []
        for rule, part, rest in zip(self.rules, self.parts, rests, strict=True):
            B, N = part.braid.rest_thread_length, part.braid.turns
            cosine = jnp.sqrt(jnp.maximum(1 - (ratio * rest / B) ** 2, 0.01))
            radius = jnp.maximum(B * cosine / (2 * jnp.pi * N), 0.3 * scale)
            across = jnp.sqrt(B**2 - (2 * jnp.pi * N * scale) ** 2)
            width = jnp.maximum(jnp.max(jnp.abs(radius - self.ends)) / (_STEEPEST * across),
                                radius / self.length)  # fmt: skip
            w, values, slopes = (one.astype(dtype) for one in rule[1:])
            matrix += (values.T * w) @ values + width**2 * (slopes.T * w) @ slopes
            right += values.T @ w * radius
            meridian, *_ = part.place(radius, jnp.zeros_like(radius))
            gaylord = self.pressure * (jnp.mean(meridian) ** 2 / (2 * jnp.pi * N**2)
                                       - jnp.pi * radius**2)  # fmt: skip
            pulls.append(gaylord)
        free = self.free
        right = right - matrix[:, np.array([0, len(self.shares)])] @ self.ends
        odd = self.odd[:-1]
        own = jnp.where(odd[:, None] == odd, matrix[np.ix_(free, free)], 0.0)
        radii = jnp.linalg.solve(own, jnp.where(odd, 0.0, right[free])) / scale
        pull = sum(s * f for s, f in zip(self.shares, pulls, strict=True)) / self.force_scale
        pushed = self.pressure * jnp.pi * jnp.min(self.ends) ** 2 / self.force_scale
        outer = jnp.append(radii, jnp.maximum(pull, 1e-3 - 0.9 * pushed))
        inner = []
        for rule, part in zip(self.rules, self.parts, strict=True):
            radius, slope, force = self.outer(rule, outer).T
            along = self.pressure * jnp.pi * radius**2 + force
            meridian, *_ = part.place(radius, jnp.zeros_like(radius))
            share = jnp.clip(slope / meridian, -0.9, 0.9)
            across = along * share / jnp.sqrt(1 - share**2)
            inner.append(jnp.stack([across, *([jnp.zeros_like(across)] * part.elastic)], axis=1))
        return jax.lax.stop_gradient((outer, tuple(inner)))


Matrix = Float[Array, "modes modes"]


def residual(y: Unknowns, balance: Balance) -> Unknowns:
    """Return the residual of the equilibrium equations, scaled to order one."""
    outer = jnp.zeros_like(y[0]).at[-1].set(balance.length)
    inner = []
    for rule, g in zip(balance.rules, balance.each(_gradient, y), strict=True):
        w = rule.weights.astype(outer.dtype)[:, None]
        outer = outer + jnp.tensordot(w * g[:, :3], balance.columns(rule)[1], 2)
        inner.append(g[:, 3:] / balance.radius_scale)
    outer = jnp.where(balance.odd, y[0], outer * balance.scales / balance.energy_scale)
    if balance.load is not None:
        outer = outer.at[-1].set(y[0][-1] - balance.load / balance.force_scale)
    return outer, tuple(inner)


def newton(y: Unknowns, balance: Balance) -> tuple[Unknowns, Matrix]:
    """Return the Newton step, and its matrix after p and e are eliminated at every station."""
    right = jnp.zeros_like(y[0]).at[-1].set(balance.length)
    matrix, back = jnp.zeros((right.size, right.size), right.dtype), []
    for rule, (second, first) in zip(balance.rules, balance.each(_hessian, y), strict=True):
        h, g, eliminated = second, first, []
        for k in range(g.shape[1] - 1, 2, -1):  # e, then p
            row, pivot = h[:, k], h[:, k, k, None]
            eliminated.append((row[:, :k], pivot[:, 0], g[:, k]))
            g = g - row * g[:, k, None] / pivot
            h = h - row[:, :, None] * (row / pivot)[:, None, :]
        linear, w = balance.columns(rule)[1], rule.weights.astype(right.dtype)[:, None]
        right = right + jnp.tensordot(w * g[:, :3], linear, 2)
        curved = jnp.einsum("qab,qbj->qaj", w[:, :, None] * h[:, :3, :3], linear)
        matrix = matrix + jnp.tensordot(linear, curved, ((0, 1), (0, 1)))
        back.append((linear, eliminated))
    scales, odd = balance.scales, balance.odd
    matrix = matrix * scales * scales[:, None] / balance.energy_scale
    matrix = jnp.where(odd[:, None] == odd, matrix, 0.0)  # over both halves odd and even do not mix
    right, system = jnp.where(odd, y[0], right * scales / balance.energy_scale), matrix
    if balance.load is not None:
        right = right.at[-1].set(y[0][-1] - balance.load / balance.force_scale)
        system = matrix.at[-1].set(np.eye(right.size)[-1])
    step, steps = -jnp.linalg.solve(system, right), []
    for linear, eliminated in back:
        whole = linear @ (scales * step)
        for row, pivot, g in reversed(eliminated):
            one = -(g + jnp.sum(row * whole, axis=1)) / pivot
            whole = jnp.concatenate([whole, one[:, None]], axis=1)
        steps.append(whole[:, 3:])
    return (step, tuple(steps)), matrix


def reduced_hessian(matrix: Matrix) -> Float[Array, "free free"]:
    """Return the energy's second derivatives with respect to the modes, with a penalty on the length."""
    across = matrix[:-1, -1]
    give = jnp.maximum(-matrix[-1, -1], 0.0) + 1 / _STIFF
    return matrix[:-1, :-1] + jnp.outer(across, across) / give


class Point(eqx.Module):
    """State of the solver.

    Attributes:
        size: size of the last step.
        part: fraction of the Newton step that was taken.
        aim: axial force after a full step, divided by `Balance.force_scale`.
        matrix: matrix of the Newton step.
        rooms: distances to the bounds before the step; see `_room`.
        kept: True if the bore was open and the stresses were finite before the step.
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
    """Newton's method for `residual`, with steps that keep r, m and mu > 0.

    If it fails, the solver returns the first guess, at which derivatives are finite. The last point is in
    `stats`.
    """

    rtol: float
    atol: float
    norm: Callable[[Any], RealArray] = eqx.field(static=True, default=optx.max_norm)

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> Point:
        del fn, options, f_struct, aux_struct, tags
        # All depend on y, so that a batch of muscles is batched in one pass over the loop.
        zero = 0 * y[0]
        rooms = jnp.zeros((sum(rule.x.size for rule in args.rules), 3)) + zero[0]
        far, one = zero[0] + jnp.inf, zero[0] + 1
        return Point(far, one, one, zero[:, None] * zero, rooms.astype(far.dtype), one > 0, y)

    def step(self, fn, y, args, options, state, tags):
        del fn, options, tags
        step, matrix = newton(y, args)

        def moved(part: RealArray) -> Unknowns:
            return jax.tree.map(lambda a, b: a + part * b, y, step)

        def ahead(part: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
            rooms, kept = zip(*args.each(_room, moved(part)), strict=True)
            return jnp.concatenate(rooms), jnp.all(jnp.concatenate(kept))

        parts = jnp.asarray(_PARTS, y[0].dtype)
        rooms, kept = jax.vmap(ahead)(parts)
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
        y: the unknowns; the first guess if no solution was found.
        found: True if a solution was found.
        last: unknowns at which the solver stopped.
        point: state of the solver at that point; only the first half of a symmetric muscle is included.
    """

    y: Unknowns
    found: Bool[Array, ""]
    last: Unknowns
    point: Point


def solve(balance: Balance) -> Solved:
    """Solve the equilibrium equations; derivatives follow from the implicit function theorem."""
    tolerance = float(jnp.finfo(balance.ends.dtype).eps) ** 0.5
    sought = balance.half() if balance.symmetric else balance
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
