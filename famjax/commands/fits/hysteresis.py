"""What `famjax fit --hysteresis` and `famjax predict --history` add to their commands."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..loading import with_tolerances

if TYPE_CHECKING:
    from fitting import ForceData
    from fitting.evidence import Evidence
    from fitting.hysteresis import BranchPairs
    from fitting.saved import SavedFit


def one_map(data: Sequence[str]) -> str:
    """The force map that a fit without hysteresis takes.

    Raises:
        InputError: there are several.
    """
    from famjax.boundary.errors import InputError

    if len(data) != 1:
        raise InputError(
            f"a fit takes one force map, got {len(data)}: {', '.join(data)}. Several muscles of one "
            "series: famjax series; raw ramps of one muscle: --hysteresis"
        )
    return data[0]


def load_ramps(
    entries: Sequence[str],
    specimen: dict,
    *,
    atmosphere: str | None,
    columns: str | None,
    pressure: str | None = None,
    length: str | None = None,
) -> tuple["ForceData", "BranchPairs"]:
    """The static map of raw ramps and both of their branches.

    Args:
        entries: records with their lengths, or a list of them, as `famjax ramps` takes them.
        specimen: fields in SI.
        atmosphere: what the pressure sensor reads at atmosphere, or the vented interval.
        columns: of the records, where their header has none.
        pressure: readings of the map nearer than this are at one pressure, with its unit.
        length: the same of lengths.

    Raises:
        InputError: what is wrong with entries or records, or an option that they need.
    """
    from famjax.boundary.errors import InputError
    from fitting.ramps import (
        parse_atmosphere,
        quasi_static,
        ramp_data,
        ramp_pairs,
        ramp_specimen,
        read_ramps,
        static_map,
    )

    if atmosphere is None:
        raise InputError(
            "--hysteresis reads raw ramps, and needs --atmosphere: what their pressure sensor reads "
            "at atmosphere (8.94kPa), or the interval in which the muscle is vented (0s:0.5s)"
        )
    muscle = ramp_specimen(specimen)
    points = quasi_static(
        read_ramps(entries, columns=columns), atmosphere=parse_atmosphere(atmosphere)
    )
    data = ramp_data(static_map(points), muscle)
    pairs = ramp_pairs(points, rest_length=data.specimen.rest_length)
    return with_tolerances(data, pressure=pressure, length=length), pairs


def with_hysteresis(evidence: "Evidence", pairs: "BranchPairs") -> "Evidence":
    """The evidence of a fit, and with it the hysteresis of its branches, tested on those left out."""
    from fitting.hysteresis import fit_hysteresis, leave_out

    return dataclasses.replace(evidence, hysteresis=leave_out(fit_hysteresis(pairs)))


def print_history(
    saved: "SavedFit",
    path: Path,
    units: str | None,
    *,
    as_json: bool,
    others: Mapping[str, object],
) -> int:
    """Predict the force along the history in a CSV file, as a table or as JSON.

    Args:
        saved: of a fit with hysteresis.
        path: of the file.
        units: of the answer; those of the file unless given, and SI of JSON.
        as_json: a JSON list instead of the table.
        others: options that a history leaves no room for, by name.

    Raises:
        InputError: another option is given, or what `read_history` and `predict_history` refuse.
    """
    from famjax.boundary.errors import InputError
    from famjax.boundary.sentence import Quantity, Sentence, in_units as in_words
    from famjax.commands.options.answers import (
        answer_units,
        in_units,
        print_answers,
        print_as_json,
    )
    from fitting.hysteresis import read_history
    from fitting.prediction import hysteresis_error, predict_history

    given = [f"--{name}" for name, value in others.items() if value]
    if given:
        raise InputError(
            f"--history gives lengths and pressures itself: leave out {', '.join(given)}"
        )
    moves = read_history(path)
    rows = predict_history(saved, moves)
    asked = answer_units(units, *([f"1{moves.units[kind]}"] for kind in ("length", "pressure")))
    if as_json:
        print_as_json(rows, units, asked)
        return 0
    print_answers("Force along the history", in_units(rows, asked), units)
    if any(row["force_std_N"] is not None for row in rows):
        note = Sentence(
            "note: the 95 % band holds the error of the static map and that of the hysteresis, ",
            Quantity(hysteresis_error(saved), "force", 2),
            " RMS on what was left out"
            if saved.document["hysteresis"]["left_out"]
            else " RMS in sample",
        )
        print(in_words(note, units or "metric"))
    return 0
