"""Commands of an identified muscle: `famjax predict`, `famjax card` and `famjax export`."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.units import (
    Quantity,
    Sentence,
    parse_quantities,
    parse_quantity,
    quantity_unit,
    sentence_in_units,
    unit_system,
)
from famjax.console import Units, add_cwd_to_path, in_units, print_json, print_rows

from .fit import load_fitting

if TYPE_CHECKING:
    from famjax.continuation import Region, SafeMuscle
    from famjax.export import Subject
    from fitting.saved import SavedFit

Target = Literal["c", "csv", "mat", "matlab", "python", "mujoco", "mjx", "jax"]
_US = {"in", "psi"}


def schema_of(path: Path) -> str:
    """The schema that a JSON file names; "" of any other file, whose reader says what is wrong."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(found.get("schema")) if isinstance(found, dict) else ""


def warn_unidentified(name: object, verdict: str | None, reasons: Sequence[str] | None) -> None:
    """Say on standard error that nothing was identified, where that is so."""
    from famjax.cards import unidentified

    doubt = unidentified(str(name), verdict, reasons)
    if doubt is not None:
        print(f"warning: {doubt}", file=sys.stderr)


def predict(
    muscle: str,
    *,
    length: tuple[str, ...] = (),
    pressure: tuple[str, ...] = (),
    force: tuple[str, ...] = (),
    onset: bool = False,
    rest_length: str | None = None,
    length_std: str | None = None,
    history: Path | None = None,
    own: tuple[str, ...] = (),
    units: Units | None = None,
    json_: bool = False,
) -> int:
    """Predict the force of a fitted muscle, and the pressure at which it begins to pull.

    Parameters
    ----------
    muscle
        A `fit.json` that `famjax fit` has written, a card of `famjax card`, or a bundled muscle, DMSP-10
        or DMSP-20. A card and a bundled muscle answer lengths with pressures and --onset, without
        error bands.
    length
        Active lengths with their unit, repeatable or separated by commas: `--length 270mm,250mm`.
    pressure
        Gauge pressures with their unit: `--pressure 500kPa`.
    force
        Forces with their unit, in the place of pressures: at which pressure the muscle pulls with
        them, up to the highest measured: `--force 200N`.
    onset
        Also the pressure at which the force leaves zero at each length.
    rest_length
        Of another muscle of the same series, its braid, bladder and end-fittings the same:
        `--rest-length 200mm`. From a fit of `famjax series` with an error band that knows how
        specimens differ; from a model that famjax fit chose, the mean of all accounts that its map
        cannot refute, with a wide one.
    length_std
        Standard deviation of the lengths, for the error band: `--length-std 0.5mm`.
    history
        CSV file of lengths and pressures in the order in which they come, such as
        `time_s,length_mm,pressure_kPa`: the force on either branch, of a fit assessed with --hysteresis.
    own
        A module that you trust, repeatable, with the classes of your own of which the file's muscle is
        made: `--own my_rubber`. Without it no module is imported that a file names.
    units
        Of the answer: si, metric (mm, kPa, N) or us (in, psi, lbf). The table has the units of the
        question unless given, and JSON has SI.
    json_
        Print one JSON list to standard output and nothing else there.
    """
    fitting = load_fitting()
    import numpy as np

    if own:
        add_cwd_to_path()
    if history is None and _is_card(muscle):
        others = {"--force": force, "--rest-length": rest_length, "--length-std": length_std}
        return _predict_by_card(
            muscle, length, pressure, units, others, onset=onset, as_json=json_, own=own
        )
    saved = fitting.load_fit(muscle, own=own)
    warn_unidentified(muscle, saved.document.get("verdict"), saved.document.get("reasons"))
    if history is not None:
        return _print_history(
            saved, history, units, as_json=json_,
            others={"length": length, "pressure": pressure, "onset": onset,
                    "rest-length": rest_length, "length-std": length_std},
        )  # fmt: skip
    lengths = np.array(parse_quantities(length, "length"))
    if force:
        if pressure or onset or rest_length is not None or length_std is not None:
            raise InputError(
                "--force asks for a pressure, and takes --length alone beside it: leave out --pressure, "
                "--onset, --rest-length and --length-std"
            )
        rows = fitting.prediction.pressures_for(
            saved, lengths, np.array(parse_quantities(force, "force"))
        )
    else:
        rows = fitting.predict(
            saved,
            lengths,
            np.array(parse_quantities(pressure, "pressure")),
            onset=onset,
            rest_length=None if rest_length is None else parse_quantity(rest_length, "length"),
            length_std=0.0 if length_std is None else parse_quantity(length_std, "length"),
        )
    asked = {**_answer_units(units, length, pressure)}
    if force and units is None:
        asked["force"] = quantity_unit(force[0])
    if json_:
        print_json(rows if units is None else in_units(rows, asked))
        return 0
    shown = in_units(rows, asked)
    for title, chosen in ({"Pressure": shown} if force else _force_and_onset(shown)).items():
        _print_answers(title, chosen, units)
    if not force:
        _print_notes(saved, other=rest_length is not None, forces=bool(pressure))
    return 0


