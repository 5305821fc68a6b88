"""What a sweep found: a row for each fit, and all of them."""

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np

import famjax

from ..convex import Status
from ..data import ForceData, data_frame, data_set, html_table
from .linear_model import LinearModel

if TYPE_CHECKING:
    import pandas
    import xarray


@dataclasses.dataclass(frozen=True)
class SweepRow:
    """One fit of a sweep, in SI.

    Attributes:
        data: name of the force map.
        dependence, order, constraint: form of the law.
        n_coefficients: number of them.
        coefficients: E_n [Pa] at each pressure, shape (pressures, order).
        coefficients_std: standard deviation [Pa] over bootstrap replicates, or nan.
        objective: minimum of the objective: half the sum of squares, or the mean RMSE, or Huber's.
        rmse, mae: [N], averaged over pressures.
        pooled_rmse: [N], over all readings.
        rmse_by_pressure, mae_by_pressure: [N].
        blocked_error: mean over pressures of |model - measured| blocked force [N].
        blocked_error_by_pressure: model minus measured [N].
        free_contraction_error: mean of |model - measured| [-] over the pressures at which there
            are both; nan where there are none.
        free_contraction_error_by_pressure: model minus measured [-]; nan where the model's force
            does not fall to zero, or the measured force does not come near it.
        aicc, bic: information criteria; they count coefficients as if none were constrained.
        cross_validated_rmse: [N] at pressures left out of the fit, nan where the form says nothing
            about other pressures.
        margin: smallest modulus along the actuation paths [Pa]; Drucker-stable where >= 0.
        condition: of the columns.
        kkt_residual, duality_gap: certificate.
        status: how the fit ended.
        verdict: in words: "stable", "not stable", or why there is no fit.
    """

    data: str
    dependence: str
    order: int
    constraint: str
    n_coefficients: int
    coefficients: np.ndarray
    coefficients_std: np.ndarray
    objective: float
    rmse: float
    mae: float
    pooled_rmse: float
    rmse_by_pressure: np.ndarray
    mae_by_pressure: np.ndarray
    blocked_error: float
    blocked_error_by_pressure: np.ndarray
    free_contraction_error: float
    free_contraction_error_by_pressure: np.ndarray
    aicc: float
    bic: float
    cross_validated_rmse: float
    margin: float
    condition: float
    kkt_residual: float
    duality_gap: float
    status: Status
    verdict: str

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers and lists, for JSON; nan stays nan."""
        return {
            key: value.tolist() if isinstance(value, np.ndarray) else _plain(value)
            for key, value in vars(self).items()
        }


@dataclasses.dataclass(frozen=True, repr=False)
class Sweep:
    """What `sweep` found.

    Attributes:
        rows: all fits, by data, dependence, order and constraint.
        pressures: levels [Pa] of each force map.
        data: the force maps.
        geometries: of the fits.
        deadbands: [Pa].
        objective: one of "sum_of_squares", "mean_rmse" and "huber".
        replicates: number of bootstrap replicates.
        seed: of the replicates.
        models: of the fits, with any coefficients.
    """

    rows: tuple[SweepRow, ...]
    pressures: tuple[np.ndarray, ...]
    data: tuple[ForceData, ...]
    geometries: tuple[famjax.geometries.AbstractGeometry, ...]
    deadbands: tuple[float, ...]
    objective: str
    replicates: int
    seed: int
    models: tuple[LinearModel, ...]

    def to_pandas(self) -> "pandas.DataFrame":
        """A row for each fit in SI: its form, errors and verdict; lists by pressure are left out.

        Raises:
            InputError: pandas is not installed.
        """
        return data_frame(
            {key: value for key, value in row.as_dict().items() if not isinstance(value, list)}
            for row in self.rows
        )

    def to_xarray(self) -> "xarray.Dataset":
        """The numbers of every fit in SI, over data, dependence, order and constraint; nan where none is.

        Raises:
            InputError: xarray is not installed.
        """
        forms = ("data", "dependence", "order", "constraint")
        axes = {
            name: list(dict.fromkeys(getattr(row, name) for row in self.rows)) for name in forms
        }
        numbers = [
            name for name, value in vars(self.rows[0]).items()
            if isinstance(value, int | float) and name not in forms and name != "status"
        ]  # fmt: skip
        found = np.full((len(numbers), *(len(values) for values in axes.values())), np.nan)
        for row in self.rows:
            place = tuple(values.index(getattr(row, name)) for name, values in axes.items())
            found[(slice(None), *place)] = [getattr(row, name) for name in numbers]
        return data_set(
            {name: (forms, values, {}) for name, values in zip(numbers, found, strict=True)},
            {name: ((name,), np.array(values), {}) for name, values in axes.items()},
            {"objective": self.objective, "replicates": self.replicates, "seed": self.seed},
        )

    def _repr_html_(self) -> str:
        header = ("dependence", "order", "constraint", "rmse", "cross_validated_rmse", "verdict")
        rows = [tuple(getattr(row, name) for name in header) for row in self.rows]
        return html_table(repr(self), header, rows)

    def __repr__(self) -> str:
        names = ", ".join(one.specimen.name for one in self.data)
        solved = sum(row.status is Status.OPTIMAL for row in self.rows)
        return (
            f"Sweep({len(self.rows)} fits of {names}, {solved} of them solved, {self.objective}, "
            f"{self.replicates} replicates)"
        )


def _plain(value: Any) -> Any:
    return value.name if isinstance(value, Status) else value
