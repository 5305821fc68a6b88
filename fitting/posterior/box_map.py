"""From all of space into a box, so that a truncated normal in the box is nearly a standard one.

Coordinate by coordinate (Rosenblatt), with t standardised by what is known of a quadratic model,

    v_j = c_j + w_j t_j,   c_j = mean_j + sum_{i<j} L_ji t_i,   w_j = L_jj
    sigma(t_j) = (1 - p) sigma(-alpha_j) + p sigma(beta_j),   p = sigma(z_j)

where sigma is the logistic function and [-alpha_j, beta_j] what the box leaves of t_j. Far from the
bounds t = z; at a bound it is the logit of the distance. The ridge of two parameters, of which one
lies on its bound, becomes a straight one, of unit width. Where it is curved, c_j follows a cubic in
the first coordinate, which leads.

References:
    Rosenblatt 1952, Ann. Math. Statist. 23(3).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

_INSIDE = 3.0  # standard deviations from a bound that do not feel it


class BoxMap(eqx.Module):
    """A smooth bijection of R^d and the inside of a box; every array is in the map's own order.

    Attributes:
        order: place in the box of each coordinate of the map, shape (d,).
        low, high: the box, shape (d,).
        mean: of the quadratic model, inside the box or not, shape (d,).
        root: its lower triangle L, L L^T the covariance, shape (d, d).
        curve: c_j as a polynomial in t_0, rising powers, but for the terms of others, shape (d, 4).
    """

    order: Int[np.ndarray, " d"]
    low: Float[np.ndarray, " d"]
    high: Float[np.ndarray, " d"]
    mean: Float[np.ndarray, " d"]
    root: Float[np.ndarray, "d d"]
    curve: Float[np.ndarray, "d 4"]

    @classmethod
    def of(
        cls,
        low: Float[np.ndarray, " d"],
        high: Float[np.ndarray, " d"],
        mean: Float[np.ndarray, " d"],
        covariance: Float[np.ndarray, "d d"],
    ) -> "BoxMap":
        """The map of a box and a quadratic model; what its bounds cut off most leads."""
        std = np.sqrt(np.diag(covariance))
        inside = np.minimum(np.minimum(mean - low, high - mean) / std, _INSIDE)
        order = np.lexsort((-std / (high - low), inside))
        root = np.linalg.cholesky(covariance[np.ix_(order, order)])
        curve = np.zeros((low.size, 4))
        curve[:, 0], curve[1:, 1] = mean[order], root[1:, 0]
        return cls(order, low[order], high[order], mean[order], root, curve)

    def along(self, leads: Float[np.ndarray, " k"], ridge: dict[int, np.ndarray]) -> "BoxMap":
        """The same map with centres that follow a ridge.

        Args:
            leads: values of the coordinate that leads, at least two.
            ridge: by place in the box, where the centre of another is at each of them.
        """
        t = (leads - self.mean[0]) / self.root[0, 0]
        powers = t[:, None] ** np.arange(min(4, leads.size))
        curve = self.curve.copy()
        for j, place in enumerate(self.order.tolist()):
            if j and place in ridge:
                curve[j] = 0.0
                curve[j, : powers.shape[1]] = np.linalg.lstsq(powers, ridge[place], rcond=None)[0]
        return eqx.tree_at(lambda m: m.curve, self, curve)

    def __call__(self, z: Float[Array, " d"]) -> tuple[Float[Array, " d"], Float[Array, ""]]:
        """The point of the box, and log |dv/dz|."""
        log_slope, t, v = jnp.zeros(()), [], []
        for j in range(z.shape[0]):
            root = jnp.asarray(self.root[j])
            width, curve = root[j], jnp.asarray(self.curve[j])
            centre = curve[0]
            if j:
                centre = centre + t[0] * (curve[1] + t[0] * (curve[2] + t[0] * curve[3]))
            centre = centre + sum((root[i] * t[i] for i in range(1, j)), start=jnp.zeros(()))
            t_j, slope = _within(
                (centre - self.low[j]) / width, (self.high[j] - centre) / width, z[j]
            )
            log_slope = log_slope + jnp.log(width) + slope
            t.append(t_j)
            v.append(centre + width * t_j)
        return jnp.zeros_like(z).at[jnp.asarray(self.order)].set(jnp.stack(v)), log_slope


def _within(alpha: Array, beta: Array, z: Array) -> tuple[Array, Array]:
    """T in (-alpha, beta), and log dt/dz; sums of positive numbers by their logarithms."""
    log = jax.nn.log_sigmoid
    up, down = log(z), log(-z)
    below = jnp.logaddexp(log(-alpha) + down, log(beta) + up)
    above = jnp.logaddexp(log(alpha) + down, log(-beta) + up)
    # sigma(beta) - sigma(-alpha), without a difference of numbers that are nearly the same
    span = log(alpha) + log(beta) + jnp.log(-jnp.expm1(-(alpha + beta)))
    return below - above, span + up + down - below - above
