"""The default answer of `famjax fit MAP.csv`: never silently wrong between the readings, 0 N where slack.

Every map of `dense_truth.py` is fitted, judged and predicted by the bare commands, on a dense grid of
states inside the measured range. A state is wrong where the error is more than 3 half-widths of the
95 % band, or more than 10 % of the largest force and outside the band. A map is bad where a state is
wrong; it is silently wrong where moreover the verdict states no doubt and the state is said to be
inside. A verdict that doubts only because the rest length was not given states none: it says nothing
of the force.

Maps of others: READINGS.truth.csv beside READINGS.csv, with pressure_kPa,length_mm,force_N of states
inside the measured range. Other figures are nested: a choice is made anew without what it is judged on.
"""

import csv
import dataclasses
import functools
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from row import Case, command, tell

# isort: split
from dense_truth import Group, TruthMap, maps

import fitting
from fitting import Choice
from fitting.choice import NestedValidation, validate_choice
from fitting.prediction import static_rows
from fitting.series import identify_series

HALF_BANDS, PERCENT = 3.0, 10.0
"""Beyond these an answer is wrong: half-widths of its band; part of the largest force."""
BAND = 1.96  # standard deviations of a series on either side
FAR = (0.2, 0.4, 1.2)
"""Lengths, in parts of the rest length, at which no muscle with a braid can be."""


@dataclasses.dataclass(frozen=True)
class Examined:
    """A map whose answer was held against its truth.

    Attributes:
        map: the map.
        why: there is no answer at any state or at some; a refusal is not silent.
        rmse_percent, half_band_percent, coverage: means over the states at which truth or answer
            pulls, in % of the largest force and of the states whose band holds the truth.
        worst_half_bands: largest error there in half-widths of the band.
        bad, silent: as in the head of this file.
    """

    map: TruthMap
    why: str = ""
    rmse_percent: float = np.nan
    half_band_percent: float = np.nan
    coverage: float = np.nan
    worst_half_bands: float = np.nan
    bad: bool = False
    silent: bool = False

    def __str__(self) -> str:
        mark = "SILENT" if self.silent else "bad" if self.bad else ""
        return (
            f"{self.map.name:12} RMSE {self.rmse_percent:.2f} %, half-band {self.half_band_percent:.2f} %, "
            f"worst error {self.worst_half_bands:.2f} half-bands, {self.coverage:.0f} % covered {mark:6} "
            f"| {self.map.about} {self.why}"
        )


def default_fit(file: Path | str) -> fitting.Identification:
    """What bare `famjax fit` saves of a map, read back.

    Raises:
        InputError: the file is refused.
    """
    with tempfile.TemporaryDirectory() as folder:
        code, _, said = command("fit", file, "--output", folder)
        if code not in (0, 1):
            raise fitting.InputError(said)
        return fitting.load_fit(Path(folder) / "fit.json")


def answer(
    fit: fitting.Identification, length: np.ndarray, pressure: np.ndarray
) -> dict[str, np.ndarray]:
    """What `famjax predict` says at pairs of lengths [m] and pressures [Pa], shape (n,) each."""
    L, row_of = np.unique(length, return_inverse=True)
    rows = [
        row
        for k, at in enumerate(L)
        for row in fitting.predict(fit, np.array([at]), pressure[row_of == k])
    ]
    order = np.argsort(np.argsort(row_of, kind="stable"))
    return {
        name: np.array([row[name] for row in rows], float)[order]
        for name in ("force_N", "low_95_N", "high_95_N", "inside")
    }


