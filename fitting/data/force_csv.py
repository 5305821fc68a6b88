"""Force maps from CSV files whose columns name their units, with the specimen in comment lines.

# specimen: rest_length_mm = 296
# specimen: embedded = true
pressure_kPa,length_mm,force_N
65,296,54.9
"""

import csv
import dataclasses
import importlib.resources
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.files import csv_lines
from famjax.boundary.near import meant
from famjax.boundary.sentence import Quantity, Sentence
from famjax.boundary.units import UNITS, to_si

from ..arguments import check_mapping, check_numbers, shown
from ..plausible import QUANTITIES, check_plausible
from .decimal_sign import comma_hint, with_points
from .force_data import NOT_NEGATIVE, ForceData, Specimen
from .header import Column, columns_of, quoted

DEFAULT_WALL_THICKNESS = 1.8e-3
"""Bladder wall [m] assumed where none is given: that of the Festo DMSP (Martens & Boblan 2017)."""

_FILL = " \t,;"
_WALL_OF_BORE = 0.18  # at most: that of the DMSP-10, the smallest muscle that is known to have it

_SPECIMEN_LENGTHS = (
    "rest_length",
    "wall_thickness",
    "nominal_diameter",
    "bladder_diameter",
    "braid_thickness",
)
_OF_THE_FIT = ("braid_angle", "braid_diameter", "deadband_pressure")


@runtime_checkable
class Stream(Protocol):
    """An open text, such as standard input."""

    def read(self) -> str:
        """All of it."""
        ...


def bundled_names() -> list[str]:
    """Names of the measured maps that come with famjax.

    >>> bundled_names()
    ['DMSP-10-250', 'DMSP-20-300']
    """
    folder = importlib.resources.files("fitting") / "data"
    return sorted(f.name.removesuffix(".csv").upper() for f in folder.iterdir() if ".csv" in f.name)


def bundled_map_name(name: str) -> str | None:
    """The name of a bundled map as people write it, or None where it is none.

    In any case, with hyphens or underscores, and with or without the muscle's length, which the name
    of its card lacks.

    >>> [bundled_map_name(one) for one in ("dmsp_20_300", "DMSP-20", "DMSP-2", "map.csv")]
    ['DMSP-20-300', 'DMSP-20-300', None, None]
    """
    asked = name.upper().replace("_", "-")
    found = [one for one in bundled_names() if asked in (one, one.rpartition("-")[0])]
    return found[0] if len(found) == 1 else None


def load_bundled(name: str, specimen: Mapping[str, Any] | None = None) -> ForceData:
    """A measured force map that comes with famjax.

    Args:
        name: one of `bundled_names()`, or one that `bundled_map_name` takes.
        specimen: fields of `Specimen` in SI that override those in the file.

    Returns:
        The map, with its specimen.

    Raises:
        InputError: no such map.

    References:
        Martens & Boblan 2017, Actuators 6(4), tables A1 (DMSP-20-300) and A2 (DMSP-10-250).

    >>> data = load_bundled("DMSP-20-300")
    >>> data.force.size, int(data.loaded.sum()), data.max_force
    (126, 60, 1653.5)
    """
    known = bundled_map_name(name) if isinstance(name, str) else None
    if known is None:
        raise InputError(f"no bundled map {name!r}; bundled are {', '.join(bundled_names())}")
    text = (importlib.resources.files("fitting") / "data" / f"{known.lower()}.csv").read_text()
    check_mapping("specimen", specimen, "from fields of Specimen to values in SI")
    return _parse(text.splitlines(), source=f"bundled map {known}", specimen=specimen or {})


