"""Response of a model in a fit: force and constraint, linear in the coefficients.

A family builds models from named parameter values. The force is affine in some of the parameters, the
coefficients. At nonlinear parameters p and coefficients x0

    F(x) = force + columns (x - x0),   g(x) = rows (x - x0) + values >= 0.

The engine traces this code and differentiates it with respect to p.
"""

import functools
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from .convex import AnyArray

Values = Mapping[str, Any]
"""Parameter values [SI], keyed by name."""

RIG = ("series_compliance", "series_exponent")
"""Parameters of the rig, not of the model: compliance and exponent in `famjax.muscle.give_way`."""


class MuscleFamily(eqx.Module):
    """A family of models of one specimen, as a function of named parameters.

    A change in its arrays, as from one specimen to another, requires no recompilation; a change in its
    static fields (names, classes) does.

    Attributes:
        nonlinear: names of the parameters found by the outer search, in order.
        linear: names of the coefficients, in which the force is affine, in order.
        source: builder of geometry and muscle, see `fitting.families.AbstractGeometrySource`.
        law: bladder law; None for a model that is not a muscle with a bladder.
        rest: rest length L0 [m] of the specimen, at which every path starts.
        terms: further force terms, or None.
    """

    nonlinear: tuple[str, ...] = eqx.field(static=True)
    linear: tuple[str, ...] = eqx.field(static=True)
    source: Any
    law: Any
    rest: Float[np.ndarray, ""]
    terms: famjax.terms.SumOfTerms | None = None

    def build(self, values: Values) -> Any:
        """Build the model from these values: any object with `force(length, pressure)`."""
        material = None if self.law is None else self.law.with_values(values)
        further = None
        if self.terms is not None:
            free = [name for name in self.terms.declared() if name in self.nonlinear]
            further = self.terms.with_parameters({name: values[name] for name in free})
        return self.source.muscle(values, material, further)

    @property
    def derived_names(self) -> tuple[str, ...]:
        """Names of the derived quantities in the report."""
        return self.source.derived_names

    def rest_length(self, values: Values) -> Float[Array, ""]:
        """Return the rest length L0 [m], where every path starts."""
        return jnp.asarray(values.get("rest_length", self.rest))


Constraint = Literal["none", "positive", "slope", "drucker"]

_EXACT = 2  # Newton steps of a compliant rig at its solution: exact to second derivatives
CONSTRAINTS: tuple[Constraint, ...] = ("none", "positive", "slope", "drucker")
DEPENDENCES = ("fixed", "linear", "free")


STATIONS = 32
"""Number of stations on each actuation path: 24 initial ones, and 8 for points found between them."""


class MapInputs(eqx.Module):
    """States at which a model is evaluated: readings and actuation paths.

    Attributes:
        length, pressure, force: readings [m, Pa, N], shape (points,).
        path_pressure: pressure [Pa] of each path, shape (paths,).
        path_end: shortest length [m] of each path, shape (paths,); all start at rest.
        stations: positions along the path in [0, 1], shape (paths, stations).
    """

    length: Float[AnyArray, " points"]
    pressure: Float[AnyArray, " points"]
    force: Float[AnyArray, " points"]
    path_pressure: Float[AnyArray, " paths"]
    path_end: Float[AnyArray, " paths"]
    stations: Float[AnyArray, "paths stations"]


class Linear(NamedTuple):
    """Linear model of one part at a point; derivatives with respect to parameters have the same structure.

    Attributes:
        force: force [N] with all coefficients zero, shape (points,).
        columns: derivative of the force with respect to the coefficients, shape (points, n).
        values: constraint along the paths [Pa] with all coefficients zero, shape (rows,).
        rows: derivative of the constraint with respect to the coefficients, shape (rows, n).
    """

    force: Float[AnyArray, " points"]
    columns: Float[AnyArray, "points n"]
    values: Float[AnyArray, " rows"]
    rows: Float[AnyArray, "rows n"]


class Report(NamedTuple):
    """Quantities of a fit that the report needs.

    Attributes:
        numbers: all stored values of the model, shape (l,).
        d_numbers: their derivatives with respect to parameters and coefficients, shape (l, q + n).
        derived: derived quantities, shape (d,).
        d_derived: their derivatives with respect to the parameters of the family, shape (d, q).
        path_modulus: Drucker modulus along the paths [Pa], shape (paths, stations); nan without a bladder.
        slope: tangent modulus [Pa] at the same fractions of the largest strain, same shape.
        largest_strain: largest strain magnitude [-] of each path, shape (paths,).
    """

    numbers: Float[AnyArray, " l"]
    d_numbers: Float[AnyArray, "l unknowns"]
    derived: Float[AnyArray, " d"]
    d_derived: Float[AnyArray, "d q"]
    path_modulus: Float[AnyArray, "paths stations"]
    slope: Float[AnyArray, "paths stations"]
    largest_strain: Float[AnyArray, " paths"]


