"""Data structures for a fit: force maps with their families, weights, bounds, priors and constraint.

`fitting.identify` finds the optimum of a `Problem`. `PureProblem` is the same problem in pure JAX, with the
same linear models and convex core. It is used to sample posteriors, and by scripts that differentiate
through a fit.
"""

import dataclasses
import itertools
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

import famjax
from famjax.boundary.errors import InputError

from .convex import AnyArray, Optimum, solve_qp
from .response import (
    RIG,
    Constraint,
    MapInputs,
    MuscleFamily,
    force_and_constraint,
    linear_response,
)

_HELD = 1e-9  # of the box: a parameter this near to a bound is on it


@dataclasses.dataclass(frozen=True)
class Prior:
    """Prior knowledge in addition to the data: direction . parameters = mean +- std.

    Attributes:
        direction: direction in the space of the nonlinear parameters, shape (q,), or of the coefficients,
            shape (n,); a unit vector for a prior on a single one.
        mean, std: mean and standard deviation in SI.
    """

    direction: Float[np.ndarray, " _"]
    mean: float
    std: float


class Within(eqx.Module):
    """A larger family whose compiled program several parts share.

    Attributes:
        family: the larger family; fixing some of its parameters yields the family of the part.
        to_p: matrix of zeros and ones that maps the part's nonlinear parameters to those of the larger
            family, shape (whole, q).
        held: values of the larger family's nonlinear parameters that the part keeps fixed; 0 for the
            part's own parameters, shape (whole,).
        to_x: the corresponding matrix for the coefficients, shape (all, n); the other coefficients are 0.
    """

    family: MuscleFamily
    to_p: Float[np.ndarray, "whole q"]
    held: Float[np.ndarray, " whole"]
    to_x: Float[np.ndarray, "all n"]


LONG, SPREAD = 256, 128
"""Number of readings above which a map is treated as long, and number that represents it in searches."""


class Part(eqx.Module):
    """One force map of a fit.

    Attributes:
        name: name of the specimen.
        family: family of models.
        inputs: readings and paths; slack and saturated readings are included only in a censored fit.
        force: measured force [N], shape (points,).
        weight: weights of the readings, 1/std or 1, shape (points,).
        at: indices of the part's nonlinear parameters in the problem's vector.
        levels: "pressure" [Pa] and "length" [m] level of each reading, shape (points,). Readings at one
            level are left out together.
        side: 0 for a normal reading; 1 if the force is an upper bound (slack muscle); -1 if it is a lower
            bound (load cell at its limit), shape (points,).
        within: larger family whose compiled program is used; None if it has its own program.
    """

    name: str = eqx.field(static=True)
    family: MuscleFamily
    inputs: MapInputs
    force: Float[AnyArray, " points"]
    weight: Float[AnyArray, " points"]
    at: Int[AnyArray, " q"]
    levels: dict[str, Float[AnyArray, " points"]]
    side: Int[AnyArray, " points"]
    within: Within | None = None

    @property
    def coefficients(self) -> Int[np.ndarray, " n"]:
        """Indices of the part's coefficients in the problem's vector; all parts share the coefficients."""
        return np.arange(len(self.family.linear))

    @property
    def rig(self) -> tuple[int, ...]:
        """Indices of the rig's compliance and exponent; empty for a rigid rig."""
        places = dict(zip(self.family.nonlinear, self.at.tolist(), strict=False))
        return tuple(places[name] for name in RIG if name in places)

    def with_stations(self, stations: Float[np.ndarray, "paths stations"]) -> "Part":
        """Return the part with different constraint stations; this does not cause a recompilation."""
        return dataclasses.replace(self, inputs=dataclasses.replace(self.inputs, stations=stations))

    def thinned(self) -> "Part":
        """Thin out a long part by keeping one random reading from each block of neighbouring lengths."""
        if self.force.size <= LONG:
            return self
        order = np.lexsort((self.levels["pressure"], self.levels["length"]))
        borders = np.linspace(0, order.size, SPREAD + 1).astype(int)
        rows = np.sort(order[np.random.default_rng(0).integers(borders[:-1], borders[1:])])
        at = self.inputs
        own = {name: getattr(at, name)[rows] for name in ("length", "pressure", "force")}
        return dataclasses.replace(
            self,
            inputs=dataclasses.replace(at, **own),
            force=self.force[rows],
            weight=self.weight[rows],
            levels={kind: level[rows] for kind, level in self.levels.items()},
            side=self.side[rows],
        )

    def mounted(
        self, muscle: famjax.AbstractMuscle, parameters: np.ndarray
    ) -> famjax.MountedMuscle:
        """Mount a muscle in the rig described by these problem parameters [SI]."""
        return famjax.MountedMuscle(muscle, *(parameters[list(self.rig)] if self.rig else (0.0,)))


