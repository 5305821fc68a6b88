"""What fits minimise, as convex functions of the unknowns with their derivatives.

The residuals of the group p of readings (a pressure) are r_p = W_p y - c_p. All arrays have a
leading axis of members, which are fits of their own; one of length one is shared by all.
"""

import abc
import dataclasses

import jax
from jaxtyping import Bool, Float

from .arrays import AnyArray, namespace, of_each

_ROUNDED = 1e-8  # of |c_p|: the norm below which the corner of a norm is rounded off
_FIRST_ROUNDED, _FASTER = 1e-1, 1e-1
_NEARLY_PERFECT = 1e-4  # of |c_p|
_RIDGE = 1e-12  # of the curvature of the sum of squares


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Model:
    """Gradient and curvature at a point.

    Attributes:
        gradient, hessian: of the function.
        majorant: a curvature with which the model lies nowhere below the function.
    """

    gradient: Float[AnyArray, "b n"]
    hessian: Float[AnyArray, "b n n"]
    majorant: Float[AnyArray, "b n n"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class AbstractObjective(abc.ABC):
    """A convex function of y.

    Attributes:
        W: shape (b, groups, k, n).
        c: shape (b, groups, k).
        weight: of each group, shape (b, groups); 0 leaves one out.
    """

    W: Float[AnyArray, "#b groups k n"]
    c: Float[AnyArray, "#b groups k"]
    weight: Float[AnyArray, "#b groups"]

    quadratic = False
    """Whether the model is the function."""

    @abc.abstractmethod
    def model(self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]) -> Model:
        """Derivatives; early iterations may see a smoother function."""

    @abc.abstractmethod
    def value(
        self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]
    ) -> Float[AnyArray, " b"]:
        """The value alone; that of the last iteration is the objective."""

    def at_corner(self, y: Float[AnyArray, "b n"]) -> Bool[AnyArray, " b"]:
        """Whether y is near a point without a derivative; never where there is none."""
        return namespace(y).zeros(len(y), bool)

    def rounded(self, y: Float[AnyArray, "b n"]) -> Float[AnyArray, " b"]:
        """How far the last model may lie above the objective anywhere."""
        return namespace(y).zeros(len(y), y.dtype)

    def residuals(self, y: Float[AnyArray, "b n"]) -> Float[AnyArray, "b groups k"]:
        """W y - c."""
        return (self.W @ y[:, None, :, None])[..., 0] - self.c

    def _gradient(self, pull: Float[AnyArray, "b groups k"]) -> Float[AnyArray, "b n"]:
        """sum_p W_p^T pull_p."""
        return (pull[..., None, :] @ self.W)[..., 0, :].sum(axis=1)

    def _curvature(self, weight: Float[AnyArray, "b groups #k"]) -> Float[AnyArray, "b n n"]:
        """sum_p W_p^T diag(weight_p) W_p."""
        xp, n = namespace(weight), self.W.shape[-1]
        weighted = weight[..., None] * self.W
        weighted = xp.swapaxes(weighted.reshape(len(weighted), -1, n), 1, 2)
        return weighted @ self.W.reshape(len(self.W), -1, n)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SumOfSquares(AbstractObjective):
    """1/2 sum_p w_p |r_p|^2."""

    quadratic = True

    def value(
        self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]
    ) -> Float[AnyArray, " b"]:
        """The value alone."""
        del iteration
        return (self.weight * (self.residuals(y) ** 2).sum(axis=2)).sum(axis=1) / 2

    def model(self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]) -> Model:
        """Derivatives."""
        del iteration
        r, weight = self.residuals(y), self.weight[..., None]
        hessian = self._curvature(weight)
        return Model(self._gradient(weight * r), hessian, hessian)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MeanRmse(AbstractObjective):
    """The reference work's objective, the mean over groups of the RMSE: mean_p |r_p| / sqrt(K_p).

    A norm has a corner where it is zero. It is rounded off, sqrt(|r_p|^2 + d_p^2), over d_p far
    below the data; the first iterations use a larger d_p, so that a fit that is perfect at some
    pressure is reached by Newton steps as well.

    Attributes:
        count: readings of each group K_p, shape (b, groups).

    References:
        Chambers 2021, equation 7.6, with the difference that a least-squares error takes.
    """

    count: Float[AnyArray, "#b groups"]

    def value(
        self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]
    ) -> Float[AnyArray, " b"]:
        """The value alone, not rounded after the first iterations."""
        rounding = of_each(_rounding(iteration))
        norm = self._norms(self.residuals(y), rounding * (rounding > _ROUNDED))
        return (self._share * norm).sum(axis=1)

    def at_corner(self, y: Float[AnyArray, "b n"]) -> Bool[AnyArray, " b"]:
        """Whether the fit is nearly perfect in a group."""
        norm = self._norms(self.residuals(y), 0.0)
        return (norm**2 < _NEARLY_PERFECT**2 * self._size).any(axis=1)

    def rounded(self, y: Float[AnyArray, "b n"]) -> Float[AnyArray, " b"]:
        """The sum of the roundings of all corners."""
        xp, norm = namespace(y), self._norms(self.residuals(y), _ROUNDED)
        corner = _ROUNDED * xp.sqrt(self._size)
        most = xp.minimum(corner, corner**2 / xp.where(norm > 0, norm, 1.0))
        return (self._share * most).sum(axis=1)

    def model(self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]) -> Model:
        """Derivatives of the rounded function."""
        xp, r = namespace(y), self.residuals(y)
        norm = self._norms(r, of_each(_rounding(iteration)))
        positive = xp.where(norm > 0, norm, 1.0)
        pull = (r[..., None, :] @ self.W)[..., 0, :] * (self.weight / positive)[..., None]
        each = self._share / positive
        majorant = self._curvature((each * self.weight)[..., None])
        bent = xp.swapaxes(each[..., None] * pull, 1, 2) @ pull
        gradient = (self._share[..., None] * pull).sum(axis=1)
        return Model(gradient, (1 + _RIDGE) * majorant - bent, majorant)

    @property
    def _share(self) -> Float[AnyArray, "#b groups"]:
        """The weight of each group in the mean."""
        return 1 / (namespace(self.count).sqrt(self.count) * self.count.shape[1])

    @property
    def _size(self) -> Float[AnyArray, "b groups"]:
        return self.weight * (self.c**2).sum(axis=2)

    def _norms(
        self, r: Float[AnyArray, "b groups k"], rounding: Float[AnyArray, "#b 1"] | float
    ) -> Float[AnyArray, "b groups"]:
        """|r_p|, rounded."""
        xp = namespace(r)
        square = self.weight * (r**2).sum(axis=2) + rounding**2 * self._size
        zero = square <= 0
        return xp.where(zero, 0.0, xp.sqrt(xp.where(zero, 1.0, square)))


