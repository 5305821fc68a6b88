"""An identification as pure functions of its nonlinear parameters: design matrix, constraint rows.

The force is linear in the coefficients of the law, so for each geometry the fit is a convex
programme. What makes it "free", "linear" or "fixed" in pressure, or own to each specimen, is a
basis over the readings; what makes it "positive", "slope" or "drucker" is a set of rows. Every case
has the same shape: blocks of independent programmes, each with `basis` times `order` unknowns.
"""

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from .._convex.qp import Optimum, solve_qp
from .laws import AbstractLaw
from .part import Part, Reach

Constraint = Literal["none", "positive", "slope", "drucker"]
PressureDependence = Literal["fixed", "linear", "free"]

CONSTRAINTS: tuple[Constraint, ...] = ("none", "positive", "slope", "drucker")
DEPENDENCES: tuple[PressureDependence, ...] = ("fixed", "linear", "free")

_REACHES = 4
"""Convex fits in a compliant rig, each about the forces of the one before: quadratic convergence."""


class Prior(eqx.Module):
    """What is known of a parameter besides the data.

    Attributes:
        place: in the vector of nonlinear parameters, or of coefficients.
        mean, std: in SI.
    """

    place: int = eqx.field(static=True)
    mean: float = eqx.field(static=True)
    std: float = eqx.field(static=True)


