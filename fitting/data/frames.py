"""Results as tables of others: pandas, xarray, and the rich display of notebooks."""

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from famjax.boundary.extras import import_extra

if TYPE_CHECKING:
    import pandas
    import xarray

_EXTRA = "tables"
_SHOWN = 12
"""Rows that a notebook shows."""

Variable = tuple[Sequence[str], np.ndarray, Mapping[str, str]]
"""Dimensions, values, attributes."""


def data_frame(rows: Iterable[Mapping[str, Any]], index: str | None = None) -> "pandas.DataFrame":
    """Rows that share their keys as a data frame.

    Raises:
        InputError: pandas is not installed.
    """
    frame = import_extra("pandas", _EXTRA).DataFrame.from_records(list(rows))
    return frame if index is None else frame.set_index(index)


def data_set(
    variables: Mapping[str, Variable], coordinates: Mapping[str, Variable], about: Mapping[str, Any]
) -> "xarray.Dataset":
    """Variables with their units as a data set.

    Raises:
        InputError: xarray is not installed.
    """
    return import_extra("xarray", _EXTRA).Dataset(variables, coordinates, dict(about))


def html_table(title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table for notebooks; of long ones the beginning."""

    def cells(values: Iterable[object], tag: str) -> str:
        return "".join(f"<{tag}>{html.escape(_text(one))}</{tag}>" for one in values)

    body = "".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows[:_SHOWN])
    more = f"<p>and {len(rows) - _SHOWN} more</p>" if len(rows) > _SHOWN else ""
    return (
        f"<table><caption>{html.escape(title)}</caption>"
        f"<thead><tr>{cells(header, 'th')}</tr></thead><tbody>{body}</tbody></table>{more}"
    )


def _text(value: object) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)
