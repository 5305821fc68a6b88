"""The helical braid: triangle relation, Gaylord's force, and braids with inextensible or elastic threads.

One unrolled thread is the hypotenuse of a right triangle: L = B sin(theta) along the axis and
pi N D = B cos(theta) around it. `theta` is measured from the circumference.
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from ._arrays import Given, Real, RealArray, as_real
from .parameters import Parametrised, number, parameter

NEUTRAL_ANGLE = math.atan(math.sqrt(0.5))
"""Braid angle [rad] at which the force magnification 2 tan(theta)^2 - 1 is zero: 35.26 deg."""

_RIGHT_ANGLE = math.pi / 2 * (1 + 1e-6)  # pi/2 in float32 is larger


def thread_length_from_angle(length: Real, braid_angle: Real) -> RealArray:
    """Return the thread length B [m], B = L / sin(theta).

    Args:
        length: active length L [m], > 0.
        braid_angle: theta [rad], from the circumference, in (0, pi/2].

    Returns:
        B [m], broadcast shape.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.

    >>> round(float(thread_length_from_angle(3.0, NEUTRAL_ANGLE)), 4)
    5.1962
    """
    return jnp.asarray(length / jnp.sin(braid_angle))


def turns_from_angle(length: Real, diameter: Real, braid_angle: Real) -> RealArray:
    """Return the turns N [-] of one thread about the axis, N = L / (pi D tan(theta)).

    Args:
        length: active length L [m], > 0.
        diameter: braid diameter D [m] at that length, > 0.
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        N [-], a float, broadcast shape.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    return jnp.asarray(length / (jnp.pi * diameter * jnp.tan(braid_angle)))


def diameter_from_length(length: Real, thread_length: Real, turns: Real) -> RealArray:
    """Return the braid diameter D [m], D = sqrt(B^2 - L^2) / (pi N).

    Args:
        length: active length L [m], 0 < L < B.
        thread_length: B [m].
        turns: N [-], > 0.

    Returns:
        D [m], broadcast shape; nan for L > B, which no braid can reach.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    squared = jnp.asarray((thread_length - length) * (thread_length + length))
    return jnp.sqrt(squared) / (jnp.pi * turns)


def braid_angle_from_length(length: Real, thread_length: Real) -> RealArray:
    """Return the braid angle theta [rad], asin(L / B), computed by atan2 to be exact near pi/2.

    Args:
        length: active length L [m], 0 < L < B.
        thread_length: B [m].

    Returns:
        theta [rad], from the circumference, broadcast shape; nan for L > B.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    squared = jnp.asarray((thread_length - length) * (thread_length + length))
    return jnp.arctan2(length, jnp.sqrt(squared))


def braid_angle_from_diameter(diameter: Real, known_diameter: Real, known_angle: Real) -> RealArray:
    """Return the braid angle theta [rad] at another diameter: cos(theta) / D is constant.

    Args:
        diameter: D [m] of the required angle, >= 0.
        known_diameter: D1 [m], > 0.
        known_angle: theta1 [rad] at D1, from the circumference.

    Returns:
        theta [rad], broadcast shape; nan if D exceeds D1 / cos(theta1), where the threads are circles.

    References:
        Chambers 2021, section 2.2.
    """
    return jnp.arccos(jnp.cos(known_angle) * diameter / known_diameter)