def _print_notes(saved: "SavedFit", *, other: bool, forces: bool) -> None:
    """What a reader must know of the answers: of another rest length, with forces among them."""
    if saved.document.get("series_compliance_m_per_N"):
        print("note: force is what the rig of the fit measures, which gives way; muscle force "
              "that of the muscle alone")  # fmt: skip
    if other and saved.other_lengths:
        names = [one["family"] for one in saved.document["other_lengths"]["members"]]
        print("note: another rest length is predicted from one specimen, by the mean of all families "
              f"that its map cannot refute ({'; '.join(names)}); the 95 % band holds what they "
              "disagree by, and how specimens differ (famjax series knows more)")  # fmt: skip
    elif other and "series" not in saved.document:
        print("note: another rest length is predicted from one specimen, so there is no error band: "
              "it does not tell how specimens differ, nor a rig that gives way from a braid that "
              "does (famjax series does)")  # fmt: skip
    elif not other and "series" in saved.document:
        one = saved.document["data"]["specimen"]
        print(f"note: of {one['name']}, the first specimen of the series, with its rest length of "
              f"{1e3 * one['rest_length_m']:.4g} mm; --rest-length asks for another")  # fmt: skip
    elif forces and saved.error is not None and not other:
        print(f"note: the 95 % bands are of {saved.error.covers}")
    elif forces and not (saved.document.get("spread") or {}).get("directions"):
        print("note: no error band, as the fit has no standard errors")


