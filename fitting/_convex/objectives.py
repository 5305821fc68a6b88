"""What a fit minimises, as a convex function of the unknowns with its derivatives.

The residuals of the group p of readings (a pressure) are r_p = W_p y - c_p. Both drivers of a fit
use these functions: that for batches with JAX's arrays, that on the host with NumPy's. They are
plain dataclasses, whose methods cost nothing to call.
"""

import abc
import dataclasses
from typing import TYPE_CHECKING, Any

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

_ROUNDED = 1e-8  # of |c_p|: the norm below which the corner of a norm is rounded off
_FIRST_ROUNDED, _FASTER = 1e-1, 1e-1
_NEARLY_PERFECT = 1e-4  # of |c_p|
_RIDGE = 1e-12  # of the curvature of the sum of squares


if TYPE_CHECKING:
    AnyArray = Any  # all of one kind in a fit, which no checker can know
    Real = Any
    Truth = Any
else:
    AnyArray = Array | np.ndarray
    Real = Float[AnyArray, ""] | float
    Truth = Bool[AnyArray, ""] | np.bool_


def namespace(array: Any) -> Any:
    """`jax.numpy` of JAX's arrays, `numpy` of NumPy's."""
    return array.__array_namespace__()


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Model:
    """Value, gradient and curvature at a point.

    Attributes:
        value, gradient, hessian: of the function.
        majorant: a curvature with which the model lies nowhere below the function.
    """

    value: Real
    gradient: Float[AnyArray, " n"]
    hessian: Float[AnyArray, "n n"]
    majorant: Float[AnyArray, "n n"]


