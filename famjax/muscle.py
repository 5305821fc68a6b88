"""Static force models, with stiffness, blocked force, equilibrium length and onset pressure."""

import abc
import dataclasses
import functools
import typing
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ._arrays import (
    Given,
    Real,
    RealArray,
    as_number,
    as_real,
    at_each,
    compiled,
    compiled_method,
    of_each,
    over_slope,
)
from .boundary.errors import InputError
from .geometries import AbstractGeometry
from .materials import AbstractMaterial
from .parameters import Declared, Parametrised, declaration, parameter
from .terms import AbstractForceTerm, BladderWall, PressurisedBraid, SumOfTerms


class AbstractMuscle(Parametrised):
    """A static force model: the force at a given length and pressure, and quantities derived from it.

    To add your own model, write a class with `force`, `rest_length` and `length_range`. Map its methods
    with `jax.vmap(muscle.force)` and compile them with `eqx.filter_jit(muscle.force)`.

    One instance represents one muscle, and its parameters are scalars. Create and evaluate many muscles
    under `jax.vmap` or `equinox.filter_vmap`.

    Attributes:
        rest_length: active length L0 [m] at zero contraction.
    """

    if TYPE_CHECKING:

        @property
        def rest_length(self) -> RealArray: ...  # noqa: D102

    else:
        rest_length: eqx.AbstractVar[RealArray]  # a field or a property

    def __check_init__(self) -> None:
        """Reject a batch of muscles."""
        check_one_muscle(self)

    @abc.abstractmethod
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the static force F [N] at length L [m] and gauge pressure P [Pa]; arguments broadcast.

        The force is positive if the muscle pulls. It is nan at impossible states, such as a negative
        length. At these states, its derivatives must be 0, so that the derivatives of other states in a
        batch stay correct.
        """

    @abc.abstractmethod
    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest active length [m] for the equilibrium search."""

    def stops(self) -> Float[Array, "2"]:
        """Return the lengths [m] at which the braid locks and at which its threads are straight.

        If the model has no braid, these are the ends of `length_range`.
        """
        return jnp.stack(self.length_range())

    def volume(self, length: Real, pressure: Real) -> RealArray:  # noqa: ARG002
        """Return the fluid volume V [m3] at active length L [m] and gauge pressure P [Pa].

        Returns:
            V, with the broadcast shape; nan at impossible states.

        Raises:
            InputError: the model has no geometry.
        """
        raise InputError(
            f"a {type(self).__name__} has no volume, because it has no geometry: use a famjax.Muscle, "
            "or pass a function of the gauge pressure [Pa] that returns the volume [m3]"
        )

    @compiled_method
    def stiffness(self, length: Real, pressure: Real) -> RealArray:
        """Return the axial stiffness dF/dL [N/m] at constant pressure, with the broadcast shape.

        A positive stiffness resists a change in length.
        """
        check_one_muscle(self)
        slopes = jax.value_and_grad(self.force)
        force, stiffness = at_each(slopes, as_real(length), as_real(pressure))
        return jnp.where(jnp.isnan(force), jnp.nan, stiffness)

    @compiled_method
    def blocked_force(self, pressure: Real) -> RealArray:
        """Return the blocked force [N]: the force at zero contraction and gauge pressure P [Pa]."""
        return self.force(self.rest_length, pressure)

    def length_at_load(self, load: Real, pressure: Real, *, throw: bool = True) -> RealArray:
        """Return the longest active length L [m] at which the contracting muscle carries a load.

        Args:
            load: load [N], positive if it stretches the muscle.
            pressure: gauge pressure P [Pa].
            throw: if True, raise an error if there is no such length; otherwise return nan.

        Returns:
            L [m], with the broadcast shape. It is differentiable, by the implicit function theorem, with
            respect to load, pressure and every parameter of the muscle.

        Raises:
            RuntimeError: there is no such length, and `throw` is True.
        """
        length, found = self._balanced(load, pressure)
        return required(length, found, "equilibrium length") if throw else length

    def free_contraction(self, pressure: Real, *, throw: bool = True) -> RealArray:
        """Return the free contraction (L0 - L) / L0 [-] at zero force and gauge pressure P [Pa].

        Args:
            pressure: gauge pressure P [Pa]. Below the deadband, the unloaded muscle is longer than L0
                and the result is negative.
            throw: if True, raise an error if the force does not cross zero; otherwise return nan.

        Returns:
            Contraction [-], a fraction, with the pressure's shape; differentiable.

        Raises:
            RuntimeError: the force does not cross zero, and `throw` is True.
        """
        length, rest = self.length_at_load(0.0, pressure, throw=throw), self.rest_length
        known = jnp.isfinite(length)
        # Nan divided by the rest length would contaminate the derivatives of all other elements.
        return jnp.where(known, 1 - jnp.where(known, length, 0.0) / rest, jnp.nan)

    def onset_pressure(self, length: Real, highest: Real, *, throw: bool = True) -> RealArray:
        """Return the onset: the gauge pressure [Pa] at which the force at a fixed length rises from zero.

        Args:
            length: active length L [m].
            highest: upper limit [Pa] of the search.
            throw: if True, raise an error if there is no onset; otherwise return nan.

        Returns:
            P [Pa], with the broadcast shape; differentiable with respect to length and every parameter.

        Raises:
            RuntimeError: the force does not cross zero between 0 and `highest`, and `throw` is True.
        """
        pressure, found = self._onset(length, highest)
        return required(pressure, found, "onset pressure") if throw else pressure

    @compiled_method
    def _balanced(self, load: Real, pressure: Real) -> tuple[RealArray, Bool[Array, "..."]]:
        check_one_muscle(self)
        ends = self.length_range()

        def one(load: RealArray, P: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
            return longest_equilibrium(lambda length: self.force(length, P), *ends, load)

        return at_each(one, as_real(load), as_real(pressure))

    @compiled_method
    def _onset(self, length: Real, highest: Real) -> tuple[RealArray, Bool[Array, "..."]]:
        check_one_muscle(self)

        def one(L: RealArray, top: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
            none = jnp.zeros_like(top)
            return longest_equilibrium(lambda pressure: self.force(L, pressure), none, top, none)

        return at_each(one, as_real(length), as_real(highest))


def check_one_muscle(*parts: eqx.Module) -> None:
    """Reject values whose number of axes differs from their declaration.

    Args:
        parts: a muscle, or components of a muscle.

    Raises:
        ValueError: a scalar parameter is an array.
    """
    for part in parts:
        _check(part, type(part).__name__)


def _check(part: eqx.Module, where: str) -> None:
    axes = _axes(type(part))
    for field in dataclasses.fields(part):
        value, at = getattr(part, field.name, None), f"{where}.{field.name}"
        count = axes.get(field.name)
        if count is not None and value is not None and jnp.ndim(value) != count:
            wanted = f"have {count} axes" if count else "be one number"
            raise ValueError(
                f"an instance represents one muscle: {at} must {wanted}, got shape "
                f"{jnp.shape(value)}. For many muscles, apply jax.vmap or equinox.filter_vmap to a "
                "function that creates one"
            )
        parts = value if isinstance(value, tuple | list) else (value,)
        for i, one in enumerate(parts):
            if isinstance(one, eqx.Module):
                _check(one, at if one is value else f"{at}[{i}]")


@functools.cache
def _axes(cls: type[eqx.Module]) -> dict[str, int]:
    """Return the number of axes of each declared number in a class, from its annotation; 0 by default.

    Annotations that are strings are not checked.
    """
    declared = [field for field in dataclasses.fields(cls) if declaration(field) is not None]
    return {f.name: _axes_of(f.type) for f in declared if not isinstance(f.type, str)}


def _axes_of(annotation: Any) -> int:
    for one in (annotation, *typing.get_args(annotation)):
        if hasattr(one, "dims"):
            return 0 if one.index_variadic is not None else len(one.dims)
    return 0


_CELLS = 64
_ROUNDED = 64  # rounding allowance in units of eps times the largest force


def longest_equilibrium(
    force: Callable[[RealArray], RealArray],
    shortest: RealArray,
    longest: RealArray,
    load: RealArray,
) -> tuple[RealArray, Bool[Array, ""]]:
    """Find the longest length at which the force of a shortening muscle has fallen to the load.

    Starting at the longest length, the search finds the first of 64 cells in which the force falls to
    the load or below, and bisects that cell to machine precision. Derivatives follow from the implicit
    function theorem, not from the search.

    Args:
        force: function that returns F [N] at a scalar length L [m].
        shortest: lower end of the range [m], shape ().
        longest: upper end of the range [m], shape ().
        load: load [N], shape ().

    Returns:
        (length [m], found); nan and False if the force does not cross the load.
    """
    force = jax.jit(force)  # traced once for both the search and the solve
    grid = jnp.linspace(longest, shortest, _CELLS + 1)
    pull = jax.lax.stop_gradient(jax.vmap(force)(grid) - load)
    # Treat a rounded value at the end as zero: the force at rest without pressure.
    rounding = _ROUNDED * jnp.finfo(pull.dtype).eps * jnp.nanmax(jnp.abs(pull))
    pull = pull.at[-1].set(jnp.where(jnp.abs(pull[-1]) <= rounding, 0.0, pull[-1]))
    falls = (pull[:-1] > 0) & (pull[1:] <= 0)
    found = jnp.any(falls)
    cell = jnp.argmax(falls)
    scale = jnp.where(found, jnp.abs(pull[cell]) + jnp.abs(pull[cell + 1]), 1.0)
    # Scale lengths and residual to order one.
    unit = jax.lax.stop_gradient(longest)

    def residual(y: RealArray) -> RealArray:
        return (force(y * unit) - load) / scale

    root = bisected(residual, grid[cell + 1] / unit, grid[cell] / unit)
    return jnp.where(found, root * unit, jnp.nan), found


def bisected(
    residual: Callable[[RealArray], RealArray], lower: RealArray, upper: RealArray
) -> RealArray:
    """Find a bracketed root by bisection; it is differentiable by the implicit function theorem.

    Derivatives of any order, forward and reverse, are available with respect to everything that the
    residual depends on. If the bracket contains no root, some point in the bracket is returned; its
    derivatives are finite, so other elements of a batch are not affected.

    Args:
        residual: function r(y) of a scalar; it rises from the lower to the upper end.
        lower: lower end of the bracket, shape ().
        upper: upper end of the bracket, shape ().

    Returns:
        y, shape ().
    """

    def solve(function: Callable[[RealArray], RealArray], start: RealArray) -> RealArray:
        def halve(_: Array, ends: tuple[RealArray, RealArray]) -> tuple[RealArray, RealArray]:
            middle = 0.5 * (ends[0] + ends[1])
            below = function(middle) < 0
            return jnp.where(below, middle, ends[0]), jnp.where(below, ends[1], middle)

        halvings = jnp.finfo(start.dtype).nmant + 2  # to the last digit
        ends = jax.lax.fori_loop(0, halvings, halve, jax.lax.stop_gradient((lower, upper)))
        return 0.5 * (ends[0] + ends[1])

    start = jax.lax.stop_gradient(0.5 * (lower + upper))
    return jax.lax.custom_root(jax.jit(residual), start, solve, over_slope)


def required(length: RealArray, found: Bool[Array, "..."], what: str) -> RealArray:
    """Return the length; if it was not found, raise an error that lists the likely causes."""
    return eqx.error_if(
        length,
        ~found,
        f"found no {what}: the force does not cross the load within the range searched. Likely "
        "causes: the load exceeds the muscle's force at that pressure; the pressure is at or below "
        "the deadband; a coefficient has the wrong sign or unit. Pass throw=False to get nan instead.",
    )


class Muscle(AbstractMuscle):
    """A fluidic artificial muscle in static equilibrium: a sum of force terms evaluated for a geometry.

    With a pressurised braid and a bladder, this is the force balance

    F = F_G(P - P_d) + sigma_z V / L - sigma_c t L^2 / (2 pi R N^2)

    The force is not clipped at zero, because root finding and gradients need a smooth function. Where the
    force is negative, a real muscle is slack: it buckles and does not pull. At pressures below the
    deadband, the formula is an extrapolation. `SafeMuscle`, predictions and exports return zero instead
    of a negative force.

    Attributes:
        geometry: geometry that computes the dimensions from the braid and bladder.
        terms: force terms, a `SumOfTerms`.

    References:
        Ferraresi 2001; Hocking & Wereley 2012; Chambers 2021, equation 6.9.

    >>> import famjax
    >>> braid = famjax.Braid.from_rest(diameter=0.023, braid_angle=1.1, length=0.296)
    >>> shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.023, 1.8e-3, embedded=True))
    >>> rubber = famjax.materials.NeoHookeanMaterial(3e5)
    >>> muscle = Muscle(shape, famjax.terms.PressurisedBraid(40e3) + famjax.terms.BladderWall(rubber))
    >>> print(f"{muscle.force(0.28, 4e5):.1f} {Muscle(shape, rubber, 40e3).force(0.28, 4e5):.1f}")
    765.2 765.2
    """

    geometry: AbstractGeometry
    terms: SumOfTerms

    def __init__(
        self,
        geometry: AbstractGeometry,
        terms: AbstractForceTerm | AbstractMaterial | Sequence[AbstractForceTerm],
        deadband_pressure: Real | None = None,
    ) -> None:
        """Create a muscle from force terms, or from the material of its bladder.

        Args:
            geometry: geometry that computes the dimensions.
            terms: a force term, a sum or sequence of terms, or the bladder material, as shorthand for
                `PressurisedBraid(deadband_pressure) + BladderWall(material)`.
            deadband_pressure: P_d [Pa], allowed only with a material; zero by default.

        Raises:
            ValueError: there are no terms, an entry is not a term, or terms are combined with a
                deadband.
        """
        if not isinstance(geometry, AbstractGeometry):
            raise ValueError(
                "the geometry must derive from famjax.geometries.AbstractGeometry, such as "
                f"famjax.EstimatedGeometry(braid, bladder); got {_kind(geometry)}"
            )
        self.geometry = geometry
        if isinstance(terms, AbstractMaterial):
            deadband = 0.0 if deadband_pressure is None else deadband_pressure
            self.terms = SumOfTerms((BladderWall(terms), PressurisedBraid(deadband)))
            return
        if deadband_pressure is not None:
            raise ValueError(
                "deadband_pressure cannot be combined with terms: set it in the pressure term, as in "
                f"PressurisedBraid({deadband_pressure})"
            )
        if isinstance(terms, AbstractForceTerm):
            terms = (terms,)
        self.terms = SumOfTerms(terms)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the static force F [N] at length L [m] and gauge pressure P [Pa]; arguments broadcast.

        The force is nan at impossible states: at a negative length, beyond the thread length, outside
        the measured lengths, and where elastic threads would stretch without limit.
        """
        return _pull(self.geometry, self.terms, as_real(length), as_real(pressure))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest active length [m] for the equilibrium search."""
        return self.geometry.length_range()

    def stops(self) -> Float[Array, "2"]:
        """Return the lengths [m] at which the braid locks and at which its threads are straight."""
        limits, known = jnp.stack(self.geometry.braid_limits()), jnp.stack(self.length_range())
        return jnp.where(jnp.isfinite(limits), limits, known)

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3], the geometry's `inner_volume`; arguments broadcast."""
        return self.geometry.inner_volume(length, pressure)

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m], taken from the geometry."""
        return self.geometry.rest_length

    @property
    def material(self) -> AbstractMaterial:
        """Material of the first term that has one.

        Raises:
            AttributeError: no term has a material.
        """
        return self._holding("material")[0].material

    @property
    def deadband_pressure(self) -> RealArray:
        """Deadband P_d [Pa] of the first term that has one.

        Raises:
            AttributeError: no term has a deadband.
        """
        return self._holding("deadband_pressure")[0].deadband_pressure

    def braid_force(self, length: Real, pressure: Real) -> RealArray:
        """Return the total force [N] of the terms with a deadband pressure; arguments broadcast."""
        terms = SumOfTerms(self._holding("deadband_pressure"))
        return _pull(self.geometry, terms, as_real(length), as_real(pressure))

    def bladder_force(self, length: Real, pressure: Real) -> RealArray:
        """Return the total force [N] of the terms with a material; arguments broadcast.

        The force is negative if these terms resist.
        """
        terms = SumOfTerms(self._holding("material"))
        return _pull(self.geometry, terms, as_real(length), as_real(pressure))

    def _holding(self, field: str) -> tuple:
        holding = tuple(term for term in self.terms.terms if hasattr(term, field))
        if not holding:
            kinds = ", ".join(type(term).__name__ for term in self.terms.terms)
            raise AttributeError(
                f"no term in this muscle has a {field}; its terms are {kinds}. Access the term itself, "
                "as in muscle.terms.terms[0]"
            )
        return holding


@compiled
def _pull(
    geometry: AbstractGeometry, terms: SumOfTerms, length: RealArray, pressure: RealArray
) -> RealArray:
    check_one_muscle(geometry, terms)  # stacking muscles bypasses the constructor
    length, pressure = jnp.broadcast_arrays(length, pressure)
    rated = any(term.uses_rates for term in terms.terms)
    dimensions = geometry.dimensions_with_rates if rated else geometry.dimensions
    at = dimensions(length, pressure)
    if not geometry.keeps_apart:
        # Evaluate a user's geometry again, at possible states only.
        there = at.reached & jnp.isfinite(pressure)
        length = jnp.where(there, length, jax.lax.stop_gradient(geometry.rest_length))
        at = dimensions(length, jnp.where(there, pressure, 0.0)).unless(there)
    # Terms receive finite numbers only: nan would contaminate the derivatives of a whole batch.
    reached = at.reached & (length > 0) & jnp.isfinite(pressure)
    force = terms.force(at.where(reached), jnp.where(reached, pressure, 0.0))
    return jnp.where(reached, force, jnp.nan)


def _kind(value: object) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"


_FOUND = 1e-4  # largest residual of a root, relative to the rigid force
_ROUNDED_RIG = 64  # rounding allowance in units of eps
_HIGHEST_COMPLIANCE = 5e-5  # m/N

SEATING_FORCE = 100.0
"""Reference force [N] for the compliance, at which the deflection does not depend on the exponent."""
LINEAR = 1e-3
"""Fraction of the reference force below which the deflection is linear."""


def give_way(force: Real, compliance: Real, exponent: Real | None = None) -> RealArray:
    """Return the deflection [m] of the mountings and rig under a force [N], with the broadcast shape.

    delta = c F s^(n - 1) with s^2 = (F/100 N)^2 + 0.001^2. The deflection is linear for n = 1. Otherwise,
    it approaches c 100 N (F/100 N)^n well above 0.1 N, as in contacts whose area grows under load
    (Hertz 1882: n = 2/3 between spheres, 1/2 between a cone and a plane). Below 0.1 N, the deflection is
    linear for every n, which keeps the stiffness finite. The deflection is an odd function of the force
    and is smooth everywhere.

    Args:
        force: force [N].
        compliance: secant compliance c [m/N] at 100 N, >= 0.
        exponent: n > 0; None for 1.
    """
    force, compliance = as_real(force), as_real(compliance)
    if exponent is None:
        return compliance * force
    squared = (force / SEATING_FORCE) ** 2 + LINEAR**2
    return compliance * force * squared ** ((as_real(exponent) - 1) / 2)


class MountedMuscle(AbstractMuscle):
    """A muscle in series with the compliance of its mountings and the rig.

    F = F_muscle(x - delta(F), P), where x is the measured length. Under load, the mountings deflect by
    delta = c F, or by a power of the force (see `give_way`), so the muscle is shorter than x by delta.

    Attributes:
        muscle: muscle on rigid mountings.
        compliance: c [m/N], >= 0; with an exponent, the secant compliance at 100 N.
        exponent: n in (0, 1]; None for a linear deflection.
    """

    muscle: AbstractMuscle
    compliance: Float[Given, "..."] = parameter(
        "m/N", name="series_compliance", low=0.0, high=_HIGHEST_COMPLIANCE
    )
    exponent: Float[Given, "..."] | None = parameter(
        name="series_exponent", low=0.3, high=1.0, default=None
    )

    def gives_way(self, force: Real) -> RealArray:
        """Return the deflection [m] of the mountings under a force [N], with the broadcast shape."""
        return give_way(force, self.compliance, self.exponent)

    def with_muscle(self, muscle: AbstractMuscle) -> "MountedMuscle":
        """Return a different muscle on the same mountings and rig."""
        return MountedMuscle(muscle, self.compliance, self.exponent)

    @compiled_method
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the static force F [N] at measured length x [m] and pressure P [Pa]; arguments broadcast.

        The force is found by bisection between zero and F_muscle(x, P), the force in a rigid rig. The force
        of the muscle must fall as the muscle shortens. By the implicit function theorem, the result is
        differentiable to any order with respect to arguments and parameters. It is nan if there is no such
        force.
        """

        def one(length: RealArray, pressure: RealArray) -> RealArray:
            rigid = jax.lax.stop_gradient(self.muscle.force(length, pressure))
            scale = jnp.where(jnp.isfinite(rigid) & (rigid != 0), rigid, 1.0)

            def residual(share: RealArray) -> RealArray:
                shortened = length - self.gives_way(share * scale)
                return share - self.muscle.force(shortened, pressure) / scale

            # The bracket extends beyond the rigid force, the solution for zero compliance.
            share = bisected(residual, jnp.full_like(scale, -0.1), jnp.full_like(scale, 1.1))
            # Near zero force, accept a residual within the effect of a rounded length.
            nearby = self.muscle.force(
                length * (1 + _ROUNDED_RIG * jnp.finfo(scale.dtype).eps), pressure
            )
            rounding = jnp.nan_to_num(jnp.abs(nearby - rigid) / jnp.abs(scale))
            found = jnp.abs(residual(share)) < _FOUND + rounding
            return jnp.where(found & jnp.isfinite(rigid), share * scale, jnp.nan)

        return at_each(one, as_real(length), as_real(pressure))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the length range [m] of the muscle alone: unloaded mountings do not deflect."""
        return self.muscle.length_range()

    def stops(self) -> Float[Array, "2"]:
        """Return the lengths [m] at which the muscle's braid locks and its threads are straight."""
        return self.muscle.stops()

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3] at the muscle's length (measured length minus deflection)."""
        force = self.force(length, pressure)
        known = jnp.isfinite(force)
        own = as_real(length) - self.gives_way(jnp.where(known, force, 0.0))
        return jnp.where(known, self.muscle.volume(own, pressure), jnp.nan)

    def declared(self) -> dict[str, Declared]:
        """Return the declarations of all parameters; none of them is declared linear.

        The force changes the length of the muscle, so the force is not affine in any parameter.
        """
        own = super().declared()
        return {name: dataclasses.replace(one, linear=False) for name, one in own.items()}

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m] without load, taken from the muscle."""
        return self.muscle.rest_length


class MeanMuscle(AbstractMuscle):
    """The weighted mean of several models of the same muscle, F = sum w_i F_i.

    Attributes:
        members: models with the same rest length.
        weights: w_i [-], shape (members,); they sum to 1.
    """

    members: tuple[AbstractMuscle, ...]
    weights: Float[Array, " members"] = eqx.field(converter=as_number)

    def __init__(
        self,
        members: Sequence[AbstractMuscle],
        weights: Sequence[float] | Float[Array, " members"] | None = None,
    ) -> None:
        """Create a weighted mean; by default, the weights are equal.

        Raises:
            ValueError: there are no members, or their number differs from the number of weights.
        """
        self.members, count = tuple(members), len(members)
        self.weights = as_real(jnp.full(count, 1 / max(count, 1)) if weights is None else weights)
        if not count or self.weights.shape != (count,):
            raise ValueError(
                f"a mean needs at least one member, and one weight per member; got {count} members and "
                f"weights with shape {self.weights.shape}"
            )

    @compiled_method
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the static force F [N] at length L [m] and gauge pressure P [Pa]; arguments broadcast."""
        L, P = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        count = len(self.members)
        forces = of_each(lambda one, L, P: one.force(L, P), self.members, [L] * count, [P] * count)
        return jnp.einsum("i,i...->...", self.weights, forces)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest active length [m] common to all members."""
        ranges = [one.length_range() for one in self.members]
        shortest, longest = (jnp.stack([one[k] for one in ranges]) for k in (0, 1))
        return jnp.max(shortest), jnp.min(longest)

    def stops(self) -> Float[Array, "2"]:
        """Return the shortest and longest length [m] that lie between the stops of every member."""
        each = jnp.stack([one.stops() for one in self.members])
        return jnp.stack([jnp.max(each[:, 0]), jnp.min(each[:, 1])])

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3] of the first member."""
        return self.members[0].volume(length, pressure)

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m] of the first member."""
        return self.members[0].rest_length


def flatten(
    mounted: MountedMuscle,
) -> tuple[Float[Array, " numbers"], Callable[[Float[Array, " numbers"]], MountedMuscle]]:
    """Return all numbers of a mounted muscle as a vector, and the function that restores it."""
    numbers, rest = eqx.partition(mounted, eqx.is_inexact_array)
    flat, unflat = ravel_pytree(numbers)
    return flat, lambda changed: eqx.combine(unflat(changed), rest)


def number_names(mounted: MountedMuscle) -> tuple[str, ...]:
    """Return the names of the numbers returned by `flatten`, such as "muscle.geometry.braid.turns"."""
    leaves = jax.tree_util.tree_flatten_with_path(eqx.filter(mounted, eqx.is_inexact_array))[0]
    return tuple(
        jax.tree_util.keystr(path).lstrip(".") + "".join(f"[{i}]" for i in index)
        for path, leaf in leaves
        for index in np.ndindex(np.shape(leaf))
    )


def cut_to_length(muscle: AbstractMuscle, rest_length: Real) -> AbstractMuscle:
    """Return a muscle with the same construction and another rest length.

    The braid keeps its diameter and angle at rest, so B0 and N scale with L0. The cross-section of the
    bladder, its material and the deadband stay the same. Rounded ends keep their dead length
    l = L0 (1 - 1/k), which does not depend on the length of the muscle.

    Args:
        muscle: muscle with an estimated geometry (with or without an end effect), with an equilibrium
            shape, or with your own geometry that has a method `cut_to_length`.
        rest_length: new L0 [m], > 0 and above the dead length.

    Returns:
        The new muscle; differentiable with respect to its rest length.

    Raises:
        ValueError: the shape was measured or assumed for only one length.

    >>> from famjax import Bladder, Braid, EstimatedGeometry, PolynomialMaterial
    >>> braid = Braid.from_rest(diameter=0.01, braid_angle=1.1, length=0.3)
    >>> long = Muscle(EstimatedGeometry(braid, Bladder(0.3, 0.009, 0.001)), PolynomialMaterial([1e6]))
    >>> short = cut_to_length(long, 0.1)
    >>> print(f"{short.blocked_force(5e5) / long.blocked_force(5e5):.6f}")
    1.000000
    """
    if isinstance(muscle, Muscle):
        geometry = muscle.geometry.cut_to_length(as_real(rest_length))
        return dataclasses.replace(muscle, geometry=geometry)
    own = getattr(muscle, "cut_to_length", None)
    if own is None:
        raise ValueError(
            f"a {type(muscle).__name__} cannot be cut to another length: cut the muscle that it contains"
        )
    return own(as_real(rest_length))
