"""Mistakes that people make in a file of a sound force map, each as a CSV file with its cause."""

import dataclasses
from collections.abc import Callable

import numpy as np

from fitting import ForceData

_KGF, _LBF, _PSI = 9.80665, 4.4482216152605, 6.894757293168361
_ATMOSPHERE = 101.325  # kPa


@dataclasses.dataclass
class Sheet:
    """A force map as a person types it: names of columns, numbers, lines on the specimen.

    Attributes:
        columns: by name; N, kPa and mm to start from.
        specimen: entries by key; mm to start from.
        other: another muscle's sheet, for faults that need one.
    """

    columns: dict[str, np.ndarray]
    specimen: dict[str, object]
    other: "Sheet | None" = None

    @classmethod
    def of(cls, data: ForceData, other: ForceData | None = None) -> "Sheet":
        """The sheet of a map."""
        columns = {
            "pressure_kPa": data.pressure / 1e3,
            "length_mm": data.length * 1e3,
            "force_N": data.force.copy(),
        }
        specimen: dict[str, object] = {
            key if isinstance(value, str | bool) else f"{key}_mm":
            str(value).lower() if isinstance(value, str | bool) else value * 1e3
            for key, value in dataclasses.asdict(data.specimen).items() if value is not None
        }  # fmt: skip
        return cls(columns, specimen, None if other is None else cls.of(other))

    def text(self) -> str:
        """The file."""
        lines = [f"# specimen: {key} = {value}" for key, value in self.specimen.items()]
        rows = np.stack(list(self.columns.values()), axis=1)
        lines += [",".join(self.columns), *(",".join(f"{v:.9g}" for v in row) for row in rows)]
        return "\n".join(lines) + "\n"

    @property
    def rest(self) -> float:
        """Rest length [mm]."""
        return float(str(self.specimen["rest_length_mm"]))

    @property
    def lengths(self) -> np.ndarray:
        """Number of each reading's length, rounded to 0.2 mm."""
        return np.unique(np.round(self.columns["length_mm"] * 5), return_inverse=True)[1]


Change = Callable[[Sheet, np.random.Generator], None]


@dataclasses.dataclass(frozen=True)
class Fault:
    """One mistake.

    Attributes:
        name: what was done.
        kind: units, absolute, sign, mixed, outliers, thick wall, wrong bore or other.
        cause: regular expression of what names it.
        change: does it to a sheet.
        possible: whether it is one in the map of a sheet.
    """

    name: str
    kind: str
    cause: str
    change: Change
    possible: Callable[[Sheet], bool] = lambda sheet: True  # noqa: ARG005


def _scaled(column: str, size: float) -> Change:
    def change(sheet: Sheet, random: np.random.Generator) -> None:
        del random
        sheet.columns[column] = sheet.columns[column] * size

    return change


def _renamed(column: str, name: str, size: float = 1.0) -> Change:
    def change(sheet: Sheet, random: np.random.Generator) -> None:
        del random
        sheet.columns = {
            name if key == column else key: values * (size if key == column else 1.0)
            for key, values in sheet.columns.items()
        }

    return change


def _specimen(key: str, size: float) -> Change:
    def change(sheet: Sheet, random: np.random.Generator) -> None:
        del random
        sheet.specimen[key] = float(str(sheet.specimen[key])) * size

    return change


def _relabelled(key: str, name: str) -> Change:
    def change(sheet: Sheet, random: np.random.Generator) -> None:
        del random
        sheet.specimen = {
            name if one == key else one: value for one, value in sheet.specimen.items()
        }

    return change


def _absolute(sheet: Sheet, random: np.random.Generator) -> None:
    del random
    sheet.columns["pressure_kPa"] = sheet.columns["pressure_kPa"] + _ATMOSPHERE


def _flipped(sheet: Sheet, random: np.random.Generator) -> None:
    del random
    sheet.columns["force_N"] = -sheet.columns["force_N"]


def _flipped_at_a_length(sheet: Sheet, random: np.random.Generator) -> None:
    level = sheet.lengths
    loaded = np.unique(level[sheet.columns["force_N"] > 0])
    sheet.columns["force_N"][level == random.choice(loaded)] *= -1


