"""The helical braid: triangle relation, Gaylord's force, and braids with inextensible or elastic threads.

An unrolled thread is the hypotenuse of a right triangle with the legs L = B sin(theta) along the axis
and pi N D = B cos(theta) around it. The braid angle theta is measured from the circumference.
"""

import abc
import functools
import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from ._arrays import Given, Real, RealArray, as_real, at_each, compiled, compiled_method, over_slope
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
        B [m], with the broadcast shape.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.

    >>> round(float(thread_length_from_angle(3.0, NEUTRAL_ANGLE)), 4)
    5.1962
    """
    return jnp.asarray(length / jnp.sin(braid_angle))


def turns_from_angle(length: Real, diameter: Real, braid_angle: Real) -> RealArray:
    """Return the number of turns N [-] of one thread about the axis, N = L / (pi D tan(theta)).

    Args:
        length: active length L [m], > 0.
        diameter: braid diameter D [m] at that length, > 0.
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        N [-], a float, with the broadcast shape.

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
        D [m], with the broadcast shape; nan for L > B, which is impossible.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    squared = jnp.asarray((thread_length - length) * (thread_length + length))
    return jnp.sqrt(squared) / (jnp.pi * turns)


def braid_angle_from_length(length: Real, thread_length: Real) -> RealArray:
    """Return the braid angle theta [rad], asin(L / B), computed with atan2 for accuracy near pi/2.

    Args:
        length: active length L [m], 0 < L < B.
        thread_length: B [m].

    Returns:
        theta [rad], from the circumference, with the broadcast shape; nan for L > B.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    squared = jnp.asarray((thread_length - length) * (thread_length + length))
    return jnp.arctan2(length, jnp.sqrt(squared))


def braid_angle_from_diameter(diameter: Real, known_diameter: Real, known_angle: Real) -> RealArray:
    """Return the braid angle theta [rad] at another diameter; the ratio cos(theta) / D is constant.

    Args:
        diameter: D [m] at which the angle is required, >= 0.
        known_diameter: D1 [m], > 0.
        known_angle: theta1 [rad] at D1, from the circumference.

    Returns:
        theta [rad], with the broadcast shape; nan if D > D1 / cos(theta1), the largest possible diameter.

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
        """Return the thread length B [m] at length L [m] and gauge pressure P [Pa]; arguments broadcast."""

    def threads_tension(self, strain: Real) -> RealArray | None:  # noqa: ARG002
        """Return the total thread tension [N] at an engineering strain [-].

        The result is None if the threads are inextensible.
        """
        return None

    def reach(
        self, length: Real, pressure: Real
    ) -> tuple[RealArray, RealArray, Bool[Array, "..."]]:
        """Return length, thread length and a mask of reachable states; other states are placeholders.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa].

        Returns:
            (L, B, reached), with the broadcast shape. `reached` is True where 0 < L < B. Elsewhere, L and
            B are placeholders that satisfy this condition, and the caller must replace the results with
            nan. A nan in L or B would contaminate the derivatives of other states.
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
        turns: N [-], number of turns of one thread about the axis; it may be fractional.
        thickness: t_braid [m], thickness of the braid where two threads cross; the bladder lies inside it.
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
            diameter: D0 [m], diameter of the braid at rest.
            braid_angle: theta0 [rad] at rest, from the circumference, in (0, pi/2].
            length: L0 [m], active length at rest.
            thickness: t_braid [m], thickness of the braid where two threads cross.

        Returns:
            The braid with B = L0 / sin(theta0) and N = L0 / (pi D0 tan(theta0)).

        Raises:
            ValueError: the angle is out of range, perhaps because it is in degrees. Traced angles are not
                checked.

        >>> braid = Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3)
        >>> print(f"{braid.diameter(0.3):.4f} {braid.braid_angle(0.3):.4f}")
        0.0200 1.1000
        """
        if not isinstance(braid_angle, Tracer):
            angle = np.asarray(braid_angle, float)
            wrong = angle[(angle <= 0) | (angle > _RIGHT_ANGLE)]
            if wrong.size:
                raise ValueError(
                    f"braid_angle must lie in (0, pi/2] rad, got {wrong[0]:.6g}; convert degrees to "
                    "radians, as in jnp.deg2rad(61.7)"
                )
        return cls(
            rest_thread_length=thread_length_from_angle(length, braid_angle),
            turns=turns_from_angle(length, diameter, braid_angle),
            thickness=as_real(thickness),
        )

    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Return the thread length B0 [m], which does not depend on the load, with the broadcast shape."""
        shape = jnp.broadcast_shapes(jnp.shape(length), jnp.shape(pressure))
        return jnp.broadcast_to(self.rest_thread_length, shape)

    def diameter(self, length: Real) -> RealArray:
        """Return the braid diameter D [m] at active length L [m]; see `diameter_from_length`."""
        return diameter_from_length(length, self.rest_thread_length, self.turns)

    def braid_angle(self, length: Real) -> RealArray:
        """Return the braid angle theta [rad] at active length L [m]; see `braid_angle_from_length`."""
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
        Magnification [-], with the broadcast shape; zero at `NEUTRAL_ANGLE`, negative at smaller angles.

    References:
        Gaylord 1958; Chambers 2021, section 2.2.
    """
    return 2 * jnp.tan(jnp.asarray(braid_angle)) ** 2 - 1


