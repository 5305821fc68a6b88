"""Mistakes that people make in a file of a force map, and whether `famjax fit` tells these from sound maps.

Every mistake is made in a sound map, written as a CSV file and fitted by the bare command; so are the
sound maps themselves: the bundled ones, given ones, and random muscles with and without noise. A file
that is refused, with a sentence, counts as one in which nothing is identified.
"""

import dataclasses
import math
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from default_answer import default_fit
from row import Case, tell

import famjax
import fitting
from fitting import ForceData, Specimen

SOUND, SEED = 20, 0
_KGF, _LBF, _PSI, _ATMOSPHERE = 9.80665, 4.4482216152605, 6.894757293168361, 101.325


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

    def entry(self, key: str) -> float:
        """A size of the specimen [mm], 0 where none is given."""
        return float(str(self.specimen.get(key, 0)))

    @property
    def levels(self) -> np.ndarray:
        """Number of each reading's length, rounded to 0.2 mm."""
        return np.unique(np.round(self.columns["length_mm"] * 5), return_inverse=True)[1]

    @property
    def loaded(self) -> np.ndarray:
        """Numbers of the lengths at which the muscle pulls."""
        return np.unique(self.levels[self.columns["force_N"] > 0])


Change = Callable[[Sheet, np.random.Generator], None]


@dataclasses.dataclass(frozen=True)
class Fault:
    """One mistake.

    Attributes:
        name: what was done.
        cause: regular expression of what names it.
        change: does it to a sheet.
        possible: whether it is one in the map of a sheet.
        fails: whether it must end in exit code 1; else it is a doubt at least, or only looked for.
    """

    name: str
    cause: str
    change: Change
    possible: Callable[[Sheet], bool] = lambda sheet: True  # noqa: ARG005
    fails: bool = True


def _column(column: str, name: str = "", size: float = 1.0) -> Change:
    """A column multiplied, under another name where one is given."""

    def change(sheet: Sheet, _: np.random.Generator) -> None:
        sheet.columns = {
            (name or key) if key == column else key: values * (size if key == column else 1.0)
            for key, values in sheet.columns.items()
        }

    return change


def _line(key: str, name: str = "", size: float = 1.0) -> Change:
    """A line of the specimen multiplied, under another name where one is given."""

    def change(sheet: Sheet, _: np.random.Generator) -> None:
        sheet.specimen = {
            (name or one) if one == key else one: sheet.entry(key) * size if one == key else value
            for one, value in sheet.specimen.items()
        }

    return change


def _absolute(sheet: Sheet, _: np.random.Generator) -> None:
    sheet.columns["pressure_kPa"] = sheet.columns["pressure_kPa"] + _ATMOSPHERE


def _flipped_at_a_length(sheet: Sheet, random: np.random.Generator) -> None:
    sheet.columns["force_N"][sheet.levels == random.choice(sheet.loaded)] *= -1


def _mixed(sheet: Sheet, _: np.random.Generator) -> None:
    assert sheet.other is not None
    for name in sheet.columns:
        sheet.columns[name] = np.concatenate([sheet.columns[name], sheet.other.columns[name]])


