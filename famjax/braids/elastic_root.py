"""The strain at which an elastic thread carries a load that grows as the thread gives way."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._implicit import over_slope
from .._types import RealArray
from .thread import AbstractThread

_MAX_STEPS = 64


class _Rise(eqx.Module):
    """State of the approach from below."""

    strain: RealArray
    steps: Int[Array, ""]
    found: Bool[Array, ""]
    done: Bool[Array, ""]


@eqx.filter_jit
def strain_under_line(
    thread: AbstractThread, constant: RealArray, slope: RealArray
) -> tuple[RealArray, Bool[Array, ""]]:
    """The strain at which the thread's tension meets the load line T = c + m (1 + eps).

    There is one where m < k = A_b E_b, and none beyond: the load then outgrows every tension.

    Newton's method on r(eps) = eps - strain(T(eps)) cannot fail. The law's strain is concave in the
    tension, so r is convex, and its slope rises to 1 - m / k > 0. By strain(T) <= T / k + e_t, with
    the offset strain e_t, r is not negative at the start ((c + m) / k + e_t) / (1 - m / k), and
    from there the iterates of a convex function fall to its root monotonically. For c = 0 its slope
    at the root is at least that of the secant from eps = -1, where r = -1: every step then leaves
    at most the part e_t / (1 + e_t) of the error, and near the root its square. A linear thread
    starts at the root.

    Args:
        thread: the law.
        constant: c [N], shape ().
        slope: m [N], shape ().

    Returns:
        (strain [-], found): nan and False where there is none. Derivatives of any order are taken
        by the implicit function theorem.
    """
    k = thread.far_stiffness
    holds = (slope < k) & jnp.isfinite(slope + constant)
    c, m = jnp.where(holds, constant, 0.0), jnp.where(holds, slope, 0.0)
    margin = 1 - m / k
    start = ((c + m) / k + thread.offset_strain) / margin
    zero = jnp.zeros_like(m)
    strain, converged = _newton(thread, jnp.stack([zero, zero, m, c]), start, margin)
    found = holds & converged
    return jnp.where(found, strain, jnp.nan), found


@eqx.filter_jit
def strain_under_cubic(
    thread: AbstractThread, linear: RealArray, cubic: RealArray
) -> tuple[RealArray, Bool[Array, ""]]:
    """The smallest strain at which the thread's tension meets the load a x + b x^3, x = 1 + eps.

    It is the one that a growing load reaches, and is approached from below, exactly: the load is
    convex, so its tangent at any strain lies below it, and the strain at which the thread carries
    that tangent is at most the one sought. Repeated from there, this rises monotonically and
    converges quadratically. Where a tangent is as steep as the thread is stiff, no larger strain
    carries the load either. What is found is polished, and differentiated, as one root.

    Args:
        thread: the law.
        linear: a [N], shape ().
        cubic: b [N], shape (), >= 0.

    Returns:
        (strain [-], found): nan and False where there is none; derivatives as above.
    """
    fixed, a, b = jax.lax.stop_gradient((thread, linear, cubic))
    tolerance = float(jnp.finfo(a.dtype).eps) ** 0.5

    def rise(state: _Rise) -> _Rise:
        x = 1 + state.strain
        strain, found = strain_under_line(fixed, -2 * b * x**3, a + 3 * b * x**2)
        still = jnp.abs(strain - state.strain) <= tolerance * (1 + jnp.abs(strain))
        return _Rise(strain, state.steps + 1, found, ~found | still)

    no = jnp.array(False)
    start = _Rise(jnp.zeros_like(a), jnp.array(0), no, no)
    below = jax.lax.while_loop(lambda s: ~s.done & (s.steps < _MAX_STEPS), rise, start)
    holds = below.found & below.done
    x = 1 + jnp.where(holds, below.strain, 0.0)
    a, b = jnp.where(holds, linear, 0.0), jnp.where(holds, cubic, 0.0)
    rate = jax.grad(lambda x: thread.strain(a * x + b * x**3))(x)
    zero = jnp.zeros_like(a)
    strain, converged = _newton(thread, jnp.stack([b, zero, a, zero]), x - 1, 1 - rate)
    found = holds & converged
    return jnp.where(found, strain, jnp.nan), found


def _newton(
    thread: AbstractThread, load: Float[Array, " 4"], start: RealArray, margin: RealArray
) -> tuple[RealArray, Bool[Array, ""]]:
    """Newton's method for eps = strain(load(1 + eps)), the load a polynomial, highest power first.

    Rounding moves the root by its size over the margin. The unknown is counted in 1 / margin^2, so
    that this is below the tolerance up to the limit itself.
    """
    start, unit = jax.lax.stop_gradient((start, 1 / margin**2))

    def residual(y: RealArray) -> RealArray:
        return y - thread.strain(jnp.polyval(load, 1 + y * unit)) / unit

    tolerance = 4 * float(jnp.finfo(start.dtype).eps)

    def solve(
        function: Callable[[RealArray], RealArray], start: RealArray
    ) -> tuple[RealArray, RealArray]:
        # A quarter of a second to import, which only elastic threads need.
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
        return solution.value, successful.astype(start.dtype)  # JAX derives no truth values here

    root, converged = jax.lax.custom_root(residual, start / unit, solve, over_slope, has_aux=True)
    return root * unit, converged > 0