class Problem(eqx.Module):
    """Force maps, a form of the law and a constraint.

    Attributes:
        parts: one for each specimen.
        law: family of the bladder's law.
        shape: places of the law's shape parameters in the vector of nonlinear parameters.
        coefficient_min, coefficient_max: bounds [Pa], shape (order,), infinite where there is none.
        priors: on nonlinear parameters.
        coefficient_priors: on coefficients.
        prior_weight: noise of the force, in the unit of the weighted residual.
        constraint: on the coefficients.
    """

    parts: tuple[Part, ...]
    law: AbstractLaw
    shape: tuple[int, ...] = eqx.field(static=True)
    coefficient_min: Float[Array, " order"]
    coefficient_max: Float[Array, " order"]
    priors: tuple[Prior, ...]
    coefficient_priors: tuple[Prior, ...]
    prior_weight: Float[Array, ""]
    constraint: Constraint = eqx.field(static=True)

    @property
    def order(self) -> int:
        """Number of coefficients of the law."""
        return self.law.order

    @property
    def blocks(self) -> int:
        """Number of independent convex programmes."""
        return self.parts[0].weights.shape[0]

    @property
    def nodes(self) -> int:
        """Number of laws within a block."""
        return self.parts[0].basis.shape[1]

    @property
    def n_coefficients(self) -> int:
        """Number of linear unknowns in all blocks."""
        return self.blocks * self.nodes * self.order

    def material(
        self, parameters: Float[Array, " q"], coefficients: Float[Array, " order"]
    ) -> famjax.AbstractMaterial:
        """The material with these parameters and coefficients of one node."""
        return self.law.material(parameters[jnp.asarray(self.shape, int)], coefficients)

    def _linear_force(
        self, part: Part, parameters: Float[Array, " q"], reach: Reach | None
    ) -> tuple[Float[Array, " points"], Float[Array, "points order"]]:
        """Force at the readings as offset + columns @ coefficients.

        In a rig that gives way by c per newton the force moves only 1/(1 + c dF/dL) as far as the
        muscle's own; `reach` holds the force and stiffness about which that is linear.
        """
        at = part.dimensions(parameters, reach)
        limp = part.muscle(parameters, famjax.PolynomialMaterial(jnp.zeros(1)))
        braid = limp.braid_force_at(at, part.pressure)

        def of_law(coefficients: Float[Array, " order"]) -> Float[Array, " points"]:
            material = self.material(parameters, coefficients)
            muscle = famjax.Muscle(limp.geometry, material, limp.deadband_pressure)
            return muscle.bladder_force_at(at, part.pressure)

        columns = jax.vmap(of_law, out_axes=-1)(jnp.eye(self.order))
        if reach is None:
            return braid, columns
        gain = 1 / (1 + jax.lax.stop_gradient(part.compliance(parameters)) * reach.stiffness)
        return reach.force + gain * (braid - reach.force), gain[:, None] * columns

    def _constraint_rows(
        self, part: Part, parameters: Float[Array, " q"]
    ) -> Float[Array, "blocks paths rows order"]:
        """Rows on the coefficients of one path's node, in Pa: the constraint asks >= 0."""
        unit = jnp.eye(self.order)
        shape = part.path_end.shape
        if self.constraint == "none":
            return jnp.zeros((*shape, 0, self.order))
        if self.constraint == "positive":
            return jnp.broadcast_to(unit, (*shape, self.order, self.order))
        if self.constraint == "slope":
            strain = part.largest_strain(parameters)[..., None] * part.stations
            return jax.vmap(
                lambda c: tangent_modulus(self.material(parameters, c), strain), out_axes=-1
            )(unit)
        path = part.path_strains(parameters)
        return jax.vmap(lambda c: path.modulus(self.material(parameters, c)), out_axes=-1)(unit)

    def _rows(
        self, part: Part, parameters: Float[Array, " q"]
    ) -> tuple[Float[Array, "blocks m n"], Float[Array, "blocks m"]]:
        """Constraint rows of one part and its bounds on the coefficients, G x >= h."""
        rows = self._constraint_rows(part, parameters)
        limits = jnp.concatenate([self.coefficient_min, -self.coefficient_max])
        signs = jnp.concatenate([jnp.eye(self.order), -jnp.eye(self.order)])
        on = jnp.isfinite(limits)
        bounds = jnp.broadcast_to(
            jnp.where(on[:, None], signs, 0.0), (*rows.shape[:2], *signs.shape)
        )
        # A row that is off must be satisfied by anything.
        offsets = jnp.broadcast_to(jnp.where(on, limits, -1.0), (*rows.shape[:2], limits.size))
        blocks, n = part.path_end.shape[0], self.nodes * self.order

        def over_nodes(
            rows: Float[Array, "blocks paths rows order"],
        ) -> Float[Array, "blocks m n"]:
            return (part.path_basis[..., None, :, None] * rows[..., None, :]).reshape(blocks, -1, n)

        G = jnp.concatenate([over_nodes(rows), over_nodes(bounds)], axis=1)
        zeros = jnp.zeros((blocks, G.shape[1] - offsets[0].size))
        return G, jnp.concatenate([zeros, offsets.reshape(blocks, -1)], axis=1)

    def programmes(
        self, parameters: Float[Array, " q"], reaches: tuple[Reach, ...] | None = None
    ) -> tuple[
        Float[Array, "blocks k n"],
        Float[Array, "blocks k"],
        Float[Array, "blocks m n"],
        Float[Array, "blocks m"],
    ]:
        """The convex programmes (A, b, G, h) of all blocks with these parameters.

        Args:
            parameters: nonlinear ones, SI.
            reaches: where a compliant rig is made linear, one for each part; None for a rigid one.
        """
        n = self.nodes * self.order
        blocks_A, blocks_b, blocks_G, blocks_h = [], [], [], []
        for k, part in enumerate(self.parts):
            offset, columns = self._linear_force(
                part, parameters, None if reaches is None else reaches[k]
            )
            columns = (part.basis[:, :, None] * columns[:, None, :]).reshape(-1, n)
            blocks_A.append(part.weights[..., None] * columns)
            blocks_b.append(part.weights * (part.force - offset))
            G, h = self._rows(part, parameters)
            blocks_G.append(G)
            blocks_h.append(h)
        if self.coefficient_priors:
            A, b = self._prior_rows()
            blocks_A.append(A)
            blocks_b.append(b)
        A, b, G, h = (
            jnp.concatenate(parts, axis=1) for parts in (blocks_A, blocks_b, blocks_G, blocks_h)
        )
        return A, b, G, h

    def _prior_rows(self) -> tuple[Float[Array, "blocks k n"], Float[Array, "blocks k"]]:
        """Rows that hold every node's coefficients to their priors."""
        unit = jnp.eye(self.nodes * self.order).reshape(self.nodes, self.order, -1)
        scale = [self.prior_weight / prior.std for prior in self.coefficient_priors]
        A = jnp.concatenate(
            [
                s * unit[:, prior.place]
                for s, prior in zip(scale, self.coefficient_priors, strict=True)
            ]
        )
        b = jnp.repeat(
            jnp.stack(
                [s * prior.mean for s, prior in zip(scale, self.coefficient_priors, strict=True)]
            ),
            self.nodes,
        )
        return (
            jnp.broadcast_to(A, (self.blocks, *A.shape)),
            jnp.broadcast_to(b, (self.blocks, *b.shape)),
        )

    def reaches(self, parameters: Float[Array, " q"]) -> tuple[Reach, ...] | None:
        """Where the best fit in a compliant rig is linear; None if every rig is rigid."""
        if not any(part.compliant for part in self.parts):
            return None
        fixed = jax.lax.stop_gradient(parameters)
        start = tuple(Reach(part.force, jnp.zeros_like(part.force)) for part in self.parts)

        def refit(_: Array, reaches: tuple[Reach, ...]) -> tuple[Reach, ...]:
            x = self._solve(fixed, reaches).x
            return tuple(
                part.reach(fixed, material)
                for part, material in zip(self.parts, self.materials(fixed, x), strict=True)
            )

        return jax.lax.stop_gradient(jax.lax.fori_loop(0, _REACHES, refit, start))

    def _own(self, x: Float[Array, " n"]) -> list[Float[Array, " order"]]:
        """Coefficients of each part in a problem that does not depend on pressure."""
        return [part.path_basis[0, 0] @ x.reshape(self.nodes, self.order) for part in self.parts]

    def _solve(self, parameters: Float[Array, " q"], reaches: tuple[Reach, ...] | None) -> Optimum:
        return jax.vmap(solve_qp)(*self.programmes(parameters, reaches))

    def solve(self, parameters: Float[Array, " q"]) -> Optimum:
        """The certified optimum of every block with these parameters, leading axis of blocks."""
        return self._solve(parameters, self.reaches(parameters))

    def residual(self, parameters: Float[Array, " q"]) -> Float[Array, " k"]:
        """Weighted residual of the best coefficients, priors included: the projected variables."""
        reaches = self.reaches(parameters)
        return self.joint_residual(parameters, self._solve(parameters, reaches).x, reaches)

    def joint_residual(
        self,
        parameters: Float[Array, " q"],
        x: Float[Array, "blocks n"],
        reaches: tuple[Reach, ...] | None,
    ) -> Float[Array, " k"]:
        """Weighted residual with these parameters and coefficients, priors included."""
        A, b, _, _ = self.programmes(parameters, reaches)
        residual = jnp.einsum("bkn,bn->bk", A, x) - b
        # A reading is in one block and weighs nothing in the others; a prior is in every block.
        points = sum(part.force.shape[0] for part in self.parts)
        rows = [jnp.sum(residual[:, :points], axis=0), residual[:, points:].ravel()]
        if self.priors:
            priors = [(parameters[prior.place] - prior.mean) / prior.std for prior in self.priors]
            rows.append(self.prior_weight * jnp.stack(priors))
        return jnp.concatenate(rows)

    def force_error(
        self,
        parameters: Float[Array, " q"],
        x: Float[Array, "blocks n"],
        reaches: tuple[Reach, ...] | None,
    ) -> Float[Array, " points"]:
        """Model minus reading [N] at every reading, whatever its weight."""
        laws = x.reshape(self.blocks, self.nodes, self.order)
        errors = []
        for k, part in enumerate(self.parts):
            offset, columns = self._linear_force(
                part, parameters, None if reaches is None else reaches[k]
            )
            block = jnp.argmax(part.weights != 0, axis=0) if self.blocks > 1 else 0
            own = jnp.einsum("pn,pno->po", part.basis, jnp.broadcast_to(
                laws[block], (part.force.shape[0], self.nodes, self.order)))  # fmt: skip
            errors.append(offset + jnp.sum(columns * own, axis=1) - part.force)
        return jnp.concatenate(errors)

    def materials(
        self, parameters: Float[Array, " q"], x: Float[Array, "blocks n"]
    ) -> tuple[famjax.AbstractMaterial, ...]:
        """The material of each part."""
        part = self.parts[0]
        if self.blocks == 1 and (self.nodes == 1 or len(self.parts) > 1):
            return tuple(self.material(parameters, own) for own in self._own(x[0]))
        nodes = x.reshape(-1, self.order)
        pressures = part.path_pressure.reshape(-1)
        if self.blocks == 1:
            pressures = jnp.stack([pressures[0], pressures[-1]])
        return (famjax.PressurePolynomialMaterial(pressures, nodes),)

    def muscles(
        self, parameters: Float[Array, " q"], x: Float[Array, "blocks n"]
    ) -> tuple[famjax.Muscle, ...]:
        """The muscle of each part."""
        return tuple(
            part.muscle(parameters, material)
            for part, material in zip(self.parts, self.materials(parameters, x), strict=True)
        )

    def rows_per_path(self, part: Part) -> int:
        """Number of rows that the constraint has on each path of a part."""
        stations = part.stations.shape[-1]
        counts = {"none": 0, "positive": self.order, "slope": stations, "drucker": stations}
        return counts[self.constraint]


def tangent_modulus(
    material: famjax.AbstractMaterial, strain: Float[Array | np.ndarray, "*shape"]
) -> Float[Array, "*shape"]:
    """Tangent modulus [Pa] at a strain [-], of a law whose two directions do not interact."""
    assert isinstance(material, famjax.PolynomialMaterial | famjax.AbstractUniaxialLaw)
    strain = jnp.asarray(strain)
    return jax.jvp(material.stress, (strain,), (jnp.ones_like(strain),))[1]
