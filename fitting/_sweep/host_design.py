"""The linear problem that all fits of a sweep share, on the host; `problem.Design` is its twin."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from .._convex.chebyshev_paths import ChebyshevPaths
from .._convex.host_fit import HostConstraint
from .._convex.path_table import PathTable
from .forms import HUBER, NORMAL_MAD
from .linear_model import LinearModel
from .problem import STATIONS, Readings, stations_of


@dataclasses.dataclass(frozen=True)
class PathConstraint:
    """What has to hold along paths, per scaled coefficient.

    Attributes:
        table: of the functions.
        functions: themselves; None where the table is exact.
        unit: of each coefficient [Pa], shape (order,).
    """

    table: PathTable
    functions: ChebyshevPaths | None
    unit: Float[np.ndarray, " order"]

    def on(
        self, paths: Int[np.ndarray, " paths"], on_y: Float[np.ndarray, "paths order n"]
    ) -> HostConstraint:
        """The constraint on unknowns y with coefficients E = on_y y at some of the paths."""
        order, table = on_y.shape[1], self.table
        some = PathTable(
            table.nodes[paths], table.value[paths, :, :order], table.slope[paths, :, :order]
        )

        def rows(
            path: Int[np.ndarray, " k"], s: Float[np.ndarray, " k"]
        ) -> tuple[Float[np.ndarray, "k order"], ...]:
            return tuple(phi[:, :order] for phi in self.rows(paths[path], s))

        return HostConstraint.along(on_y, some, stations_of(table.nodes), rows)

    def rows(
        self, path: Int[np.ndarray, " k"], s: Float[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, "k order"], ...]:
        """The functions at positions of paths, with their first and second derivative."""
        if self.functions is None:
            return self.table.rows(path, s)
        return tuple(phi * self.unit for phi in self.functions.rows(path, s))


@dataclasses.dataclass(frozen=True)
class HostDesign:
    """The linear problem of one force map at one geometry.

    Attributes:
        A: force [N] per coefficient in units of `unit`, shape (pressures, readings, order).
        target: force [N] that the bladder has to explain, shape (pressures, readings).
        weight: of the readings, shape (pressures, readings), 0 where there is none.
        factor: compressed [A y], weighted, shape (pressures, order + 1, order + 1).
        unit: of each coefficient [Pa], shape (order,).
        slope, drucker: the two constraints along the paths.
        basis: shares of the coefficients at the lowest and the highest pressure, (pressures, 2).
    """

    A: Float[np.ndarray, "pressures readings order"]
    target: Float[np.ndarray, "pressures readings"]
    weight: Float[np.ndarray, "pressures readings"]
    factor: Float[np.ndarray, "pressures rows rows"]
    unit: Float[np.ndarray, " order"]
    slope: PathConstraint
    drucker: PathConstraint
    basis: Float[np.ndarray, "pressures 2"]

    @classmethod
    def of(cls, model: LinearModel, readings: Readings) -> "HostDesign":
        """The problem of some readings."""
        pressure, weight = readings.pressure, readings.weight
        braid, columns = model.columns(readings.length, pressure[:, None])
        target, weighted = readings.force - braid, columns * weight[..., None]
        unit = 1 / np.sqrt(np.sum(weighted**2, axis=(0, 1)))
        functions = model.path_functions()
        table = functions.table()
        share = (pressure - pressure[0]) / max(pressure[-1] - pressure[0], 1.0)
        return cls(
            A=columns * unit,
            target=target,
            weight=weight,
            factor=_compressed(weighted * unit, target * weight),
            unit=unit,
            slope=PathConstraint(_slope_table(model.largest_strain, unit), None, unit),
            drucker=PathConstraint(
                PathTable(table.nodes, table.value * unit, table.slope * unit), functions, unit
            ),
            basis=np.stack([1 - share, share], axis=-1),
        )

    @property
    def there(self) -> np.ndarray:
        """Which of the padded readings are readings, shape (pressures, readings)."""
        return self.weight > 0

    def huber_threshold(self) -> float:
        """1.345 standard deviations of the noise, by the residuals of a law free in pressure.

        At each pressure it has the highest order, but no more coefficients than half the readings:
        a law that goes through all of them shows no noise.
        """
        y, count = self.target * self.weight, self.there.sum(axis=1)
        # The first columns of Q span the law of a lower order.
        Q, _ = np.linalg.qr(self.A * self.weight[..., None])
        Q = np.where(2 * np.arange(1, Q.shape[-1] + 1) <= count[:, None, None], Q, 0.0)
        left = np.abs(y - (Q @ (Q.mT @ y[..., None]))[..., 0])
        shows = left[self.there & (count > 1)[:, None]]
        spread = NORMAL_MAD * float(np.median(shows)) if shows.size else 0.0
        return HUBER * max(spread, 1e-9 * float(np.sqrt(np.sum(y**2) / count.sum())))


def _slope_table(
    largest: Float[np.ndarray, " paths"], unit: Float[np.ndarray, " order"]
) -> PathTable:
    """The law's tangent n eps^(n - 1) over the strains of each path, up to order 4 a cubic."""
    s, n = np.linspace(0, 1, STATIONS), np.arange(1, unit.size + 1)
    strain = largest[:, None, None] * s[:, None]
    value = n * strain ** (n - 1) * unit
    curved = np.maximum(n - 2, 0)
    slope = largest[:, None, None] * n * (n - 1) * strain**curved * unit
    return PathTable(np.tile(s, (largest.size, 1)), value, slope)


def _compressed(
    A: Float[np.ndarray, "paths k n"], y: Float[np.ndarray, "paths k"]
) -> Float[np.ndarray, "paths n+1 n+1"]:
    """Rows with the Gram matrix of [A y]: R and Q^T y, and below them what A cannot reach of y."""
    Q, R = np.linalg.qr(A)
    c = (Q.mT @ y[..., None])[..., 0]
    n = A.shape[-1]
    rows = np.zeros((len(A), n + 1, n + 1))
    rows[:, :n, :n], rows[:, :n, n] = R, c
    rows[:, n, n] = np.linalg.norm(y - (Q @ c[..., None])[..., 0], axis=-1)
    return rows
