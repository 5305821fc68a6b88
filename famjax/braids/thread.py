"""The braid's thread as a spring: strain from tension and tension from strain."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from .._types import Given, Real, RealArray
from ..parameters import Parametrised, number, parameter


def thread_tension(
    force: Real, pressure: Real, radius: Real, braid_angle: Real, n_threads: Real
) -> RealArray:
    """Tension T [N] of one thread, T = (F + P pi R^2) / (n sin(theta)); the bladder's is neglected.

    The threads that cross the muscle's section hold its pull and the pressure on its end.

    Args:
        force: pull F [N] of the muscle.
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference, in (0, pi/2].
        n_threads: n [-], threads of both families.

    Returns:
        T [N], broadcast shape; negative where the threads would have to push.

    References:
        Chambers 2021, section 5.1.

    >>> round(float(thread_tension(1058, 100, 0.522, 1.2032, 144)), 2)  # lbf: 8.5 in the print
    8.51
    """
    carried = force + pressure * jnp.pi * radius**2
    return jnp.asarray(carried / (n_threads * jnp.sin(braid_angle)))


class AbstractThread(Parametrised):
    """An elastic thread, at most as stiff as its far modulus.

    With the far stiffness k = A_b E_b, a law's strain must start from 0 at T = 0 and rise with the
    tension at a rate that never grows and tends to 1 / k, so that it stays below T / k + offset.
    The root solve of `ElasticBraid` converges for every such law.
    """

    modulus: eqx.AbstractVar[RealArray]
    area: eqx.AbstractVar[RealArray]

    @property
    def far_stiffness(self) -> RealArray:
        """Tension per strain k = A_b E_b [N] far beyond the toe region."""
        return self.area * self.modulus

    @property
    @abc.abstractmethod
    def offset_strain(self) -> RealArray:
        """Strain [-] at which the far line starts, by which the strain exceeds T / k at most."""

    @abc.abstractmethod
    def strain(self, tension: Real) -> RealArray:
        """Engineering strain [-] of the thread at tension T [N], broadcast shape."""

    @abc.abstractmethod
    def tension(self, strain: Real) -> RealArray:
        """Tension T [N] of the thread at an engineering strain [-]: the inverse of `strain`."""


class LinearThread(AbstractThread):
    """A thread that obeys Hooke's law, T = A_b E_b eps; continued so where it would have to push.

    Attributes:
        modulus: E_b [Pa], > 0.
        area: A_b [m2], section of the fibres of one thread.

    References:
        Chambers 2021, section 5.1.

    >>> kevlar = LinearThread(11.6e6, 1.332e-4)  # psi and in2
    >>> print(f"{kevlar.strain(8.5):.4f}")
    0.0055
    """

    modulus: Float[Given, "..."] = parameter("Pa", kind="stress", low=0.0, name="thread_modulus")
    area: Float[Given, "..."] = number("m2")

    @property
    def offset_strain(self) -> RealArray:
        """Zero [-]: there is no toe region."""
        return jnp.zeros_like(self.far_stiffness)

    def strain(self, tension: Real) -> RealArray:
        """Engineering strain [-] at tension T [N], T / (A_b E_b)."""
        return jnp.asarray(tension / self.far_stiffness)

    def tension(self, strain: Real) -> RealArray:
        """Tension T [N] at an engineering strain [-], A_b E_b eps."""
        return jnp.asarray(strain * self.far_stiffness)


class ToeThread(AbstractThread):
    """A thread whose fibres straighten before they stretch: a toe region, then a line.

    eps = T / (A_b E_b) + e_t T / (T + T_t)

    A hyperbola, so that both directions are closed forms, smooth on the whole line and monotone. At
    rest its modulus is E_b / (1 + A_b E_b e_t / T_t); far out it is the line of modulus E_b that
    starts at the strain e_t. A slack thread pushes with less than T_t.

    Attributes:
        modulus: E_b [Pa], > 0, beyond the toe region.
        area: A_b [m2], section of the fibres of one thread.
        toe_strain: e_t [-], >= 0, that straightening adds in the end.
        toe_tension: T_t [N], > 0, at which half of it is done.

    >>> thread = ToeThread(16.9e6, 1.332e-4, 0.002, 2.0)  # psi, in2, lbf
    >>> print(f"{thread.strain(8.5):.4f} {thread.tension(thread.strain(8.5)):.3f}")
    0.0054 8.500
    """

    modulus: Float[Given, "..."] = parameter("Pa", kind="stress", low=0.0, name="thread_modulus")
    area: Float[Given, "..."] = number("m2")
    toe_strain: Float[Given, "..."] = parameter(low=0.0)
    toe_tension: Float[Given, "..."] = parameter("N", low=0.0)

    @property
    def offset_strain(self) -> RealArray:
        """The toe strain e_t [-]."""
        return self.toe_strain

    def strain(self, tension: Real) -> RealArray:
        """Engineering strain [-] at tension T [N], T > -T_t; nan below, where there is none."""
        inside = jnp.asarray(tension > -self.toe_tension)
        T = jnp.where(inside, tension, 0.0)
        value = T / self.far_stiffness + self.toe_strain * T / (T + self.toe_tension)
        return jnp.where(inside, value, jnp.nan)

    def tension(self, strain: Real) -> RealArray:
        """Tension T [N] at an engineering strain [-]: the larger root of a quadratic equation."""
        k = self.far_stiffness
        # T^2 + p T - q = 0. Of the two forms of its root each is free of cancellation on one side.
        p = self.toe_tension + k * (self.toe_strain - strain)
        q = k * strain * self.toe_tension
        root = jnp.sqrt(
            (p - 2 * self.toe_tension) ** 2 + 4 * k * self.toe_strain * self.toe_tension
        )
        near = p > 0
        return jnp.where(near, 2 * q / jnp.where(near, p + root, 1.0), (root - p) / 2)
