"""From all of space into a box, so that a truncated normal in the box is nearly a standard one.

Coordinate by coordinate (Rosenblatt), with t standardised by what is known of a quadratic model,

    v_j = c_j + w_j t_j,   c_j = mean_j + sum_{i<j} L_ji t_i,   w_j = L_jj
    sigma(t_j) = (1 - p) sigma(-alpha_j) + p sigma(beta_j),   p = sigma(z_j)

where sigma is the logistic function and [-alpha_j, beta_j] what the box leaves of t_j. Far from the
bounds t = z; at a bound it is the logit of the distance. The ridge of two parameters, of which one
lies on its bound, becomes a straight one, of unit width.

References:
    Rosenblatt 1952, Ann. Math. Statist. 23(3).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int


class BoxMap(eqx.Module):
    """A smooth bijection of R^d and the inside of a box; every array is in the map's own order.

    Attributes:
        order: place in the box of each coordinate of the map, shape (d,).
        low, high: the box, shape (d,).
        mean: of the quadratic model, inside the box or not, shape (d,).
        root: its lower triangle L, L L^T the covariance, shape (d, d).
    """

    order: Int[np.ndarray, " d"]
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]
    mean: Float[np.ndarray, " d"]
    root: Float[np.ndarray, "d d"]

    @classmethod
    def of(
        cls,
        low: Float[np.ndarray, " d"],
        high: Float[np.ndarray, " d"],
        mean: Float[np.ndarray, " d"],
        covariance: Float[np.ndarray, "d d"],
    ) -> "BoxMap":
        """The map of a box and a quadratic model; what its bounds cut off most comes first."""
        std = np.sqrt(np.diag(covariance))
        inside = np.minimum(mean - low, high - mean) / std
        order = np.argsort(inside, kind="stable")
        root = np.linalg.cholesky(covariance[np.ix_(order, order)])
        return cls(order, low[order], high[order], mean[order], root)

    def __call__(self, z: Float[Array, " d"]) -> tuple[Float[Array, " d"], Float[Array, ""]]:
        """The point of the box, and log |dv/dz|."""
        log_slope, t, v = jnp.zeros(()), [], []
        for j in range(z.shape[0]):
            root = jnp.asarray(self.root[j])
            width = root[j]
            centre = self.mean[j] + sum((root[i] * t[i] for i in range(j)), start=jnp.zeros(()))
            t_j, slope = _within((centre - self.low[j]) / width, (self.high[j] - centre) / width, z[j])
            log_slope = log_slope + jnp.log(width) + slope
            t.append(t_j)
            v.append(centre + width * t_j)
        return jnp.zeros_like(z).at[jnp.asarray(self.order)].set(jnp.stack(v)), log_slope


def _within(alpha: Array, beta: Array, z: Array) -> tuple[Array, Array]:
    """t in (-alpha, beta), and log dt/dz; sums of positive numbers by their logarithms."""
    log = jax.nn.log_sigmoid
    up, down = log(z), log(-z)
    below = jnp.logaddexp(log(-alpha) + down, log(beta) + up)
    above = jnp.logaddexp(log(alpha) + down, log(-beta) + up)
    # sigma(beta) - sigma(-alpha), without a difference of numbers that are nearly the same
    span = log(alpha) + log(beta) + jnp.log(-jnp.expm1(-(alpha + beta)))
    return below - above, span + up + down - below - above
