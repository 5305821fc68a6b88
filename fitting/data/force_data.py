"""A measured static force map: force, pressure and length, with the specimen they belong to."""

import dataclasses
import functools
import hashlib
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError
from famjax.boundary.units import factor, unit_system

from ..arguments import check_mapping, check_numbers, is_number, shown
from ..plausible import QUANTITIES, check_plausible
from .frames import data_frame, data_set, html_table
from .levels import Levels, groups_of_levels, levels_of

if TYPE_CHECKING:
    import pandas
    import xarray

NOT_NEGATIVE = frozenset({"pressure_std", "length_std"})
"""Columns that weigh no reading: they may be zero, where a converter shows no scatter."""

_PUSHES = 3.0  # times the largest pull: nothing that pulls pushes so hard


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
        sizes = {
            "rest_length": self.rest_length,
            "wall_thickness": self.wall_thickness,
            "nominal_diameter": self.nominal_diameter,
            "bladder_diameter": self.bladder_diameter,
        }
        for name, size in {**sizes, "braid_thickness": self.braid_thickness}.items():
            if size is None and name not in {"rest_length", "wall_thickness"}:
                continue
            must = "a length >= 0" if name == "braid_thickness" else "a positive length"
            known = size is not None and is_number(size)
            if size is None or not (known and 0 <= size < math.inf and (size > 0 or "0" in must)):
                raise InputError(f"{name} must be {must} in m, got {size!r}")
            check_plausible(name, size, QUANTITIES[name])
        if not isinstance(self.name, str):
            raise InputError(f"the specimen's name must be a text, got {shown(self.name)}")
        if not isinstance(self.embedded, bool | np.bool_):
            raise InputError(
                f"the specimen's embedded must be True or False, got {shown(self.embedded)}"
            )
        widest = (
            self.bladder_diameter or (self.nominal_diameter or np.inf) + 2 * self.wall_thickness
        )
        if 2 * self.wall_thickness >= widest:
            raise InputError(
                f"a wall of {self.wall_thickness * 1e3:.4g} mm does not fit twice into a bladder "
                f"of {widest * 1e3:.4g} mm: one of the two is wrong; check wall_thickness and "
                "nominal_diameter or bladder_diameter, and their units"
            )
        if self.embedded and self.bladder_diameter is not None:
            raise InputError(
                "an embedded braid runs inside the wall, so the bladder has no diameter of its "
                "own: leave bladder_diameter out, or set embedded = false"
            )


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
            values = getattr(self, name)
            if values is None and name.endswith("_std"):
                continue
            values = check_numbers(name, values)
            object.__setattr__(self, name, values)
            if values.ndim != 1 or values.shape != self.force.shape:
                raise InputError(
                    f"all columns must be one-dimensional and equally long; force has shape "
                    f"{self.force.shape}, {name} has shape {values.shape}"
                )
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise InputError(
                    f"{name} of reading {bad[0] + 1} is {values[bad[0]]}; every value must be "
                    "finite: remove the reading"
                )
            if name != "force":
                may_be_zero = name == "pressure" or name in NOT_NEGATIVE
                must = ">= 0" if may_be_zero else "> 0"
                wrong = values < 0 if may_be_zero else values <= 0
                if wrong.any():
                    first = int(np.flatnonzero(wrong)[0])
                    gauge = " (gauge pressure, not absolute)" if name == "pressure" else ""
                    raise InputError(
                        f"{name}{gauge} must be {must}; reading {first + 1} has "
                        f"{values[first]:.6g} in SI units"
                    )
        if self.saturated.any() and not self.loaded.any():
            raise InputError(
                f"every reading that pulls is at the limit of the load cell, {self.force_limit:.6g} N, "
                "or above: nothing to fit. Check force_limit and its unit"
            )
        if not self.loaded.any():
            raise InputError(
                f"all {self.force.size} readings are slack (force <= 0): nothing to fit. A muscle "
                "pulls with positive force: check the sign of the force column"
            )
        if -self.force.min() > _PUSHES * self.force.max():
            raise InputError(
                f"the forces reach down to {self.force.min():.4g} N and up to "
                f"{self.force.max():.4g} N only. A muscle pulls with positive force: check the sign "
                "of the force column"
            )
        for name in ("force", "pressure", "length"):
            largest = float(getattr(self, name).max())
            check_plausible(f"the largest {name}", largest, name, self.units.get(name, ""))
        self._check_copies()

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
        columns = {**self.columns(), "loaded": self.loaded}
        return data_frame(
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        )

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
        from .force_csv import map_of_columns  # noqa: PLC0415 -- which makes maps itself

        if not callable(getattr(frame, "to_numpy", None)) or not hasattr(frame, "columns"):
            raise InputError(f"frame must be a pandas.DataFrame, got {shown(frame)}")
        names = [name for name in frame.columns if name != "loaded"]
        values = [frame[name].to_numpy() for name in names]
        return map_of_columns([str(name) for name in names], values, specimen or {}, "data frame")

    def to_xarray(self) -> "xarray.Dataset":
        """The readings in SI along `reading`, units and specimen as attributes.

        Raises:
            InputError: xarray is not installed.
        """
        known = {k: v for k, v in dataclasses.asdict(self.specimen).items() if v is not None}
        return data_set(
            {
                key: (("reading",), values, {"units": key.rpartition("_")[2]})
                for key, values in self.columns().items()
            }
            | {"loaded": (("reading",), self.loaded, {})},
            {},
            {
                "source": self.source,
                "sha256": self.sha256,
                **known,
                "embedded": int(self.specimen.embedded),
            },
        )  # fmt: skip

    def columns(self, system: str = "si") -> dict[str, np.ndarray]:
        """The columns there are in a unit system, by name and unit."""
        units = unit_system(system)
        return {
            f"{name}_{units[kind]}": values / factor(units[kind], kind)
            for name, kind in COLUMNS.items()
            if (values := getattr(self, name)) is not None
        }

    def _repr_html_(self) -> str:
        columns = self.columns()
        rows = list(zip(*(values.tolist() for values in columns.values()), strict=True))
        return html_table(repr(self), list(columns), rows)

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
        limit = np.inf if self.force_limit is None else self.force_limit
        return self.force >= limit

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


COLUMNS = {
    "force": "force",
    "pressure": "pressure",
    "length": "length",
    "force_std": "force",
    "pressure_std": "pressure",
    "length_std": "length",
}
"""The columns of a force map and the kind of unit of each."""