def _rounding(iteration: Float[AnyArray, "#b"]) -> Float[AnyArray, "#b"]:
    return namespace(iteration).maximum(_FIRST_ROUNDED * _FASTER**iteration, _ROUNDED)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Huber(AbstractObjective):
    """sum over readings of w (r^2 / 2 where |r| <= d, else d |r| - d^2 / 2): robust to outliers.

    Attributes:
        there: 1 for a reading, 0 for none, shape (b, groups, k).
        threshold: d, in the unit of the residuals, shape (1, 1, 1).
    """

    there: Float[AnyArray, "#b groups k"]
    threshold: Float[AnyArray, "1 1 1"]

    def value(
        self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]
    ) -> Float[AnyArray, " b"]:
        """The value alone."""
        del iteration
        size, d = abs(self.residuals(y)), self.threshold
        cost = namespace(y).where(size <= d, size**2 / 2, d * size - d**2 / 2)
        return (self._each * cost).sum(axis=(1, 2))

    def model(self, y: Float[AnyArray, "b n"], iteration: Float[AnyArray, "#b"]) -> Model:
        """Derivatives; a little curvature is left where every reading is an outlier."""
        del iteration
        xp, r, d = namespace(y), self.residuals(y), self.threshold
        size = abs(r)
        outside = size > d
        softer = xp.where(outside, d / xp.where(outside, size, 1.0), 1.0)
        return Model(
            self._gradient(self._each * xp.clip(r, -d, d)),
            self._curvature(self._each * (~outside + _RIDGE)),
            self._curvature(self._each * (softer + _RIDGE)),
        )

    @property
    def _each(self) -> Float[AnyArray, "b groups k"]:
        return self.weight[..., None] * self.there