def _mixed(sheet: Sheet, random: np.random.Generator) -> None:
    del random
    assert sheet.other is not None
    for name in sheet.columns:
        sheet.columns[name] = np.concatenate([sheet.columns[name], sheet.other.columns[name]])


def _mixed_in_part(sheet: Sheet, random: np.random.Generator) -> None:
    """A third of the lengths come from a muscle of the same bore with a steeper braid."""
    level = sheet.lengths
    chosen = random.choice(level.max() + 1, max(1, (level.max() + 1) // 3), replace=False)
    sheet.columns["force_N"][np.isin(level, chosen)] *= 1.45


def _length_off(sheet: Sheet, random: np.random.Generator) -> None:
    level = sheet.lengths
    inner = np.unique(level[sheet.columns["force_N"] > 0])[1:-1]
    chosen = int(random.choice(inner)) if inner.size else 0
    offset = sheet.rest * random.uniform(0.02, 0.03) * random.choice([-1, 1])
    sheet.columns["length_mm"][level == chosen] += offset


def _outliers(sheet: Sheet, random: np.random.Generator) -> None:
    force = sheet.columns["force_N"]
    loaded = np.flatnonzero(force > 0)
    count = max(2, round(loaded.size * random.uniform(0.05, 0.1)))
    rows = random.choice(loaded, count, replace=False)
    off = force.max() * random.uniform(0.2, 0.5, count) * random.choice([-1, 1], count)
    force[rows] = np.where(force[rows] + off > 0, force[rows] + off, force[rows] + np.abs(off))


def _one_giant(sheet: Sheet, random: np.random.Generator) -> None:
    force = sheet.columns["force_N"]
    force[random.choice(np.flatnonzero(force > 0))] = 99999.0


def _full_load_cell(sheet: Sheet, random: np.random.Generator) -> None:
    force = sheet.columns["force_N"]
    loaded = np.sort(force[force > 0])
    sheet.columns["force_N"] = np.minimum(force, loaded[-random.integers(6, loaded.size // 3)])


def _percent_as_length(sheet: Sheet, random: np.random.Generator) -> None:
    del random
    sheet.columns["length_mm"] = 100 * (1 - sheet.columns["length_mm"] / sheet.rest)


def _percent_as_fraction(sheet: Sheet, random: np.random.Generator) -> None:
    _percent_as_length(sheet, random)
    _renamed("length_mm", "contraction")(sheet, random)


def _fraction_as_percent(sheet: Sheet, random: np.random.Generator) -> None:
    _percent_as_length(sheet, random)
    _renamed("length_mm", "contraction_%", 0.01)(sheet, random)


def _swapped(sheet: Sheet, random: np.random.Generator) -> None:
    del random
    columns = sheet.columns
    columns["force_N"], columns["pressure_kPa"] = columns["pressure_kPa"], columns["force_N"]


def _constant(sheet: Sheet, random: np.random.Generator) -> None:
    del random
    force = sheet.columns["force_N"]
    force[:] = force.max() * (1 + 1e-6 * np.arange(force.size))


def _many_lengths(sheet: Sheet) -> bool:
    """Three lengths for each of two muscles."""
    return np.unique(sheet.lengths[sheet.columns["force_N"] > 0]).size >= 6


def _many_readings(sheet: Sheet) -> bool:
    """A part of which may stand at one limit."""
    return (sheet.columns["force_N"] > 0).sum() > 24


def _four_lengths(sheet: Sheet) -> bool:
    """Of which one is told by the others."""
    return np.unique(sheet.lengths[sheet.columns["force_N"] > 0]).size >= 4


def _large_bore(sheet: Sheet) -> bool:
    """Half of it and two walls, which the braid lies in, is another muscle."""
    return float(str(sheet.specimen.get("nominal_diameter_mm", 0))) >= 16


def _has(key: str) -> Callable[[Sheet], bool]:
    return lambda sheet: key in sheet.specimen


def _other_muscle(sheet: Sheet) -> bool:
    """Of another bore by a fifth or more."""
    assert sheet.other is not None
    bores = [float(str(one.specimen.get("nominal_diameter_mm", 1))) for one in (sheet, sheet.other)]
    return not 0.8 < bores[0] / bores[1] < 1.25


FAULTS: tuple[Fault, ...] = (
    Fault("kgf labelled N", "units", r"in kgf, not N", _scaled("force_N", 1 / _KGF)),
    Fault("lbf labelled N", "units", r"in lbf, not N", _scaled("force_N", 1 / _LBF)),
    Fault("kN labelled N", "units", r"in kN, not N", _scaled("force_N", 1e-3)),
    Fault("N labelled kN", "units", r"(in|like) N, not kN", _renamed("force_N", "force_kN")),
    Fault("N labelled lbf", "units", r"in N, not lbf", _renamed("force_N", "force_lbf")),
    Fault("N labelled kgf", "units", r"in N, not kgf", _renamed("force_N", "force_kgf")),
    Fault("psi labelled kPa", "units", r"in psi, not kPa", _scaled("pressure_kPa", 1 / _PSI)),
    Fault("bar labelled kPa", "units", r"in bar, not kPa", _scaled("pressure_kPa", 1e-2)),
    Fault("Pa labelled kPa", "units", r"(in|like) Pa, not kPa", _scaled("pressure_kPa", 1e3)),
    Fault("bar labelled MPa", "units", r"in bar, not MPa",
          _renamed("pressure_kPa", "pressure_MPa", 1e-2)),
    Fault("kPa labelled psi", "units", r"in kPa, not psi", _renamed("pressure_kPa", "pressure_psi")),
    Fault("mm labelled cm", "units", r"like mm, not cm", _renamed("length_mm", "length_cm")),
    Fault("mm labelled m", "units", r"like mm, not m", _renamed("length_mm", "length_m")),
    Fault("rest length in mm labelled m", "units", r"like mm, not m",
          _relabelled("rest_length_mm", "rest_length_m")),
    Fault("bore in mm labelled m", "units", r"like mm, not m",
          _relabelled("nominal_diameter_mm", "nominal_diameter_m"), _has("nominal_diameter_mm")),
    Fault("wall in mm labelled m", "units", r"like mm, not m",
          _relabelled("wall_thickness_mm", "wall_thickness_m"), _has("wall_thickness_mm")),
    Fault("length in cm labelled mm", "units", r"lengths were in cm, not mm", _scaled("length_mm", 0.1)),
    Fault("length in inches labelled mm", "units", r"inch", _scaled("length_mm", 1 / 25.4)),
    Fault("rest length in cm labelled mm", "units", r"rest length was in cm, not mm",
          _specimen("rest_length_mm", 0.1)),
    Fault("percent of contraction as length", "units", r"percent", _percent_as_length),
    Fault("percent of contraction as fraction", "units", r"percent", _percent_as_fraction),
    Fault("fraction of contraction as percent", "units", r"percent", _fraction_as_percent),
    Fault("absolute pressures", "absolute", r"absolute", _absolute),
    Fault("all forces negative", "sign", r"sign", _flipped),
    Fault("forces of a length negative", "sign", r"sign", _flipped_at_a_length),
    Fault("two muscles, one file after the other", "mixed", r"two muscles", _mixed,
          _other_muscle),
    Fault("two muscles, some lengths of each", "mixed", r"two muscles", _mixed_in_part,
          _many_lengths),
    Fault("one length off by 2 to 3 %", "length", r"length .* mm is", _length_off,
          _four_lengths),
    Fault("outliers", "outliers", r"outlier", _outliers),
    Fault("one reading of 99999 N", "outliers", r"outlier", _one_giant),
    Fault("wall ten times too thick", "thick wall", r"wall", _specimen("wall_thickness_mm", 10.0)),
    Fault("bore doubled", "wrong bore", r"diameter", _specimen("nominal_diameter_mm", 2.0),
          _has("nominal_diameter_mm")),
    Fault("bore halved", "wrong bore", r"diameter", _specimen("nominal_diameter_mm", 0.5),
          _large_bore),
    Fault("force and pressure swapped", "other", r"swapped", _swapped),
    Fault("constant force", "other", r"does not|hardly", _constant),
    Fault("full load cell, not declared", "other", r"load cell", _full_load_cell, _many_readings),
)  # fmt: skip
"""The mistakes that a verdict must find."""
