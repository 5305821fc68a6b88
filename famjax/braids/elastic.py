"""The braid of elastic threads: how pressure and pull lengthen the threads and widen the braid."""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._compiled import compiled_method
from .._each import at_each
from .._types import Given, Real, RealArray, as_real
from ..parameters import number, parameter
from .elastic_root import strain_under_cubic, strain_under_line
from .gaylord import gaylord_force
from .inextensible import AbstractBraid, braid_angle_from_length, diameter_from_length
from .thread import AbstractThread, thread_tension


class BraidState(eqx.Module):
    """A braid at one length and pressure under its own pull, Gaylord's.

    Attributes:
        thread_length: B [m].
        diameter: D [m].
        braid_angle: theta [rad], from the circumference.
        gaylord_force: F_G [N].
        tension: T [N] of one thread.
    """

    thread_length: RealArray
    diameter: RealArray
    braid_angle: RealArray
    gaylord_force: RealArray
    tension: RealArray


class BraidStretch(eqx.Module):
    """The same braid with and without the stretch of its threads.

    Attributes:
        elastic: with the threads as long as their tension makes them.
        inelastic: with the threads at their rest length.
    """

    elastic: BraidState
    inelastic: BraidState


_Stretched = tuple[RealArray, Bool[Array, "..."], Bool[Array, "..."]]
"""B [m] of finite numbers, whether it is an equilibrium, and whether it is longer than the braid."""