@dataclasses.dataclass(frozen=True)
class Problem:
    """Force maps with their unknowns, bounds, priors and constraint.

    Attributes:
        parts: one for each force map.
        names: names of the q nonlinear parameters.
        low, high: bounds on the nonlinear parameters [SI], shape (q,).
        linear: names of the n coefficients, which all parts share.
        coefficient_min, coefficient_max: bounds on the coefficients, shape (n,); infinite if there is none.
        priors: priors on nonlinear parameters.
        coefficient_priors: priors on coefficients.
        noise: standard deviation of a weighted force reading, used to weight priors.
        constraint: constraint on the coefficients.
        ridge: ridge regularisation for columns scaled to unit length; 0 for none.
    """

    parts: tuple[Part, ...]
    names: tuple[str, ...]
    low: Float[np.ndarray, " q"]
    high: Float[np.ndarray, " q"]
    linear: tuple[str, ...]
    coefficient_min: Float[np.ndarray, " n"]
    coefficient_max: Float[np.ndarray, " n"]
    priors: tuple[Prior, ...] = ()
    coefficient_priors: tuple[Prior, ...] = ()
    noise: float = 1.0
    constraint: Constraint = "none"
    ridge: float = 0.0

    @property
    def free(self) -> Int[np.ndarray, " p"]:
        """Indices of the free parameters."""
        return np.flatnonzero(self.low < self.high)

    @property
    def lowest(self) -> Float[np.ndarray, " n"]:
        """Lower bounds on the coefficients, shape (n,); at least 0 with constraint="positive"."""
        low = self.coefficient_min
        return np.maximum(low, 0.0) if self.constraint == "positive" else low

    @property
    def force(self) -> Float[np.ndarray, " points"]:
        """Measured force [N] of all parts, concatenated."""
        return np.concatenate([part.force for part in self.parts])

    @property
    def weight(self) -> Float[np.ndarray, " points"]:
        """Weights of the readings of all parts, concatenated."""
        return np.concatenate([part.weight for part in self.parts])

    @property
    def side(self) -> Int[np.ndarray, " points"]:
        """Sides of the readings of all parts, concatenated; see `Part`."""
        return np.concatenate([part.side for part in self.parts])

    @property
    def readings(self) -> list[slice]:
        """Slice of each part in the concatenated readings."""
        ends = np.cumsum([0, *(part.force.size for part in self.parts)]).tolist()
        return [slice(first, end) for first, end in itertools.pairwise(ends)]

    @property
    def path_rows(self) -> list[int]:
        """Number of constraint rows along the paths of each part."""
        along = self.constraint in ("slope", "drucker")
        return [part.inputs.stations.size if along else 0 for part in self.parts]

    def levels(self, kind: str) -> Float[np.ndarray, " points"]:
        """Return the "pressure" [Pa] or "length" [m] level, or the "specimen" index, of each reading."""
        if kind == "specimen":
            return np.repeat(
                np.arange(1.0 * len(self.parts)), [one.force.size for one in self.parts]
            )
        return np.concatenate([part.levels[kind] for part in self.parts])

    def with_readings(
        self, *, force: np.ndarray | None = None, factor: np.ndarray | None = None
    ) -> "Problem":
        """Return the problem with different forces [N], or with its weights multiplied by factors."""
        force = self.force if force is None else force
        weight = self.weight if factor is None else self.weight * factor
        parts = tuple(
            dataclasses.replace(part, force=force[here], weight=weight[here])
            for part, here in zip(self.parts, self.readings, strict=True)
        )
        return dataclasses.replace(self, parts=parts)

    def thinned(self) -> "Problem":
        """Return the problem with `SPREAD` readings of each long part, spread evenly over the map.

        Bounds and paths stay the same, so a point in the unit box represents the same muscle.
        """
        parts = tuple(part.thinned() for part in self.parts)
        same = all(one is part for one, part in zip(parts, self.parts, strict=True))
        return self if same else dataclasses.replace(self, parts=parts)

    def parameters(self, u: Float[np.ndarray, " p"]) -> Float[np.ndarray, " q"]:
        """Return the parameters [SI] at a point in the unit box."""
        found = self.low.copy()
        found[self.free] += u * (self.high - self.low)[self.free]
        return found