def linear_response(
    family: MuscleFamily,
    constraint: Constraint,
    at: MapInputs,
    p: Float[AnyArray, " q"],
    x0: Float[AnyArray, " n"],
    reached: Float[AnyArray, " points"],
    to_x: Float[AnyArray, "own n"] | None = None,
) -> Linear:
    """Linearise the response about (p, x0).

    Args:
        family: family of models.
        constraint: constraint on the coefficients.
        at: readings and paths.
        p: values of `family.nonlinear`.
        x0: values of `family.linear`, or the vector from which `to_x` computes them.
        reached: force [N] at each reading, which deflects a compliant rig.
        to_x: matrix from x0 to `family.linear`; None if x0 is already these values.
    """
    searched, rig, length, paths = _placed(family, at, p, reached)
    directions = jnp.eye(x0.shape[0]) if to_x is None else jnp.asarray(to_x)

    def of_coefficients(own: Float[Array, " own"]) -> tuple[Array, Array]:
        model = _model(family, searched, own)
        ((values,), _) = along_paths(model, at, *paths, constraint)
        return model.force(length, at.pressure), values.ravel()

    # Strains are the same for all coefficients: they are traced once.
    (force, values), slope = jax.linearize(of_coefficients, directions @ x0)
    if x0.shape[0]:
        columns, rows = jax.vmap(slope, out_axes=-1)(directions.T)
    else:
        columns, rows = jnp.zeros((*force.shape, 0)), jnp.zeros((*values.shape, 0))
    force, values = force - columns @ x0, values - rows @ x0
    if rig is not None:
        model = _model(family, searched, directions @ x0)
        gain = jax.lax.stop_gradient(_gain(model, length, at.pressure, reached, rig)[1])
        force, columns = reached + gain * (force - reached), gain[:, None] * columns
    return Linear(force, columns, values, rows)


def report(
    family: MuscleFamily,
    at: MapInputs,
    p: Float[AnyArray, " q"],
    x: Float[AnyArray, " n"],
    reached: Float[AnyArray, " points"],
) -> Report:
    """Return the quantities for the report at (p, x); see `linear_response` for the arguments."""
    searched, _, _, paths = _placed(family, at, p, reached)
    model = _model(family, searched, x)
    (modulus, slope), largest = along_paths(model, at, *paths, "drucker", "slope")

    def derived(p: Float[Array, " q"]) -> Float[Array, " d"]:
        values = dict(zip(family.nonlinear, p, strict=True))
        return jnp.array(family.source.derived(values) if family.derived_names else ())

    def numbers(unknowns: Float[Array, " unknowns"]) -> Float[Array, " l"]:
        names = (*family.nonlinear, *family.linear)
        return flat(family.build(dict(zip(names, unknowns, strict=True))))

    both = jnp.concatenate([p, x])
    return Report(
        numbers=flat(model),
        d_numbers=jax.jacfwd(numbers)(both),
        derived=derived(p),
        d_derived=jax.jacfwd(derived)(p),
        path_modulus=modulus,
        slope=slope,
        largest_strain=largest,
    )


def _placed(
    family: MuscleFamily, at: MapInputs, p: Float[Array, " q"], reached: Float[Array, " points"]
) -> tuple[dict[str, Array], tuple | None, Float[Array, " points"], tuple[Array, Array]]:
    """Return searched numbers, rig, lengths of the muscle alone, and rest length and ends of the paths."""
    searched = dict(zip(family.nonlinear, p, strict=True))
    length, end = jnp.asarray(at.length), jnp.asarray(at.path_end)
    rig, compliance = None, searched.get("series_compliance")
    if compliance is not None:
        rig = compliance, searched.get("series_exponent")
        under_load = length - famjax.muscle.give_way(at.force, *rig)
        end = jnp.minimum(end, under_load[jnp.argmin(under_load)])
        length = length - famjax.muscle.give_way(reached, *rig)
    return searched, rig, length, (jnp.asarray(family.rest_length(searched)), end)


def _model(family: MuscleFamily, searched: dict[str, Array], x: Float[Array, " n"]) -> Any:
    """Build the model with these coefficients."""
    return family.build({**searched, **dict(zip(family.linear, x, strict=True))})