def _print_history(
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
    from fitting.prediction import hysteresis_error, predict_history
    from fitting.records import read_history

    given = [f"--{name}" for name, value in others.items() if value]
    if given:
        raise InputError(
            f"--history gives lengths and pressures itself: leave out {', '.join(given)}"
        )
    moves = read_history(path)
    rows = predict_history(saved, moves)
    asked = _answer_units(units, *([f"1{moves.units[kind]}"] for kind in ("length", "pressure")))
    if as_json:
        print_json(rows if units is None else in_units(rows, asked))
        return 0
    _print_answers("Force along the history", in_units(rows, asked), units)
    if any(row["force_std_N"] is not None for row in rows):
        note = Sentence(
            "note: the 95 % band holds the error of the static map and that of the hysteresis, ",
            Quantity(hysteresis_error(saved), "force", 2),
            " RMS on what was left out"
            if saved.document["hysteresis"]["left_out"]
            else " RMS in sample",
        )
        print(sentence_in_units(note, units or "metric"))
    return 0


def _is_card(muscle: str) -> bool:
    """Whether this is a bundled muscle's name or the file of a card."""
    from famjax.muscles import bundled_name

    path = Path(muscle)
    if not path.exists():
        return bundled_name(muscle) is not None
    return schema_of(path).startswith("famjax-card/")


def _predict_by_card(
    muscle: str,
    length: Sequence[str],
    pressure: Sequence[str],
    units: str | None,
    others: Mapping[str, object],
    *,
    onset: bool,
    as_json: bool,
    own: Sequence[str],
) -> int:
    """Print the force of a card's safe muscle, and where it is not the model's own.

    Args:
        muscle: a file, or a bundled muscle's name.
        length: as typed.
        pressure: as typed.
        units: of the answer; those of the question unless given.
        others: options that a card does not answer, by name.
        onset: also answer it.
        as_json: instead of tables.
        own: modules that are trusted.
    """
    import numpy as np

    from famjax.cards import read_card
    from famjax.muscles import bundled_card

    asked = [name for name, value in others.items() if value]
    if asked:
        raise InputError(
            f"{', '.join(asked)} needs a fit: give the fit.json of famjax fit. Of a card or a bundled "
            "muscle famjax.control.pressure_for_force answers forces, and famjax export --length cuts it"
        )
    if not length or not (pressure or onset):
        raise InputError("give --length, and --pressure or --onset, with their units")
    card = read_card(muscle, own=own) if Path(muscle).exists() else bundled_card(muscle)
    warn_unidentified(muscle, card.provenance.verdict, card.provenance.reasons)
    safe = card.safe()
    L, P = (
        np.array(parse_quantities(length, "length")),
        np.array(parse_quantities(pressure, "pressure")),
    )
    rows: list[dict[str, Any]] = []
    if P.size:
        force, model = (np.asarray(ask(L[:, None], P)) for ask in (safe.force, safe.model_force))
        for i, j in np.ndindex(L.size, P.size):
            row = {"length_m": float(L[i]), "pressure_Pa": float(P[j]), "force_N": float(force[i, j]),
                   "model_force_N": float(model[i, j]), "slack": bool(force[i, j] <= 0)}  # fmt: skip
            impossible = _impossible(safe, float(L[i]))
            if impossible is not None:
                row |= {"force_N": None, "model_force_N": None, "slack": None}
            rows.append(row | _inside(impossible or _beyond(safe.region, float(L[i]), float(P[j]))))
    if onset:
        highest = float(safe.region.pressure[1])
        begins = np.asarray(safe.onset_pressure(L, highest, throw=False))
        for one, at in zip(L, begins, strict=True):
            impossible = _impossible(safe, one)
            none = impossible is not None or np.isnan(at)
            rows.append(
                {"length_m": float(one), "onset_pressure_Pa": None if none else float(at)}
                | _inside(impossible or _beyond(safe.region, one, at))
            )
    asked_units = _answer_units(units, length, pressure)
    if as_json:
        print_json(rows if units is None else in_units(rows, asked_units))
        return 0
    for title, chosen in _force_and_onset(in_units(rows, asked_units)).items():
        _print_answers(f"{title} of {card.name}", chosen, units)
    print("note: of a card; rows that are not inside are continued beyond the model's own region")
    return 0


def _impossible(safe: "SafeMuscle", length: float) -> Sentence | None:
    """Why no muscle has that length, or None."""
    lock, straight = (float(end) for end in safe.continued.stops)
    if length < lock:
        end = Quantity(lock, "length")
        return Sentence("the length is below the braid's lock, ", end)
    if length > straight:
        end = Quantity(straight, "length")
        return Sentence("the length is beyond the thread's, ", end)
    return None


def _beyond(region: "Region", length: float, pressure: float) -> Sentence | None:
    """Why a state is not the model's own, or None."""
    for value, kind in ((length, "length"), (pressure, "pressure")):
        low, high = (float(end) for end in getattr(region, kind))
        if not low <= value <= high:
            ends = Quantity(low, kind), " to ", Quantity(high, kind)
            return Sentence(f"the {kind} is beyond the model's own region, ", *ends)
    return None


def _inside(why: Sentence | None) -> dict[str, Any]:
    return {"inside": why is None, "outside": why}


def _answer_units(
    system: str | None, lengths: Sequence[str], pressures: Sequence[str]
) -> Mapping[str, str]:
    """Unit of each kind of quantity in the answer.

    Args:
        system: "si", "metric" or "us"; None for the units of the question.
        lengths: as they were typed, such as "270mm,250mm".
        pressures: the same.

    >>> _answer_units(None, ["10in"], ["5 bar"])
    {'length': 'in', 'pressure': 'bar', 'force': 'N'}
    >>> _answer_units(None, ["10in"], ["50psi"])["force"]
    'lbf'
    """
    if system is not None:
        return unit_system(system)
    length = quantity_unit(lengths[0])
    pressure = quantity_unit(pressures[0]) if pressures else "psi" if length == "in" else "kPa"
    force = "lbf" if {length, pressure} <= _US else "N"
    return {"length": length, "pressure": pressure, "force": force}


def _force_and_onset(rows: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The tables of a prediction by their titles: forces, and onset pressures; none is empty."""
    tables = {
        "Force": [row for row in rows if "slack" in row],
        "Onset": [row for row in rows if "slack" not in row],
    }
    return {title: chosen for title, chosen in tables.items() if chosen}


def _print_answers(title: str, rows: Sequence[Mapping[str, Any]], system: str | None) -> None:
    """A table of answers, with the model's force where some are slack, and why some are not inside."""
    slack = any(row.get("slack") for row in rows)
    hidden = ("outside",) if slack else ("outside", "model_force_")
    print_rows(title, [{k: v for k, v in row.items() if not k.startswith(hidden)} for row in rows])
    if slack:
        print("note: where the muscle is slack it pulls nothing; model force is what the model says "
              "there, not clipped")  # fmt: skip
    if not all(row["inside"] for row in rows):
        print("note: rows that are not inside lie beyond the fitted lengths or pressures:")
        for reason in dict.fromkeys(row["outside"] for row in rows if not row["inside"]):
            print(f"- {sentence_in_units(reason, system or 'metric')}")


def card(
    fit_json: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    name: str | None = None,
    sample: int = 32,
    own: tuple[str, ...] = (),
    json_: bool = False,
) -> int:
    """Write the muscle card of a fit: what a simulator, a controller or a colleague needs of it.

    A card holds the muscle, the lengths and pressures of the data, the volume of the fluid, the
    errors, a sample of muscles, the hysteresis where it was fitted, and where all of it comes from.
    `famjax.cards.read_card` reads it; its `safe()` may be taken beyond the data.

    Parameters
    ----------
    fit_json
        A `fit.json` that `famjax fit` has written.
    output
        The card's file; `card.json` beside the fit unless given.
    name
        Of the muscle; the specimen's unless given.
    sample
        Number of muscles drawn from the fit's errors, 0 for none.
    own
        A module that you trust, repeatable, with the classes of your own of which the file's muscle is
        made: `--own my_rubber`. Without it no module is imported that a file names.
    json_
        Print the card to standard output too, and nothing else there.
    """
    load_fitting()
    from famjax.boundary.files import Origin
    from famjax.cards import write_card
    from fitting.saved import card_of, load_fit

    if own:
        add_cwd_to_path()
    saved = load_fit(fit_json, own=own)
    found = card_of(saved, name=name, count=sample, origin=Origin.of_this_command())
    warn_unidentified(fit_json, found.provenance.verdict, found.provenance.reasons)
    path = write_card(found, fit_json.parent / "card.json" if output is None else output)
    if json_:
        print_json(json.loads(path.read_text(encoding="utf-8")))
        return 0
    print(f"{found.name}: {len(found.members)} model(s), RMSE {found.provenance.rmse_N:.3g} N")
    for note in found.safe().notes:
        print(f"note: {note}")
    if found.draws is None:
        print("note: no sample of muscles, as the fit has no standard errors or none was wanted")
    print(f"written: {path}")
    return 0


def export(
    muscle: str,
    *,
    to: tuple[Target, ...],
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("exported"),
    length: str | None = None,
    own: tuple[str, ...] = (),
) -> int:
    """Write a muscle as C, tables, MATLAB functions, or for a simulator.

    Each file's head says what muscle it is of, and its largest difference from the model, measured
    when it is written. Targets:

    c: C99 of force, stiffness and inverse pressure, for a microcontroller; double or float.

    csv, mat: tables of force, stiffness and area over length and pressure.

    matlab: functions for MATLAB, Octave and Simulink's MATLAB Function block.

    mujoco: XML of a load that hangs on the muscle, and the actuator's callback.

    mjx: the model itself inside MJX's step, to be differentiated; runs with famjax.

    jax: the model itself with its derivative as StableHLO; runs with JAX, without famjax.

    Parameters
    ----------
    muscle
        A card of `famjax card`, a `fit.json` of `famjax fit`, or a bundled muscle, DMSP-10 or DMSP-20.
    to
        A target; can be given several times.
    output
        Folder of the files.
    length
        Rest length to which the muscle is cut, with its unit, such as 300mm.
    own
        A module that you trust, repeatable, with the classes of your own of which the file's muscle is
        made: `--own my_rubber`. Without it no module is imported that a file names.
    """
    load_fitting()
    from famjax.export import export as export_to

    cut = None if length is None else parse_quantity(length, "length")
    if own:
        add_cwd_to_path()
    subject = _subject(muscle, cut, own)
    if subject.card is not None:
        made = subject.card.provenance
        warn_unidentified(muscle, made.verdict, made.reasons)
    for path in export_to(subject, to, output):
        print(f"written: {path}")
    return 0


def _subject(muscle: str, length: float | None, own: Sequence[str]) -> "Subject":
    """The muscle of a fit, of a card, or a bundled one."""
    from famjax.boundary.files import Origin
    from famjax.export import Subject, made_of, read_subject

    origin, path = Origin.of_this_command(), Path(muscle)
    if not schema_of(path).startswith("famjax-fit/"):
        return read_subject(muscle, length=length, origin=origin, own=own)
    from fitting.saved import card_of, load_fit

    card = card_of(load_fit(path, own=own), count=0, origin=origin)
    return Subject.of_card(
        card, length=length, origin=made_of(path.name, path.read_bytes(), origin)
    )