class PureProblem(eqx.Module):
    """A problem as pure functions of the parameters and the measured forces.

    Attributes:
        parts: one for each force map.
        low, high: bounds on the nonlinear parameters [SI], shape (q,).
        free: indices of the free parameters.
        limits: bounds on the coefficients as G x >= h; rows of zeros where there is no bound.
        prior_rows: weighted rows and targets of the priors on coefficients.
        priors: weighted rows and targets of the priors on nonlinear parameters.
        constraint: constraint on the coefficients.
        compliant: true if any rig is compliant.
    """

    parts: tuple[Part, ...]
    low: Float[AnyArray, " q"]
    high: Float[AnyArray, " q"]
    free: tuple[int, ...] = eqx.field(static=True)
    limits: tuple[Float[AnyArray, "m n"], Float[AnyArray, " m"]]
    prior_rows: tuple[Float[AnyArray, "k n"], Float[AnyArray, " k"]]
    priors: tuple[Float[AnyArray, "r q"], Float[AnyArray, " r"]]
    constraint: Constraint = eqx.field(static=True)
    compliant: bool = eqx.field(static=True)

    @classmethod
    def of(cls, problem: Problem) -> "PureProblem":
        """Convert the problem of an identification."""
        unit, (low, high) = np.eye(len(problem.linear)), (problem.lowest, problem.coefficient_max)
        ends = [(np.isfinite(low), unit, low), (np.isfinite(high), -unit, -high)]

        def priors(of: tuple[Prior, ...], size: int) -> tuple[np.ndarray, np.ndarray]:
            weights = np.array([problem.noise / one.std for one in of])
            rows = np.array([one.direction for one in of]).reshape(-1, size)
            return weights[:, None] * rows, weights * np.array([one.mean for one in of])

        return cls(
            parts=tuple(dataclasses.replace(part, within=None) for part in problem.parts),
            low=problem.low,
            high=problem.high,
            free=tuple(problem.free.tolist()),
            limits=(
                np.concatenate([rows * on[:, None] for on, rows, _ in ends]),
                np.concatenate([np.where(on, end, -1.0) for on, _, end in ends]),
            ),
            prior_rows=priors(problem.coefficient_priors, len(problem.linear)),
            priors=priors(problem.priors, len(problem.names)),
            constraint=problem.constraint,
            compliant=any(part.rig for part in problem.parts),
        )

    def parameters(self, u: Float[Array, " p"]) -> Float[Array, " q"]:
        """Return the parameters [SI] at a point in the unit box."""
        at, low = jnp.asarray(self.free, int), jnp.asarray(self.low)
        return low.at[at].add(u * (self.high - low)[at])

    def optimum(self, p: Float[Array, " q"], force: Float[Array, " points"]) -> Optimum:
        """Return the convex fit at given parameters [SI] with its certificate, for a rigid rig.

        The coefficients `x` and the objective are differentiable; other fields have zero derivatives.

        Args:
            p: nonlinear parameters [SI], in the order of `Problem.names`.
            force: force [N] of each reading used in the fit (the loaded ones), `data.force[data.loaded]`.

        Raises:
            InputError: the number of forces differs from the number of readings in the fit, or the rig is
                compliant.
        """
        if self.compliant:
            raise InputError(
                "with a compliant rig, the fit at given parameters is not a convex programme: use identify "
                "with these parameters fixed"
            )
        none = jnp.zeros(self.limits[0].shape[1])
        A, b, G, h = self.programme(p, none, force, force)
        found = solve_qp(A, b, G, h)
        return dataclasses.replace(found, objective=jnp.sum((A @ found.x - b) ** 2) / 2)

    def coefficients(
        self, p: Float[Array, " q"], force: Float[Array, " points"]
    ) -> Float[Array, " n"]:
        """Return the coefficients of `optimum`."""
        return self.optimum(p, force).x

    def _each(self, force: Float[Array, " points"]) -> Iterator[tuple[Part, slice]]:
        """Iterate over the parts with the slices of their readings."""
        first, count = 0, sum(part.weight.shape[0] for part in self.parts)
        if force.shape != (count,):
            raise InputError(
                f"the fit has {count} readings, so force must have the shape ({count},), got "
                f"{force.shape}: pass the loaded readings, data.force[data.loaded]"
            )
        for part in self.parts:
            yield part, slice(first, first := first + part.weight.shape[0])

    def programme(
        self,
        p: Float[Array, " q"],
        x0: Float[Array, " n"],
        force: Float[Array, " points"],
        reached: Float[Array, " points"],
    ) -> tuple[Array, Array, Array, Array]:
        """Return A, b, G and h of the convex programme.

        Args:
            p: parameters [SI].
            x0: coefficients about which a compliant rig is linearised.
            force: measured force [N].
            reached: force [N] about which a compliant rig is linearised.
        """
        (rows, targets), (bounds, ends) = self.prior_rows, self.limits
        blocks: list[tuple[Array, ...]] = []
        for part, here in self._each(force):
            found = linear_response(
                part.family, self.constraint, part.inputs, p[part.at], x0, reached[here]
            )
            target = part.weight * (force[here] - found.force)
            columns = part.weight[:, None] * found.columns
            blocks.append((columns, target, found.rows, -found.values))
        blocks.append((jnp.asarray(rows), targets, bounds, ends))
        A, b, G, h = (jnp.concatenate(leaves) for leaves in zip(*blocks, strict=True))
        return A, b, G, h

    def exact(
        self,
        p: Float[Array, " q"],
        x: Float[Array, " n"],
        force: Float[Array, " points"],
        reached: Float[Array, " points"],
    ) -> tuple[Float[Array, " k"], Float[Array, " m"]]:
        """Return the weighted residual and the slack of every constraint row, without linearisation."""
        residuals, values = [], []
        for part, here in self._each(force):
            at = part.inputs
            if self.compliant:
                at = dataclasses.replace(at, force=reached[here])
            model, constraint = force_and_constraint(
                part.family, self.constraint, at, p[part.at], x
            )
            residuals.append(part.weight * (model - force[here]))
            values.append(constraint)
        (rows, targets), (G, h), (own, means) = self.prior_rows, self.limits, self.priors
        residuals += [rows @ x - targets, jnp.asarray(own @ p - means)]
        return jnp.concatenate(residuals), jnp.concatenate([*values, G @ x - h])

    def differentiable(
        self, force: Float[Array, " points"], near: Any
    ) -> tuple[Float[Array, " q"], Float[Array, " n"]]:
        """Return the optimum as a differentiable function of the forces, near the forces of a fit.

        This is one Newton step on the optimality conditions. Parameters at a bound stay there, and
        active constraint rows stay active. At the forces of the fit, the derivative of this step equals
        the derivative of the optimum.

        Args:
            force: forces [N] of the readings of the fit, `data.force[data.loaded]`.
            near: optimum of the fit, an `engine.Point` such as `result.end.point`.

        Returns:
            Nonlinear parameters [SI], shape (q,), and coefficients [Pa], shape (n,).
        """
        at, q = np.asarray(self.free, int), len(self.free)
        width = (jnp.asarray(self.high) - self.low)[at]
        u, x = (near.parameters - self.low)[at] / width, jnp.asarray(near.x)
        moves = jnp.concatenate([(u > _HELD) & (u < 1 - _HELD), jnp.ones(x.shape, bool)])
        size = jnp.maximum(jnp.abs(x), jnp.max(jnp.abs(x)) * 1e-6 + 1e-300)
        active, multipliers = np.zeros(near.h.size, bool), np.zeros(near.h.size)
        active[near.rows], multipliers[near.rows] = True, near.multipliers

        def both(z: Float[Array, " z"], force: Array) -> tuple[Array, Array]:
            p, x = self.parameters(z[:q]), z[q:] * size
            residual, slack = self.exact(p, x, force, jnp.asarray(near.reached))
            return residual @ residual / 2, jnp.where(active, slack, 0.0)

        def lagrangian(z: Float[Array, " z"], force: Array) -> Float[Array, ""]:
            cost, slack = both(z, force)
            return cost - multipliers @ slack

        z, still = jnp.concatenate([u, x / size]), jax.lax.stop_gradient(force)
        curvature = jax.hessian(lagrangian)(z, still)
        rows = jax.jacfwd(lambda z: both(z, still)[1])(z)
        H = jnp.where(moves[:, None] & moves, curvature, jnp.eye(z.size))
        N = jnp.where(moves, rows, 0.0)
        off = jnp.diag(jnp.where(active, 0.0, 1.0))
        system = jax.lax.stop_gradient(jnp.block([[H, -N.T], [N, off]]))
        gradient = jnp.where(moves, jax.grad(lagrangian)(z, force), 0.0)
        conditions = jnp.concatenate([gradient, both(z, force)[1]])
        z = z + jnp.linalg.solve(system, -conditions)[: z.size]
        return self.parameters(z[:q]), z[q:] * size
