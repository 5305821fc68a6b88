"""A measured static force map: force, pressure and length, with the specimen they belong to.

Measured pressures and lengths scatter about nominal ones. `levels_of` finds the levels: what "at one
pressure" and "at one length" mean for a map.
"""

import dataclasses
import functools
import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError
from famjax.boundary.extras import import_extra
from famjax.boundary.sentence import Quantity, Sentence
from famjax.boundary.units import factor, unit_system

from .arguments import check_mapping, check_numbers, is_number, shown
from .plausible import QUANTITIES, check_plausible

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

MAY_BE_ZERO = frozenset({"pressure", "pressure_std", "length_std"})
"""Columns that may be zero; the force alone may be negative, and the others must be positive."""

MOST_APART = 40
"""Levels at most that are left out one by one; more are left out in as many groups of neighbours."""

_PUSHES = 3.0  # times the largest pull: nothing that pulls pushes so hard
_CLEAR = 8.0  # times wider is the narrowest gap between levels than the widest one within
_WITHIN = 0.02  # of the whole range: the widest gap within a level that is taken without asking
_FINEST = 1e-4  # of the whole range: narrower gaps are all alike
_SHARED = 1.5  # readings for each level that was found: fewer, and it is chance
_NOMINAL = 2.0  # readings for each value: values that repeat exactly are nominal
_FRACTION = 0.75  # of the readings alone on their level: no levels are to be seen
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
    """Whether values of one group are a single one that was read here so, there so.

    What was set on purpose at two neighbouring values was set at both of them somewhere.
    """
    if beside is None:
        return False
    pairs = np.unique(np.stack([group, beside], axis=1), axis=0)
    with_values = np.unique(np.stack([group, beside, values], axis=1), axis=0)
    return len(with_values) == len(pairs)


def _tolerance_of_gaps(distinct: Float[np.ndarray, " k"], readings: int) -> float:
    """The tolerance that the gaps show, or 0."""
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


@dataclasses.dataclass(frozen=True)
class Specimen:
    """What is known of the muscle besides the force map.

    Attributes:
        name: for reports.
        rest_length: active length L0 [m] of zero contraction.
        wall_thickness: bladder wall t0 [m] at rest.
        nominal_diameter: bore [m] by which the muscle is sold, or None; it bounds the braid
            diameter of a fit.
        bladder_diameter: outer diameter [m] of the bladder at rest, or None where it fills the
            braid.
        braid_thickness: [m].
        embedded: True where the threads run inside the rubber (Festo DMSP).
    """

    name: str
    rest_length: float
    wall_thickness: float
    nominal_diameter: float | None = None
    bladder_diameter: float | None = None
    braid_thickness: float = 0.0
    embedded: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(f"the specimen's name must be a text, got {shown(self.name)}")
        if not isinstance(self.embedded, bool | np.bool_):
            raise InputError(
                f"the specimen's embedded must be True or False, got {shown(self.embedded)}"
            )
        for name in SPECIMEN_LENGTHS:
            size = getattr(self, name)
            if size is None and name in {"nominal_diameter", "bladder_diameter"}:
                continue
            positive = name != "braid_thickness"
            known = size is not None and is_number(size)
            if size is None or not (known and 0 <= size < math.inf and (size > 0 or not positive)):
                must = "a positive length" if positive else "a length >= 0"
                raise InputError(f"{name} must be {must} in m, got {size!r}")
            check_plausible(name, size, QUANTITIES[name])
        wall, bore = self.wall_thickness, self.nominal_diameter or math.inf
        widest = self.bladder_diameter or bore + 2 * wall
        if 2 * wall >= widest:
            raise InputError(
                f"a wall of {wall * 1e3:.4g} mm does not fit twice into a bladder of "
                f"{widest * 1e3:.4g} mm: one of the two is wrong; check wall_thickness and "
                "nominal_diameter or bladder_diameter, and their units"
            )
        if self.embedded and self.bladder_diameter is not None:
            raise InputError(
                "an embedded braid runs inside the wall, so the bladder has no diameter of its "
                "own: leave bladder_diameter out, or set embedded = false"
            )


SPECIMEN_LENGTHS = (
    "rest_length",
    "wall_thickness",
    "nominal_diameter",
    "bladder_diameter",
    "braid_thickness",
)
"""Fields of `Specimen` that are lengths."""