class AbstractBraid(Parametrised):
    """A braid whose thread length may depend on the load."""

    rest_thread_length: eqx.AbstractVar[RealArray]
    turns: eqx.AbstractVar[RealArray]
    thickness: eqx.AbstractVar[RealArray]

    @abc.abstractmethod
    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Thread length B [m] at active length L [m] and gauge pressure P [Pa], broadcast shape."""

    def threads_tension(self, strain: Real) -> RealArray | None:  # noqa: ARG002
        """Total tension [N] of all threads at an engineering strain [-]; None for inextensible threads."""
        return None

    def reach(
        self, length: Real, pressure: Real
    ) -> tuple[RealArray, RealArray, Bool[Array, "..."]]:
        """Return length and thread length, masked if they form no triangle, and the mask.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa].

        Returns:
            (L, B, reached), broadcast shape. Unless 0 < L < B, `reached` is False and L and B are
            placeholders that form a triangle. The caller must replace results there by nan. A nan
            here would spoil the derivatives of other states.
        """
        lengths, pressures = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        unloaded = jax.lax.stop_gradient(self.rest_thread_length)
        aside = unloaded / 2
        found = self.thread_length(jnp.where(lengths > 0, lengths, aside), pressures)
        reached = (lengths > 0) & (lengths < found)
        return (
            jnp.where(reached, lengths, aside),
            jnp.where(reached, found, unloaded),
            reached,
        )


class Braid(AbstractBraid):
    """A braid of inextensible threads.

    Attributes:
        rest_thread_length: B0 [m], length of one thread from fitting to fitting.
        turns: N [-], turns of one thread about the axis, a float.
        thickness: t_braid [m] of two crossing threads; the bladder lies below them.
    """

    rest_thread_length: Float[Given, "..."] = parameter("m", low=0.0)
    turns: Float[Given, "..."] = parameter(low=0.0)
    thickness: Float[Given, "..."] = number("m", default=0.0)

    @classmethod
    def from_rest(
        cls, *, diameter: Real, braid_angle: Real, length: Real, thickness: Real = 0.0
    ) -> "Braid":
        """Create a braid from its diameter and angle at one length.

        Args:
            diameter: D0 [m], braid diameter at rest.
            braid_angle: theta0 [rad] at rest, from the circumference, in (0, pi/2].
            length: L0 [m], active length at rest.
            thickness: t_braid [m].

        Returns:
            The braid with B = L0 / sin(theta0) and N = L0 / (pi D0 tan(theta0)).

        Raises:
            ValueError: the angle is out of range, for example in degrees; traced angles are not checked.

        >>> braid = Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3)
        >>> print(f"{braid.diameter(0.3):.4f} {braid.braid_angle(0.3):.4f}")
        0.0200 1.1000
        """
        if not isinstance(braid_angle, Tracer):
            angle = np.asarray(braid_angle, float)
            wrong = angle[(angle <= 0) | (angle > _RIGHT_ANGLE)]
            if wrong.size:
                raise ValueError(
                    f"braid_angle must lie in (0, pi/2] rad, got {wrong[0]:.6g}; convert degrees by "
                    "jnp.deg2rad(61.7)"
                )
        return cls(
            rest_thread_length=thread_length_from_angle(length, braid_angle),
            turns=turns_from_angle(length, diameter, braid_angle),
            thickness=as_real(thickness),
        )

    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Thread length B0 [m], independent of the load, broadcast shape."""
        shape = jnp.broadcast_shapes(jnp.shape(length), jnp.shape(pressure))
        return jnp.broadcast_to(self.rest_thread_length, shape)

    def diameter(self, length: Real) -> RealArray:
        """Braid diameter D [m] at active length L [m]; see `diameter_from_length`."""
        return diameter_from_length(length, self.rest_thread_length, self.turns)

    def braid_angle(self, length: Real) -> RealArray:
        """Braid angle theta [rad] at active length L [m]; see `braid_angle_from_length`."""
        return braid_angle_from_length(length, self.rest_thread_length)

    @property
    def neutral_length(self) -> RealArray:
        """Active length [m] at the neutral angle, B / sqrt(3); a shorter braid pushes."""
        return self.rest_thread_length * math.sin(NEUTRAL_ANGLE)


def force_magnification(braid_angle: Real) -> RealArray:
    """Return the force magnification [-], 2 tan(theta)^2 - 1: braid force divided by P pi R^2.

    Args:
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        Magnification [-], broadcast shape; zero at `NEUTRAL_ANGLE`, negative below it.

    References:
        Gaylord 1958; Chambers 2021, section 2.2.
    """
    return 2 * jnp.tan(jnp.asarray(braid_angle)) ** 2 - 1


def gaylord_force(pressure: Real, radius: Real, braid_angle: Real) -> RealArray:
    """Return the pull F_G [N] of a cylindrical braid, F_G = P pi R^2 (2 tan(theta)^2 - 1).

    Bladder stiffness, thread stretch and rounded ends are neglected.

    Args:
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        F_G [N], broadcast shape, positive when the muscle pulls.

    References:
        Gaylord 1958; Chambers 2021, equation 6.1.

    >>> round(float(gaylord_force(6e5, 0.01, 1.1)))
    1267
    """
    return jnp.asarray(pressure * jnp.pi * radius**2 * force_magnification(braid_angle))


