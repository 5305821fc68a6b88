"""Force maps from CSV files whose columns name their units, with the specimen in comment lines, and back.

# specimen: rest_length_mm = 296
# specimen: embedded = true
pressure_kPa,length_mm,force_N
65,296,54.9
"""

import csv
import dataclasses
import importlib.resources
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from famjax.boundary.errors import InputError, meant
from famjax.boundary.files import csv_lines
from famjax.boundary.units import UNITS, Quantity, Sentence, factor, si_unit, to_si, unit_system

from .arguments import QUANTITIES, check_mapping, check_numbers, check_path, check_plausible, shown
from .data import COLUMNS, MAY_BE_ZERO, SPECIMEN_LENGTHS, ForceData, Specimen, check_maps

DEFAULT_WALL_THICKNESS = 1.8e-3
"""Bladder wall [m] assumed where none is given: that of the Festo DMSP (Martens & Boblan 2017)."""

_FILL = " \t,;"
_WALL_OF_BORE = 0.18  # at most: that of the DMSP-10, the smallest muscle that is known to have it
_OF_THE_FIT = ("braid_angle", "braid_diameter", "deadband_pressure")
_NOT_ASSUMED = {"wall_thickness": "wall_thickness", "bladder_diameter": "embedded"}
"""Field of a specimen that an assumption has filled in, by what was not said."""

_CONTRACTIONS = {
    f"{quantity}{unit}": (quantity, size, unit.lstrip("_"))
    for quantity in ("contraction", "contraction_std")
    for unit, size in {"": 1.0, "_%": 0.01, "_percent": 0.01}.items()
}
"""Columns that stand for the length."""

_BRACKETED = re.compile(r"\s*([A-Za-z][A-Za-z _]*?)\s*(?:[(\[]\s*([^()\[\]]*?)\s*[)\]]|\s(\S+))\s*")
"""A quantity, then its unit in brackets or after a space."""

_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+")
_LONGEST = 40  # characters of a cell in a message

_REACH = (0.55, 1.07)  # of the rest length: what muscles of rubber and threads come to
_LONGEST_AT_LEAST = 0.85  # of the rest length: the longest length of most tests is above it
_WORDS = {"in": "inches"}
_USUAL = 0.25  # m: rest length of a usual muscle
_ALIKE = 0.5  # decades: taken as equal


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
    folder = importlib.resources.files("fitting") / "maps"
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
    file = importlib.resources.files("fitting") / "maps" / f"{known.lower()}.csv"
    text = file.read_text(encoding="utf-8")
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
    else:
        where = source = str(getattr(path, "name", "a stream")).strip("<>")
        lines = _stream_lines(path, where)
    try:
        return _parse(lines, source=source, specimen=specimen or {})
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _stream_lines(stream: Any, where: str) -> list[str]:
    if not callable(getattr(stream, "read", None)):
        frame = ": fitting.ForceData.from_pandas(frame) takes a table of pandas"
        raise InputError(
            f"a force map is read from a path or an open text file, got {shown(stream)}"
            + (frame if hasattr(stream, "columns") else "")
        )
    try:
        text = stream.read()
    except UnicodeDecodeError:
        raise InputError(f"{where} is not UTF-8 text; save it as CSV, UTF-8") from None
    if not isinstance(text, str):
        raise InputError(
            f"{where} must be open as text, not as bytes: open(path, encoding='utf-8')"
        )
    return text.removeprefix("\ufeff").splitlines()


def _parse(lines: list[str], source: str, specimen: Mapping[str, Any]) -> ForceData:
    # A spreadsheet fills comments and empty rows up to the width of its table.
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip(_FILL)]
    comments = [line.rstrip(_FILL) for _, line in numbered if line.lstrip().startswith("#")]
    known = parse_specimen(_entries(comments, "specimen"))
    known.update({key: value for key, value in specimen.items() if value is not None})
    tolerances: dict[str, Any] = dict(_tolerance(entry) for entry in _entries(comments, "level"))
    rows = [(number, line) for number, line in numbered if not line.lstrip().startswith("#")]
    if not rows:
        raise InputError(
            "the file is empty; it needs a header such as pressure_kPa,length_mm,force_N"
        )
    separator = max(",;\t", key=rows[0][1].count)
    cells = [
        (number, [cell.strip() for cell in next(csv.reader([line], delimiter=separator))])
        for number, line in rows
    ]
    columns = columns_of(_without_fill(cells[0][1], 1))
    if len(rows) == 1:
        raise InputError("the file has a header but no readings")
    table = [(number, _without_fill(row, len(columns))) for number, row in cells[1:]]
    if separator != ",":
        table = with_points(table)
    readings = [_readings(row, number, columns) for number, row in table]
    arrays: dict[str, Any] = {
        column.quantity: np.array(values)
        for column, values in zip(columns, zip(*readings, strict=True), strict=True)
    }
    return _described(columns, arrays, known, source, tolerances)


