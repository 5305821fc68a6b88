"""Measured static force maps, with their specimen, and their files.

Measured pressures and lengths scatter about nominal ones. `levels_of` finds the levels: what "at one
pressure" and "at one length" mean for a map.
"""

import dataclasses
import functools
import hashlib
import importlib.resources
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError, import_extra
from famjax.boundary.units import Quantity, Sentence, factor, to_si, unit_system
from famjax.tables import Table, read_table

from .arguments import check_mapping, check_numbers, check_path, is_number, shown
from .specimen import (
    SPECIMEN_LENGTHS,
    Specimen,
    check_plausible,
    describe,
    parse_specimen,
    said_number,
)

if TYPE_CHECKING:
    import pandas
    import xarray

COLUMNS = {
    "force": "force",
    "pressure": "pressure",
    "length": "length",
    "force_std": "force",
    "pressure_std": "pressure",
    "length_std": "length",
}
"""The columns of a force map and the kind of unit of each."""

_STDS = tuple(name for name in COLUMNS if name.endswith("_std"))

MAY_BE_ZERO = frozenset({"pressure", "pressure_std", "length_std"})
"""Columns that may be zero; the force alone may be negative, and the others must be positive."""

MOST_APART = 40
"""Levels at most that are left out one by one; more are left out in as many groups of neighbours."""

_HINTS = {
    "pressure": ": subtract what the gauge reads when it is vented",
    "length": ": contractions stand in a column contraction, as fractions, or contraction_%, in percent",
}
_PUSHES = 3.0  # times the largest pull: nothing that pulls pushes so hard
_CLEAR = 8.0  # times wider is the narrowest gap between levels than the widest one within
_WITHIN = 0.02  # of the whole range: the widest gap within a level that is taken without asking
_FINEST = 1e-4  # of the whole range: narrower gaps are all alike
_SHARED = 1.5  # readings for each level that was found: fewer, and it is chance
_NOMINAL = 2.0  # readings for each value: values that repeat exactly are nominal
_FRACTION = 0.75  # of the readings alone on their level: no levels are to be seen
_NEAR_ZERO = 0.01  # of the largest value: how far below zero a sensor at zero may read
_EXTREMES = 1.5  # of the noise that readings below zero show: largest noise above zero
_SHOWN = 12  # rows of a table in a notebook


