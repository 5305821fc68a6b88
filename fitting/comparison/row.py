"""One model's line in the league table."""

import dataclasses
import math
from typing import Any

import numpy as np
from jaxtyping import Float

from famjax.boundary.units import finite_or_none

from ..validation import LeftOut
from .cross_validation import CrossValidation

HeldOut = CrossValidation | LeftOut
"""Errors on what a fit had not seen."""


@dataclasses.dataclass(frozen=True)
class ComparisonRow:
    """One model in the table. Errors are of loaded readings [N]; nan where there is none.

    Attributes:
        name: of the model.
        label: authors and variant.
        n_parameters: fitted to the map; 0 for published constants.
        rmse, mae, max_error: in sample.
        lopo_rmse: with each pressure in turn left out and predicted.
        lolo_interior_rmse: with each length left out, the shortest and the longest not counted.
        lolo_rmse: with each length left out, all counted.
        at_bound: parameters that ended on a bound.
        note: what else to know.
    """

    name: str
    label: str
    n_parameters: int
    rmse: float = math.nan
    mae: float = math.nan
    max_error: float = math.nan
    lopo_rmse: float = math.nan
    lolo_interior_rmse: float = math.nan
    lolo_rmse: float = math.nan
    at_bound: tuple[str, ...] = ()
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The row for JSON: no nan, lists for tuples."""
        row: dict[str, Any] = {}
        for key, value in dataclasses.asdict(self).items():
            if isinstance(value, float):
                row[f"{key}_N"] = finite_or_none(value)
            else:
                row[key] = list(value) if isinstance(value, tuple) else value
        return row

    @classmethod
    def from_dict(cls, row: dict[str, Any]) -> "ComparisonRow":
        """The row that `as_dict` made plain."""
        given: dict[str, Any] = {}
        for field in dataclasses.fields(cls):
            value = row.get(field.name, row.get(f"{field.name}_N"))
            value = math.nan if value is None else value
            given[field.name] = tuple(value) if isinstance(value, list) else value
        return cls(**given)

    def noted(self, note: str) -> "ComparisonRow":
        """The row with one more note."""
        return dataclasses.replace(self, note="; ".join(filter(None, (self.note, note))))

    def with_errors(
        self,
        error: Float[np.ndarray, " points"],
        without_pressure: HeldOut | None,
        without_length: HeldOut | None,
    ) -> "ComparisonRow":
        """The row with its errors [N]: in sample at the loaded readings, and held out."""
        size = np.abs(error)
        return dataclasses.replace(
            self,
            rmse=float(np.sqrt(np.mean(size**2))),
            mae=float(size.mean()),
            max_error=float(size.max()),
            lopo_rmse=without_pressure.rmse if without_pressure else math.nan,
            lolo_interior_rmse=without_length.interior_rmse if without_length else math.nan,
            lolo_rmse=without_length.rmse if without_length else math.nan,
        )