def force_and_constraint(
    family: MuscleFamily,
    constraint: Constraint,
    at: MapInputs,
    p: Float[Array, " q"],
    x: Float[Array, " n"],
) -> tuple[Float[Array, " points"], Float[Array, " rows"]]:
    """Return the force in the rig [N] and the constraint values [Pa], without linearisation.

    Args:
        family: family of models.
        constraint: constraint on the coefficients.
        at: readings and paths.
        p: values of `family.nonlinear`.
        x: coefficients. The force in a compliant rig is found by two Newton steps from `at.force`, which
            yield exact first and second derivatives at the solution.
    """
    force = jnp.asarray(at.force)
    searched, rig, length, paths = _placed(family, at, p, force)
    model = _model(family, searched, x)
    if rig is None:
        force = model.force(length, at.pressure)
    else:
        for _ in range(_EXACT):
            length = at.length - famjax.muscle.give_way(force, *rig)
            muscle, gain = _gain(model, length, at.pressure, force, rig)
            force = force + gain * (muscle - force)
    ((values,), _) = along_paths(model, at, *paths, constraint)
    return force, values.ravel()


def _gain(
    model: Any,
    length: AnyArray,
    pressure: AnyArray,
    reached: AnyArray,
    rig: tuple[Array, Array | None],
) -> tuple[Array, Array]:
    """Return the muscle's force [N] and the factor 1 / (1 + rig compliance x muscle stiffness).

    Args:
        model: model of the muscle.
        length: length of the muscle [m].
        pressure: gauge pressure [Pa].
        reached: force [N] that deflects the rig.
        rig: compliance, and exponent or None.
    """
    ones = jnp.ones_like(length)
    force, stiffness = jax.jvp(lambda L: model.force(L, pressure), (length,), (ones,))
    softness = jax.jvp(lambda F: famjax.muscle.give_way(F, *rig), (reached,), (ones,))[1]
    return force, 1 / (1 + softness * stiffness)


def flat(model: Any) -> Float[Array, " l"]:
    """Return all stored values of a model as one vector."""
    leaves = jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array))
    return jnp.concatenate([leaf.ravel() for leaf in leaves])


def along_paths(
    model: Any, at: MapInputs, rest: Array, end: Float[Array, " paths"], *kinds: Constraint
) -> tuple[list[Float[Array, "paths stations"]], Float[Array, " paths"]]:
    """Return the constraints [Pa] at the stations of the actuation paths, and each path's largest strain.

    "drucker" and "slope" are nan without a bladder; other kinds have no values along a path.
    """
    shares, pressure = jnp.asarray(at.stations), jnp.asarray(at.path_pressure)
    material, unknown = bladder_of(model), jnp.full(shares.shape, jnp.nan)
    none = {kind: jnp.zeros((shares.shape[0], 0)) for kind in ("none", "positive")}
    if material is None or not shares.shape[1]:
        return [none.get(kind, unknown) for kind in kinds], jnp.zeros(pressure.shape)
    ends = jnp.stack([jnp.broadcast_to(rest, end.shape), end], axis=-1)
    lengths = rest + shares * (end - rest)[:, None]
    # One evaluation serves the stations and both ends.
    both = famjax.stability.path_strains(
        model.geometry, jnp.concatenate([lengths, ends], axis=-1), pressure[:, None]
    )
    sizes = [jnp.abs(one[:, -2:]).reshape(len(end), -1) for one in (both.axial, both.hoop)]
    every = jnp.concatenate(sizes, axis=1)
    # The derivative of a maximum compares recomputed values for equality, which rounding may defeat.
    largest = jnp.take_along_axis(every, jnp.argmax(every, axis=1, keepdims=True), axis=1)[:, 0]
    found = []
    for kind in kinds:
        if kind == "drucker":
            strains = jax.tree.map(lambda leaf: leaf[:, :-2], both)
            found.append(strains.modulus(material))
        elif kind == "slope" and not material.directions_interact:
            strain = shares * largest[:, None]
            stress = functools.partial(_equal_stress, material, pressure[:, None])
            found.append(jax.jvp(stress, (strain,), (jnp.ones_like(strain),))[1])
        else:
            found.append(none.get(kind, unknown))
    return found, largest


def _equal_stress(material: Any, pressure: Array, strain: Array) -> Array:
    """Return the axial stress [Pa] at equal strains in both directions."""
    return material.stresses(strain, strain, pressure)[0]


def bladder_of(model: Any) -> famjax.materials.AbstractMaterial | None:
    """Return the bladder law of a model with a geometry; None if there is none."""
    if getattr(model, "geometry", None) is None:
        return None
    return getattr(model, "material", None)