def compared(
    one: TruthMap, truth: np.ndarray, found: dict[str, np.ndarray], saved: Mapping[str, Any]
) -> Examined:
    """An answer against the truth at the states of a map.

    A muscle that is slack reads 0: so does an answer below 0, and a band that reaches below.

    Args:
        one: the map.
        truth: at its states [N].
        found: what is predicted there, see `answer`.
        saved: document of the fit.
    """
    largest = saved["max_force_N"]
    force, low = np.maximum(found["force_N"], 0.0), np.maximum(found["low_95_N"], 0.0)
    high = found["high_95_N"]
    half, error = np.fmax(high - force, force - low), force - truth  # the end at 0 is nearer
    known = np.isfinite(error) & np.isfinite(half)
    pulls = known & ((truth > 0) | (force > 0))
    if not pulls.any():
        return Examined(one, "no answer at any state that pulls")
    percent = 100 * np.abs(error) / largest
    halves = np.divide(np.abs(error), half, where=known & (half > 0), out=np.zeros(half.size))
    covered = (low <= truth) & (truth <= np.maximum(high, 0.0))
    wrong = known & ((halves > HALF_BANDS) | ((percent > PERCENT) & ~covered))
    return Examined(
        one,
        "" if known.all() else f"no answer at {(~known).sum()} of {known.size} states",
        rmse_percent=float(100 * np.sqrt(np.mean(error[pulls] ** 2)) / largest),
        half_band_percent=float(100 * np.mean(half[pulls]) / largest),
        coverage=float(100 * np.mean(covered[pulls])),
        worst_half_bands=float(halves[pulls].max()),
        bad=bool(wrong.any()),
        silent=bool((wrong & (found["inside"] > 0)).any()) and not saved["reasons"],
    )


def examine(one: TruthMap) -> Examined:
    """A map, fitted and predicted; whatever ends its fit is told."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "map.csv"
            path.write_text(one.readings, encoding="utf-8")
            fit = default_fit(path)
        truth = one.force
        if truth is None:
            whole = answer(_whole(one.reference), one.length, one.pressure)
            truth = np.maximum(whole["force_N"], 0.0)
        return compared(one, truth, answer(fit, one.length, one.pressure), fit.document)
    except (ArithmeticError, LookupError, RuntimeError, TypeError, ValueError) as error:
        return Examined(one, f"{type(error).__name__}: {error}".splitlines()[0])


@functools.lru_cache
def _whole(name: str) -> fitting.Identification:
    """The fit of a whole bundled map with its lines."""
    return default_fit(name)


def dense(case: Case, group: Group | Literal["given"]) -> dict[str, float]:
    """Figures of a group of maps."""
    found = []
    for one in given_maps(case.paths) if group == "given" else maps(group):
        found.append(examine(one))
        tell(str(found[-1]))
    return summary(found)


def summary(found: Sequence[Examined]) -> dict[str, float]:
    """Counts, and means over the maps that have an answer."""
    answered = [one for one in found if np.isfinite(one.rmse_percent)]

    def values(name: str) -> list[float]:
        return [getattr(one, name) for one in answered] or [np.nan]

    return {
        "maps without an answer": float(len(found) - len(answered)),
        "silently wrong": float(sum(one.silent for one in found)),
        "bad": float(sum(one.bad for one in found)),
        "mean RMSE [%]": float(np.mean(values("rmse_percent"))),
        "mean half-band [%]": float(np.mean(values("half_band_percent"))),
        "mean coverage [%]": float(np.mean(values("coverage"))),
        "worst error [half-bands]": max(values("worst_half_bands")),
    }


def given_maps(paths: Sequence[str]) -> Iterator[TruthMap]:
    """Maps of others, see the head of this file.

    Raises:
        OSError, KeyError: the truth, or a column of it, is not there.
    """
    for path in map(Path, paths):
        with path.with_suffix(".truth.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
        L, P, F = (np.array([float(row[name]) for row in rows])
                   for name in ("length_mm", "pressure_kPa", "force_N"))  # fmt: skip
        text = path.read_text(encoding="utf-8")
        yield TruthMap("given", path.stem, 0, path.name, text, L / 1e3, P * 1e3, F)


def slack(case: Case) -> dict[str, float]:
    """What is said of a slack muscle, which pulls nothing: its readings, rest, and far lengths."""
    data, fit = case.map, default_fit(case.source)
    at, rest = data.slack, data.specimen.rest_length
    rows = static_rows(fit, data.length[at], data.pressure[at])
    (at_rest,) = fitting.predict(fit, np.array([rest]), np.zeros(1))
    far = fitting.predict(fit, rest * np.array(FAR), np.array([0.0, data.pressure.max()]))
    holds = [r["low_95_N"] is not None and r["low_95_N"] <= 0 <= r["high_95_N"] for r in rows]
    return {
        "slack readings without 0 N in their band": float(len(rows) - sum(holds)),
        "force at rest without pressure [N]": np.nan
        if (F := at_rest["force_N"]) is None
        else abs(F),
        "forces far beyond the braid's limits": float(sum(r["force_N"] is not None for r in far)),
    }


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Readings that were predicted: errors [N], whether inside the band, its full width [N]."""

    error: Float[np.ndarray, " n"]
    inside: Any
    width: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, parts: Sequence[Any]) -> "LeftOut":
        """All of several."""
        return cls(*(np.concatenate([getattr(one, field.name) for one in parts])
                     for field in dataclasses.fields(cls)))  # fmt: skip

    def figures(self) -> dict[str, float]:
        """Error, coverage and width."""
        rmse = float(np.sqrt(np.mean(self.error**2)))
        return {
            "RMSE [N]": rmse,
            "part of the readings inside the 95 % band": float(np.mean(self.inside)),
            "mean full width of the band / RMSE": float(np.mean(self.width)) / rmse,
        }


