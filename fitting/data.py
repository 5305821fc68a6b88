"""Static force maps and their specimens: data class, readers and writers.

Measured pressures and lengths scatter about nominal values. `levels_of` groups them into levels, which
define the readings that share a pressure or a length.
"""

import dataclasses
import functools
import hashlib
import importlib.resources
import io
import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError, import_extra
from famjax.boundary.files import write_all
from famjax.boundary.units import Quantity, factor, parse_quantity, unit_system
from famjax.tables import Table, read_table

from .arguments import check_mapping, check_numbers, check_path, is_number, shown
from .specimen import SPECIMEN_LENGTHS, Specimen, check_plausible, describe, parse_specimen

if TYPE_CHECKING:
    import pandas
    import xarray

COLUMNS = {
    "force": "force", "pressure": "pressure", "length": "length",
    "force_std": "force", "pressure_std": "pressure", "length_std": "length",
}  # fmt: skip
"""Columns of a force map, and the kind of quantity in each column."""

_NEEDED = ("force", "pressure", "length")
_STDS = tuple(name for name in COLUMNS if name.endswith("_std"))

MOST_APART = 40
"""Largest number of levels that are left out one by one. If there are more levels, they are combined into
this many groups."""

_MAY_BE_ZERO = {"pressure", "pressure_std", "length_std"}
_HINTS = {
    "pressure": " (gauge pressure, not absolute): subtract the gauge's reading at atmospheric pressure",
    "length": ": put contractions in a column named contraction (fractions) or contraction_% (percent)",
}
_PUSHES = 3.0  # ratio of push to pull beyond which the sign of the force must be wrong
_CLEAR = 8.0  # smallest ratio of the gaps between levels to the gaps within a level
_WITHIN = 0.02  # widest gap within a level that is accepted automatically, relative to the range
_FINEST = 1e-4  # gaps below this fraction of the range count as equal
_SHARED = 1.5  # fewest readings per level; with fewer, the levels may be chance
_NOMINAL = 2.0  # readings per distinct value from which values count as nominal
_FRACTION = 0.75  # levels per reading above which the data show no levels
_NEAR_ZERO = 0.01  # deepest reading of a sensor at zero, relative to the largest value
_EXTREMES = 1.5  # largest noise above zero, relative to the noise seen below zero


@dataclasses.dataclass(frozen=True)
class Levels:
    """Level of every reading.

    Attributes:
        level: mean of the values at the reading's level, or the common value if all are equal; shape (n,).
        tolerance: values closer than this to a neighbour share its level; 0 if only equal values do.
        note: remark for the report, or "".
    """

    level: Float[np.ndarray, " n"]
    tolerance: float
    note: str


def levels_of(
    values: Float[np.ndarray, " n"],
    what: str,
    tolerance: float | None = None,
    beside: Float[np.ndarray, " n"] | None = None,
) -> Levels:
    """Group measured values into levels: neighbours closer than a tolerance share a level.

    If no tolerance is given, it is derived from the gaps between the sorted values. The gaps must separate
    clearly into narrow gaps (at most 2 % of the range) and gaps at least 8 times as wide, with 1.5 or more
    readings per level. The tolerance is then the geometric mean of the widest narrow gap and the narrowest
    wide gap.

    Values that repeat exactly, at least twice on average, are nominal values or were rounded by the gauge.
    Equal values then share a level. Different values share a level only if the gaps support this and no two
    of them occur at the same level of the other quantity. Two values that occur together there are
    different set points.

    Args:
        values: measured values in SI.
        what: the quantity, "pressure" or "length".
        tolerance: tolerance in SI, >= 0; None to derive it.
        beside: level of the other quantity for each reading. If None, repeated values count as nominal.

    >>> levels_of(np.array([79.97e3, 80.03e3, 80.0e3, 120.1e3, 119.9e3]), "pressure").level / 1e3
    array([ 80.,  80.,  80., 120., 120.])
    """
    given = tolerance is not None
    distinct, place = np.unique(values, return_inverse=True)
    if tolerance is None:
        tolerance = _tolerance_of_gaps(distinct, values.size)
        nominal = values.size >= _NOMINAL * distinct.size
        if nominal and not _rounded(values, _chained(distinct, tolerance)[place], beside):
            tolerance = 0.0
    group = _chained(distinct, tolerance)
    numbers = np.arange(group[-1] + 1)
    low = distinct[np.searchsorted(group, numbers)]
    high = distinct[np.searchsorted(group, numbers, "right") - 1]

    label, count, note = group[place], np.bincount(group[place]), ""
    mean = np.where(high > low, np.bincount(label, values) / count, low)
    if tolerance > 0 and count.size < distinct.size:
        said = Quantity(tolerance, what).in_units("metric")
        note = (
            f"Readings whose {what}s differ by less than {said} are treated as one {what} (tolerance "
            f"{'from the file' if given else 'derived from the gaps'}). {distinct.size} different values "
            f"form {count.size} levels."
        )
    elif count.size > max(2, _FRACTION * values.size):
        note = (
            f"Few readings share a {what}, and the gaps between {what}s do not separate them into levels. "
            f"Cross-validation by {what} therefore leaves out single readings. If readings were "
            f"taken at common {what}s, specify a tolerance in the file: "
            f"# level: {what}_tolerance_{'kPa = 5' if what == 'pressure' else 'mm = 0.1'}"
        )
    return Levels(mean[label], float(tolerance), note)


