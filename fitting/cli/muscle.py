"""Commands of an identified muscle: `famjax predict`, `famjax card` and `famjax export`."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from famjax.boundary import sentence
from famjax.boundary.errors import InputError
from famjax.boundary.units import (
    parse_quantities,
    parse_quantity,
    quantity_unit,
    unit_system,
)
from famjax.console import Units, add_cwd_to_path, in_units, print_json, print_rows

from .fit import load_fitting

if TYPE_CHECKING:
    from famjax.continuation import SafeMuscle
    from famjax.export import Subject
    from fitting.saved import SavedFit

Target = Literal["c", "csv", "mat", "matlab", "mujoco", "mjx", "jax"]
_US = {"in", "psi"}


def schema_of(path: Path) -> str:
    """The schema that a JSON file names; "" of any other file, whose reader says what is wrong."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(found.get("schema")) if isinstance(found, dict) else ""


def warn_unidentified(name: object, verdict: str | None, reasons: Sequence[str] | None) -> None:
    """Warn on standard error if nothing was identified."""
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
        Read this `fit.json` of `famjax fit`, this card of `famjax card`, or a bundled muscle (DMSP-10,
        DMSP-20). Cards and bundled muscles have no error bands.
    length
        Predict at these active lengths, with units, repeatable or separated by commas:
        `--length 270mm,250mm`.
    pressure
        Predict at these gauge pressures, with units: `--pressure 500kPa`.
    force
        Find the pressure at which the muscle pulls with these forces, up to the highest measured
        pressure: `--force 200N`.
    onset
        Find the pressure at which the force leaves zero at each length.
    rest_length
        Predict another muscle of the same series with this rest length: `--rest-length 200mm`. A fit of
        `famjax series` knows how specimens differ; a fit of one muscle gives a wide error band.
    length_std
        State the standard deviation of the lengths, for the error band: `--length-std 0.5mm`.
    history
        Predict the force on either branch along a CSV file of lengths and pressures in time, such as
        `time_s,length_mm,pressure_kPa`. The fit needs `famjax assess --hysteresis`.
    own
        Trust a module with your own classes, repeatable: `--own my_rubber`. A file imports no other module.
    units
        Choose the units of the answer: si, metric (mm, kPa, N) or us (in, psi, lbf); default: those of
        the question in tables, SI in JSON.
    json_
        Print one JSON list and nothing else.
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
                "--force asks for a pressure and needs --length alone: leave out --pressure, --onset, "
                "--rest-length and --length-std"
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
    document, notes = saved.document, []
    if document.get("series_compliance_m_per_N"):
        notes.append(
            "force is what the compliant rig measures; muscle force is that of the muscle alone"
        )
    if other and saved.other_lengths:
        names = "; ".join(one["family"] for one in document["other_lengths"]["members"])
        notes.append(
            f"another rest length is predicted from one specimen, by the mean of all models that its map "
            f"cannot reject ({names}). The 95 % band holds their disagreement and how specimens differ; "
            "famjax series knows more"
        )
    elif other and "series" not in document:
        notes.append(
            "another rest length is predicted from one specimen, so there is no error band. Use famjax "
            "series to learn how specimens differ"
        )
    elif not other and "series" in document:
        one = document["data"]["specimen"]
        notes.append(
            f"this is {one['name']}, the first specimen of the series, of rest length "
            f"{1e3 * one['rest_length_m']:.4g} mm; --rest-length asks for another"
        )
    elif forces and saved.error is not None and not other:
        notes.append(f"the 95 % bands are of {saved.error.covers}")
    elif forces and not (document.get("spread") or {}).get("directions"):
        notes.append("there is no error band, as the fit has no standard errors")
    for note in notes:
        print(f"note: {note}")


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
        error = sentence.Quantity(hysteresis_error(saved), "force", 2).in_units(units or "metric")
        held_out = "held-out" if saved.document["hysteresis"]["left_out"] else "in-sample"
        print(f"note: the 95 % band holds the error of the static map and the {held_out} error of the "
              f"hysteresis, {error} RMS")  # fmt: skip
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
            f"{', '.join(asked)} needs a fit: give the fit.json of famjax fit. For a card or a bundled "
            "muscle use famjax.control.pressure_for_force for forces and famjax export --length to cut it"
        )
    if not length or not (pressure or onset):
        raise InputError("give --length, and --pressure or --onset, with their units")
    card = read_card(muscle, own=own) if Path(muscle).exists() else bundled_card(muscle)
    warn_unidentified(muscle, card.provenance.verdict, card.provenance.reasons)
    safe = card.safe()
    L = np.array(parse_quantities(length, "length"))
    P = np.array(parse_quantities(pressure, "pressure"))
    rows: list[dict[str, Any]] = []
    if P.size:
        force, model = (np.asarray(ask(L[:, None], P)) for ask in (safe.force, safe.model_force))
        for i, j in np.ndindex(L.size, P.size):
            row = {"length_m": float(L[i]), "pressure_Pa": float(P[j])}
            pull = {"force_N": float(force[i, j]), "model_force_N": float(model[i, j]),
                    "slack": bool(force[i, j] <= 0)}  # fmt: skip
            why, possible = _outside(safe, row)
            row |= pull if possible else dict.fromkeys(pull)
            rows.append(row | {"inside": why is None, "outside": why})
    if onset:
        begins = np.asarray(safe.onset_pressure(L, float(safe.region.pressure[1]), throw=False))
        for one, at in zip(L.tolist(), begins.tolist(), strict=True):
            why, possible = _outside(safe, {"length_m": one, "pressure_Pa": at})
            known = at if possible and not np.isnan(at) else None
            row = {"length_m": one, "onset_pressure_Pa": known}
            rows.append(row | {"inside": why is None, "outside": why})
    asked_units = _answer_units(units, length, pressure)
    if as_json:
        print_json(rows if units is None else in_units(rows, asked_units))
        return 0
    for title, chosen in _force_and_onset(in_units(rows, asked_units)).items():
        _print_answers(f"{title} of {card.name}", chosen, units)
    print("note: rows that are not inside are continued beyond the region of the card's model")
    return 0