def gaylord_force(pressure: Real, radius: Real, braid_angle: Real) -> RealArray:
    """Return the axial force F_G [N] of a cylindrical braid, F_G = P pi R^2 (2 tan(theta)^2 - 1).

    Bladder stiffness, thread stretch and rounded ends are neglected.

    Args:
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        F_G [N], with the broadcast shape; positive if the muscle pulls.

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

    The threads that cross a section carry the muscle's force and the force of the pressure on the end
    fitting. The tension in the bladder is neglected.

    Args:
        force: F [N] of the muscle, positive when the muscle pulls.
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference, in (0, pi/2].
        n_threads: n [-], number of threads in both families.

    Returns:
        T [N], with the broadcast shape; negative if the threads would be in compression.

    References:
        Chambers 2021, section 5.1.

    >>> round(float(thread_tension(1058, 100, 0.522, 1.2032, 144)), 2)  # lbf: 8.5 in the print
    8.51
    """
    carried = force + pressure * jnp.pi * radius**2
    return jnp.asarray(carried / (n_threads * jnp.sin(braid_angle)))


class AbstractThread(Parametrised):
    """An elastic thread whose stiffness rises with tension towards a limit.

    The strain must be 0 at T = 0 and must increase with the tension. The slope of strain against tension
    must never increase, and must tend to 1 / k, where k = A_b E_b is the limiting stiffness. Under these
    conditions, the root search in `ElasticBraid` converges.
    """

    modulus: eqx.AbstractVar[RealArray]
    area: eqx.AbstractVar[RealArray]

    @property
    def far_stiffness(self) -> RealArray:
        """Tension per unit strain k = A_b E_b [N], far beyond the toe region."""
        return self.area * self.modulus

    @property
    @abc.abstractmethod
    def offset_strain(self) -> RealArray:
        """Strain [-] of the asymptote at T = 0.

        At a tension T, the strain of the thread exceeds T / k by at most this value.
        """

    @abc.abstractmethod
    def strain(self, tension: Real) -> RealArray:
        """Return the thread's engineering strain [-] at tension T [N], with the broadcast shape."""

    @abc.abstractmethod
    def tension(self, strain: Real) -> RealArray:
        """Return the thread's tension T [N] at an engineering strain [-]: the inverse of `strain`."""


class LinearThread(AbstractThread):
    """A thread that obeys Hooke's law, T = A_b E_b eps, also in compression.

    Attributes:
        modulus: E_b [Pa], > 0.
        area: A_b [m2], cross-sectional area of the fibres in one thread.

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
        """Return the engineering strain [-] at tension T [N], T / (A_b E_b)."""
        return jnp.asarray(tension / self.far_stiffness)

    def tension(self, strain: Real) -> RealArray:
        """Return the tension T [N] at an engineering strain [-], A_b E_b eps."""
        return jnp.asarray(strain * self.far_stiffness)


class ToeThread(AbstractThread):
    """A thread whose fibres straighten before they stretch: a toe region followed by a straight line.

    eps = T / (A_b E_b) + e_t T / (T + T_t)

    At zero tension, the modulus is E_b / (1 + A_b E_b e_t / T_t). At high tension, the curve approaches a
    straight line with modulus E_b that starts at the strain e_t. A compressed thread pushes with less
    than T_t.

    Attributes:
        modulus: E_b [Pa], > 0, beyond the toe region.
        area: A_b [m2], cross-sectional area of the fibres in one thread.
        toe_strain: e_t [-], >= 0, strain added by straightening.
        toe_tension: T_t [N], > 0, tension at which half the toe strain is reached.

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
        """Return the engineering strain [-] at tension T [N]; nan unless T > -T_t."""
        inside = jnp.asarray(tension > -self.toe_tension)
        T = jnp.where(inside, tension, 0.0)
        value = T / self.far_stiffness + self.toe_strain * T / (T + self.toe_tension)
        return jnp.where(inside, value, jnp.nan)

    def tension(self, strain: Real) -> RealArray:
        """Return the tension T [N] at an engineering strain [-]: the larger root of a quadratic."""
        k = self.far_stiffness
        # T^2 + p T - q = 0: each of the two forms of the root is free of cancellation on one side.
        p = self.toe_tension + k * (self.toe_strain - strain)
        q = k * strain * self.toe_tension
        root = jnp.sqrt(
            (p - 2 * self.toe_tension) ** 2 + 4 * k * self.toe_strain * self.toe_tension
        )
        near = p > 0
        return jnp.where(near, 2 * q / jnp.where(near, p + root, 1.0), (root - p) / 2)


_MAX_STEPS = 64