def _chained(distinct: Float[np.ndarray, " k"], tolerance: float) -> Int[np.ndarray, " k"]:
    """Return the level number of each value."""
    return np.cumsum(np.concatenate([[0], np.diff(distinct) > tolerance]))


def _rounded(
    values: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    beside: Float[np.ndarray, " n"] | None,
) -> bool:
    """Return whether the values in each group are readings of a single set point.

    Two set points close together would both appear at some level of the other quantity.
    """
    if beside is None:
        return False
    pairs = np.unique(np.stack([group, beside], axis=1), axis=0)
    with_values = np.unique(np.stack([group, beside, values], axis=1), axis=0)
    return len(with_values) == len(pairs)


def _tolerance_of_gaps(distinct: Float[np.ndarray, " k"], readings: int) -> float:
    """Return the tolerance that separates narrow gaps from wide ones, or 0 if there is none."""
    if distinct.size < 3:
        return 0.0
    span = distinct[-1] - distinct[0]
    gaps = np.sort(np.maximum(np.diff(distinct), _FINEST * span))
    divide = int(np.argmax(gaps[1:] / gaps[:-1]))
    within, between = gaps[divide], gaps[divide + 1]
    clear = between >= _CLEAR * within and within <= _WITHIN * span
    clear &= readings >= _SHARED * (gaps.size - divide)  # number of levels: wide gaps + 1
    return float(np.sqrt(within * between)) if clear else 0.0


def groups_of_levels(
    level: Float[np.ndarray, " n"], values: Float[np.ndarray, " levels"], groups: int | None = None
) -> Int[np.ndarray, " n"]:
    """Return the cross-validation group of each reading; -1 if its level is not left out.

    Args:
        level: level of each reading.
        values: levels to leave out, ascending.
        groups: number of groups of neighbouring levels; default: one per level, at most `MOST_APART`.
    """
    count = min(groups or MOST_APART, values.size)
    group = np.searchsorted(values, level) * count // values.size
    return np.where(np.isin(level, values), group, -1)