def read_csv(path: str | Path | Stream, specimen: Mapping[str, Any] | None = None) -> ForceData:
    """A force map from a CSV file, or an open one such as standard input.

    The columns `force`, `pressure` and `length` must each be there once with their unit, as in
    `force_lbf,pressure_psi,length_in`; `force_std_N` and the like are optional. In the place of the
    length there may be a `contraction`, (L0 - L)/L0, or `contraction_%`. Lines that
    start with # are comments; `# specimen: rest_length_mm = 296` describes the muscle.

    Args:
        path: the file, UTF-8, separated by comma, semicolon or tab; or a stream of its text. Between
            semicolons or tabs numbers may have decimal commas.
        specimen: fields of `Specimen` in SI that override those in the file.

    Returns:
        The map in SI. What had to be assumed about the specimen stands in its `notes`.

    Raises:
        InputError: what is wrong with the file, with the number of the row.
    """
    check_mapping("specimen", specimen, "from fields of Specimen to values in SI")
    if isinstance(path, str | Path):
        path = Path(path)
        if not path.exists():
            raise InputError(f"no such file: {path}")
        lines, source, where = csv_lines(path), path.name, str(path)
    elif not callable(getattr(path, "read", None)):
        remedy = (
            ": fitting.ForceData.from_pandas(frame) takes a table of pandas"
            if hasattr(path, "columns") else ""
        )  # fmt: skip
        raise InputError(
            f"a force map is read from a path or an open text file, got {shown(path)}{remedy}"
        )
    else:
        where = source = getattr(path, "name", "a stream").strip("<>")
        try:
            text = path.read()
        except UnicodeDecodeError:
            raise InputError(f"{where} is not UTF-8 text; save it as CSV, UTF-8") from None
        if not isinstance(text, str):
            raise InputError(
                f"{where} must be open as text, not as bytes: open(path, encoding='utf-8')"
            )
        lines = text.removeprefix("\ufeff").splitlines()
    try:
        return _parse(lines, source=source, specimen=specimen or {})
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _parse(lines: list[str], source: str, specimen: Mapping[str, Any]) -> ForceData:
    # A spreadsheet fills comments and empty rows up to the width of its table.
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip(_FILL)]
    comments = [line.rstrip(_FILL) for _, line in numbered if line.lstrip().startswith("#")]
    known = parse_specimen(_entries(comments, "specimen"))
    tolerances: dict[str, Any] = dict(_tolerance(entry) for entry in _entries(comments, "level"))
    rows = [(number, line) for number, line in numbered if not line.lstrip().startswith("#")]
    if not rows:
        raise InputError(
            "the file is empty; it needs a header such as pressure_kPa,length_mm,force_N"
        )
    header = rows[0][1]
    separator = max(",;\t", key=header.count)
    names = [name.strip() for name in next(csv.reader([header], delimiter=separator))]
    columns = columns_of(_without_fill(names, 1))
    if len(rows) == 1:
        raise InputError("the file has a header but no readings")
    values: dict[str, list[float]] = {column.quantity: [] for column in columns}
    table = [
        (number, _without_fill(next(csv.reader([line], delimiter=separator)), len(columns)))
        for number, line in rows[1:]
    ]
    for number, cells in with_points(table, separator):
        if len(cells) != len(columns):
            raise InputError(f"row {number} has {len(cells)} cells, the header has {len(columns)}")
        for column, cell in zip(columns, cells, strict=True):
            name = column.quantity
            values[name].append(column.factor * _number(cell, number, name))
            _check_range(name, values[name][-1], cell, number)
    known.update({key: value for key, value in specimen.items() if value is not None})
    arrays = {name: np.array(column) for name, column in values.items()}
    return _described(columns, arrays, known, source, tolerances)


def map_of_columns(
    header: Sequence[str],
    values: Sequence[Any],
    specimen: Specimen | Mapping[str, Any],
    source: str,
) -> ForceData:
    """The force map of columns whose names have their unit, as in a file.

    Args:
        header: names of the columns.
        values: numbers of each, shape (n,), in the unit of its name.
        specimen: the muscle, or fields of it in SI.
        source: where the columns come from.

    Raises:
        InputError: what is wrong with a column.
    """
    columns = columns_of(header)
    arrays: dict[str, Any] = {
        column.quantity: column.factor * check_numbers(f"column {name}", numbers)
        for name, column, numbers in zip(header, columns, values, strict=True)
    }
    if not isinstance(specimen, Specimen):
        check_mapping("specimen", specimen, "from fields of Specimen to values in SI")
        return _described(columns, arrays, dict(specimen), source, {})
    _lengths_of_contractions(arrays, {"rest_length": specimen.rest_length})
    units = {column.quantity: column.unit for column in columns}
    return ForceData(**arrays, specimen=specimen, source=source, units=units)


def _described(
    columns: Sequence[Column],
    arrays: dict[str, Any],
    known: dict[str, Any],
    source: str,
    tolerances: Mapping[str, Any],
) -> ForceData:
    """The map of columns in SI, and of what is known of the muscle."""
    fields = {field.name for field in dataclasses.fields(Specimen)} | {"force_limit"}
    if unknown := sorted(set(known) - fields):
        raise InputError(
            f"unknown entry of the specimen {unknown[0]!r}; known are {', '.join(sorted(fields))}"
        )
    if not arrays["force"].size:
        raise InputError("there are no readings")
    _lengths_of_contractions(arrays, known)
    limit = known.pop("force_limit", None)
    muscle = describe({"name": Path(source).stem, **known}, float(arrays["length"].max()))
    units = {column.quantity: column.unit for column in columns}
    return ForceData(
        **arrays, **muscle._asdict(), source=source, units=units, force_limit=limit, **tolerances
    )


