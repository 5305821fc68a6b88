"""The linear problem that all fits of a sweep share: columns, target and constraints in arrays.

Readings enter once: the columns of each pressure are compressed by a QR factorisation, [A_p y_p] to
(order + 1) rows. What follows is independent of their number.
"""

import dataclasses

import jax
import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError

from ..search import NORMAL_MAD, TUNED
from .arrays import AnyArray, fixed, namespace
from .linear_model import LinearModel
from .paths import PathFunctions, PathTable
from .readings import Readings

STATIONS = 17
"""Points of each path at which a constraint is posed from the start."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Design:
    """The linear problem of one force map at one geometry, in NumPy's arrays or in JAX's.

    Attributes:
        A: force [N] per coefficient in units of `unit`, shape (pressures, readings, order).
        target: force [N] that the bladder has to explain, shape (pressures, readings).
        weight: of the readings, shape (pressures, readings), 0 where there is none.
        unit: of each coefficient [Pa], shape (order,).
        basis: shares of the coefficients at the lowest and the highest pressure, (pressures, 2).
        functions: of the slope constraint along the path of each pressure, then of Drucker's, on
            the scaled coefficients.
        table: of the functions.
    """

    A: Float[AnyArray, "pressures readings order"]
    target: Float[AnyArray, "pressures readings"]
    weight: Float[AnyArray, "pressures readings"]
    unit: Float[AnyArray, " order"]
    basis: Float[AnyArray, "pressures 2"]
    functions: PathFunctions
    table: PathTable

    @classmethod
    def of(cls, model: LinearModel, readings: Readings) -> "Design":
        """The problem of some readings."""
        pressure, weight = readings.pressure, readings.weight
        braid, columns = model.columns(readings.length, pressure[:, None])
        known = np.isfinite(braid) & np.isfinite(columns).all(axis=-1)
        lost = np.argwhere(readings.there & ~known)
        if lost.size:
            k, n = lost[0]
            raise InputError(
                f"the muscle must have a force at every loaded reading; it has none at {len(lost)} of "
                f"them, first at {readings.length[k, n] * 1e3:.5g} mm and {pressure[k] / 1e3:.5g} kPa: "
                "the geometry does not reach it, or a force term is no number there"
            )
        unit = 1 / np.sqrt(np.sum((columns * weight[..., None]) ** 2, axis=(0, 1)))
        functions = model.path_functions().scaled(unit)
        share = (pressure - pressure[0]) / max(pressure[-1] - pressure[0], 1.0)
        return cls(
            A=columns * unit,
            target=readings.force - braid,
            weight=weight,
            unit=unit,
            basis=np.stack([1 - share, share], axis=-1),
            functions=functions,
            table=functions.table(),
        )

    @property
    def there(self) -> Bool[AnyArray, "pressures readings"]:
        """Which of the padded readings are readings."""
        return self.weight > 0

    @property
    def stations(self) -> np.ndarray:
        """Indices of the nodes at which a constraint is posed from the start."""
        return np.linspace(0, self.table.nodes.shape[1] - 1, STATIONS).round().astype(int)

    def factor(self) -> Float[AnyArray, "pressures rows rows"]:
        """Compressed [A y], weighted, shape (pressures, order + 1, order + 1)."""
        return compressed(self.A * self.weight[..., None], self.target * self.weight)

    def huber_threshold(self) -> Float[AnyArray, "1 1 1"]:
        """1.345 standard deviations of the noise, by the residuals of a law free in pressure.

        At each pressure it has the highest order, but no more coefficients than half the readings:
        a law that goes through all of them shows no noise.
        """
        xp, y, count = namespace(self.A), self.target * self.weight, self.there.sum(axis=1)
        # The first columns of Q span the law of a lower order.
        Q, _ = xp.linalg.qr(self.A * self.weight[..., None])
        Q = xp.where(2 * np.arange(1, Q.shape[-1] + 1) <= count[:, None, None], Q, 0.0)
        left = abs(y - (Q @ (Q.mT @ y[..., None]))[..., 0])
        shows = self.there & (count > 1)[:, None]
        # Of pressures with one reading each there is no spread.
        left = xp.where(shows.any(), xp.where(shows, left, xp.nan), 0.0)
        size = xp.sqrt((y**2).sum() / count.sum())
        spread = xp.maximum(NORMAL_MAD * xp.nanmedian(left), 1e-9 * size)
        return fixed(TUNED * spread.reshape(1, 1, 1))


def compressed(
    A: Float[AnyArray, "*batch k n"], y: Float[AnyArray, "*batch k"]
) -> Float[AnyArray, "*batch n+1 n+1"]:
    """Rows with the Gram matrix of [A y]: R and Q^T y, and below them what A cannot reach of y."""
    xp = namespace(A)
    Q, R = xp.linalg.qr(A)
    c = Q.mT @ y[..., None]
    square = ((y - (Q @ c)[..., 0]) ** 2).sum(axis=-1)
    rest = xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), 0.0)
    bottom = np.arange(A.shape[-1] + 1) == A.shape[-1]
    top = xp.concatenate([R, c], axis=-1)
    return xp.concatenate([top, bottom * rest[..., None, None]], axis=-2)