@compiled
def strain_under_line(thread: AbstractThread, load: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
    """Solve strain(T) = eps with the load T = m (1 + eps), by Newton's method.

    A solution exists if m < k = A_b E_b; otherwise, the load grows faster than the tension. The residual
    r(eps) = eps - strain(T(eps)) is convex, and its slope rises to 1 - m / k > 0. The search starts at
    (m / k + e_t) / (1 - m / k), where e_t is the offset strain. The residual there is not negative, so the
    iterates decrease monotonically to the root. For a linear thread, the starting point is the root.

    Args:
        thread: thread law.
        load: m [N], shape ().

    Returns:
        (strain [-], found); nan and False if there is no solution. Derivatives follow from the implicit
        function theorem.
    """
    k = thread.far_stiffness
    holds = (load < k) & jnp.isfinite(load)
    m = jnp.where(holds, load, 0.0)
    margin = 1 - m / k
    # Rounding moves the root by its size over the margin; in units of 1 / margin^2 that is small.
    start, unit = jax.lax.stop_gradient((
        (m / k + thread.offset_strain) / margin, 1 / margin**2
    ))  # fmt: skip

    def residual(y: RealArray) -> RealArray:
        return y - thread.strain(m * (1 + y * unit)) / unit

    tolerance = 4 * float(jnp.finfo(start.dtype).eps)

    def solve(
        function: Callable[[RealArray], RealArray], start: RealArray
    ) -> tuple[RealArray, RealArray]:
        # 0.25 s, which only elastic threads need.
        import lineax as lx  # noqa: PLC0415
        import optimistix as optx  # noqa: PLC0415

        solution = optx.root_find(
            lambda y, _: function(y),
            optx.Newton(rtol=tolerance, atol=tolerance),
            start,
            max_steps=_MAX_STEPS,
            throw=False,
            tags=frozenset({lx.diagonal_tag}),
        )
        successful = solution.result == optx.RESULTS.successful
        return solution.value, successful.astype(start.dtype)  # JAX cannot differentiate booleans

    root, converged = jax.lax.custom_root(residual, start / unit, solve, over_slope, has_aux=True)
    found = holds & (converged > 0)
    return jnp.where(found, root * unit, jnp.nan), found


class ElasticBraid(AbstractBraid):
    """A braid of elastic threads that stretch under their tension.

    B = B0 (1 + strain(T)),  T = (F_G + P pi R^2) / (n sin(theta)) = P L B / (2 pi N^2 n)

    The tension T is computed from Gaylord's force F_G, without the bladder, and is proportional to B. If T
    grows faster with B than the threads' resistance, or if L >= B, there is no equilibrium and B is nan.

    Attributes:
        rest_thread_length: B0 [m], length of one unloaded thread from fitting to fitting.
        turns: N [-], number of turns of one thread about the axis; it may be fractional.
        thickness: t_braid [m], thickness of the braid where two threads cross; the bladder lies inside it.
        n_threads: n [-], number of threads in both families.
        thread: tension law of one thread.

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

    def threads_tension(self, strain: Real) -> RealArray:
        """Return the total thread tension [N] at an engineering strain [-]."""
        return self.n_threads * self.thread.tension(strain)

    @compiled_method
    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Return the thread length B [m], with the broadcast shape; nan if there is no equilibrium.

        The result is differentiable.
        """
        length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        known = jnp.isfinite(pressure)  # nan would spoil the derivatives of other states
        around = 2 * jnp.pi * self.turns**2 * self.n_threads
        load = jnp.where(known, pressure, 0.0) * length * self.rest_thread_length / around
        strains, found = at_each(functools.partial(strain_under_line, self.thread), load)
        found &= known
        stretched = self.rest_thread_length * (1 + jnp.where(found, strains, 0.0))
        return jnp.where(found & (stretched > length), stretched, jnp.nan)


_HIGHEST_COMPLIANCE = 3e-5  # 1/N


class CompliantBraid(AbstractBraid):
    """A braid whose threads stretch in proportion to their tension, described by one compliance.

    B = B0 / (1 - C B0 P L / (2 pi N^2)),  C = 1 / (n A_b E_b)

    This is the closed form of `ElasticBraid` with linear threads, for use in identification. Neither the
    number nor the cross-section of the threads is needed. With C = 0, the braid is inextensible.

    Attributes:
        rest_thread_length: B0 [m], length of one unloaded thread from fitting to fitting.
        turns: N [-], number of turns of one thread about the axis; it may be fractional.
        thickness: t_braid [m], thickness of the braid where two threads cross; the bladder lies inside it.
        compliance: C [1/N], >= 0, strain of the threads per unit of their total tension.

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

    def threads_tension(self, strain: Real) -> RealArray:
        """Return the total thread tension [N] at an engineering strain [-]; the compliance must be > 0."""
        return jnp.asarray(strain / self.compliance)

    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Return the thread length B [m]; nan if the threads stretch without limit. Arguments broadcast."""
        length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        known = jnp.isfinite(pressure)  # nan would spoil the derivatives of other states
        at = jnp.where(known, pressure, 0.0) * length
        left = 1 - self.compliance * self.rest_thread_length * at / (2 * jnp.pi * self.turns**2)
        holds = known & (left > 0)
        return jnp.where(holds, self.rest_thread_length / jnp.where(holds, left, 1.0), jnp.nan)