def _without_fill(cells: list[str], fewest: int) -> list[str]:
    """The cells of a line without empty ones that a spreadsheet has put behind the last column."""
    while len(cells) > fewest and not cells[-1].strip():
        cells = cells[:-1]
    return cells


def _number(cell: str, row: int, name: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        if not cell.strip():
            raise InputError(
                f"row {row}: {name} is missing; take the row out, or write what was read"
            ) from None
        shown = quoted(cell.strip())
        raise InputError(f"row {row}: {name} is {shown}, not a number{comma_hint(cell)}") from None
    if not math.isfinite(value):
        raise InputError(f"row {row}: {name} is {cell.strip()}; every value must be finite")
    return value


def _check_range(name: str, value: float, cell: str, row: int) -> None:
    if name == "pressure" and value < 0:
        raise InputError(f"row {row}: pressure is {cell.strip()}; gauge pressure must be >= 0")
    if name == "contraction" and value >= 1:
        raise InputError(
            f"row {row}: contraction is {cell.strip()}; (L0 - L)/L0 lies below 1: write percent "
            "in a column contraction_%, lengths in a column such as length_mm"
        )
    if name in NOT_NEGATIVE and value < 0:
        raise InputError(f"row {row}: {name} is {cell.strip()}; it must be >= 0")
    if name not in {"pressure", "force", "contraction", *NOT_NEGATIVE} and value <= 0:
        hint = (
            ": contractions stand in a column contraction, as fractions, or contraction_%, in percent"
            if name == "length" else ""
        )  # fmt: skip
        raise InputError(f"row {row}: {name} is {cell.strip()}; it must be > 0{hint}")


def _lengths_of_contractions(arrays: dict[str, Any], known: Mapping[str, Any]) -> None:
    """Put lengths in the place of contractions."""
    if "contraction" not in arrays:
        return
    rest = known.get("rest_length")
    if rest is None:
        raise InputError(
            "contractions need the rest length: write '# specimen: rest_length_mm = 296' into the "
            "file, or give --specimen rest_length_mm=296"
        )
    arrays["length"] = rest * (1 - arrays.pop("contraction"))
    if "contraction_std" in arrays:
        arrays["length_std"] = rest * arrays.pop("contraction_std")


def _entries(comments: Iterable[str], wanted: str) -> list[str]:
    """The entries of lines such as `# specimen: rest_length_mm = 296`, by what stands before the colon."""
    parts = [line.lstrip("# \t").partition(":") for line in comments]
    return [entry.strip() for label, _, entry in parts if label.strip() == wanted]


def _tolerance(entry: str) -> tuple[str, float]:
    """Field of `ForceData` and SI value of `pressure_tolerance_kPa = 5`."""
    key, _, value = (part.strip() for part in entry.partition("="))
    name, _, unit = key.rpartition("_")
    kind = name.removesuffix("_tolerance")
    if name not in {"pressure_tolerance", "length_tolerance"}:
        raise InputError(
            f"level {entry!r} must read pressure_tolerance_kPa = 5 or length_tolerance_mm = 0.1"
        )
    try:
        number = float(value)
    except ValueError:
        raise InputError(f"the level's {key} is {value!r}, not a number") from None
    return name, to_si(number, unit, kind)


def parse_specimen(entries: Iterable[str]) -> dict[str, Any]:
    """Fields of `Specimen` in SI, from entries such as `rest_length_mm=296`.

    Raises:
        InputError: an entry that is not of this form, or a field twice.

    >>> parse_specimen(["rest_length_in=10", "embedded=false"])
    {'rest_length': 0.254, 'embedded': False}
    """
    fields: dict[str, Any] = {}
    for entry in entries:
        key, equals, value = (part.strip() for part in entry.partition("="))
        if not equals:
            raise InputError(f"specimen {entry!r} must read key=value, as in rest_length_mm=296")
        name, field = specimen_field(key, value)
        if name in fields:
            raise InputError(f"the specimen's {name} is given twice")
        fields[name] = field
    return fields


def specimen_field(key: str, value: str) -> tuple[str, Any]:
    """Name and SI value of one field of `Specimen`, from a key with its unit and a text.

    >>> specimen_field("rest_length_mm", "296")
    ('rest_length', 0.296)
    """
    if key == "name":
        return key, value
    if key == "embedded":
        if value not in {"true", "false"}:
            raise InputError(f"the specimen's embedded must be true or false, got {value!r}")
        return key, value == "true"
    name, _, unit = key.rpartition("_")
    if name not in (*_SPECIMEN_LENGTHS, "force_limit"):
        known = ", ".join(
            [*(f"{n}_mm" for n in _SPECIMEN_LENGTHS), "force_limit_N", "name", "embedded"]
        )
        units = tuple(UNITS["length"])
        near = [f"{n}_{unit}" for n in _SPECIMEN_LENGTHS for unit in units]
        if name in _OF_THE_FIT:
            raise InputError(
                f"{name} is identified by the fit, and no entry of the specimen: what is known of it is "
                f"--prior {key}=MEAN+-STD, or held by --bounds {key}={value}"
            )
        raise InputError(
            f"unknown entry of the specimen {key!r}; known are {known}"
            f"{meant(key, [*near, 'force_limit_N', 'name', 'embedded'])}"
        )
    try:
        number = float(value)
    except ValueError:
        raise InputError(
            f"the specimen's {key} is {value!r}, not a number{comma_hint(value)}"
        ) from None
    value_in_si = to_si(number, unit, "force" if name == "force_limit" else "length")
    # What is not positive the specimen itself refuses.
    check_plausible(f"the specimen's {name}", max(value_in_si, 0.0), QUANTITIES[name], unit)
    return name, value_in_si


def _assumed(fields: Mapping[str, Any]) -> tuple[str, ...]:
    """What is not said of a specimen and has to be assumed."""
    found = [n for n in ("rest_length", "nominal_diameter", "wall_thickness") if n not in fields]
    given = {"embedded", "bladder_diameter"} & set(fields)
    return (*found, *([] if given else ["bladder_diameter"]))


class Described(NamedTuple):
    """A specimen of which not everything was said.

    Attributes:
        specimen: with what had to be assumed.
        notes: a sentence for each value that was.
        assumed: their names, as in `ForceData`.
    """

    specimen: Specimen
    notes: tuple[str, ...]
    assumed: tuple[str, ...]


def describe(known: Mapping[str, Any], longest: float) -> Described:
    """The specimen of what is known of it.

    Args:
        known: fields of `Specimen` in SI; the name is needed.
        longest: of the lengths that were measured [m], in the place of an unknown rest length.
    """
    fields, assumed, notes = dict(known), _assumed(known), []
    if "rest_length" not in fields:
        fields["rest_length"] = longest
        notes.append(
            Sentence(
                "The rest length was not given: the longest length in the file, ",
                Quantity(fields["rest_length"], "length"),
                ", is taken (--specimen rest_length_mm=...).",
            )
        )
    if "wall_thickness" not in fields:
        across = fields.get("nominal_diameter") or fields.get("bladder_diameter") or math.inf
        fields["wall_thickness"] = min(DEFAULT_WALL_THICKNESS, _WALL_OF_BORE * across)
        notes.append(
            Sentence(
                "The bladder's wall was not given: ",
                Quantity(fields["wall_thickness"], "length"),
                " is assumed (--specimen wall_thickness_mm=...). E_n scales nearly inversely with it; "
                "the force does not change.",
            )
        )
    if "nominal_diameter" not in fields:
        notes.append(
            Sentence(
                "The nominal diameter was not given: the braid diameter is sought between ",
                Quantity(3e-3, "length", 3),
                " and ",
                Quantity(80e-3, "length", 3),
                " (--specimen nominal_diameter_mm=...), and may not be that of a muscle on sale.",
            )
        )
    if "embedded" not in fields and "bladder_diameter" not in fields:
        fields["embedded"] = True
        notes.append(
            "The bladder's diameter was not given: the braid is taken to run inside the wall, as "
            "in a Festo DMSP (--specimen bladder_diameter_mm=..., or embedded=false)."
        )
    return Described(Specimen(**fields), tuple(notes), assumed)


def specimen_as_dict(specimen: Specimen) -> dict[str, Any]:
    """The specimen with the unit in each key, for saved files."""
    return {
        f"{key}_m" if key in _SPECIMEN_LENGTHS else key: value
        for key, value in dataclasses.asdict(specimen).items()
    }
