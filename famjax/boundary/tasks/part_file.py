"""One part of a work as a Parquet file of one row, a column for each array or value.

An array is a list of its elements, whose shape and type are in the file's metadata; what is neither
an array, a number nor a text is kept as JSON.
"""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..extras import import_extra

_KEY = b"famjax"
_KINDS = "biufU"  # NumPy's kinds of arrays that a file takes


class Damaged(InputError):  # noqa: N818 -- the name says what it is
    """A file that is not what was written."""


def part_bytes(part: dict[str, Any]) -> bytes:
    """The file of a part; the same part has the same bytes.

    Raises:
        InputError: a value that cannot be kept, or pyarrow is not installed.
    """
    arrow, parquet = arrow_modules()
    columns, about = {}, {}
    for name, value in part.items():
        columns[name], about[name] = _column(name, value, arrow)
    schema = arrow.schema(
        [(name, column.type) for name, column in columns.items()],
        metadata={_KEY: json.dumps(about).encode()},
    )
    buffer = io.BytesIO()
    parquet.write_table(
        arrow.table(list(columns.values()), schema=schema),
        buffer,
        compression="zstd",
        use_dictionary=False,
        write_statistics=False,
        write_page_checksum=True,
    )
    return buffer.getvalue()


def read_part(file: Path) -> dict[str, Any]:
    """The part in a file, arrays with their shapes and types.

    Raises:
        Damaged: it is not what was written.
        OSError: it cannot be read.
        InputError: pyarrow is not installed.
    """
    arrow, parquet = arrow_modules()
    content = file.read_bytes()
    try:
        reader = parquet.ParquetFile(io.BytesIO(content), page_checksum_verification=True)
        table = reader.read()
        about = json.loads(table.schema.metadata[_KEY])
        return {name: _value(table[name].chunk(0), about[name]) for name in about}
    except (arrow.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        reason = str(error).partition("\n")[0]
        raise Damaged(f"{file} is damaged ({reason})") from None


def arrow_modules() -> tuple[Any, Any]:
    """What writes parts, `pyarrow` and its `parquet`.

    Raises:
        InputError: it is not installed.
    """
    arrow, parquet = (import_extra(name, "tables") for name in ("pyarrow", "pyarrow.parquet"))
    return arrow, parquet


def _column(name: str, value: Any, arrow: Any) -> tuple[Any, dict[str, Any]]:
    """A column of one row, and what is needed to read it."""
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in _KINDS:
        array = np.asarray(value)
        elements = array.ravel().tolist() if array.dtype.kind == "U" else array.ravel()
        inner = arrow.array(elements, from_pandas=False)
        lists = arrow.LargeListArray.from_arrays([0, array.size], inner)
        return lists, {"shape": list(array.shape), "dtype": array.dtype.str}
    if isinstance(value, bool | int | float | str):
        return column_of_one(value, arrow), {}
    try:
        return column_of_one(json.dumps(value, allow_nan=False), arrow), {"json": True}
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name} must be an array of numbers or texts, or a plain value, to be kept: {error}"
        ) from None


def column_of_one(value: Any, arrow: Any) -> Any:
    """What `arrow.array([value])` is, without the 0.3 s in which that imports pandas."""
    if isinstance(value, str):
        text = value.encode()
        kind, held = arrow.string(), [np.array([0, len(text)], np.int32), text]
    else:
        kinds = {bool: arrow.bool_(), int: arrow.int64(), float: arrow.float64()}
        of = next(of for of in kinds if isinstance(value, of))
        kind, held = kinds[of], [np.array([value], of)]
    return arrow.Array.from_buffers(kind, 1, [None, *(arrow.py_buffer(one) for one in held)])


def _value(column: Any, about: dict[str, Any]) -> Any:
    if "shape" in about:
        flat = column.values.to_numpy(zero_copy_only=False)
        return flat.astype(about["dtype"]).reshape(about["shape"])
    value = column[0].as_py()
    return json.loads(value) if "json" in about else value