@dataclasses.dataclass(frozen=True)
class Levels:
    """The level of every reading.

    Attributes:
        level: the mean of the values on the reading's level, or the value itself where all of them
            are equal; shape (n,).
        tolerance: neighbours nearer than this are on one level; 0 where only equal values are.
        note: what a reader must know, or "".
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
    """The levels of measured values: neighbours nearer than a tolerance are on one level.

    Without a tolerance, one is found where the gaps between the sorted values fall clearly into
    narrow ones, within 2 % of the range, and ones 8 times as wide that leave 1.5 readings to a
    level: the geometric mean of the two beside the divide. Values that repeat exactly, twice on
    average, are nominal, or rounded by the gauge: equal ones are on one level, and others only where
    the gaps show it and no two of them were read at one level of the other quantity, as values that
    someone set one after the other would have been.

    Args:
        values: in SI.
        what: they are, "pressure" or "length".
        tolerance: in SI, >= 0; None to find one.
        beside: level of the other quantity of each reading; None where it is not known, and values that
            repeat are nominal.

    Raises:
        InputError: a tolerance below zero, or one that chains values into a level as wide as the
            gap to the next one.

    >>> levels_of(np.array([79.97e3, 80.03e3, 80.0e3, 120.1e3, 119.9e3]), "pressure").level / 1e3
    array([ 80.,  80.,  80., 120., 120.])
    """
    given = tolerance is not None
    if given and not (np.isfinite(tolerance) and tolerance >= 0):
        raise InputError(f"the tolerance of a {what} must be >= 0, got {tolerance}")
    distinct, place = np.unique(values, return_inverse=True)
    if tolerance is None:
        tolerance = _tolerance_of_gaps(distinct, values.size)
        nominal = values.size >= _NOMINAL * distinct.size
        if nominal and not _rounded(values, _chained(distinct, tolerance)[place], beside):
            tolerance = 0.0
    group = _chained(distinct, tolerance)
    numbers = np.arange(group[-1] + 1)
    low, high = (
        distinct[np.searchsorted(group, numbers)],
        distinct[np.searchsorted(group, numbers, "right") - 1],
    )
    if given and tolerance > 0 and (high - low).max() >= (low[1:] - high[:-1]).min(initial=np.inf):
        worst = int(np.argmax(high - low))
        said, *ends = (
            Quantity(value, what).in_units("metric")
            for value in (tolerance, low[worst], high[worst])
        )
        raise InputError(
            f"with a tolerance of {said} the readings between {' and '.join(ends)} chain into one "
            f"{what}, wider than the gap to another: give a smaller tolerance"
        )
    label = group[place]
    count = np.bincount(label)
    mean = np.where(high > low, np.bincount(label, values) / count, low)
    note = ""
    if tolerance > 0 and count.size < distinct.size:
        note = Sentence(
            f"Readings whose {what}s are less than ",
            Quantity(tolerance, what),
            f" apart count as one {what} ({'given' if given else 'found from the gaps between them'}): "
            f"{distinct.size} values on {count.size} levels.",
        )
    elif count.size > max(2, _FRACTION * values.size):
        note = (
            f"Hardly two readings share a {what}, and no gaps divide them into levels: leaving one "
            f"{what} out leaves out single readings. Give a tolerance "
            f"(--{what}-tolerance) if they were taken at common {what}s."
        )
    return Levels(mean[label], float(tolerance), note)


def _chained(distinct: Float[np.ndarray, " k"], tolerance: float) -> Int[np.ndarray, " k"]:
    """Number of the level of each value."""
    return np.cumsum(np.concatenate([[0], np.diff(distinct) > tolerance]))


def _rounded(
    values: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    beside: Float[np.ndarray, " n"] | None,
) -> bool:
    """Whether the values of one group are readings of a single value.

    What was set on purpose at two neighbouring values was set at both of them somewhere.
    """
    if beside is None:
        return False
    pairs = np.unique(np.stack([group, beside], axis=1), axis=0)
    with_values = np.unique(np.stack([group, beside, values], axis=1), axis=0)
    return len(with_values) == len(pairs)


def _tolerance_of_gaps(distinct: Float[np.ndarray, " k"], readings: int) -> float:
    """Tolerance found from the gaps, or 0."""
    if distinct.size < 3:
        return 0.0
    span = distinct[-1] - distinct[0]
    gaps = np.sort(np.maximum(np.diff(distinct), _FINEST * span))
    divide = int(np.argmax(gaps[1:] / gaps[:-1]))
    within, between = gaps[divide], gaps[divide + 1]
    clear = between >= _CLEAR * within and within <= _WITHIN * span
    clear &= readings >= _SHARED * (gaps.size - divide)  # levels: the wide gaps, and one
    return float(np.sqrt(within * between)) if clear else 0.0


def groups_of_levels(
    level: Float[np.ndarray, " n"], values: Float[np.ndarray, " levels"], groups: int | None = None
) -> Int[np.ndarray, " n"]:
    """In which group of neighbouring levels each reading is left out; -1 at none of the levels.

    Args:
        level: of each reading.
        values: levels to be left out, ascending.
        groups: their number; each level by itself unless given, as far as `MOST_APART` of them.
    """
    count = min(groups or MOST_APART, values.size)
    group = np.searchsorted(values, level) * count // values.size
    return np.where(np.isin(level, values), group, -1)


@dataclasses.dataclass(frozen=True, repr=False)
class ForceData:
    """A static force map in SI, one row per reading.

    A reading with force <= 0 is slack: the muscle would push but buckles instead, so all that is
    known is that its force is not positive. Readings slightly below zero show the noise of the load
    cell, and readings up to 1.5 times that force above zero are slack as well. A reading at or above
    the limit of the load cell is saturated: its force is at least that. Slack and saturated readings
    are censored: they enter no fit as data, but a fit is checked against the slack ones, and
    `identify(..., censored=True)` has both as one-sided ones.

    Attributes:
        force: F [N], shape (n,), positive when the muscle pulls.
        pressure: gauge pressure P [Pa], shape (n,), >= 0.
        length: active length L [m], shape (n,), > 0.
        specimen: the muscle.
        force_std, pressure_std, length_std: standard deviations in the same units, shape (n,),
            or None.
        source: where the numbers come from.
        notes: assumptions made when reading, for the report.
        assumed: fields of the specimen that were not given but assumed, for the verdict.
        units: of the columns of the file by quantity, where there was one; the numbers are SI.
        force_limit: largest force [N] that the load cell reads, or None where it never was at it.
        slack_below: readings up to this force [N] are slack; None to find it from those below zero.
        count: how many readings were the same to the last digit, shape (n,), or None where none was: they
            are averaged here, and weigh by their number.
        taken: what the columns of a file were taken as, for the command that read it.
        pressure_tolerance, length_tolerance: readings nearer than this [Pa, m] are at one pressure
            or length, see `levels_of`; None to find it from the gaps between them.
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
        self._check_arguments()
        for name in COLUMNS:
            if getattr(self, name) is not None or not name.endswith("_std"):
                object.__setattr__(self, name, self._checked_column(name))
        if self.slack_below is None:
            self._find_slack()
        self._check_pulls()
        for name in ("force", "pressure", "length"):
            largest = float(getattr(self, name).max())
            check_plausible(f"the largest {name}", largest, name, self.units.get(name, ""))
        if self.count is None:
            self._average_copies()
        elif np.shape(self.count) != np.shape(self.force):
            raise InputError(
                "count must have the same length as force; omit it to have it recomputed"
            )

    def _check_arguments(self) -> None:
        """Check the types of the arguments that are not columns."""
        if not isinstance(self.specimen, Specimen):
            raise InputError(
                f"specimen must be a fitting.Specimen, got {shown(self.specimen)}: it has the name, the "
                "rest length and the wall of the muscle"
            )
        check_mapping("units", self.units, "from columns to units")
        for name in ("pressure_tolerance", "length_tolerance"):
            tolerance = getattr(self, name)
            if tolerance is not None and not is_number(tolerance):
                raise InputError(f"{name} must be a number in SI, got {shown(tolerance)}")
        limit = self.force_limit
        if limit is not None and not (is_number(limit) and 0 < limit < math.inf):
            raise InputError(f"force_limit must be a force > 0 in N, got {limit!r}")

    def _checked_column(self, name: str) -> Float[np.ndarray, " n"]:
        values, shape = check_numbers(name, getattr(self, name)), np.shape(self.force)
        if values.ndim != 1 or values.shape != shape:
            raise InputError(
                f"all columns must be one-dimensional and equally long; force has shape "
                f"{shape}, {name} has shape {values.shape}"
            )
        for k in np.flatnonzero(~np.isfinite(values)):
            raise InputError(
                f"{name} of reading {k + 1} is {values[k]}; every value must be finite: remove the "
                "reading"
            )
        if name != "force":
            zero = name in MAY_BE_ZERO
            gauge = " (gauge pressure, not absolute)" if name == "pressure" else ""
            for k in np.flatnonzero((values < 0) | ((values == 0) & (not zero))):
                raise InputError(
                    f"{name}{gauge} must be {'>=' if zero else '>'} 0; reading {k + 1} has "
                    f"{values[k]:.6g} in SI units{_HINTS.get(name, '')}"
                )
        return values

    def _find_slack(self) -> None:
        """Readings of a slack muscle scatter about zero: those below it show how far."""
        noise = -float(self.force.min(initial=0.0))
        small = noise <= _NEAR_ZERO * float(self.force.max(initial=0.0))
        found = _EXTREMES * noise if small else 0.0
        object.__setattr__(self, "slack_below", found)
        count = int(((self.force > 0) & (self.force <= found)).sum())
        if count:
            note = Sentence(
                f"{count} reading{'s' * (count > 1)} of at most ", Quantity(found, "force", 2),
                " count as slack: readings below zero show that much noise.",
            )  # fmt: skip
            object.__setattr__(self, "notes", (*self.notes, note))

    def _check_pulls(self) -> None:
        """Check that some readings pull."""
        sign = "A muscle pulls with positive force: check the sign of the force column"
        if not self.loaded.any() and self.saturated.any():
            raise InputError(
                f"every reading that pulls is at the limit of the load cell, {self.force_limit:.6g} N, "
                "or above: nothing to fit. Check force_limit and its unit"
            )
        if not self.loaded.any():
            raise InputError(
                f"all {self.force.size} readings are slack (force <= 0): nothing to fit. {sign}"
            )
        low, high = float(self.force.min()), self.max_force
        if -low > _PUSHES * high:
            raise InputError(
                f"the forces reach down to {low:.4g} N and up to {high:.4g} N only. {sign}"
            )

    def _average_copies(self) -> None:
        """Readings that are the same to the last digit become one, which weighs by their number."""
        rows = np.stack([self.force, self.pressure, self.length], axis=1)
        order = np.lexsort(rows.T[::-1])
        new = np.concatenate([[True], (np.diff(rows[order], axis=0) != 0).any(axis=1)])
        if new.all():
            return
        starts = np.flatnonzero(new)
        count = np.diff(np.append(starts, order.size))
        first = np.minimum.reduceat(order, starts)
        there = np.argsort(first)
        first, count = first[there], count[there]
        n = order.size
        for name in COLUMNS:
            if (values := getattr(self, name)) is not None:
                object.__setattr__(self, name, values[first])
        if self.force_std is not None:
            object.__setattr__(self, "force_std", self.force_std / np.sqrt(count))
        object.__setattr__(self, "count", count.astype(float))
        k = int(np.argmax(count))
        note = Sentence(
            f"{n - count.size} of {n} readings repeat another to the last digit, such as ",
            Quantity(self.force[k], "force"), " at ", Quantity(self.pressure[k], "pressure"), " and ",
            Quantity(self.length[k], "length"),
            f" ({count[k]} times): they are averaged, and weigh by their number. If they are copies, "
            "remove them.",
        )  # fmt: skip
        object.__setattr__(self, "notes", (*self.notes, note))

    def __repr__(self) -> str:
        length, pressure = self.length * 1e3, self.pressure / 1e3
        return (
            f"ForceData({self.specimen.name}, {self.source}: {self.force.size} readings, "
            f"{self.loaded.sum()} of them loaded, {length.min():.4g} to {length.max():.4g} mm, "
            f"{pressure.min():.4g} to {pressure.max():.4g} kPa, up to {self.max_force:.5g} N)"
        )

    def to_pandas(self) -> "pandas.DataFrame":
        """The readings in SI, a column each with its unit, and whether they are loaded.

        Raises:
            InputError: pandas is not installed.
        """
        held = {**self.columns(), "loaded": self.loaded}
        return import_extra("pandas", "tables").DataFrame(self._repeated(held))

    def to_xarray(self) -> "xarray.Dataset":
        """The same as a data set over the dimension `reading`, the specimen in its attributes.

        Raises:
            InputError: xarray is not installed.
        """
        held = self._repeated({**self.columns(), "loaded": self.loaded})
        frame = {name: (("reading",), values, {}) for name, values in held.items()}
        known = {
            key: one for key, one in dataclasses.asdict(self.specimen).items() if one is not None
        }
        about = {key: int(one) if isinstance(one, bool) else one for key, one in known.items()}
        return data_set(frame, {}, about)

    @classmethod
    def from_pandas(
        cls,
        frame: "pandas.DataFrame",
        specimen: "Specimen | Mapping[str, Any] | None" = None,
        columns: Mapping[str, str] | None = None,
    ) -> "ForceData":
        """Build a force map from a pandas table; column names state the units, as in a CSV file.

        Args:
            frame: with columns such as `force_N`, `pressure_kPa` and `length_mm`; others, such as the
                `loaded` of `to_pandas`, are left out.
            specimen: the muscle, or fields of it in SI. What is not said is assumed, as by `read_csv`.
            columns: which column is which quantity, as of `read_csv`.

        Raises:
            InputError: what is wrong with the columns, as `read_csv` says it.

        >>> import pandas
        >>> frame = pandas.DataFrame(
        ...     {"force_N": [300.0, 120.0], "pressure_bar": [3.0, 3.0], "length_mm": [250.0, 230.0]}
        ... )
        >>> ForceData.from_pandas(frame, {"nominal_diameter": 10e-3}).pressure
        array([300000., 300000.])
        """
        if not callable(getattr(frame, "to_csv", None)) or not hasattr(frame, "columns"):
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

        Variables over several dimensions, such as length and pressure, become one reading for each of
        their combinations. Without a specimen that in the attributes counts, as `to_xarray` writes it.

        Raises:
            InputError: what is wrong with the variables.
        """
        if not hasattr(dataset, "data_vars") or not hasattr(dataset, "to_dataframe"):
            raise InputError(f"dataset must be an xarray.Dataset, got {shown(dataset)}")
        frame = (
            dataset.to_dataframe().dropna().reset_index().drop(columns="reading", errors="ignore")
        )
        fields = {field.name for field in dataclasses.fields(Specimen)}
        known = {key: one for key, one in dataset.attrs.items() if key in fields}
        known |= {"embedded": bool(known["embedded"])} if "embedded" in known else {}
        return cls.from_pandas(frame, known if specimen is None else specimen, columns)

    def _repeated(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Columns with averaged readings repeated as often as they were read."""
        if self.count is None or self.force_std is not None:
            return dict(columns)
        times = self.count.astype(int)
        return {name: np.repeat(values, times) for name, values in columns.items()}

    def columns(self, system: str = "si") -> dict[str, np.ndarray]:
        """The available columns in a unit system, by name and unit."""
        units = unit_system(system)
        return {
            f"{name}_{units[kind]}": values / factor(units[kind], kind)
            for name, kind in COLUMNS.items()
            if (values := getattr(self, name)) is not None
        }

    @functools.cached_property
    def pressures(self) -> Levels:
        """The pressure level [Pa] of every reading: what "at one pressure" means for this map."""
        lengths = levels_of(self.length, "length", self.length_tolerance)
        return levels_of(self.pressure, "pressure", self.pressure_tolerance, lengths.level)

    @functools.cached_property
    def lengths(self) -> Levels:
        """The length level [m] of every reading: what "at one length" means for this map."""
        pressures = levels_of(self.pressure, "pressure", self.pressure_tolerance)
        return levels_of(self.length, "length", self.length_tolerance, pressures.level)

    def levels(self, kind: str) -> Float[np.ndarray, " n"]:
        """The "pressure" [Pa] or "length" [m] level of every reading."""
        return {"pressure": self.pressures, "length": self.lengths}[kind].level

    def left_out_as(self, kind: str) -> Float[np.ndarray, " n"]:
        """The level that is left out with each reading, or the middle of a group of levels.

        Levels are left out one by one, but many of them (see `MOST_APART`) in groups of neighbours.
        """
        level = self.levels(kind)
        group = groups_of_levels(level, np.unique(level[self.loaded]))
        middle = np.array([np.median(np.unique(level[group == k])) for k in range(group.max() + 1)])
        return np.where(group < 0, level, middle[group])

    @property
    def loaded(self) -> Bool[np.ndarray, " n"]:
        """Rows with a pulling force below the load cell's limit; the others are censored."""
        return ~self.slack & ~self.saturated

    @property
    def slack(self) -> Bool[np.ndarray, " n"]:
        """Rows whose force is at most zero, but for the noise."""
        return self.force <= (self.slack_below or 0.0)

    @property
    def saturated(self) -> Bool[np.ndarray, " n"]:
        """Rows whose force is at least the limit of the load cell."""
        return self.force >= (math.inf if self.force_limit is None else self.force_limit)

    @property
    def strained(self) -> Bool[np.ndarray, " n"]:
        """Loaded rows away from the rest length, where the bladder is strained."""
        away = np.abs(self.lengths.level - self.specimen.rest_length) > self.lengths.tolerance
        return self.loaded & away

    @property
    def max_force(self) -> float:
        """Largest measured force [N]; errors are given relative to it."""
        return float(self.force.max())

    def part(self, rows: Bool[np.ndarray, " n"]) -> "ForceData":
        """The force map with some of the readings only.

        What is at one pressure or length does not change with what is left.

        Args:
            rows: which, shape (n,).

        Raises:
            InputError: none of them is loaded.
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
        """Hash of the numbers in SI and of the specimen; the file's format does not matter."""
        digest = hashlib.sha256()
        for name in COLUMNS:
            values = getattr(self, name)
            digest.update(name.encode())
            if values is not None:
                digest.update(np.ascontiguousarray(values, "<f8").tobytes())
        digest.update(repr(dataclasses.astuple(self.specimen)).encode())
        if self.count is not None:
            digest.update(self.count.tobytes())
        if self.force_limit is not None:
            digest.update(f"force_limit {self.force_limit!r}".encode())
        return digest.hexdigest()


