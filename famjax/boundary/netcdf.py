"""NetCDF 3 files by SciPy alone, with the conventions by which xarray reads them back."""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

Variable = tuple[tuple[str, ...], np.ndarray, Mapping[str, str]]
"""Names of the dimensions, values and attributes."""


def netcdf_content(
    data: Mapping[str, Variable], coordinates: Mapping[str, Variable], attributes: Mapping[str, Any]
) -> bytes:
    """A file with 64-bit offsets, the same to the last bit as xarray writes of a `Dataset`.

    A text becomes characters along a dimension of its own, of its longest value in UTF-8. A number
    that is missing is nan, as `_FillValue` states. A variable along the dimensions of a coordinate
    that is not one of these dimensions names it in its attribute `coordinates`.

    Args:
        data: variables by name; values of dtype float64 or int8, or texts.
        coordinates: the same for the coordinates.
        attributes: of the file; texts and numbers.
    """
    from scipy.io import netcdf_file  # noqa: PLC0415 -- only where a table is written

    content = io.BytesIO()
    file = netcdf_file(content, "w", version=2)
    for key, value in attributes.items():
        setattr(file, key, value.encode() if isinstance(value, str) else np.atleast_1d(value))
    for name, (dimensions, values, about) in {**data, **coordinates}.items():
        shown: dict[str, Any] = {key: text.encode() for key, text in about.items()}
        beside = [
            other
            for other, (along, *_) in coordinates.items()
            if other not in along and set(along) <= set(dimensions)
        ]
        if beside and name not in coordinates:
            shown["coordinates"] = " ".join(beside).encode()
        stored, along = values, dimensions
        if stored.dtype.kind == "U":
            stored = _characters(stored)
            along = (*dimensions, f"string{stored.shape[-1]}")
            shown["_Encoding"] = b"utf-8"
        elif stored.dtype.kind == "f":
            shown["_FillValue"] = np.array([np.nan])
        for dimension, length in zip(along, stored.shape, strict=True):
            if dimension not in file.dimensions:
                file.createDimension(dimension, length)
        variable = file.createVariable(name, stored.dtype, along)
        variable.data[:] = stored
        for key, value in shown.items():
            setattr(variable, key, value)
    file.flush()
    return content.getvalue()


def _characters(texts: np.ndarray) -> np.ndarray:
    """The bytes of texts in UTF-8, shape (..., longest)."""
    coded = np.char.encode(texts, "utf-8")
    return coded.reshape(*texts.shape, 1).view("S1")
