"""What a fit minimises, as a convex function of the unknowns with its derivatives.

The residuals of the group p of readings (a pressure) are r_p = W_p y - c_p.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

_ROUNDED = 1e-8  # of |c_p|: the norm below which the corner of a norm is rounded off
_FIRST_ROUNDED, _FASTER = 1e-1, 1e-1
_NEARLY_PERFECT = 1e-4  # of |c_p|
_RIDGE = 1e-12  # of the curvature of the sum of squares


class Model(eqx.Module):
    """Value, gradient and curvature at a point.

    Attributes:
        value, gradient, hessian: of the function.
        majorant: a curvature with which the model lies nowhere below the function.
    """

    value: Float[Array, ""]
    gradient: Float[Array, " n"]
    hessian: Float[Array, "n n"]
    majorant: Float[Array, "n n"]


class AbstractObjective(eqx.Module):
    """A convex function of y."""

    @property
    @abc.abstractmethod
    def quadratic(self) -> bool:
        """Whether the model is the function."""

    @abc.abstractmethod
    def model(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Model:
        """Value and derivatives; early iterations may see a smoother function."""

    @abc.abstractmethod
    def value(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Float[Array, ""]:
        """The value alone; that of the last iteration is the objective."""

    @abc.abstractmethod
    def at_corner(self, y: Float[Array, " n"]) -> Bool[Array, ""]:
        """Whether y is near a point without a derivative."""

    @abc.abstractmethod
    def rounded(self, y: Float[Array, " n"]) -> Float[Array, ""]:
        """How far the last model may lie above the objective anywhere."""


class SumOfSquares(AbstractObjective):
    """1/2 sum_p w_p |r_p|^2.

    Attributes:
        W: shape (groups, k, n).
        c: shape (groups, k).
        weight: w, shape (groups,); 0 leaves a group out.
    """

    W: Float[Array, "groups k n"]
    c: Float[Array, "groups k"]
    weight: Float[Array, " groups"]

    @property
    def quadratic(self) -> bool:
        """Whether the model is the function."""
        return True

    def value(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Float[Array, ""]:
        """The value alone."""
        del iteration
        return self.weight @ jnp.sum((self.W @ y - self.c) ** 2, axis=1) / 2

    def at_corner(self, y: Float[Array, " n"]) -> Bool[Array, ""]:
        """Never: it has none."""
        del y
        return jnp.array(False)

    def rounded(self, y: Float[Array, " n"]) -> Float[Array, ""]:
        """Nothing is rounded."""
        return jnp.zeros((), y.dtype)

    def model(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Model:
        """Value and derivatives."""
        weighted = self.weight[:, None, None] * self.W
        gradient = jnp.einsum("pkn,pk->n", weighted, self.W @ y - self.c)
        hessian = jnp.einsum("pkn,pkm->nm", weighted, self.W)
        return Model(self.value(y, iteration), gradient, hessian, hessian)


class MeanRmse(AbstractObjective):
    """The reference work's objective, the mean over groups of the RMSE: mean_p |r_p| / sqrt(K_p).

    A norm has a corner where it is zero. It is rounded off, sqrt(|r_p|^2 + d_p^2), over d_p far
    below the data; the first iterations use a larger d_p, so that a fit that is perfect at some
    pressure is reached by Newton steps as well.

    Attributes:
        W: shape (groups, k, n).
        c: shape (groups, k).
        weight: shape (groups,); 0 leaves a group out.
        count: readings of each group K_p, shape (groups,).

    References:
        Chambers 2021, equation 7.6, with the difference that a least-squares error takes.
    """

    W: Float[Array, "groups k n"]
    c: Float[Array, "groups k"]
    weight: Float[Array, " groups"]
    count: Float[Array, " groups"]

    @property
    def quadratic(self) -> bool:
        """Whether the model is the function."""
        return False

    def value(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Float[Array, ""]:
        """The value alone, not rounded after the first iterations."""
        rounding = _rounding(iteration)
        _, share, norm = self._norms(y, jnp.where(rounding > _ROUNDED, rounding, 0.0))
        return share @ norm

    def at_corner(self, y: Float[Array, " n"]) -> Bool[Array, ""]:
        """Whether the fit is nearly perfect in a group."""
        _, _, norm = self._norms(y, jnp.zeros(()))
        return jnp.any(norm**2 < _NEARLY_PERFECT**2 * self._size)

    def rounded(self, y: Float[Array, " n"]) -> Float[Array, ""]:
        """The sum of the roundings of all corners."""
        _, share, norm = self._norms(y, jnp.asarray(_ROUNDED))
        corner = _ROUNDED * jnp.sqrt(self._size)
        return share @ jnp.minimum(corner, corner**2 / norm)

    def model(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Model:
        """Value and derivatives of the rounded function."""
        r, share, norm = self._norms(y, _rounding(iteration))
        norm = jnp.where(norm > 0, norm, 1.0)
        weighted = self.weight[:, None, None] * self.W
        pull = jnp.einsum("pkn,pk->pn", weighted, r) / norm[:, None]
        majorant = jnp.einsum("p,pkn,pkm->nm", share / norm, weighted, self.W)
        return Model(
            share @ norm,
            share @ pull,
            majorant - jnp.einsum("p,pn,pm->nm", share / norm, pull, pull),
            majorant,
        )

    @property
    def _size(self) -> Float[Array, " groups"]:
        return self.weight * jnp.sum(self.c**2, axis=1)

    def _norms(self, y: Float[Array, " n"], rounding: Float[Array, ""]) -> tuple[Array, ...]:
        """Residuals, the weight of each group in the mean, and |r_p|, rounded."""
        r = self.W @ y - self.c
        square = self.weight * jnp.sum(r**2, axis=1) + rounding**2 * self._size
        zero = square <= 0
        norm = jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))
        return r, 1 / (jnp.sqrt(self.count) * self.count.shape[0]), norm


def _rounding(iteration: Float[Array, ""]) -> Float[Array, ""]:
    return jnp.maximum(_FIRST_ROUNDED * _FASTER**iteration, _ROUNDED)


class Huber(AbstractObjective):
    """sum over readings of w (r^2 / 2 where |r| <= d, else d |r| - d^2 / 2): robust to outliers.

    Attributes:
        W: all readings, shape (groups, k, n).
        c: shape (groups, k).
        weight: w, shape (groups, k), zero where there is no reading.
        threshold: d, in the unit of the residuals.
    """

    W: Float[Array, "groups k n"]
    c: Float[Array, "groups k"]
    weight: Float[Array, "groups k"]
    threshold: Float[Array, ""]

    @property
    def quadratic(self) -> bool:
        """Whether the model is the function."""
        return False

    def value(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Float[Array, ""]:
        """The value alone."""
        del iteration
        size = jnp.abs(self.W @ y - self.c)
        d = self.threshold
        return jnp.sum(self.weight * jnp.where(size <= d, size**2 / 2, d * size - d**2 / 2))

    def model(self, y: Float[Array, " n"], iteration: Float[Array, ""]) -> Model:
        """Value and derivatives; a little curvature is left where every reading is an outlier."""
        r = self.W @ y - self.c
        size, d = jnp.abs(r), self.threshold
        inner = self.weight * (size <= d)
        everywhere = jnp.einsum("pkn,pk,pkm->nm", self.W, self.weight, self.W)
        softer = self.weight * jnp.where(size <= d, 1.0, d / jnp.where(size <= d, 1.0, size))
        return Model(
            self.value(y, iteration),
            jnp.einsum("pkn,pk->n", self.W, self.weight * jnp.clip(r, -d, d)),
            jnp.einsum("pkn,pk,pkm->nm", self.W, inner, self.W) + _RIDGE * everywhere,
            jnp.einsum("pkn,pk,pkm->nm", self.W, softer, self.W) + _RIDGE * everywhere,
        )

    def at_corner(self, y: Float[Array, " n"]) -> Bool[Array, ""]:
        """Never: it has none."""
        del y
        return jnp.array(False)

    def rounded(self, y: Float[Array, " n"]) -> Float[Array, ""]:
        """Nothing is rounded."""
        return jnp.zeros((), y.dtype)