def thread_tension(
    force: Real, pressure: Real, radius: Real, braid_angle: Real, n_threads: Real
) -> RealArray:
    """Return the tension T [N] of one thread, T = (F + P pi R^2) / (n sin(theta)).

    The threads that cross a section carry the pull and the pressure on the end. The tension of the
    bladder is neglected.

    Args:
        force: pull F [N] of the muscle.
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference, in (0, pi/2].
        n_threads: n [-], number of threads in both families.

    Returns:
        T [N], broadcast shape; negative if the threads would have to push.

    References:
        Chambers 2021, section 5.1.

    >>> round(float(thread_tension(1058, 100, 0.522, 1.2032, 144)), 2)  # lbf: 8.5 in the print
    8.51
    """
    carried = force + pressure * jnp.pi * radius**2
    return jnp.asarray(carried / (n_threads * jnp.sin(braid_angle)))


class LinearThread(Parametrised):
    """A thread that obeys Hooke's law, T = A_b E_b eps, also in compression.

    Attributes:
        modulus: E_b [Pa], > 0.
        area: A_b [m2], cross-section of the fibres of one thread.

    References:
        Chambers 2021, section 5.1.
    """

    modulus: Float[Given, "..."] = parameter("Pa", kind="stress", low=0.0, name="thread_modulus")
    area: Float[Given, "..."] = number("m2")


class AbstractCompliantBraid(AbstractBraid):
    """A braid whose threads stretch in proportion to their tension.

    B = B0 (1 + C n T),  n T = (F_G + P pi R^2) / sin(theta) = P L B / (2 pi N^2)

    The tension under Gaylord's force F_G is proportional to B, so B has a closed form:

    B = B0 / (1 - C B0 P L / (2 pi N^2))

    The bladder is neglected. There is no equilibrium if the denominator is not positive: a longer thread
    makes the braid wider, and the tension grows faster than the stretch.
    """

    @property
    @abc.abstractmethod
    def total_compliance(self) -> RealArray:
        """C [1/N]: strain of the threads per total tension of all threads."""

    def threads_tension(self, strain: Real) -> RealArray:
        """Total tension [N] of all threads at an engineering strain [-]; the compliance must not be 0."""
        return jnp.asarray(strain / self.total_compliance)

    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Thread length B [m], broadcast shape; nan if the threads stretch without limit."""
        length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        known = jnp.isfinite(pressure)  # nan would spoil the derivatives of other states
        at = jnp.where(known, pressure, 0.0) * length
        rest = self.rest_thread_length
        left = 1 - self.total_compliance * rest * at / (2 * jnp.pi * self.turns**2)
        holds = known & (left > 0)
        return jnp.where(holds, rest / jnp.where(holds, left, 1.0), jnp.nan)


class ElasticBraid(AbstractCompliantBraid):
    """A braid of elastic threads with known modulus, C = 1 / (n A_b E_b).

    Attributes:
        rest_thread_length: B0 [m], one unloaded thread from fitting to fitting.
        turns: N [-], turns of one thread about the axis, a float.
        thickness: t_braid [m] of two crossing threads; the bladder lies below them.
        n_threads: n [-], number of threads in both families.
        thread: stress law of one thread.

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
    thread: LinearThread

    @property
    def total_compliance(self) -> RealArray:
        """C [1/N], 1 / (n A_b E_b)."""
        return 1 / (self.n_threads * self.thread.area * self.thread.modulus)


_HIGHEST_COMPLIANCE = 3e-5  # 1/N


class CompliantBraid(AbstractCompliantBraid):
    """A braid of elastic threads with one compliance, for identification.

    It requires neither number nor cross-section of the threads. With C = 0 it is inextensible.

    Attributes:
        rest_thread_length: B0 [m].
        turns: N [-].
        thickness: t_braid [m].
        compliance: C [1/N], >= 0, strain of the threads per total tension of all threads.

    References:
        Davis et al. 2003 (stretching braid); Chambers 2021, section 5.1.

    >>> kevlar = CompliantBraid(9.89, 1.09, 0.011, 1 / (144 * 1.332e-4 * 11.6e6))  # inches, psi
    >>> print(f"{kevlar.thread_length(9.28125, 100.0):.3f}")
    9.945
    """

    rest_thread_length: Float[Given, "..."] = parameter("m", low=0.0)
    turns: Float[Given, "..."] = parameter(low=0.0)
    thickness: Float[Given, "..."] = number("m")
    compliance: Float[Given, "..."] = parameter(
        "1/N", name="braid_compliance", low=0.0, high=_HIGHEST_COMPLIANCE
    )

    @classmethod
    def of(cls, braid: Braid, compliance: Real) -> "CompliantBraid":
        """Return the same braid with compliant threads."""
        return cls(braid.rest_thread_length, braid.turns, braid.thickness, compliance)

    @property
    def total_compliance(self) -> RealArray:
        """C [1/N]."""
        return self.compliance
