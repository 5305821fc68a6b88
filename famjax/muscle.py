"""Methods of every static force model: stiffness, blocked force, equilibrium lengths, onset."""

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
    of_each,
    over_slope,
)
from .boundary.errors import InputError
from .geometries import AbstractGeometry
from .materials import AbstractMaterial
from .parameters import Declared, Parametrised, declaration, parameter
from .terms import AbstractForceTerm, BladderWall, PressurisedBraid, SumOfTerms


class AbstractMuscle(Parametrised):
    """A static force model: a force at a length and a pressure, and all that follows from it.

    A model of your own is a class with `force`, `rest_length` and `length_range`. Methods are mapped
    and differentiated as they are, `jax.vmap(muscle.force)`, and compiled by equinox:
    `eqx.filter_jit(muscle.force)`.

    One instance is one muscle: its numbers are scalars. Many muscles are made and asked under
    `jax.vmap` or `equinox.filter_vmap`.

    Attributes:
        rest_length: active length L0 [m] of zero contraction.
    """

    if TYPE_CHECKING:

        @property
        def rest_length(self) -> RealArray: ...  # noqa: D102

    else:
        rest_length: eqx.AbstractVar[RealArray]  # a field or a property

    def __check_init__(self) -> None:
        """Refuse a batch of muscles."""
        check_one_muscle(self)

    @abc.abstractmethod
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape.

        Nan where the model has no such state, such as at a negative length. Its derivative there is 0,
        so that those of the others in a batch, and of what they share, are right.
        """

    @abc.abstractmethod
    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] for the equilibrium search."""

    def stops(self) -> Float[Array, "2"]:
        """Lengths [m] at which the braid locks and at which its threads are straight.

        The ends of `length_range` for a model that does not know its braid.
        """
        return jnp.stack(self.length_range())

    def volume(self, length: Real, pressure: Real) -> RealArray:  # noqa: ARG002
        """Volume V [m3] of the fluid at active length L [m] and gauge pressure P [Pa].

        Returns:
            V, broadcast shape; nan where the model has no such state.

        Raises:
            InputError: a model that has no geometry.
        """
        raise InputError(
            f"a {type(self).__name__} has no volume, as it has no geometry: ask a famjax.Muscle, "
            "or give a function of the gauge pressure [Pa] that returns the volume [m3]"
        )

    def stiffness(self, length: Real, pressure: Real) -> RealArray:
        """Axial stiffness dF/dL [N/m] at constant pressure, broadcast shape; positive resists."""
        return _stiffness(self, as_real(length), as_real(pressure))

    def blocked_force(self, pressure: Real) -> RealArray:
        """Blocked force [N], the pull at zero contraction and gauge pressure P [Pa]."""
        return _force(self, self.rest_length, as_real(pressure))

    def length_at_load(self, load: Real, pressure: Real, *, throw: bool = True) -> RealArray:
        """Active length L [m] at which the muscle, contracting, carries the load.

        Args:
            load: [N], positive when it stretches the muscle.
            pressure: gauge pressure P [Pa].
            throw: raise where there is no such length; if False, return nan there.

        Returns:
            L [m], broadcast shape. Differentiable in load, pressure and every number of the
            muscle by the implicit function theorem.

        Raises:
            RuntimeError: there is no such length, and `throw`.
        """
        length, found = _length_at_load(self, as_real(load), as_real(pressure))
        return required(length, found, "equilibrium length") if throw else length

    def free_contraction(self, pressure: Real, *, throw: bool = True) -> RealArray:
        """Free contraction (L0 - L) / L0 [-] at zero force and gauge pressure P [Pa].

        Args:
            pressure: gauge pressure P [Pa]. Below the deadband the muscle rests longer than L0
                and the result is negative.
            throw: raise where the force has no zero; if False, return nan there.

        Returns:
            Contraction [-], a fraction, of the pressure's shape; differentiable.

        Raises:
            RuntimeError: the force has no zero, and `throw`.
        """
        length, rest = self.length_at_load(0.0, pressure, throw=throw), self.rest_length
        known = jnp.isfinite(length)
        # Nan divided by the rest length would spoil the derivative of all others in it.
        return jnp.where(known, 1 - jnp.where(known, length, 0.0) / rest, jnp.nan)

    def onset_pressure(self, length: Real, highest: Real, *, throw: bool = True) -> RealArray:
        """Gauge pressure [Pa] at which the force rises from zero at fixed length: the onset.

        Args:
            length: active length L [m].
            highest: pressure [Pa] up to which the onset is looked for.
            throw: raise where there is none; if False, return nan there.

        Returns:
            P [Pa], broadcast shape; differentiable in length and every number of the muscle.

        Raises:
            RuntimeError: the force has no zero between 0 and `highest`, and `throw`.
        """
        pressure, found = _onset_pressure(self, as_real(length), as_real(highest))
        return required(pressure, found, "onset pressure") if throw else pressure


