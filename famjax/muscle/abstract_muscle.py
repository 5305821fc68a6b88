"""What everything with a static force offers: stiffness, blocked force, equilibrium lengths, onset."""

import abc
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._compiled import compiled
from .._each import at_each
from .._types import Real, RealArray, as_real
from ..boundary.errors import InputError
from ..parameters import Parametrised
from .equilibrium import longest_equilibrium, required
from .one_muscle import check_one_muscle


class AbstractMuscle(Parametrised):
    """A static force model: a pull at a length and a pressure, and all that follows from it.

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
        """Shortest and longest active length [m] between which an equilibrium is looked for."""

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
        """Gauge pressure [Pa] at which the force leaves zero at a held length: the onset.

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