class AbstractObjective(abc.ABC):
    """A convex function of y."""

    @property
    @abc.abstractmethod
    def quadratic(self) -> bool:
        """Whether the model is the function."""

    @abc.abstractmethod
    def model(self, y: Float[AnyArray, " n"], iteration: Real) -> Model:
        """Value and derivatives; early iterations may see a smoother function."""

    @abc.abstractmethod
    def value(self, y: Float[AnyArray, " n"], iteration: Real) -> Real:
        """The value alone; that of the last iteration is the objective."""

    @abc.abstractmethod
    def at_corner(self, y: Float[AnyArray, " n"]) -> Truth:
        """Whether y is near a point without a derivative."""

    @abc.abstractmethod
    def rounded(self, y: Float[AnyArray, " n"]) -> Real:
        """How far the last model may lie above the objective anywhere."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SumOfSquares(AbstractObjective):
    """1/2 sum_p w_p |r_p|^2.

    Attributes:
        W: shape (groups, k, n).
        c: shape (groups, k).
        weight: w, shape (groups,); 0 leaves a group out.
    """

    W: Float[AnyArray, "groups k n"]
    c: Float[AnyArray, "groups k"]
    weight: Float[AnyArray, " groups"]

    @property
    def quadratic(self) -> bool:
        """Whether the model is the function."""
        return True

    def value(self, y: Float[AnyArray, " n"], iteration: Real) -> Real:
        """The value alone."""
        del iteration
        return self.weight @ ((self.W @ y - self.c) ** 2).sum(axis=1) / 2

    def at_corner(self, y: Float[AnyArray, " n"]) -> Truth:
        """Never: it has none."""
        return namespace(y).zeros((), bool)

    def rounded(self, y: Float[AnyArray, " n"]) -> Real:
        """Nothing is rounded."""
        return namespace(y).zeros((), y.dtype)

    def model(self, y: Float[AnyArray, " n"], iteration: Real) -> Model:
        """Value and derivatives."""
        xp, weighted = namespace(y), self.weight[:, None, None] * self.W
        gradient = xp.einsum("pkn,pk->n", weighted, self.W @ y - self.c)
        hessian = xp.einsum("pkn,pkm->nm", weighted, self.W)
        return Model(self.value(y, iteration), gradient, hessian, hessian)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
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

    W: Float[AnyArray, "groups k n"]
    c: Float[AnyArray, "groups k"]
    weight: Float[AnyArray, " groups"]
    count: Float[AnyArray, " groups"]

    @property
    def quadratic(self) -> bool:
        """Whether the model is the function."""
        return False

    def value(self, y: Float[AnyArray, " n"], iteration: Real) -> Real:
        """The value alone, not rounded after the first iterations."""
        rounding = _rounding(y, iteration)
        _, share, norm = self._norms(y, rounding * (rounding > _ROUNDED))
        return share @ norm

    def at_corner(self, y: Float[AnyArray, " n"]) -> Truth:
        """Whether the fit is nearly perfect in a group."""
        _, _, norm = self._norms(y, 0.0)
        return (norm**2 < _NEARLY_PERFECT**2 * self._size).any()

    def rounded(self, y: Float[AnyArray, " n"]) -> Real:
        """The sum of the roundings of all corners."""
        xp, (_, share, norm) = namespace(y), self._norms(y, _ROUNDED)
        corner = _ROUNDED * xp.sqrt(self._size)
        return share @ xp.minimum(corner, corner**2 / xp.where(norm > 0, norm, 1.0))

    def model(self, y: Float[AnyArray, " n"], iteration: Real) -> Model:
        """Value and derivatives of the rounded function."""
        xp, (r, share, norm) = namespace(y), self._norms(y, _rounding(y, iteration))
        positive = xp.where(norm > 0, norm, 1.0)
        pull = xp.einsum("pkn,pk->pn", self.W, r) * (self.weight / positive)[:, None]
        each = share / positive
        weighted = (each * self.weight)[:, None, None] * self.W
        majorant = xp.einsum("pkn,pkm->nm", weighted, self.W)
        return Model(
            share @ norm,
            share @ pull,
            (1 + _RIDGE) * majorant - (each[:, None] * pull).T @ pull,
            majorant,
        )

    @property
    def _size(self) -> Float[AnyArray, " groups"]:
        return self.weight * (self.c**2).sum(axis=1)

    def _norms(self, y: Float[AnyArray, " n"], rounding: Real) -> tuple[AnyArray, ...]:
        """Residuals, the weight of each group in the mean, and |r_p|, rounded."""
        xp, r = namespace(y), self.W @ y - self.c
        square = self.weight * (r**2).sum(axis=1) + rounding**2 * self._size
        zero = square <= 0
        norm = xp.where(zero, 0.0, xp.sqrt(xp.where(zero, 1.0, square)))
        return r, 1 / (xp.sqrt(self.count) * self.count.shape[0]), norm


def _rounding(y: Float[AnyArray, " n"], iteration: Real) -> Real:
    return namespace(y).maximum(_FIRST_ROUNDED * _FASTER**iteration, _ROUNDED)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Huber(AbstractObjective):
    """sum over readings of w (r^2 / 2 where |r| <= d, else d |r| - d^2 / 2): robust to outliers.

    Attributes:
        W: all readings, shape (groups, k, n).
        c: shape (groups, k).
        weight: w, shape (groups, k), zero where there is no reading.
        threshold: d, in the unit of the residuals.
    """

    W: Float[AnyArray, "groups k n"]
    c: Float[AnyArray, "groups k"]
    weight: Float[AnyArray, "groups k"]
    threshold: Real

    @property
    def quadratic(self) -> bool:
        """Whether the model is the function."""
        return False

    def value(self, y: Float[AnyArray, " n"], iteration: Real) -> Real:
        """The value alone."""
        del iteration
        size, d = abs(self.W @ y - self.c), self.threshold
        cost = namespace(y).where(size <= d, size**2 / 2, d * size - d**2 / 2)
        return (self.weight * cost).sum()

    def model(self, y: Float[AnyArray, " n"], iteration: Real) -> Model:
        """Value and derivatives; a little curvature is left where every reading is an outlier."""
        xp, r, d = namespace(y), self.W @ y - self.c, self.threshold
        size = abs(r)
        outside = size > d
        inner = self.weight * (~outside + _RIDGE)
        softer = self.weight * (xp.where(outside, d / xp.where(outside, size, 1.0), 1.0) + _RIDGE)
        return Model(
            self.value(y, iteration),
            xp.einsum("pkn,pk->n", self.W, self.weight * xp.clip(r, -d, d)),
            xp.einsum("pkn,pkm->nm", self.W * inner[..., None], self.W),
            xp.einsum("pkn,pkm->nm", self.W * softer[..., None], self.W),
        )

    def at_corner(self, y: Float[AnyArray, " n"]) -> Truth:
        """Never: it has none."""
        return namespace(y).zeros((), bool)

    def rounded(self, y: Float[AnyArray, " n"]) -> Real:
        """Nothing is rounded."""
        return namespace(y).zeros((), y.dtype)