_NOT_ASSUMED = {"wall_thickness": "wall_thickness", "bladder_diameter": "embedded"}
"""Field of a specimen that an assumption has filled in, by what was not said."""


def bundled_names() -> list[str]:
    """Names of the measured maps that come with famjax.

    >>> bundled_names()
    ['DMSP-10-250', 'DMSP-20-300']
    """
    folder = importlib.resources.files("fitting") / "maps"
    return sorted(f.name.removesuffix(".csv").upper() for f in folder.iterdir() if ".csv" in f.name)


def bundled_map_name(name: str) -> str | None:
    """Name of the bundled map that a text stands for, or None.

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
        raise InputError(f"unknown bundled map {name!r}; available: {', '.join(bundled_names())}")
    with importlib.resources.as_file(
        importlib.resources.files("fitting") / "maps" / f"{known.lower()}.csv"
    ) as path:
        return dataclasses.replace(
            read_csv(path, specimen), source=f"bundled map {known}", taken=""
        )


def read_csv(
    path: Any,
    specimen: Specimen | Mapping[str, Any] | None = None,
    columns: Mapping[str, str] | None = None,
) -> ForceData:
    """A force map from a file: text in any usual form, or a workbook (.xlsx).

    The columns are found by their names, each with its unit, as in `force_lbf`, `Pressure (psi)` or a row
    of units below; `force_std_N` and the like are optional. In the place of the length there may be a
    `contraction`, (L0 - L)/L0, or `contraction_%`. Lines that start with # are comments;
    `# specimen: rest_length_mm = 296` describes the muscle.

    Args:
        path: the file, an open text such as standard input, or a table of pandas.
        specimen: the muscle, or fields of `Specimen` in SI that override those in the file.
        columns: which column is which quantity where the names do not say it, `{"force": "Kraft [N]"}`;
            also `decimal` and `atmosphere`, see `famjax.tables.read_table`.

    Returns:
        The map in SI. What had to be assumed about columns and specimen stands in its `notes`.

    Raises:
        InputError: what is wrong with the file, with the number of the row.
    """
    given = specimen if isinstance(specimen, Specimen) else None
    if given is None:
        check_mapping("specimen", specimen, "from fields of Specimen to values in SI")
    check_mapping("columns", columns, "from quantities to names of columns")
    if hasattr(path, "columns") and hasattr(path, "to_csv"):
        return ForceData.from_pandas(path, specimen, columns)
    if not isinstance(path, str | Path) and not callable(getattr(path, "read", None)):
        raise InputError(f"a force map is read from a path or an open text file, got {shown(path)}")
    table = read_table(path, _NEEDED, optional=_STDS, columns=columns, strict=True)
    known = parse_specimen(_entries(table.comments, "specimen"))
    if isinstance(specimen, Mapping):
        known |= {key: value for key, value in specimen.items() if value is not None}
    try:
        tolerances: dict[str, Any] = dict(map(_tolerance, _entries(table.comments, "level")))
        return _map(table, given, known, tolerances)
    except InputError as error:
        where = path if isinstance(path, str | Path) else table.source
        raise InputError(f"{where}: {error}") from None


_NEEDED = ("force", "pressure", "length")
_LEAST_CONTRACTION = 0.006  # of a map: no muscle is measured over less


def _map(
    table: Table, given: Specimen | None, known: dict[str, Any], tolerances: Mapping[str, Any]
) -> ForceData:
    """Build the map from a table and the specimen, or from what is known about the specimen."""
    arrays = dict(table.columns)
    for unknown in sorted(known.keys() - {one.name for one in dataclasses.fields(Specimen)}):
        if unknown != "force_limit":
            raise InputError(f"unknown entry of the specimen {unknown!r}")
    notes = [*_told(table), *_near_zero(arrays)]
    _lengths_of_contractions(arrays, given.rest_length if given else known.get("rest_length"))
    limit = known.pop("force_limit", None)
    muscle: dict[str, Any] = {"specimen": given}
    if given is None:
        longest = float(arrays["length"].max())
        muscle = describe({"name": Path(table.source).stem, **known}, longest)._asdict()
        notes = [*muscle.pop("notes"), *notes]
    return ForceData(
        **arrays, **muscle, **tolerances, notes=tuple(notes), source=table.source, units=table.units,
        force_limit=limit, taken=table.said(),
    )  # fmt: skip


def _told(table: Table) -> Iterable[str]:
    """Notes on columns that the user named, and on columns that were ignored."""
    if named := [(quantity, one) for quantity, one in table.taken.items() if one.named]:
        said = ", ".join(
            f"{quantity} is {one.name!r} in {one.unit or '-'}" for quantity, one in named
        )
        yield f"As was said, {said}."
    if table.others:
        yield f"Columns left aside: {', '.join(table.others)}."


def _near_zero(arrays: dict[str, np.ndarray]) -> Iterable[str]:
    """Read a vented gauge's small negative pressures as 0, with a note."""
    pressure = arrays["pressure"]
    below = pressure < 0
    if below.any() and pressure.min() >= -_NEAR_ZERO * pressure.max():
        arrays["pressure"] = np.where(below, 0.0, pressure)
        least = Quantity(float(pressure.min()), "pressure", 3)
        yield Sentence(
            f"{below.sum()} pressures below zero, ", least, " at the least, are read as 0."
        )