@dataclasses.dataclass(frozen=True, repr=False)
class ForceData:
    """A static force map in SI, one row per reading.

    A reading with force <= 0 is slack: the muscle would push but buckles instead, so all that is
    known is that its force is not positive. One at or above the limit of the load cell is
    saturated: its force is at least that. Such rows are censored: they enter no fit as data, but a
    fit is checked against those that are slack, and `identify(..., censored=True)` has both as
    one-sided ones.

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

    def __post_init__(self) -> None:
        self._check_arguments()
        for name in COLUMNS:
            if getattr(self, name) is not None or not name.endswith("_std"):
                object.__setattr__(self, name, self._checked_column(name))
        self._check_pulls()
        for name in ("force", "pressure", "length"):
            largest = float(getattr(self, name).max())
            check_plausible(f"the largest {name}", largest, name, self.units.get(name, ""))
        self._check_copies()

    def _check_arguments(self) -> None:
        """What is no column must be of its kind."""
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
                    f"{values[k]:.6g} in SI units"
                )
        return values

    def _check_pulls(self) -> None:
        """There must be something to fit, and it must pull."""
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

    def _check_copies(self) -> None:
        """No loaded reading may be there twice: a copy would count twice and understate the error."""
        rows = np.stack([self.force, self.pressure, self.length], axis=1)
        order = np.lexsort(rows.T)
        same = (np.diff(rows[order], axis=0) == 0).all(axis=1) & self.loaded[order[1:]]
        if same.any():
            first = int(np.flatnonzero(same)[0])
            one, other = sorted(order[first : first + 2] + 1)
            raise InputError(
                f"readings {one} and {other} are the same to the last digit ({rows[one - 1, 0]:.6g} N, "
                f"{rows[one - 1, 1] / 1e3:.6g} kPa, {rows[one - 1, 2] * 1e3:.6g} mm), one of {same.sum()} "
                "such pairs: remove the copies; if they were truly measured twice, give "
                "their mean"
            )

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
        return import_extra("pandas", "tables").DataFrame({**self.columns(), "loaded": self.loaded})

    @classmethod
    def from_pandas(
        cls, frame: "pandas.DataFrame", specimen: "Specimen | Mapping[str, Any] | None" = None
    ) -> "ForceData":
        """The force map in a table of pandas, the unit in the name of each column as in a CSV file.

        Args:
            frame: with columns such as `force_N`, `pressure_kPa` and `length_mm`; a column `loaded`, as
                `to_pandas` writes, is left out.
            specimen: the muscle, or fields of it in SI. What is not said is assumed, as by `read_csv`.

        Raises:
            InputError: what is wrong with the columns, as `read_csv` says it.

        >>> import pandas
        >>> frame = pandas.DataFrame(
        ...     {"force_N": [300.0, 120.0], "pressure_bar": [3.0, 3.0], "length_mm": [250.0, 230.0]}
        ... )
        >>> ForceData.from_pandas(frame, {"nominal_diameter": 10e-3}).pressure
        array([300000., 300000.])
        """
        from .reading import map_of_columns  # noqa: PLC0415 -- which makes maps itself

        if not callable(getattr(frame, "to_numpy", None)) or not hasattr(frame, "columns"):
            raise InputError(f"frame must be a pandas.DataFrame, got {shown(frame)}")
        columns = {str(name): frame[name].to_numpy() for name in frame.columns if name != "loaded"}
        return map_of_columns(columns, specimen or {}, "data frame")

    def columns(self, system: str = "si") -> dict[str, np.ndarray]:
        """The columns there are in a unit system, by name and unit."""
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
        """What is left out with each reading: its level, or the middle of it and its neighbours.

        Levels are left out one by one, but many of them (see `MOST_APART`) in groups of neighbours.
        """
        level = self.levels(kind)
        group = groups_of_levels(level, np.unique(level[self.loaded]))
        middle = np.array([np.median(np.unique(level[group == k])) for k in range(group.max() + 1)])
        return np.where(group < 0, level, middle[group])

    @property
    def loaded(self) -> Bool[np.ndarray, " n"]:
        """Rows with a pulling force below the load cell's limit; the others are censored."""
        return (self.force > 0) & ~self.saturated

    @property
    def slack(self) -> Bool[np.ndarray, " n"]:
        """Rows whose force is at most zero."""
        return self.force <= 0

    @property
    def saturated(self) -> Bool[np.ndarray, " n"]:
        """Rows whose force is at least the limit of the load cell."""
        return self.force >= (math.inf if self.force_limit is None else self.force_limit)

    @property
    def strained(self) -> Bool[np.ndarray, " n"]:
        """Loaded rows away from the rest length, where the bladder has a part in the force."""
        away = np.abs(self.lengths.level - self.specimen.rest_length) > self.lengths.tolerance
        return self.loaded & away

    @property
    def max_force(self) -> float:
        """Largest measured force [N], by which errors are scaled."""
        return float(self.force.max())

    def part(self, rows: Bool[np.ndarray, " n"]) -> "ForceData":
        """The force map of some of the readings.

        What is at one pressure or length does not change with what is left.

        Args:
            rows: which, shape (n,).

        Raises:
            InputError: none of them is loaded.
        """
        columns = {name: getattr(self, name) for name in COLUMNS}
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
        if self.force_limit is not None:
            digest.update(f"force_limit {self.force_limit!r}".encode())
        return digest.hexdigest()


def check_maps(*data: object) -> None:
    """Refuse what is no force map, such as a file that has not been read.

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
