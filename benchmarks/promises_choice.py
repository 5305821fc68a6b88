"""Promises of a model that chooses itself: what it predicts of readings kept from it, and its bands.

Each figure is nested: the choice is made anew without the readings that it is judged on.
"""

import dataclasses
import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from promise import Case, Cost, Promise, shown
from promises_fits import A1, A2, LOADED

import fitting
from fitting import Choice, ForceData, load_fit, predict
from fitting.choice import NestedValidation, identify_series, validate_choice
from fitting.saved import fit_as_dict

BAND = 1.96  # standard deviations of a series on either side
_SERIES = "a series"
_PAIR = "two specimens"


def chosen(case: Case) -> Choice:
    """The choice of a map with no option."""
    return case.once("chosen", lambda: fitting.choose(case.map))


def nested(case: Case, groups: str) -> NestedValidation:
    """Each pressure, or each length, predicted by a choice that has not seen it."""
    return case.once(("nested", groups), lambda: validate_choice(chosen(case), groups))


def pressures_out(case: Case) -> float:
    """RMSE [N] on each pressure."""
    return nested(case, "pressure").rmse


def interior_lengths_out(case: Case) -> float:
    """RMSE [N] on each length between the first and the last."""
    return nested(case, "length").interior_rmse


def covered(case: Case) -> float:
    """Part of the readings of lengths left out that are inside their 95 % bands."""
    return nested(case, "length").covered


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Readings that were predicted: errors, whether inside the band, its full width [N]."""

    error: Float[np.ndarray, " n"]
    inside: Bool[np.ndarray, " n"]
    width: Float[np.ndarray, " n"]

    @property
    def rmse(self) -> float:
        """Over all readings [N]."""
        return float(np.sqrt(np.mean(self.error**2)))


def both_muscles(case: Case) -> LeftOut:
    """Every length of both bundled muscles left out in turn."""

    def compute() -> LeftOut:
        cases = [dataclasses.replace(case, data=fitting.load_bundled(n), name=n) for n in (A1, A2)]
        found = [nested(one, "length") for one in cases]
        return LeftOut(
            *(np.concatenate([getattr(one, name) for one in found])
              for name in ("error", "inside", "width"))
        )  # fmt: skip

    return case.once("both muscles", compute)


def specimens_out(case: Case) -> list[LeftOut]:
    """Each specimen of a series predicted by a choice from the others."""

    def predicted(out: int) -> LeftOut:
        data = case.series[out]
        rest = identify_series([one for k, one in enumerate(case.series) if k != out])
        at, force = data.loaded, data.force[data.loaded]
        found, std = rest.predict(data.specimen.rest_length, data.length[at], data.pressure[at])
        error = found - force
        return LeftOut(error, np.abs(error) <= BAND * std, 2 * BAND * std)

    return case.once("specimens out", lambda: [predicted(k) for k in range(len(case.series))])


def pooled(case: Case) -> LeftOut:
    """All specimens that were left out."""
    found = specimens_out(case)
    return LeftOut(
        *(np.concatenate([getattr(one, name) for one in found])
          for name in ("error", "inside", "width"))
    )  # fmt: skip


def from_the_other(case: Case) -> LeftOut:
    """Each of two specimens of different lengths predicted from the fit of the other.

    A prediction without a band covers nothing, and its width is not a number.
    """

    def predicted(seen: ForceData, other: ForceData) -> list[tuple[float, bool, float]]:
        choice = fitting.choose(seen)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "fit.json"
            path.write_text(json.dumps(fit_as_dict(choice.chosen, choice=choice)), encoding="utf-8")
            fit = load_fit(path)
        found = []
        for length in np.unique(other.length[other.loaded]):
            at = other.loaded & (other.length == length)
            rows = predict(
                fit, np.array([length]), other.pressure[at],
                rest_length=other.specimen.rest_length,
            )  # fmt: skip
            for row, force in zip(rows, other.force[at], strict=True):
                band = [np.nan if (end := row[f"{side}_95_N"]) is None else end
                        for side in ("low", "high")]  # fmt: skip
                inside = band[0] <= force <= band[1]
                found.append((row["force_N"] - force, inside, band[1] - band[0]))
        return found

    def compute() -> LeftOut:
        one, other = case.series
        found = [*predicted(one, other), *predicted(other, one)]
        return LeftOut(*(np.array(column) for column in zip(*found, strict=True)))

    return case.once("from the other", compute)


def _row(name: str, measure: Callable[[Case], float], data: str, statistic: str, limit: float,
         direction: str = "at most", cost: Cost = "minutes", *, of_its_data: bool = False,
         command: str = "famjax assess FIT.json --validate", part: str = LOADED) -> Promise:  # fmt: skip
    return Promise(
        14, name, measure, command, data, part, statistic, limit,
        "at least" if direction == "at least" else "at most", seed=0, cost=cost,
        of_its_data=of_its_data,
    )  # fmt: skip


def _muscles() -> list[Promise]:
    found = []
    for data, rmse, pressure, length in ((A1, 4.0, 4.2, 11.0), (A2, 1.25, 1.55, 8.0)):
        found += [
            _row("no option", lambda case: chosen(case).chosen.errors.rmse, data, "RMSE [N]", rmse,
                 of_its_data=True, command="famjax fit MAP.csv"),
            _row("no option, one pressure out", pressures_out, data, "RMSE [N]", pressure,
                 of_its_data=True, cost="long"),
            _row("no option, one interior length out", interior_lengths_out, data, "RMSE [N]",
                 length, of_its_data=True),
            _row("95 % band, each length left out", covered, data, "part of the readings inside",
                 0.8, "at least"),
        ]  # fmt: skip
    return found


_BOTH = "both bundled maps"
_ONE_OUT = "loaded readings of every length, while it was left out"
_OUT = "loaded readings of every specimen, while it was left out"
_OF_PAIR = "famjax fit MAP.csv, and predict --rest-length of the other"
_OF_SERIES = "famjax series MAPS, and predict --rest-length of the one that is not among them"

CHOICE: tuple[Promise, ...] = (
    *_muscles(),
    _row("95 % band, lengths of both muscles", lambda case: float(both_muscles(case).inside.mean()),
         _BOTH, "part of the readings inside", 0.88, "at least", part=_ONE_OUT),
    _row("95 % band, lengths of both muscles, not too wide",
         lambda case: float(both_muscles(case).inside.mean()), _BOTH, "part of the readings inside",
         0.99, part=_ONE_OUT),
    _row("95 % band, its width", lambda case: float(
             both_muscles(case).width.mean() / both_muscles(case).rmse), _BOTH,
         "mean full width / RMSE", 8.0, part=_ONE_OUT),
    *(_row("no option, raw ramps", lambda case: chosen(case).chosen.errors.rmse, data, "RMSE [N]", 2.3,
           of_its_data=True, command="famjax ramps ... && famjax fit famjax-ramps/map.csv")
      for data in ("bpa10 10cm", "bpa10 30cm")),
    _row("one specimen from another", lambda case: from_the_other(case).rmse, _PAIR, "RMSE [N]",
         12.0, command=_OF_PAIR, part="loaded readings of either, predicted from the other"),
    _row("one specimen from another, 95 % band",
         lambda case: float(from_the_other(case).inside.mean()), _PAIR,
         "part of the readings inside", 0.88, "at least", command=_OF_PAIR,
         part="loaded readings of either, predicted from the other"),
    _row("a series with no option", lambda case: pooled(case).rmse, _SERIES, "RMSE [N]", 20.0,
         part=_OUT, command=_OF_SERIES),
    _row("a series, 95 % band", lambda case: float(pooled(case).inside.mean()), _SERIES,
         "part of the readings inside", 0.85, "at least", part=_OUT, command=_OF_SERIES),
    _row("a series, 95 % band of each specimen",
         lambda case: min(float(one.inside.mean()) for one in specimens_out(case)), _SERIES,
         "least part of a specimen's readings inside", 0.7, "at least", part=_OUT,
         command=_OF_SERIES),
    _row("a series, width of the band",
         lambda case: float(pooled(case).width.mean() / pooled(case).rmse), _SERIES,
         "mean full width / RMSE", 4.0, part=_OUT, command=_OF_SERIES),
    *(shown(14, f"hysteresis, one {out} left out", "famjax assess FIT.json --hysteresis",
            "RMS error of the half-difference / its measured RMS", 0.6)
      for out in ("record", "length")),
)  # fmt: skip
"""Issue 14: choice and bands. The series is given by `--data 'a series=FOLDER'`,
the two specimens by `--data 'two specimens=FOLDER'`."""
