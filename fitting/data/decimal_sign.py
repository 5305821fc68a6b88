"""The decimal sign of a table of numbers: a point, or a comma where columns are separated otherwise."""

import re
from collections.abc import Sequence

from famjax.boundary.errors import InputError

from .header import quoted

_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+")


def comma_hint(cell: str) -> str:
    """What to do about a comma in what is not a number; "" where there is none."""
    return " (write a decimal point, and nothing between thousands)" if "," in cell else ""


def with_points(
    rows: Sequence[tuple[int, list[str]]], separator: str
) -> list[tuple[int, list[str]]]:
    """The cells of a file with decimal points, as a spreadsheet of another country has commas.

    Args:
        rows: number and cells of each line.
        separator: between the cells.

    Raises:
        InputError: commas may stand between thousands, or there are points beside them.

    >>> with_points([(2, ["300", "1,5"]), (3, ["300", "1,25"])], ";")
    [(2, ['300', '1.5']), (3, ['300', '1.25'])]
    """
    if separator == ",":
        return list(rows)
    cells = [(number, cell.strip()) for number, row in rows for cell in row]
    commas = [one for one in cells if "," in one[1]]
    if not commas:
        return list(rows)
    number, cell = next((one for one in cells if "." in one[1]), (0, ""))
    if number:
        raise InputError(
            f"row {number}: {quoted(cell)} has a point, and {quoted(commas[0][1])} in row "
            f"{commas[0][0]} a comma: write all numbers with one decimal sign, and with nothing between "
            "thousands"
        )
    if all(_THOUSANDS.fullmatch(cell) for _, cell in commas):
        number, cell = commas[0]
        raise InputError(
            f"row {number}: {quoted(cell)} may be {cell.replace(',', '.')} or "
            f"{cell.replace(',', '')}: write decimal points, and nothing between thousands"
        )
    return [(number, [cell.replace(",", ".") for cell in row]) for number, row in rows]