def choice(case: Case) -> Choice:
    """The choice of a map with no option."""
    return case.once("choice", lambda: fitting.choose(case.map))


def lengths_out(case: Case) -> NestedValidation:
    """Each length predicted by a choice that has not seen it."""
    return case.once("lengths out", lambda: validate_choice(choice(case), "length"))


def chosen(case: Case) -> dict[str, float]:
    """In sample."""
    return {"RMSE [N]": choice(case).chosen.errors.rmse}


def with_shape(case: Case) -> dict[str, float]:
    """The choice with the shape from mechanics among the families, beside the bare one."""
    bare, wide = choice(case), fitting.choose(case.map, ends="equilibrium")
    return {
        "held-out error / that of the bare choice": wide.tried[0].held_out / bare.tried[0].held_out
    }


def nested_lengths(case: Case) -> dict[str, float]:
    """Each length left out."""
    found = lengths_out(case)
    return {
        "RMSE on interior lengths [N]": found.interior_rmse,
        "part of the readings inside the 95 % band": found.covered,
    }


def nested_pressures(case: Case) -> dict[str, float]:
    """Each pressure left out."""
    return {"RMSE [N]": validate_choice(choice(case), "pressure").rmse}


def both_muscles(case: Case) -> dict[str, float]:
    """Every length of both bundled muscles left out in turn."""
    cases = [dataclasses.replace(case, source=n, name=n) for n in fitting.bundled_names()]
    return LeftOut.of([lengths_out(one) for one in cases]).figures()


def place(case: Case) -> dict[str, float]:
    """Where the choice stands in the league table by interior lengths left out."""
    names = [row.name for row in fitting.compare(case.map).rows]
    return {"place by RMSE, 1 for the first": 1.0 + names.index("famjax_choice")}


def series_out(case: Case) -> dict[str, float]:
    """Each specimen of a series predicted by a choice from the others."""
    found, every = [], case.series
    for out, data in enumerate(every):
        rest = identify_series([one for k, one in enumerate(every) if k != out])
        at, force = data.loaded, data.force[data.loaded]
        F, std = rest.predict(data.specimen.rest_length, data.length[at], data.pressure[at])
        found.append(LeftOut(F - force, np.abs(F - force) <= BAND * std, 2 * BAND * std))
    least = min(float(one.inside.mean()) for one in found)
    return LeftOut.of(found).figures() | {"least part of a specimen's readings inside": least}