@dataclasses.dataclass(frozen=True, repr=False)
class ForceData:
    """A static force map in SI, one row per reading.

    A reading with force <= 0 is slack: the muscle would have to push but buckles instead, so only the sign
    of its force is known. Readings slightly below zero reveal the noise of the load cell, and readings up
    to 1.5 times as far above zero also count as slack. A reading at or above the limit of the load cell is
    saturated: the true force is at least that large. Slack and saturated readings are censored: they are
    not fitted, but every fit is checked against the slack ones. With `identify(..., censored=True)`, both
    act as one-sided limits on the force.

    Attributes:
        force: F [N], shape (n,), positive when the muscle pulls.
        pressure: gauge pressure P [Pa], shape (n,), >= 0.
        length: active length L [m], shape (n,), > 0.
        specimen: the muscle.
        force_std, pressure_std, length_std: standard deviations in the same units, shape (n,),
            or None.
        source: origin of the data, for reports.
        notes: assumptions made when the file was read, for the report.
        assumed: fields of the specimen that were assumed, for the verdict.
        units: unit of each quantity in the file, if the data come from a file; the values here are in SI.
        force_limit: largest force [N] that the load cell can read; None if it was never reached.
        slack_below: readings up to this force [N] are slack; None to derive it from negative readings.
        count: number of identical readings averaged into each row, shape (n,), used as weight; None if
            no reading repeats.
        taken: how the columns of the file were interpreted; commands print it.
        pressure_tolerance, length_tolerance: readings closer than this [Pa or m] share a pressure or
            length, see `levels_of`; None to derive it from the gaps.
    """

    force: np.ndarray
    pressure: np.ndarray
    length: np.ndarray
    specimen: Specimen
    force_std: np.ndarray | None = None
    pressure_std: np.ndarray | None = None
    length_std: np.ndarray | None = None
    source: str = "arrays"
    notes: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    pressure_tolerance: float | None = None
    length_tolerance: float | None = None
    force_limit: float | None = None
    slack_below: float | None = None
    count: np.ndarray | None = None
    taken: str = dataclasses.field(default="", compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.specimen, Specimen):
            raise InputError(f"specimen must be a fitting.Specimen, got {shown(self.specimen)}")
        for name in ("pressure_tolerance", "length_tolerance", "force_limit"):
            value = getattr(self, name)
            if value is not None and not (is_number(value) and 0 <= value < math.inf):
                raise InputError(f"{name} must be a number >= 0 in SI, got {shown(value)}")
        for name in (*COLUMNS, "count"):
            if getattr(self, name) is not None or name in _NEEDED:
                object.__setattr__(self, name, self._checked_column(name))
        if self.slack_below is None:
            self._find_slack()
        self._check_pulls()
        for name in _NEEDED:
            largest = float(getattr(self, name).max())
            check_plausible(f"the largest {name}", largest, name, self.units.get(name, ""))
        if self.count is None:
            self._average_copies()

    def _checked_column(self, name: str) -> Float[np.ndarray, " n"]:
        values, shape = check_numbers(name, getattr(self, name)), np.shape(self.force)
        if values.ndim != 1 or values.shape != shape:
            raise InputError(
                f"all columns must be one-dimensional and have the same length, but force has shape "
                f"{shape} and {name} has shape {values.shape}"
            )
        must, wrong = "be finite", ~np.isfinite(values)
        if name != "force":
            zero = name in _MAY_BE_ZERO
            must = f"be finite and {'>=' if zero else '>'} 0{_HINTS.get(name, '')}"
            wrong |= (values < 0) | ((values == 0) & (not zero))
        for k in np.flatnonzero(wrong):
            raise InputError(
                f"{name} of reading {k + 1} is {values[k]:.6g} in SI units; it must {must}"
            )
        return values

    def _find_slack(self) -> None:
        """Derive `slack_below`: readings below zero reveal the noise of a slack muscle."""
        noise = -float(self.force.min(initial=0.0))
        small = noise <= _NEAR_ZERO * float(self.force.max(initial=0.0))
        found = _EXTREMES * noise if small else 0.0
        object.__setattr__(self, "slack_below", found)
        if count := int(((self.force > 0) & (self.force <= found)).sum()):
            size = Quantity(found, "force", 2).in_units("metric")
            said = f"{count} readings of at most {size} count as slack"
            note = f"{said}: readings below zero show noise of this size."
            object.__setattr__(self, "notes", (*self.notes, note))

    def _check_pulls(self) -> None:
        check = (
            "Pulling forces must be positive: check the sign of the force column, and force_limit"
        )
        if not self.loaded.any():
            raise InputError(
                f"all {self.force.size} readings are slack (force <= 0) or at the limit of the load cell: "
                f"there is nothing to fit. {check}"
            )
        low, high = float(self.force.min()), self.max_force
        if -low > _PUSHES * high:
            raise InputError(f"the forces range from {low:.4g} N to only {high:.4g} N. {check}")

    def _average_copies(self) -> None:
        """Merge identical readings into one, weighted by their number."""
        rows, n = np.stack([self.force, self.pressure, self.length], axis=1), self.force.size
        order = np.lexsort(rows.T[::-1])
        starts = np.flatnonzero(np.append(True, (np.diff(rows[order], axis=0) != 0).any(axis=1)))
        if starts.size == n:
            return
        first, count = order[starts], np.diff(starts, append=n)
        kept, count = np.sort(first), count[np.argsort(first)]
        note = (
            f"{n - kept.size} of {n} readings repeat another reading exactly. Identical readings are "
            "merged and weighted by their number. If they were copied by mistake, remove them."
        )
        for name in COLUMNS:
            if (values := getattr(self, name)) is not None:
                values = values[kept] / (np.sqrt(count) if name == "force_std" else 1.0)
                object.__setattr__(self, name, values)
        object.__setattr__(self, "count", count.astype(float))
        object.__setattr__(self, "notes", (*self.notes, note))

    def __repr__(self) -> str:
        known = f"{self.force.size} readings, up to {self.max_force:.5g} N"
        return f"ForceData({self.specimen.name}, {self.source}: {known})"

    def to_pandas(self) -> "pandas.DataFrame":
        """Return the readings as a data frame in SI: one column per quantity, and a column `loaded`.

        Raises:
            InputError: pandas is not installed.
        """
        held = {**self.columns(), "loaded": self.loaded}
        return import_extra("pandas", "tables").DataFrame(self._repeated(held))

    def to_xarray(self) -> "xarray.Dataset":
        """Return the columns of `to_pandas` as an xarray data set, with the specimen as an attribute.

        Its dimension is `reading`.

        Raises:
            InputError: xarray is not installed.
        """
        import_extra("xarray", "tables")
        known = {"specimen": json.dumps(dataclasses.asdict(self.specimen))}
        return self.to_pandas().rename_axis("reading").to_xarray().assign_attrs(known)

    @classmethod
    def from_pandas(
        cls,
        frame: "pandas.DataFrame",
        specimen: "Specimen | Mapping[str, Any] | None" = None,
        columns: Mapping[str, str] | None = None,
    ) -> "ForceData":
        """Build a force map from a pandas table; column names state the units, as in a CSV file.

        Args:
            frame: table with columns such as `force_N`, `pressure_kPa` and `length_mm`; other columns, such
                as `loaded` from `to_pandas`, are ignored.
            specimen: the muscle, or its fields in SI. Missing fields get assumed values, as in `read_csv`.
            columns: column name of each quantity, see `read_csv`.

        Raises:
            InputError: see `read_csv`.

        >>> import pandas
        >>> frame = pandas.DataFrame(
        ...     {"force_N": [300.0, 120.0], "pressure_bar": [3.0, 3.0], "length_mm": [250.0, 230.0]}
        ... )
        >>> ForceData.from_pandas(frame, {"nominal_diameter": 10e-3}).pressure
        array([300000., 300000.])
        """
        if not (hasattr(frame, "to_csv") and hasattr(frame, "columns")):
            raise InputError(f"frame must be a pandas.DataFrame, got {shown(frame)}")
        text = io.StringIO(f"sep=,\n{frame.to_csv(index=False)}")
        text.name = "data frame"  # type: ignore[attr-defined]
        return read_csv(text, specimen, columns)

    @classmethod
    def from_xarray(
        cls,
        dataset: "xarray.Dataset",
        specimen: "Specimen | Mapping[str, Any] | None" = None,
        columns: Mapping[str, str] | None = None,
    ) -> "ForceData":
        """Build a force map from an xarray data set; see `from_pandas`.

        A variable with several dimensions, such as length and pressure, yields one reading per combination.
        If `specimen` is None, it is read from the attribute that `to_xarray` writes.

        Raises:
            InputError: see `read_csv`.
        """
        if not hasattr(dataset, "to_dataframe"):
            raise InputError(f"dataset must be an xarray.Dataset, got {shown(dataset)}")
        frame = dataset.to_dataframe().dropna().reset_index()
        frame = frame.drop(columns="reading", errors="ignore")
        known = json.loads(dataset.attrs.get("specimen", "{}"))
        return cls.from_pandas(frame, known if specimen is None else specimen, columns)

    def _repeated(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Expand averaged readings to their original number."""
        if self.count is None or self.force_std is not None:
            return dict(columns)
        times = self.count.astype(int)
        return {name: np.repeat(values, times) for name, values in columns.items()}

    def columns(self, system: str = "si") -> dict[str, np.ndarray]:
        """Return the available columns in a unit system; keys are `name_unit`."""
        units = unit_system(system)
        return {
            f"{name}_{units[kind]}": values / factor(units[kind], kind)
            for name, kind in COLUMNS.items()
            if (values := getattr(self, name)) is not None
        }

    @functools.cached_property
    def pressures(self) -> Levels:
        """Pressure levels [Pa] of the readings, see `levels_of`."""
        lengths = levels_of(self.length, "length", self.length_tolerance)
        return levels_of(self.pressure, "pressure", self.pressure_tolerance, lengths.level)

    @functools.cached_property
    def lengths(self) -> Levels:
        """Length levels [m] of the readings, see `levels_of`."""
        pressures = levels_of(self.pressure, "pressure", self.pressure_tolerance)
        return levels_of(self.length, "length", self.length_tolerance, pressures.level)

    def levels(self, kind: str) -> Float[np.ndarray, " n"]:
        """Return the level of every reading; `kind` is "pressure" [Pa] or "length" [m]."""
        return {"pressure": self.pressures, "length": self.lengths}[kind].level

    def left_out_as(self, kind: str) -> Float[np.ndarray, " n"]:
        """Return the level under which each reading is left out: its own, or the median of its group.

        If there are more than `MOST_APART` levels, neighbouring levels are left out in groups.
        """
        level = self.levels(kind)
        group = groups_of_levels(level, np.unique(level[self.loaded]))
        middle = np.array([np.median(np.unique(level[group == k])) for k in range(group.max() + 1)])
        return np.where(group < 0, level, middle[group])

    @property
    def loaded(self) -> Bool[np.ndarray, " n"]:
        """True for readings of a pulling force below the load cell's limit; all others are censored."""
        return ~self.slack & ~self.saturated

    @property
    def slack(self) -> Bool[np.ndarray, " n"]:
        """True for forces that are zero or negative, to within the noise."""
        return self.force <= (self.slack_below or 0.0)

    @property
    def saturated(self) -> Bool[np.ndarray, " n"]:
        """True for forces at or above the limit of the load cell."""
        return self.force >= (math.inf if self.force_limit is None else self.force_limit)

    @property
    def strained(self) -> Bool[np.ndarray, " n"]:
        """True for loaded readings at lengths other than the rest length, where the bladder is strained."""
        away = np.abs(self.lengths.level - self.specimen.rest_length) > self.lengths.tolerance
        return self.loaded & away

    @property
    def max_force(self) -> float:
        """Largest measured force [N], the reference for relative errors."""
        return float(self.force.max())

    def part(self, rows: Bool[np.ndarray, " n"]) -> "ForceData":
        """Return the force map with selected readings only; level tolerances are kept.

        Args:
            rows: mask of the readings to keep, shape (n,).

        Raises:
            InputError: no selected reading is loaded.
        """
        columns = {name: getattr(self, name) for name in (*COLUMNS, "count")}
        kept = {name: None if values is None else values[rows] for name, values in columns.items()}
        return dataclasses.replace(
            self,
            **kept,
            pressure_tolerance=self.pressures.tolerance,
            length_tolerance=self.lengths.tolerance,
        )

    @property
    def sha256(self) -> str:
        """Hash of the SI values and the known specimen data, independent of the file format."""
        lines = [one for one in csv_text(self).splitlines() if not one.startswith("# note")]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()


_NOT_ASSUMED = {"wall_thickness": "wall_thickness", "bladder_diameter": "embedded"}
"""Specimen field that each assumption fills in."""


def bundled_names() -> list[str]:
    """Return the names of the measured maps supplied with famjax.

    >>> bundled_names()
    ['DMSP-10-250', 'DMSP-20-300']
    """
    folder = importlib.resources.files("fitting") / "maps"
    return sorted(f.name.removesuffix(".csv").upper() for f in folder.iterdir() if ".csv" in f.name)


def bundled_map_name(name: str) -> str | None:
    """Return the bundled map that matches a name, or None.

    Case is ignored, underscores may replace hyphens, and the muscle's length may be omitted.

    >>> [bundled_map_name(one) for one in ("dmsp_20_300", "DMSP-20", "DMSP-2", "map.csv")]
    ['DMSP-20-300', 'DMSP-20-300', None, None]
    """
    asked = name.upper().replace("_", "-")
    found = [one for one in bundled_names() if asked in (one, one.rpartition("-")[0])]
    return found[0] if len(found) == 1 else None


def load_bundled(name: str, specimen: Mapping[str, Any] | None = None) -> ForceData:
    """Load a measured force map supplied with famjax.

    Args:
        name: one of `bundled_names()`, or a variant that `bundled_map_name` accepts.
        specimen: fields of `Specimen` in SI that override those in the file.

    Raises:
        InputError: there is no such map.

    References:
        Martens & Boblan 2017, Actuators 6(4), tables A1 (DMSP-20-300) and A2 (DMSP-10-250).

    >>> data = load_bundled("DMSP-20-300")
    >>> data.force.size, int(data.loaded.sum()), data.max_force
    (126, 60, 1653.5)
    """
    known = bundled_map_name(name) if isinstance(name, str) else None
    if known is None:
        raise InputError(f"unknown bundled map {name!r}; available: {', '.join(bundled_names())}")
    folder = importlib.resources.files("fitting") / "maps"
    with importlib.resources.as_file(folder / f"{known.lower()}.csv") as path:
        found = read_csv(path, specimen)
    return dataclasses.replace(found, source=f"bundled map {known}", taken="")


def read_csv(
    path: Any,
    specimen: Specimen | Mapping[str, Any] | None = None,
    columns: Mapping[str, str] | None = None,
) -> ForceData:
    """Read a force map from a text file (CSV or similar) or a workbook (.xlsx).

    Columns are recognised by name and unit, as in `force_lbf` or `Pressure (psi)`. The units may also be in
    a row below the header. Standard deviations such as `force_std_N` are optional. A column `contraction`,
    (L0 - L)/L0, or `contraction_%` may replace the length. Lines that start with # are comments. Comments
    such as `# specimen: rest_length_mm = 296` describe the muscle.

    Args:
        path: the file, an open text stream such as standard input, or a pandas table.
        specimen: the muscle, or fields of `Specimen` in SI that override those in the file.
        columns: column name of each quantity that is not recognised, `{"force": "Kraft [N]"}`; also
            `decimal` and `atmosphere`, see `famjax.tables.read_table`.

    Returns:
        The map in SI. Its `notes` list all assumptions about columns and specimen.

    Raises:
        InputError: the file is invalid; the message states the row.
    """
    check_mapping("columns", columns, "from quantities to column names")
    if hasattr(path, "columns") and hasattr(path, "to_csv"):
        return ForceData.from_pandas(path, specimen, columns)
    if not isinstance(path, str | Path) and not callable(getattr(path, "read", None)):
        raise InputError(f"path must be a file path or an open text file, got {shown(path)}")
    table = read_table(path, _NEEDED, optional=_STDS, columns=columns, strict=True)
    known = parse_specimen(_entries(table.comments, "specimen"))
    if isinstance(specimen, Specimen):  # it replaces that of the file
        known = {key: value for key, value in known.items() if key == "force_limit"}
        specimen = dataclasses.asdict(specimen)
    check_mapping("specimen", specimen, "from fields of Specimen to values in SI")
    known |= {key: value for key, value in (specimen or {}).items() if value is not None}
    try:
        return _map(table, known)
    except InputError as error:
        where = path if isinstance(path, str | Path) else table.source
        raise InputError(f"{where}: {error}") from None


_LEAST_CONTRACTION = 0.006  # smallest plausible maximum of a contraction column


def _map(table: Table, known: dict[str, Any]) -> ForceData:
    """Build the map from a table and the known fields of the specimen."""
    arrays, limit = dict(table.columns), known.pop("force_limit", None)
    for unknown in sorted(known.keys() - {one.name for one in dataclasses.fields(Specimen)}):
        raise InputError(f"unknown specimen entry {unknown!r}")
    tolerances: dict[str, Any] = dict(map(_tolerance, _entries(table.comments, "level")))
    notes = [f"Ignored columns: {', '.join(table.others)}."] if table.others else []
    notes += _near_zero(arrays)
    if "length_std" in arrays:
        notes.append(
            "The standard deviations of the lengths are stored, but the fit does not use them. State "
            "errors that all readings share with --error."
        )
    _lengths_of_contractions(arrays, known.get("rest_length"))
    longest = float(arrays["length"].max())
    muscle = describe({"name": Path(table.source).stem, **known}, longest)
    return ForceData(
        **arrays, **tolerances, specimen=muscle.specimen, assumed=muscle.assumed,
        notes=(*muscle.notes, *notes), source=table.source, units=table.units, force_limit=limit,
        taken=table.said(),
    )  # fmt: skip


def _near_zero(arrays: dict[str, np.ndarray]) -> Iterable[str]:
    """Set the small negative pressures that a vented gauge may indicate to 0, and yield a note."""
    pressure = arrays["pressure"]
    below = pressure < 0
    if below.any() and pressure.min() >= -_NEAR_ZERO * pressure.max():
        arrays["pressure"] = np.where(below, 0.0, pressure)
        least = Quantity(float(pressure.min()), "pressure", 3).in_units("metric")
        yield f"{below.sum()} pressures below zero, down to {least}, were set to 0."


def _lengths_of_contractions(arrays: dict[str, Any], rest: float | None) -> None:
    """Replace contractions by lengths."""
    if "contraction" not in arrays:
        return
    if rest is None:
        raise InputError(
            "contractions require the rest length: add '# specimen: rest_length_mm = 296' to the "
            "file, or use --specimen rest_length_mm=296"
        )
    largest = float(arrays["contraction"].max())
    if largest < _LEAST_CONTRACTION:
        raise InputError(
            f"the largest contraction is {largest:.2%}: the values may be fractions labelled as "
            'percent. If so, use --column contraction="NAME [-]"'
        )
    arrays["length"] = rest * (1 - arrays.pop("contraction"))
    if "contraction_std" in arrays:
        arrays["length_std"] = rest * arrays.pop("contraction_std")


def _entries(comments: Iterable[str], wanted: str) -> list[str]:
    """Return the text after the colon of comment lines such as `# specimen: rest_length_mm = 296`."""
    parts = [line.lstrip("# \t").partition(":") for line in comments]
    return [entry.strip() for label, _, entry in parts if label.strip() == wanted]


def _tolerance(entry: str) -> tuple[str, float]:
    """Parse `pressure_tolerance_kPa = 5` into a field of `ForceData` and its SI value."""
    key, _, value = (part.strip() for part in entry.partition("="))
    name, _, unit = key.rpartition("_")
    if name not in {"pressure_tolerance", "length_tolerance"}:
        raise InputError(
            f"the text after '# level:' must have the form pressure_tolerance_kPa = 5 or "
            f"length_tolerance_mm = 0.1; got {entry!r}"
        )
    return name, parse_quantity(value + unit, name.removesuffix("_tolerance"))


def csv_text(data: ForceData, system: str = "si") -> str:
    """Return a force map as CSV text: specimen and notes as comments, then one row per reading.

    Assumed values of the specimen are omitted, because `read_csv` makes the same assumptions.

    Args:
        data: the map.
        system: "si", "metric" or "us"; `read_csv` recovers the exact values only from "si".

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
    for kind in ("pressure", "length"):
        if (tolerance := getattr(data, f"{kind}_tolerance")) is not None:
            add("level", f"{kind}_tolerance", tolerance, kind)
    columns = data._repeated(data.columns(system))
    lines.append(",".join(columns))
    rows = np.stack(list(columns.values()), axis=1).tolist()
    lines += [",".join(map(repr, row)) for row in rows]
    return "\n".join(lines) + "\n"


def write_csv(data: ForceData, path: str | Path, system: str = "si") -> Path:
    """Write a force map with its specimen and notes to a CSV file.

    Args:
        data: the map.
        path: the file to write; an existing file is replaced.
        system: "si", "metric" or "us"; `read_csv` recovers the exact values only from "si".

    Returns:
        The path.

    Raises:
        InputError: the unit system is unknown, or the file cannot be written.
    """
    check_maps(data)
    path = check_path("path", path)
    return write_all(path.parent, {path.name: csv_text(data, system).encode()})[0]


def check_maps(*data: object) -> None:
    """Reject anything that is not a force map, such as a file path.

    Raises:
        InputError: an argument is not a `ForceData`.
    """
    for one in data:
        if not isinstance(one, ForceData):
            raise InputError(
                f"a force map must be a fitting.ForceData, got {shown(one)}: use fitting.read_csv(path) "
                "for a file, or fitting.load_bundled(name) for a bundled map"
            )


def several_maps(data: Any) -> tuple[ForceData, ...]:
    """Return a sequence of force maps as a tuple.

    Raises:
        InputError: the argument is a single map, or an item is not a map.
    """
    if isinstance(data, ForceData):
        raise InputError(
            "force maps must be passed in a list, got a single map: use fitting.identify for one map"
        )
    several = isinstance(data, Iterable) and not isinstance(data, str)
    maps: tuple[Any, ...] = tuple(data) if several else (data,)
    check_maps(*maps)
    return maps


def data_frame(rows: Iterable[Mapping[str, Any]], index: str | None = None) -> "pandas.DataFrame":
    """Return rows with common keys as a data frame.

    Raises:
        InputError: pandas is not installed.
    """
    frame = import_extra("pandas", "tables").DataFrame.from_records(list(rows))
    return frame if index is None else frame.set_index(index)