class ElasticBraid(AbstractBraid):
    """A braid of elastic threads, each as long as its tension makes it.

    B = B0 (1 + strain(T)),  T = (F + P pi R^2) / (n sin(theta)),  pi N D = sqrt(B^2 - L^2)

    All attributes are scalars. Two things can forbid an equilibrium, and both give nan in sweeps
    and an error where a method is asked to `throw`:

    - The threads are too soft: a longer thread makes the braid wider, so the tension grows with the
      stretch. Where it outgrows every force of the thread the braid gives way without limit; under
      Gaylord's force that is where B0 P L / (2 pi N^2 n A_b E_b) >= 1.
    - The active length is L >= B: the threads lie along the axis and enclose nothing.

    Attributes:
        rest_thread_length: B0 [m], one unloaded thread from fitting to fitting.
        turns: N [-], turns of one thread about the axis, a float.
        thickness: t_braid [m], two threads crossing; the bladder lies below it.
        n_threads: n [-], threads of both families.
        thread: the law of one thread.

    References:
        Chambers 2021, section 5.1.

    >>> from famjax.braids import LinearThread
    >>> kevlar = LinearThread(11.6e6, 1.332e-4)
    >>> braid = ElasticBraid(9.89, 1.09, 0.011, 144, kevlar)  # inches, psi
    >>> print(f"{braid.thread_length(9.28125, 100.0):.3f}")
    9.945
    """

    rest_thread_length: Float[Given, "..."] = parameter("m", low=0.0)
    turns: Float[Given, "..."] = parameter(low=0.0)
    thickness: Float[Given, "..."] = number("m")
    n_threads: Float[Given, "..."] = number()
    thread: AbstractThread

    def thread_length(self, length: Real, pressure: Real, *, throw: bool = False) -> RealArray:
        """Thread length B [m] under Gaylord's force, that is, with no help from the bladder.

        F_G + P pi R^2 = P L^2 / (2 pi N^2) at any diameter, so the tension is proportional to B.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa], >= 0; B0 at zero.
            throw: raise where there is no equilibrium; if False, as in `dimensions`, nan there.

        Returns:
            B [m], broadcast shape. Differentiable to any order in the arguments and in every
            number of the braid, by the implicit function theorem.

        Raises:
            RuntimeError: there is no equilibrium, and `throw`.
        """
        arrays = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        return _required(*self._under_its_own_pull(*arrays), throw=throw)

    def thread_length_at_force(
        self, length: Real, pressure: Real, force: Real, *, throw: bool = True
    ) -> RealArray:
        """Thread length B [m] under a given pull, such as a measured one.

        The tension is a cubic in B. Of the lengths that satisfy the balance the shortest is meant,
        which a growing load reaches; beyond it the braid widens faster than its threads resist.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa], >= 0.
            force: pull F [N] of the muscle, bladder included, >= 0.
            throw: raise where there is no equilibrium; if False, return nan there.

        Returns:
            B [m], broadcast shape; differentiable as `thread_length` is.

        Raises:
            RuntimeError: there is no equilibrium, and `throw`.
        """
        arrays = jnp.broadcast_arrays(as_real(length), as_real(pressure), as_real(force))
        return _required(*self._under_a_pull(*arrays), throw=throw)

    def stretch(self, length: Real, pressure: Real) -> BraidStretch:
        """B, D, theta, Gaylord's force and the tension, with and without stretch.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa], >= 0.

        Returns:
            The two states, of broadcast shape; nan where there is no equilibrium.
        """
        length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        rest = jnp.broadcast_to(self.rest_thread_length, length.shape)
        elastic = self._state(length, pressure, self.thread_length(length, pressure))
        return BraidStretch(elastic, self._state(length, pressure, rest))

    @compiled_method
    def _under_its_own_pull(self, length: RealArray, pressure: RealArray) -> _Stretched:
        def strain(length: RealArray, pressure: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
            tension = self._tension_at_rest_length(length, pressure)
            return strain_under_line(self.thread, jnp.zeros_like(tension), tension)

        return self._stretched(strain, length, pressure)

    @compiled_method
    def _under_a_pull(self, length: RealArray, pressure: RealArray, force: RealArray) -> _Stretched:
        def strain(
            length: RealArray, pressure: RealArray, force: RealArray
        ) -> tuple[RealArray, Bool[Array, ""]]:
            rest = self.rest_thread_length
            # pi R^2 = (B^2 - L^2) / section and sin(theta) = L / B, with B = B0 (1 + strain)
            section = 4 * jnp.pi * self.turns**2
            share = rest / (self.n_threads * length)
            linear = share * (force - pressure * length**2 / section)
            cubic = share * pressure * rest**2 / section
            return strain_under_cubic(self.thread, linear, cubic)

        return self._stretched(strain, length, pressure, force)

    def _tension_at_rest_length(self, length: RealArray, pressure: RealArray) -> RealArray:
        """Tension [N] under Gaylord's force if the threads did not stretch."""
        around = 2 * jnp.pi * self.turns**2 * self.n_threads
        return pressure * length * self.rest_thread_length / around

    def _state(
        self, length: RealArray, pressure: RealArray, thread_length: RealArray
    ) -> BraidState:
        diameter = diameter_from_length(length, thread_length, self.turns)
        angle = braid_angle_from_length(length, thread_length)
        force = gaylord_force(pressure, diameter / 2, angle)
        return BraidState(
            thread_length=thread_length,
            diameter=diameter,
            braid_angle=angle,
            gaylord_force=force,
            tension=thread_tension(force, pressure, diameter / 2, angle, self.n_threads),
        )

    def _stretched(
        self, strain: Callable[..., tuple[RealArray, Bool[Array, ""]]], *arrays: RealArray
    ) -> _Stretched:
        """B0 (1 + strain), for arguments of one shape; the first is the active length."""
        strains, found = at_each(strain, *arrays)
        # No nan takes part in what follows: it would spoil the derivatives of all others.
        stretched = self.rest_thread_length * (1 + jnp.where(found, strains, 0.0))
        return stretched, found, stretched > arrays[0]


def _required(
    stretched: RealArray,
    found: Bool[Array, "..."],
    encloses: Bool[Array, "..."],
    *,
    throw: bool,
) -> RealArray:
    """B [m]; where there is no equilibrium an error, or nan."""
    if throw:
        stretched = eqx.error_if(stretched, ~found, _GIVES_WAY)
        stretched = eqx.error_if(stretched, found & ~encloses, _TOO_LONG)
    return jnp.where(found & encloses, stretched, jnp.nan)


_GIVES_WAY = (
    "no equilibrium of the braid: its threads stretch without limit, because the wider the braid "
    "becomes the more the pressure pulls them. Likely causes: the thread's modulus, its area or "
    "the number of threads is too small or in another unit; the pressure is too high or in another "
    "unit; an argument is nan. Pass throw=False to get nan instead."
)
_TOO_LONG = (
    "no equilibrium of the braid: the active length must be shorter than the stretched threads, "
    "and the load does not stretch them to it. Likely causes: the active length and the thread "
    "length are in different units; the muscle is pulled beyond what its threads allow. Pass "
    "throw=False to get nan instead."
)