def map_of_columns(
    given: Mapping[str, Any], specimen: Specimen | Mapping[str, Any], source: str
) -> ForceData:
    """The force map of columns whose names have their unit, as in a file.

    Args:
        given: numbers of each column, shape (n,), in the unit of its name.
        specimen: the muscle, or fields of it in SI.
        source: where the columns come from.

    Raises:
        InputError: what is wrong with a column.
    """
    columns = columns_of(list(given))
    arrays: dict[str, Any] = {
        column.quantity: column.factor * check_numbers(f"column {name}", numbers)
        for (name, numbers), column in zip(given.items(), columns, strict=True)
    }
    if not isinstance(specimen, Specimen):
        check_mapping("specimen", specimen, "from fields of Specimen to values in SI")
        return _described(columns, arrays, dict(specimen), source, {})
    _lengths_of_contractions(arrays, specimen.rest_length)
    units = {column.quantity: column.unit for column in columns}
    return ForceData(**arrays, specimen=specimen, source=source, units=units)


def _described(
    columns: Sequence["Column"],
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
    _lengths_of_contractions(arrays, known.get("rest_length"))
    limit = known.pop("force_limit", None)
    muscle = describe({"name": Path(source).stem, **known}, float(arrays["length"].max()))
    units = {column.quantity: column.unit for column in columns}
    return ForceData(
        **arrays, **muscle._asdict(), source=source, units=units, force_limit=limit, **tolerances
    )


def _without_fill(cells: list[str], fewest: int) -> list[str]:
    """The cells of a line without empty ones that a spreadsheet has put behind the last column."""
    while len(cells) > fewest and not cells[-1]:
        cells = cells[:-1]
    return cells


def with_points(rows: Sequence[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """The cells of a file with decimal points, where a spreadsheet of another country has commas.

    Args:
        rows: number and cells of each line; no comma is between cells.

    Raises:
        InputError: commas may stand between thousands, or there are points beside them.

    >>> with_points([(2, ["300", "1,5"]), (3, ["300", "1,25"])])
    [(2, ['300', '1.5']), (3, ['300', '1.25'])]
    """
    cells = [(number, cell) for number, row in rows for cell in row]
    commas = [one for one in cells if "," in one[1]]
    points = [one for one in cells if "." in one[1]]
    if commas and points:
        (number, cell), (other, with_comma) = points[0], commas[0]
        raise InputError(
            f"row {number}: {quoted(cell)} has a point, and {quoted(with_comma)} in row {other} a "
            "comma: write all numbers with one decimal sign, and with nothing between thousands"
        )
    if commas and all(_THOUSANDS.fullmatch(cell) for _, cell in commas):
        number, cell = commas[0]
        raise InputError(
            f"row {number}: {quoted(cell)} may be {cell.replace(',', '.')} or "
            f"{cell.replace(',', '')}: write decimal points, and nothing between thousands"
        )
    return [(number, [cell.replace(",", ".") for cell in row]) for number, row in rows]


def _readings(cells: list[str], row: int, columns: Sequence["Column"]) -> list[float]:
    """The numbers of one row in SI."""
    if len(cells) != len(columns):
        raise InputError(f"row {row} has {len(cells)} cells, the header has {len(columns)}")
    return [
        column.factor * _number(cell, row, column)
        for cell, column in zip(cells, columns, strict=True)
    ]


def _number(cell: str, row: int, column: "Column") -> float:
    name = column.quantity
    if not cell:
        raise InputError(f"row {row}: {name} is missing; take the row out, or write what was read")
    try:
        value = float(cell)
    except ValueError:
        raise InputError(
            f"row {row}: {name} is {quoted(cell)}, not a number{_comma_hint(cell)}"
        ) from None
    if not math.isfinite(value):
        raise InputError(f"row {row}: {name} is {cell}; every value must be finite")
    if name == "contraction" and column.factor * value >= 1:
        raise InputError(
            f"row {row}: contraction is {cell}; (L0 - L)/L0 lies below 1: write percent in a column "
            "contraction_%, lengths in a column such as length_mm"
        )
    must = ">= 0" if name in MAY_BE_ZERO else "> 0"
    if name not in {"force", "contraction"} and (value < 0 or (value == 0 and must == "> 0")):
        gauge = "gauge pressure" if name == "pressure" else "it"
        hint = (
            ": contractions stand in a column contraction, as fractions, or contraction_%, in percent"
            if name == "length" else ""
        )  # fmt: skip
        raise InputError(f"row {row}: {name} is {cell}; {gauge} must be {must}{hint}")
    return value


def _comma_hint(cell: str) -> str:
    return " (write a decimal point, and nothing between thousands)" if "," in cell else ""


def _lengths_of_contractions(arrays: dict[str, Any], rest: float | None) -> None:
    """Put lengths in the place of contractions."""
    if "contraction" not in arrays:
        return
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
    if name not in {"pressure_tolerance", "length_tolerance"}:
        raise InputError(
            f"level {entry!r} must read pressure_tolerance_kPa = 5 or length_tolerance_mm = 0.1"
        )
    return name, to_si(_said(value, f"the level's {key}"), unit, name.removesuffix("_tolerance"))


def _said(value: str, what: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise InputError(f"{what} is {value!r}, not a number{_comma_hint(value)}") from None


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
        name, field = _specimen_field(key, value)
        if name in fields:
            raise InputError(f"the specimen's {name} is given twice")
        fields[name] = field
    return fields


def _specimen_field(key: str, value: str) -> tuple[str, Any]:
    """Name and SI value of one field of `Specimen`, from a key with its unit and a text."""
    if key == "name":
        return key, value
    if key == "embedded":
        if value not in {"true", "false"}:
            raise InputError(f"the specimen's embedded must be true or false, got {value!r}")
        return key, value == "true"
    name, _, unit = key.rpartition("_")
    if name in _OF_THE_FIT:
        raise InputError(
            f"{name} is identified by the fit, and no entry of the specimen: what is known of it is "
            f"--prior {key}=MEAN+-STD, or held by --bounds {key}={value}"
        )
    if name not in (*SPECIMEN_LENGTHS, "force_limit"):
        others = ["force_limit_N", "name", "embedded"]
        known = [*(f"{length}_mm" for length in SPECIMEN_LENGTHS), *others]
        near = [f"{length}_{one}" for length in SPECIMEN_LENGTHS for one in UNITS["length"]]
        raise InputError(
            f"unknown entry of the specimen {key!r}; known are {', '.join(known)}"
            f"{meant(key, [*near, *others])}"
        )
    kind = "force" if name == "force_limit" else "length"
    in_si = to_si(_said(value, f"the specimen's {key}"), unit, kind)
    # What is not positive the specimen itself refuses.
    check_plausible(f"the specimen's {name}", max(in_si, 0.0), QUANTITIES[name], unit)
    return name, in_si


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
    """Complete a specimen with defaults for what is not given.

    Args:
        known: fields of `Specimen` in SI; the name is needed.
        longest: longest measured length [m]; used as rest length if none is given.
    """
    fields, notes = dict(known), {}
    if "rest_length" not in fields:
        fields["rest_length"] = longest
        notes["rest_length"] = Sentence(
            "The rest length was not given: the longest length in the file, ",
            Quantity(longest, "length"),
            ", is taken (--specimen rest_length_mm=...).",
        )
    if "nominal_diameter" not in fields:
        notes["nominal_diameter"] = Sentence(
            "The nominal diameter was not given: the braid diameter is sought between ",
            Quantity(3e-3, "length", 3),
            " and ",
            Quantity(80e-3, "length", 3),
            " (--specimen nominal_diameter_mm=...), and may not be that of a muscle on sale.",
        )
    if "wall_thickness" not in fields:
        across = fields.get("nominal_diameter") or fields.get("bladder_diameter") or math.inf
        fields["wall_thickness"] = min(DEFAULT_WALL_THICKNESS, _WALL_OF_BORE * across)
        notes["wall_thickness"] = Sentence(
            "The bladder's wall was not given: ",
            Quantity(fields["wall_thickness"], "length"),
            " is assumed (--specimen wall_thickness_mm=...). E_n scales nearly inversely with it; "
            "the force does not change.",
        )
    if "embedded" not in fields and "bladder_diameter" not in fields:
        fields["embedded"] = True
        notes["bladder_diameter"] = (
            "The bladder's diameter was not given: the braid is taken to run inside the wall, as "
            "in a Festo DMSP (--specimen bladder_diameter_mm=..., or embedded=false)."
        )
    return Described(Specimen(**fields), tuple(notes.values()), tuple(notes))


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of a file.

    Attributes:
        quantity: one of `COLUMNS`, or contraction or contraction_std, whose length is not known.
        factor: multiplier of its numbers to SI.
        unit: as the header has it, "" for a fraction.
    """

    quantity: str
    factor: float
    unit: str = ""


def columns_of(header: Sequence[str]) -> list[Column]:
    """The columns of a header: a quantity and its unit, as in `force_N`, `Force [N]` or `Force (N)`.

    Raises:
        InputError: a column that is not known, has no unit or is there twice, or one that is not
            there.

    >>> [column.quantity for column in columns_of(["force_N", "pressure_kPa", "contraction_%"])]
    ['force', 'pressure', 'contraction']
    """
    columns = [_column(name) for name in header]
    given = [column.quantity for column in columns]
    for quantity in given:
        if given.count(quantity) > 1:
            raise InputError(f"the quantity {quantity!r} has two columns; keep one")
    for length, contraction in (("length", "contraction"), ("length_std", "contraction_std")):
        if length in given and contraction in given:
            raise InputError(
                f"{length!r} and {contraction!r} say the same of a reading; keep one of the columns"
            )
    if "contraction_std" in given and "contraction" not in given:
        raise InputError("contraction_std is that of a contraction, and there is none")
    there = {*given, *(["length"] if "contraction" in given else [])}
    missing = [name for name in ("force", "pressure", "length") if name not in there]
    if missing:
        raise InputError(
            f"no column for {' and '.join(missing)}; the header has "
            f"{', '.join(name[:_LONGEST] for name in header)} and must have force, pressure and "
            "length, each with its unit, as in pressure_kPa"
        )
    return columns


def _plain(name: str) -> str:
    """A column's name as this program writes it, from one with its unit in brackets or after a space.

    In any case: `Pressure (psi)`, `Force [N]`, `Length mm`. What is not of this form stays.

    >>> [_plain(one) for one in ("Pressure (PSI)", "Force [N]", "Contraction [%]", "Force")]
    ['pressure_psi', 'force_N', 'contraction_%', 'Force']
    """
    match = _BRACKETED.fullmatch(name)
    if match is None:
        stem, _, unit = name.rpartition("_")
    else:
        stem, unit = match[1], match[2] or match[3] or ""
    quantity = "_".join(stem.lower().split())
    if quantity in {"contraction", "contraction_std"}:
        return quantity if unit in {"", "-"} else f"{quantity}_{unit.lower()}"
    if quantity not in COLUMNS:
        return name
    known = UNITS[COLUMNS[quantity]]
    # In any case, but m and M are of different size, and are not taken for one another.
    alike = [
        one for one in known
        if one.lower() == unit.lower() and (one[0] == unit[0] or unit[0] not in "mM")
    ]  # fmt: skip
    return f"{quantity}_{alike[0] if unit not in known and len(alike) == 1 else unit}"


def _column(given: str) -> Column:
    name = _plain(given)
    if name in _CONTRACTIONS:
        return Column(*_CONTRACTIONS[name])
    quantity, _, unit = name.rpartition("_")
    plain = name.lower()
    if plain in COLUMNS:
        units = " or ".join(f"{plain}_{unit}" for unit in UNITS[COLUMNS[plain]])
        raise InputError(f"column {given!r} has no unit; write for example {units}")
    if quantity in {"contraction", "contraction_std"}:
        raise InputError(
            f"column {quoted(name)} has the unknown unit {unit!r}: a contraction is (L0 - L)/L0, "
            "contraction as a fraction or contraction_% in percent; lengths stand in a column "
            "such as length_mm"
        )
    if quantity not in COLUMNS:
        known = ", ".join(f"{key}_{si_unit(kind)}" for key, kind in COLUMNS.items())
        every = [f"{key}_{unit}" for key, kind in COLUMNS.items() for unit in UNITS[kind]]
        words = "_".join(re.split(r"[\s()\[\]_]+", name.strip(" )]")))
        raise InputError(
            f"unknown column {quoted(given)}; known are, with any unit: {known}; and contraction "
            f"or contraction_% in place of the length{meant(words, [*every, *_CONTRACTIONS])}"
        )
    kind = COLUMNS[quantity]
    if unit not in UNITS[kind]:
        gauge = ", gauge" if kind == "pressure" else ""
        raise InputError(
            f"column {quoted(given)} has the unknown unit {quoted(unit)}; known units of {kind} "
            f"are: {', '.join(UNITS[kind])}{gauge}{meant(unit, UNITS[kind])}"
        )
    return Column(quantity, factor(unit, kind), unit)


def quoted(text: str) -> str:
    """A text as a message shows it: what is long is cut."""
    return repr(text if len(text) <= _LONGEST else text[:_LONGEST] + "...")


def csv_text(data: ForceData, system: str = "si") -> str:
    """The text of a CSV file: specimen and notes in comment lines, then one row per reading.

    Wall and place of the braid are left out where they were assumed: who reads the file assumes them too.

    Args:
        data: the map.
        system: "si", which reads back to the same bits, "metric" or "us".

    >>> lines = csv_text(load_bundled("DMSP-10-250")).splitlines()
    >>> next(line for line in lines if not line.startswith("#"))
    'force_N,pressure_Pa,length_m'
    """
    units = unit_system(system)
    lines = [f"# note: {note}" for note in data.notes]

    def add(label: str, name: str, value: float, kind: str) -> None:
        scaled = float(value) / factor(units[kind], kind)
        lines.append(f"# {label}: {name}_{units[kind]} = {scaled!r}")

    assumed = {_NOT_ASSUMED[name] for name in data.assumed if name in _NOT_ASSUMED}
    for key, value in dataclasses.asdict(data.specimen).items():
        if key in assumed or value is None:
            continue
        if key in SPECIMEN_LENGTHS:
            add("specimen", key, value, "length")
        else:
            lines.append(f"# specimen: {key} = {value if key == 'name' else str(value).lower()}")
    if data.force_limit is not None:
        add("specimen", "force_limit", data.force_limit, "force")
    for kind, tolerance in (
        ("pressure", data.pressure_tolerance),
        ("length", data.length_tolerance),
    ):
        if tolerance is not None:
            add("level", f"{kind}_tolerance", tolerance, kind)
    columns = data.columns(system)
    lines.append(",".join(columns))
    rows = np.stack(list(columns.values()), axis=1).tolist()
    lines += [",".join(map(repr, row)) for row in rows]
    return "\n".join(lines) + "\n"


def write_csv(data: ForceData, path: str | Path, system: str = "si") -> Path:
    """Write a force map, with its specimen and notes.

    Args:
        data: the map.
        path: the file; one that is there is replaced.
        system: "si", which `read_csv` reads back to the same bits, "metric" or "us".

    Returns:
        The path.

    Raises:
        InputError: an unknown unit system, or a file that cannot be written.
    """
    check_maps(data)
    path, text = check_path("path", path), csv_text(data, system)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    return path


def likely_length_fault(data: ForceData) -> str:
    """The likeliest fault of a map whose lengths cannot be reached, a sentence, or "".

    >>> data = load_bundled("DMSP-20-300")
    >>> likely_length_fault(dataclasses.replace(data, length=data.length / 10, units={"length": "mm"}))
    'It looks as if the lengths were in cm, not mm.'
    """
    rest, length = data.specimen.rest_length, data.length[data.loaded]
    low, high = float(length.min()) / rest, float(length.max()) / rest
    # Either change brings the two together; they differ in the muscle that is left.
    found = sorted(
        (
            abs(math.log10(then / _USUAL)),
            f"{what} in {_WORDS.get(true, true)}, not {_WORDS.get(said, said)}",
        )
        for scale, then, what, true, said in _unit_slips(data)
        if _LONGEST_AT_LEAST <= high * scale <= _REACH[1] and low * scale >= _REACH[0]
    )
    likely = [sentence for away, sentence in found if away < found[0][0] + _ALIKE][:2]
    return f"It looks as if {', or '.join(likely)}." if likely else ""


def _unit_slips(data: ForceData) -> Iterator[tuple[float, float, str, str, str]]:
    """Units of lengths or of the rest length that may be meant.

    Yields:
        By how much lengths grow against the rest length, the rest length then, what is wrong, and both
        units.
    """
    rest, said = data.specimen.rest_length, data.units.get("length", "mm")
    known = UNITS["length"]
    for true in known:
        if true != said:
            yield known[true] / known[said], rest, "the lengths were", true, said
    for typed, true in itertools.permutations(("mm", "cm", "m", "in"), 2):
        scale = known[true] / known[typed]
        yield 1 / scale, rest * scale, "the rest length was", true, typed