def _outside(safe: "SafeMuscle", row: Mapping[str, float]) -> tuple[sentence.Sentence | None, bool]:
    """Why a state is not the model's own, or None; and whether a muscle can have that length."""
    length, (lock, straight) = row["length_m"], map(float, safe.continued.stops)
    for beyond, text, end in (
        (length < lock, "the length is below the braid's lock, ", lock),
        (length > straight, "the length is beyond the thread's, ", straight),
    ):
        if beyond:
            return sentence.Sentence(text, sentence.Quantity(end, "length")), False
    for value, kind in ((length, "length"), (row["pressure_Pa"], "pressure")):
        low, high = (float(end) for end in getattr(safe.region, kind))
        if not low <= value <= high:
            ends = sentence.Quantity(low, kind), " to ", sentence.Quantity(high, kind)
            return sentence.Sentence(f"the {kind} is beyond the model's own region, ", *ends), True
    return None, True


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
        print("note: a slack muscle pulls nothing; model force is the model's own value there")
    if not all(row["inside"] for row in rows):
        print("note: rows that are not inside lie beyond the fitted lengths or pressures:")
        for reason in dict.fromkeys(row["outside"] for row in rows if not row["inside"]):
            print(f"- {sentence.in_units(reason, system or 'metric')}")


def card(
    fit_json: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    name: str | None = None,
    sample: int = 32,
    own: tuple[str, ...] = (),
    json_: bool = False,
) -> int:
    """Write the muscle card of a fit: one file for a simulator, a controller or a colleague.

    A card holds the muscle, the range of the data, the fluid volume, the errors, a sample of muscles, the
    hysteresis if it was fitted, and the origin of all of it. `famjax.cards.read_card` reads it; the
    muscle of its `safe()` can be used beyond the data.

    Parameters
    ----------
    fit_json
        Read this `fit.json` of `famjax fit`.
    output
        Write this file; default: `card.json` beside the fit.
    name
        Name the muscle; default: the name of the specimen.
    sample
        Draw this number of muscles from the fit's errors; 0 for none.
    own
        Trust a module with your own classes, repeatable: `--own my_rubber`. A file imports no other module.
    json_
        Print the card as JSON and nothing else.
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
        print(
            "note: the card has no sample of muscles: the fit has no standard errors, or --sample is 0"
        )
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

    The head of each file names its muscle and its largest difference from the model. Targets:

    c: C99 of force, stiffness and inverse pressure, for a microcontroller; double or float.

    csv, mat: tables of force, stiffness and area over length and pressure.

    matlab: functions for MATLAB, Octave and Simulink's MATLAB Function block.

    mujoco: XML of a load that hangs on the muscle, and the actuator's callback.

    mjx: the model inside MJX's step, differentiable; runs with famjax.

    jax: the model with its derivative as StableHLO; runs with JAX, without famjax.

    Parameters
    ----------
    muscle
        Read this card of `famjax card`, this `fit.json` of `famjax fit`, or a bundled muscle (DMSP-10,
        DMSP-20).
    to
        Choose a target, repeatable.
    output
        Write the files to this folder; it is created if missing.
    length
        Cut the muscle to this rest length, with its unit, such as 300mm.
    own
        Trust a module with your own classes, repeatable: `--own my_rubber`. A file imports no other module.
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