def _mixed_in_part(sheet: Sheet, random: np.random.Generator) -> None:
    """A third of the lengths come from a muscle of the same bore with a steeper braid."""
    count = sheet.levels.max() + 1
    chosen = random.choice(count, max(1, count // 3), replace=False)
    sheet.columns["force_N"][np.isin(sheet.levels, chosen)] *= 1.45


def _length_off(sheet: Sheet, random: np.random.Generator) -> None:
    level, inner = sheet.levels, sheet.loaded[1:-1]
    chosen = int(random.choice(inner)) if inner.size else 0
    offset = sheet.entry("rest_length_mm") * random.uniform(0.02, 0.03) * random.choice([-1, 1])
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


def _percent(name: str, size: float = 1.0) -> Change:
    """Percent of contraction in the place of the length, under a name."""

    def change(sheet: Sheet, random: np.random.Generator) -> None:
        part = 1 - sheet.columns["length_mm"] / sheet.entry("rest_length_mm")
        sheet.columns["length_mm"] = 100 * part
        _column("length_mm", name, size)(sheet, random)

    return change


def _swapped(sheet: Sheet, _: np.random.Generator) -> None:
    columns = sheet.columns
    columns["force_N"], columns["pressure_kPa"] = columns["pressure_kPa"], columns["force_N"]


def _constant(sheet: Sheet, _: np.random.Generator) -> None:
    force = sheet.columns["force_N"]
    force[:] = force.max() * (1 + 1e-6 * np.arange(force.size))


def _lengths(count: int) -> Callable[[Sheet], bool]:
    return lambda sheet: sheet.loaded.size >= count


def _has(key: str, least: float = 1e-9) -> Callable[[Sheet], bool]:
    return lambda sheet: sheet.entry(key) >= least


def _other_bore(sheet: Sheet) -> bool:
    """Of another muscle, by a fifth or more."""
    assert sheet.other is not None
    bores = [one.entry("nominal_diameter_mm") or 1.0 for one in (sheet, sheet.other)]
    return not 0.8 < bores[0] / bores[1] < 1.25


P, L, F, BORE, WALL = (
    "pressure_kPa",
    "length_mm",
    "force_N",
    "nominal_diameter_mm",
    "wall_thickness_mm",
)
REST = "rest_length_mm"
FAULTS: tuple[Fault, ...] = (
    Fault("kgf labelled N", "in kgf, not N", _column(F, size=1 / _KGF)),
    Fault("lbf labelled N", "in lbf, not N", _column(F, size=1 / _LBF)),
    Fault("kN labelled N", "in kN, not N", _column(F, size=1e-3)),
    Fault("N labelled kN", "(in|like) N, not kN", _column(F, "force_kN")),
    Fault("N labelled lbf", "in N, not lbf", _column(F, "force_lbf")),
    Fault("N labelled kgf", "in N, not kgf", _column(F, "force_kgf")),
    Fault("psi labelled kPa", "in psi, not kPa", _column(P, size=1 / _PSI)),
    Fault("bar labelled kPa", "in bar, not kPa", _column(P, size=1e-2)),
    Fault("Pa labelled kPa", "(in|like) Pa, not kPa", _column(P, size=1e3)),
    Fault("bar labelled MPa", "in bar, not MPa", _column(P, "pressure_MPa", 1e-2)),
    Fault("kPa labelled psi", "in kPa, not psi", _column(P, "pressure_psi")),
    Fault("mm labelled cm", "like mm, not cm", _column(L, "length_cm")),
    Fault("mm labelled m", "like mm, not m", _column(L, "length_m")),
    Fault("rest length in mm labelled m", "like mm, not m", _line(REST, "rest_length_m")),
    Fault("bore in mm labelled m", "like mm, not m", _line(BORE, "nominal_diameter_m"), _has(BORE)),
    Fault("wall in mm labelled m", "like mm, not m", _line(WALL, "wall_thickness_m"), _has(WALL)),
    Fault("length in cm labelled mm", "lengths were in cm, not mm", _column(L, size=0.1)),
    Fault("length in inches labelled mm", "inch", _column(L, size=1 / 25.4)),
    Fault("rest length in cm labelled mm", "rest length was in cm, not mm", _line(REST, size=0.1)),
    Fault("percent of contraction as length", "percent", _percent(L)),
    Fault("percent of contraction as fraction", "percent", _percent("contraction")),
    Fault("fraction of contraction as percent", "percent", _percent("contraction_%", 0.01)),
    Fault("absolute pressures", "absolute", _absolute),
    Fault("all forces negative", "sign", _column(F, size=-1.0)),
    Fault("forces of a length negative", "sign", _flipped_at_a_length),
    Fault("two muscles, one file after the other", "two muscles|from one muscle", _mixed, _other_bore),
    Fault("two muscles, some lengths of each", "two muscles", _mixed_in_part, _lengths(6)),
    Fault("one length off by 2 to 3 %", "length .* mm is", _length_off, _lengths(4), fails=False),
    Fault("outliers", "outlier", _outliers),
    Fault("one reading of 99999 N", "outlier", _one_giant),
    Fault("wall ten times too thick", "wall", _line(WALL, size=10.0)),
    Fault("bore doubled", "diameter", _line(BORE, size=2.0), _has(BORE)),
    Fault("bore halved", "diameter", _line(BORE, size=0.5), _has(BORE, 16)),
    Fault("force and pressure swapped", "swapped", _swapped, fails=False),
    Fault("constant force", "does not|hardly", _constant, fails=False),
    Fault("full load cell, not declared", "load cell", _full_load_cell,
          lambda sheet: (sheet.columns[F] > 0).sum() > 24, fails=False),
)  # fmt: skip
"""The mistakes that a verdict must find."""


def random_map(seed: int) -> ForceData:
    """The map of a random muscle.

    Bores of 8 to 40 mm, walls of 5 to 12 % of them, braid angles of 62 to 69 deg, rubbers of 0.6 to
    3 MPa, rounded ends, rigs that give; 3 to 10 lengths at 0 to 25 % of contraction, 4 to 10
    pressures up to 4 to 8 bar. Two maps of three have noise: 0.2 to 1 % of the largest force, 0.1 %
    of the rest length on each length, 0.5 kPa on each pressure. Slack readings are zeros.

    Args:
        seed: of everything.
    """
    random = np.random.default_rng(seed)
    bore = random.uniform(8e-3, 40e-3)
    wall = min(bore * random.uniform(0.05, 0.12), 1.8e-3)
    embedded = bool(random.random() < 0.5)
    outer = bore + 2 * wall
    diameter = bore + wall * random.uniform(0.6, 1.4) if embedded else outer
    rest = round(bore * random.uniform(9, 22), 3)
    braid = famjax.Braid.from_rest(
        diameter=diameter, braid_angle=math.radians(random.uniform(62, 69)), length=rest
    )
    bladder = famjax.Bladder(rest, diameter if embedded else outer, wall, embedded=embedded)
    cylinder = famjax.EstimatedGeometry(braid, bladder)
    geometry = famjax.geometries.EndEffectGeometry(cylinder, random.uniform(1.0, 1.2))
    law = int(random.integers(4))
    muscle = famjax.Muscle(geometry, _material(law, random), random.uniform(5e3, 50e3))
    model = famjax.MountedMuscle(muscle, 1e-3 * rest / np.asarray(muscle.blocked_force(6e5)))
    highest = random.uniform(4e5, 8e5)
    lengths = rest * (1 - np.linspace(0, random.uniform(0.12, 0.25), int(random.integers(3, 11))))
    pressures = np.linspace(random.uniform(0.1, 0.25), 1, int(random.integers(4, 11))) * highest
    L, P = (grid.ravel() for grid in np.meshgrid(np.round(lengths, 4), np.round(pressures, -2)))
    noisy = random.random() < 2 / 3
    moved = 1e-3 * rest * noisy * random.normal(size=lengths.size).clip(-2, 2)
    moved -= moved.max()  # none is longer than the rest length
    length, pressure = (
        L + np.tile(moved, pressures.size),
        P + 500 * noisy * random.normal(size=P.size),
    )
    force = np.maximum(np.nan_to_num(np.asarray(model.force(length, pressure)), nan=0.0), 0.0)
    noise = random.uniform(0.002, 0.01) * force.max() * noisy
    force = force + noise * random.normal(size=force.size) * (force > 0)
    specimen = Specimen(
        f"random {seed}", rest, wall, nominal_diameter=bore, embedded=embedded,
        bladder_diameter=None if embedded else outer,
    )  # fmt: skip
    return ForceData(force, P, L, specimen, source=f"random muscle {seed}")


def _material(law: int, random: np.random.Generator) -> famjax.materials.AbstractMaterial:
    E = random.uniform(0.6e6, 3e6)
    if law <= 1:
        return famjax.PolynomialMaterial(E * np.array([[1.0], [1.0, -1.2, 1.2]][law]))
    if law == 2:
        share = random.uniform(0.6, 0.95)
        return famjax.materials.MooneyRivlinMaterial(E / 6 * share, E / 6 * (1 - share))
    exponent = random.uniform(1.5, 4.0)
    return famjax.materials.OgdenMaterial(np.array([2 * E / 3 / exponent]), np.array([exponent]))


@dataclasses.dataclass(frozen=True)
class Judged:
    """What came of a file: the mistake in it, the verdict or "refused", and what was suspected."""

    name: str
    fault: Fault | None
    level: str
    told: str

    @property
    def right(self) -> bool:
        """Whether the verdict is that of a file with this mistake."""
        failed = self.level in ("refused", "not identified")
        return not failed if self.fault is None else failed or not self.fault.fails

    @property
    def named(self) -> bool:
        """Whether the mistake is named; of a sound map, whether any is."""
        return bool(self.told if self.fault is None else re.search(self.fault.cause, self.told))

    def __str__(self) -> str:
        fault = self.fault.name if self.fault else "sound"
        mark = f"{'right' if self.right else 'WRONG'} {'named' if self.named else '-'}"
        return f"{self.name}: {fault}: {self.level}, {mark} | {self.told}"


def judged(name: str, fault: Fault | None, sheet: Sheet) -> Judged:
    """A file as bare `famjax fit` judges it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.csv"
        path.write_text(sheet.text(), encoding="utf-8")
        try:
            saved = default_fit(path).document
        except fitting.InputError as error:
            return Judged(name, fault, "refused", " ".join(str(error).split()))
    return Judged(name, fault, saved["verdict"], " ".join(saved["suspicions"]))


def every(given: Sequence[ForceData]) -> Iterator[Judged]:
    """Sound maps, then each mistake in one that it can be made in."""
    maps = [*map(fitting.load_bundled, fitting.bundled_names()), *given]
    maps += [random_map(1000 * SEED + k) for k in range(max(0, SOUND - len(maps)))]
    for data in maps:
        yield judged(data.specimen.name, None, Sheet.of(data))
    for number, fault in enumerate(FAULTS):
        random = np.random.default_rng((SEED, number))
        for k in random.permutation(len(maps)):
            sheet = Sheet.of(maps[k], maps[(k + 1) % len(maps)])
            if fault.possible(sheet):
                fault.change(sheet, random)
                yield judged(maps[k].specimen.name, fault, sheet)
                break


def verdicts(case: Case) -> dict[str, float]:
    """How sound maps and wrong files end."""
    found = []
    for one in every(case.series if case.source else ()):
        found.append(one)
        tell(str(one))
    sound = [one for one in found if one.fault is None]
    wrong = [one for one in found if one.fault is not None and one.fault.fails]
    return {
        "wrong files that end 0": float(sum(not one.right for one in wrong)),
        "wrong files whose cause is named, part": sum(one.named for one in wrong) / len(wrong),
        "sound maps that end 1": float(sum(not one.right for one in sound)),
        "sound maps with a false cause": float(sum(one.named for one in sound)),
    }