@compiled
def _force(muscle: AbstractMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    return muscle.force(length, pressure)


@compiled
def _stiffness(muscle: AbstractMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    check_one_muscle(muscle)
    force, stiffness = at_each(jax.value_and_grad(muscle.force), length, pressure)
    return jnp.where(jnp.isnan(force), jnp.nan, stiffness)


@compiled
def _length_at_load(
    muscle: AbstractMuscle, load: RealArray, pressure: RealArray
) -> tuple[RealArray, Bool[Array, "..."]]:
    check_one_muscle(muscle)
    shortest, longest = muscle.length_range()

    def one(load: RealArray, pressure: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
        return longest_equilibrium(
            lambda length: muscle.force(length, pressure), shortest, longest, load
        )

    return at_each(one, load, pressure)


@compiled
def _onset_pressure(
    muscle: AbstractMuscle, length: RealArray, highest: RealArray
) -> tuple[RealArray, Bool[Array, "..."]]:
    check_one_muscle(muscle)

    def one(length: RealArray, top: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
        none = jnp.zeros_like(top)
        return longest_equilibrium(lambda pressure: muscle.force(length, pressure), none, top, none)

    return at_each(one, length, highest)


def check_one_muscle(*parts: eqx.Module) -> None:
    """Refuse declared numbers with more axes than their declaration has.

    Args:
        parts: a muscle, or parts of one.

    Raises:
        ValueError: a number of a part, or of a part of it, is an array where one is meant.
    """
    for part in parts:
        _check(part, type(part).__name__)


def _check(part: eqx.Module, where: str) -> None:
    axes = _axes(type(part))
    for field in dataclasses.fields(part):
        value = getattr(part, field.name, None)
        at = f"{where}.{field.name}"
        if field.name in axes and value is not None:
            if jnp.ndim(value) != axes[field.name]:
                wanted = "one number" if not axes[field.name] else f"{axes[field.name]} axes"
                raise ValueError(
                    f"one muscle is meant: {at} must have {wanted}, got the shape "
                    f"{jnp.shape(value)}. Make and ask many muscles under jax.vmap or "
                    "equinox.filter_vmap, over a function that makes one"
                )
        elif isinstance(value, eqx.Module):
            _check(value, at)
        elif isinstance(value, tuple | list):
            for i, one in enumerate(value):
                if isinstance(one, eqx.Module):
                    _check(one, f"{at}[{i}]")


@functools.cache
def _axes(cls: type[eqx.Module]) -> dict[str, int]:
    """Number of axes of every declared number of a class: its annotation's, by default none.

    What is annotated with names that cannot be resolved is not known, and not checked.
    """
    declared = [field for field in dataclasses.fields(cls) if declaration(field) is not None]
    if any(isinstance(field.type, str) for field in declared):
        try:
            hints: dict[str, Any] = typing.get_type_hints(cls)
        except NameError:
            return {}
    else:
        hints = {field.name: field.type for field in declared}
    return {field.name: _axes_of(hints[field.name]) for field in declared}


def _axes_of(annotation: Any) -> int:
    for one in (annotation, *typing.get_args(annotation)):
        if hasattr(one, "dims"):
            return 0 if one.index_variadic is not None else len(one.dims)
    return 0


_CELLS = 64
_ROUNDED = 64  # times the precision, per largest force: a few sums and powers of rounded numbers


def longest_equilibrium(
    force: Callable[[RealArray], RealArray],
    shortest: RealArray,
    longest: RealArray,
    load: RealArray,
) -> tuple[RealArray, Bool[Array, ""]]:
    """The longest length at which a shortening muscle's force has fallen to the load.

    The range is walked from its longest end in 64 steps to the first one in which the force falls
    through the load, and that step is bisected to the last digit. What the force depends on is
    differentiated by the implicit function theorem, not through the search.

    Args:
        force: F(L) [N], of a scalar length.
        shortest: lower end of the range [m], shape ().
        longest: upper end of the range [m], shape ().
        load: [N], shape ().

    Returns:
        (length [m], found): nan and False where the force does not fall through the load.
    """
    force = jax.jit(force)  # traced once, for the walk and for the parts of the solve
    grid = jnp.linspace(longest, shortest, _CELLS + 1)
    pull = jax.lax.stop_gradient(jax.vmap(force)(grid) - load)
    # A zero at the very end that rounding left above zero is one: the force at rest without pressure.
    rounding = _ROUNDED * jnp.finfo(pull.dtype).eps * jnp.nanmax(jnp.abs(pull))
    pull = pull.at[-1].set(jnp.where(jnp.abs(pull[-1]) <= rounding, 0.0, pull[-1]))
    falls = (pull[:-1] > 0) & (pull[1:] <= 0)
    found = jnp.any(falls)
    cell = jnp.argmax(falls)
    scale = jnp.where(found, jnp.abs(pull[cell]) + jnp.abs(pull[cell + 1]), 1.0)
    # The solve runs in parts of the rest range and of the force in the cell, both of order one.
    unit = jax.lax.stop_gradient(longest)

    def residual(y: RealArray) -> RealArray:
        return (force(y * unit) - load) / scale

    dtype = jnp.result_type(unit, pull)
    tolerance = 4 * float(jnp.finfo(dtype).eps)
    root = bisected(
        residual,
        grid[cell + 1] / unit,
        grid[cell] / unit,
        tolerance=tolerance,
        max_steps=20 if dtype == jnp.float32 else 50,
    )
    return jnp.where(found, root * unit, jnp.nan), found


def bisected(
    residual: Callable[[RealArray], RealArray],
    lower: RealArray,
    upper: RealArray,
    *,
    tolerance: float,
    max_steps: int,
    flip: bool = False,
) -> RealArray:
    """The root of a residual in a bracket, with the derivatives of the implicit function theorem.

    Derivatives of any order, forward and reverse, in whatever the residual depends on. Where the
    bracket holds no root some point of it is returned, with finite derivatives where the residual
    has them, so that it does no harm to others in a batch.

    Args:
        residual: r(y) of a scalar, of order one.
        lower: end of the bracket, shape ().
        upper: the other end.
        tolerance: absolute and relative.
        max_steps: of the bisection.
        flip: r falls from the lower to the upper end.

    Returns:
        y, shape ().
    """

    def solve(function: Callable[[RealArray], RealArray], start: RealArray) -> RealArray:
        import optimistix as optx  # noqa: PLC0415 -- slow to load, and only needed for a root

        return optx.root_find(
            lambda y, _: function(y),
            optx.Bisection(rtol=tolerance, atol=tolerance, flip=flip),
            start,
            options={"lower": lower, "upper": upper},
            max_steps=max_steps,
            throw=False,
        ).value

    start = jax.lax.stop_gradient(0.5 * (lower + upper))
    return jax.lax.custom_root(jax.jit(residual), start, solve, over_slope)


def required(length: RealArray, found: Bool[Array, "..."], what: str) -> RealArray:
    """The length, or an error with the likely causes if no equilibrium was found."""
    return eqx.error_if(
        length,
        ~found,
        f"no {what}: the force does not fall through the load between the longest and the "
        "shortest length of the muscle. Likely causes: the load exceeds what the muscle pulls at "
        "that pressure; the pressure is at or below the deadband; a coefficient has the wrong "
        "sign or unit. Pass throw=False to get nan instead.",
    )


class Muscle(AbstractMuscle):
    """A fluidic artificial muscle in static equilibrium: the sum of its force terms in a geometry.

    Of a pressurised braid and a bladder it is the force balance

    F = F_G(P - P_d) + sigma_z V / L - sigma_c t L^2 / (2 pi R N^2)

    The force is that of the model, not clipped, as roots and gradients need it: where it is below
    zero a real muscle is slack, buckles and pulls nothing, and below the deadband the formula is an
    extrapolation. `SafeMuscle`, predictions and exports give no force there.

    Attributes:
        geometry: source of the dimensions; it composes braid and bladder.
        terms: what pulls, a `SumOfTerms`.

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
        """The muscle of these terms, or of a pressurised braid and a bladder of this material.

        Args:
            geometry: source of the dimensions.
            terms: a force term, a sum or a sequence of them; or the material of the bladder, which
                stands for `PressurisedBraid(deadband_pressure) + BladderWall(material)`.
            deadband_pressure: P_d [Pa], beside a material only; zero by default. Among terms it is
                the braid's own.

        Raises:
            ValueError: no terms, something else than terms, or a deadband beside terms.
        """
        if not isinstance(geometry, AbstractGeometry):
            raise ValueError(
                "the geometry of a muscle is derived from famjax.geometries.AbstractGeometry, such as "
                f"famjax.EstimatedGeometry(braid, bladder); got {_kind(geometry)}"
            )
        self.geometry = geometry
        if isinstance(terms, AbstractMaterial):
            deadband = 0.0 if deadband_pressure is None else deadband_pressure
            self.terms = SumOfTerms((BladderWall(terms), PressurisedBraid(deadband)))
            return
        if deadband_pressure is not None:
            raise ValueError(
                "the deadband pressure belongs to the term of the pressure, as in "
                f"PressurisedBraid({deadband_pressure}); beside terms it cannot be given"
            )
        if isinstance(terms, AbstractForceTerm):
            terms = (terms,)
        self.terms = SumOfTerms(terms)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape.

        Nan where the geometry cannot be: at a negative length, beyond the threads' length, outside
        the measured lengths, where a soft braid gives way.
        """
        return _pull(self.geometry, self.terms, as_real(length), as_real(pressure))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] for the equilibrium search."""
        return self.geometry.length_range()

    def stops(self) -> Float[Array, "2"]:
        """Lengths [m] at which the braid locks and at which its threads are straight, if it has one."""
        limits, known = jnp.stack(self.geometry.braid_limits()), jnp.stack(self.length_range())
        return jnp.where(jnp.isfinite(limits), limits, known)

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, the geometry's `inner_volume`, broadcast shape."""
        return self.geometry.inner_volume(length, pressure)

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction: the geometry's."""
        return self.geometry.rest_length

    @property
    def material(self) -> AbstractMaterial:
        """The material of the first term that has one.

        Raises:
            AttributeError: no term has one.
        """
        return self._holding("material")[0].material

    @property
    def deadband_pressure(self) -> RealArray:
        """P_d [Pa] of the first term that has one.

        Raises:
            AttributeError: no term has one.
        """
        return self._holding("deadband_pressure")[0].deadband_pressure

    def braid_force(self, length: Real, pressure: Real) -> RealArray:
        """Pull [N] of the pressure alone, of the terms with a deadband pressure, broadcast shape."""
        terms = SumOfTerms(self._holding("deadband_pressure"))
        return _pull(self.geometry, terms, as_real(length), as_real(pressure))

    def bladder_force(self, length: Real, pressure: Real) -> RealArray:
        """Pull [N] of the bladder alone, of the terms with a material; negative where it resists."""
        terms = SumOfTerms(self._holding("material"))
        return _pull(self.geometry, terms, as_real(length), as_real(pressure))

    def _holding(self, field: str) -> tuple:
        """The terms that have this field."""
        holding = tuple(term for term in self.terms.terms if hasattr(term, field))
        if not holding:
            kinds = ", ".join(type(term).__name__ for term in self.terms.terms)
            raise AttributeError(
                f"no term of this muscle has a {field}; its terms are {kinds}. Read the term itself, "
                "as in muscle.terms.terms[0]"
            )
        return holding


@compiled
def _pull(
    geometry: AbstractGeometry, terms: SumOfTerms, length: RealArray, pressure: RealArray
) -> RealArray:
    """The force [N] of some terms, nan where the muscle cannot be."""
    check_one_muscle(geometry, terms)  # a stack of muscles was never constructed
    length, pressure = jnp.broadcast_arrays(length, pressure)
    rated = any(term.uses_rates for term in terms.terms)
    dimensions = geometry.dimensions_with_rates if rated else geometry.dimensions
    at = dimensions(length, pressure)
    if not geometry.keeps_apart:
        # A geometry of a user's own is asked once more, of states that there are, for the same reason.
        there = at.reached & jnp.isfinite(pressure)
        length = jnp.where(there, length, jax.lax.stop_gradient(geometry.rest_length))
        at = dimensions(length, jnp.where(there, pressure, 0.0)).unless(there)
    # Terms see numbers everywhere: what is nan would spoil the derivatives of all others in a batch.
    reached = at.reached & (length > 0) & jnp.isfinite(pressure)
    force = terms.force(at.where(reached), jnp.where(reached, pressure, 0.0))
    return jnp.where(reached, force, jnp.nan)


def _kind(value: object) -> str:
    return f"the class {value.__name__}" if isinstance(value, type) else f"a {type(value).__name__}"


_FOUND = 1e-4  # of the rigid force: what is left where a bracket held no root at all
_ROUNDED_RIG = 64  # times the precision
_HIGHEST_COMPLIANCE = 5e-5  # m/N

SEATING_FORCE = 100.0
"""Force [N] at which a rig gives way by the same, whatever its exponent."""
_LINEAR = 1e-3  # of it: below, every rig gives way in proportion to the force


def give_way(force: Real, compliance: Real, exponent: Real | None = None) -> RealArray:
    """Deflection [m] of mountings and rig under a force [N], broadcast shape.

    delta = c F s^(n - 1) with s^2 = (F/100 N)^2 + 0.001^2: in proportion to the force for n = 1, and
    else c 100 N (F/100 N)^n, as contacts that grow under load do (Hertz 1882: 2/3 between spheres, 1/2
    between a cone and a plane). Below a tenth of a newton it is in proportion to the force for every
    n, as it must be for the stiffness to stay finite; odd in the force, smooth everywhere.

    Args:
        force: [N].
        compliance: c [m/N], that of the secant at 100 N, >= 0.
        exponent: n > 0; None stands for 1.
    """
    force, compliance = as_real(force), as_real(compliance)
    if exponent is None:
        return compliance * force
    squared = (force / SEATING_FORCE) ** 2 + _LINEAR**2
    return compliance * force * squared ** ((as_real(exponent) - 1) / 2)


class MountedMuscle(AbstractMuscle):
    """A muscle in series with the compliance of its mountings and of the rig.

    F = F_muscle(x - delta(F), P), with x the length that the rig measures: under load the mountings
    give way by delta = c F, or by a power of the force, see `give_way`, and the muscle is that much
    shorter.

    Attributes:
        muscle: the muscle itself.
        compliance: c [m/N], >= 0; where there is an exponent, that of the secant at 100 N.
        exponent: n of the power, in (0, 1]; None for a rig that gives way in proportion.
    """

    muscle: AbstractMuscle
    compliance: Float[Given, "..."] = parameter(
        "m/N", name="series_compliance", low=0.0, high=_HIGHEST_COMPLIANCE
    )
    exponent: Float[Given, "..."] | None = parameter(
        name="series_exponent", low=0.3, high=1.0, default=None
    )

    def gives_way(self, force: Real) -> RealArray:
        """Deflection [m] of the mountings under a force [N], broadcast shape."""
        return give_way(force, self.compliance, self.exponent)

    def with_muscle(self, muscle: AbstractMuscle) -> "MountedMuscle":
        """Another muscle in the same rig."""
        return MountedMuscle(muscle, self.compliance, self.exponent)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at measured length x [m] and gauge pressure P [Pa], broadcast shape.

        Bisection between no force and that of a rigid mounting, F_muscle(x, P), for a muscle that
        pulls the less the shorter it is. Differentiable to any order in the arguments and in every
        number of the muscle, by the implicit function theorem; nan where there is no such force.
        """
        return _forces(self, as_real(length), as_real(pressure))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Length range [m] of the muscle; without load the mountings do not deflect."""
        return self.muscle.length_range()

    def stops(self) -> Float[Array, "2"]:
        """Lengths [m] of the stops of the muscle."""
        return self.muscle.stops()

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, at the length of the muscle without the mountings' deflection."""
        force = self.force(length, pressure)
        known = jnp.isfinite(force)
        own = as_real(length) - self.gives_way(jnp.where(known, force, 0.0))
        return jnp.where(known, self.muscle.volume(own, pressure), jnp.nan)

    def declared(self) -> dict[str, Declared]:
        """Declarations of the compliance and of the muscle, none of them linear.

        The force acts on the length at which the muscle is asked, so it is affine in nothing.
        """
        own = super().declared()
        return {name: dataclasses.replace(one, linear=False) for name, one in own.items()}

    @property
    def rest_length(self) -> RealArray:
        """Measured length [m] of zero contraction without load: the muscle's own."""
        return self.muscle.rest_length


@compiled
def _forces(mounted: MountedMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    def one(length: RealArray, pressure: RealArray) -> RealArray:
        rigid = jax.lax.stop_gradient(mounted.muscle.force(length, pressure))
        scale = jnp.where(jnp.isfinite(rigid) & (rigid != 0), rigid, 1.0)

        def residual(share: RealArray) -> RealArray:
            shortened = length - mounted.gives_way(share * scale)
            return share - mounted.muscle.force(shortened, pressure) / scale

        fine = jnp.finfo(scale.dtype)
        share = bisected(
            residual,
            # A little more than all of the rigid force, which a rigid mounting itself has.
            jnp.full_like(scale, -0.1),
            jnp.full_like(scale, 1.1),
            tolerance=4 * float(fine.eps),
            max_steps=fine.nmant + 2,
        )
        # Near zero force what is left is rounding: less than what a rounded length makes of it.
        nearby = mounted.muscle.force(length * (1 + _ROUNDED_RIG * fine.eps), pressure)
        rounding = jnp.nan_to_num(jnp.abs(nearby - rigid) / jnp.abs(scale))
        found = jnp.abs(residual(share)) < _FOUND + rounding
        return jnp.where(found & jnp.isfinite(rigid), share * scale, jnp.nan)

    return at_each(one, length, pressure)


class MeanMuscle(AbstractMuscle):
    """Several models of one muscle, F = sum w_i F_i.

    Attributes:
        members: models of the same rest length.
        weights: w_i [-], of sum 1, shape (members,).
    """

    members: tuple[AbstractMuscle, ...]
    weights: Float[Array, " members"] = eqx.field(converter=as_number)

    def __init__(
        self,
        members: Sequence[AbstractMuscle],
        weights: Sequence[float] | Float[Array, " members"] | None = None,
    ) -> None:
        """The mean of the members, or their sum with these weights.

        Raises:
            ValueError: no members, or not a weight for each.
        """
        self.members = tuple(members)
        count = len(self.members)
        self.weights = as_real(jnp.full(count, 1 / max(count, 1)) if weights is None else weights)
        if not count or self.weights.shape != (count,):
            raise ValueError(
                f"a mean needs members and a weight for each, got {count} and weights of shape "
                f"{self.weights.shape}"
            )

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        return _mean_force(self, *jnp.broadcast_arrays(as_real(length), as_real(pressure)))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] that all members have."""
        ranges = [one.length_range() for one in self.members]
        shortest, longest = (jnp.stack([one[k] for one in ranges]) for k in (0, 1))
        return jnp.max(shortest), jnp.min(longest)

    def stops(self) -> Float[Array, "2"]:
        """Lengths [m] between the stops of all members."""
        each = jnp.stack([one.stops() for one in self.members])
        return jnp.stack([jnp.max(each[:, 0]), jnp.min(each[:, 1])])

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid: the first member's."""
        return self.members[0].volume(length, pressure)

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction: the first member's."""
        return self.members[0].rest_length


@compiled
def _mean_force(mean: MeanMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    count = len(mean.members)
    forces = of_each(
        lambda one, L, P: one.force(L, P), mean.members, [length] * count, [pressure] * count
    )
    return jnp.einsum("i,i...->...", mean.weights, forces)


def flatten(
    mounted: MountedMuscle,
) -> tuple[Float[Array, " numbers"], Callable[[Float[Array, " numbers"]], MountedMuscle]]:
    """All numbers of a mounted muscle in one row, and the function that restores it."""
    numbers, rest = eqx.partition(mounted, eqx.is_inexact_array)
    flat, unflat = ravel_pytree(numbers)
    return flat, lambda changed: eqx.combine(unflat(changed), rest)


def number_names(mounted: MountedMuscle) -> tuple[str, ...]:
    """Names of the numbers of `flatten`, such as "muscle.geometry.braid.turns"."""
    leaves = jax.tree_util.tree_flatten_with_path(eqx.filter(mounted, eqx.is_inexact_array))[0]
    return tuple(
        jax.tree_util.keystr(path).lstrip(".") + "".join(f"[{i}]" for i in index)
        for path, leaf in leaves
        for index in np.ndindex(np.shape(leaf))
    )


def cut_to_length(muscle: AbstractMuscle, rest_length: Real) -> AbstractMuscle:
    """The muscle with another rest length and otherwise the same construction.

    The braid keeps its diameter and angle at rest, so that B0 and N are proportional to L0; bladder
    section, rubber and deadband stay. Rounded ends keep their dead length l = L0 (1 - 1/k), as the
    end-fittings do not know how long the muscle is.

    Args:
        muscle: of a geometry that can be cut: an estimated one, with or without an end effect, or one
            of your own with a method `cut_to_length`; or with the shape from mechanics.
        rest_length: L0 [m] of the other muscle, > 0, above the dead length.

    Returns:
        The other muscle. Differentiable in its length.

    Raises:
        ValueError: the shape was measured or assumed over the length, and cannot be cut.

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