def _lengths_of_contractions(arrays: dict[str, Any], rest: float | None) -> None:
    """Replace contractions by lengths."""
    if "contraction" not in arrays:
        return
    if rest is None:
        raise InputError(
            "contractions need the rest length: write '# specimen: rest_length_mm = 296' into the "
            "file, or give --specimen rest_length_mm=296"
        )
    largest = float(arrays["contraction"].max())
    if largest < _LEAST_CONTRACTION:
        raise InputError(
            f"the largest contraction is {largest:.2%}, which looks like fractions labelled "
            "percent: if they "
            'are fractions, --column contraction="NAME [-]"'
        )
    if largest >= 1:
        raise InputError(
            f"contraction is {largest:.6g}; (L0 - L)/L0 lies below 1: write percent in a column "
            "contraction_%, lengths in a column such as length_mm"
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
    return name, to_si(
        said_number(value, f"the level's {key}"), unit, name.removesuffix("_tolerance")
    )


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
    columns = data._repeated(data.columns(system))
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


def check_maps(*data: object) -> None:
    """Refuse anything that is not a force map, such as the path of a file.

    Raises:
        InputError: one of them is none.
    """
    for one in data:
        if not isinstance(one, ForceData):
            raise InputError(
                f"a force map must be a fitting.ForceData, got {shown(one)}: fitting.read_csv(path) "
                "reads a file, fitting.load_bundled(name) a bundled map"
            )


def several_maps(data: object) -> tuple[ForceData, ...]:
    """Force maps in a sequence.

    Raises:
        InputError: it is one map, or holds something else.
    """
    if isinstance(data, ForceData):
        raise InputError(
            "several force maps must be given in a list, got a single one: fitting.identify takes one"
        )
    if isinstance(data, str | Path) or not isinstance(data, Iterable):
        check_maps(data)
    maps: tuple[Any, ...] = tuple(cast("Iterable[Any]", data))
    check_maps(*maps)
    return maps


def data_frame(rows: Iterable[Mapping[str, Any]], index: str | None = None) -> "pandas.DataFrame":
    """Rows that share their keys as a data frame.

    Raises:
        InputError: pandas is not installed.
    """
    frame = import_extra("pandas", "tables").DataFrame.from_records(list(rows))
    return frame if index is None else frame.set_index(index)


Variable = tuple[Sequence[str], np.ndarray, Mapping[str, str]]
"""Dimensions, values, attributes."""


def data_set(
    variables: Mapping[str, Variable], coordinates: Mapping[str, Variable], about: Mapping[str, Any]
) -> "xarray.Dataset":
    """Variables with their units as a data set.

    Raises:
        InputError: xarray is not installed.
    """
    return import_extra("xarray", "tables").Dataset(variables, coordinates, dict(about))
