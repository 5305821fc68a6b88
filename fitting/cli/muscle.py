"""Commands for an identified muscle: `famjax predict`, `famjax card` and `famjax export`."""

import dataclasses
import itertools
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.units import (
    finite_or_none,
    parse_quantities,
    parse_quantity,
    sentence_in_units,
    unit_system,
)
from famjax.console import (
    Columns,
    Units,
    add_cwd_to_path,
    in_units,
    parse_columns,
    print_json,
    print_rows,
    progress,
)

from .fit import load_fitting

if TYPE_CHECKING:
    from famjax.export import Subject
    from fitting import Identification

Target = Literal["c", "fmu", "csv", "mat", "matlab", "python", "mujoco", "mjx"]


def is_fit(muscle: str) -> bool:
    """Return whether a file contains a fit; any other file or name is treated as a card."""
    path = Path(muscle)
    return path.is_file() and b'"famjax-fit/' in path.read_bytes()[:99]


def warn_unidentified(name: object, verdict: str | None, reasons: Sequence[str] | None) -> None:
    """Print a warning to standard error if no muscle was identified."""
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
    history: Path | None = None,
    column: Columns = (),
    own: tuple[str, ...] = (),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Predict the force of a fitted muscle, and the pressure at which it begins to pull.

    Parameters
    ----------
    muscle
        Use this `fit.json` written by `famjax fit` or `famjax series`, this card, or this bundled muscle. A
        card has no error bands.
    length
        Predict at these active lengths, with units, repeated or separated by commas, as in
        `--length 270mm,250mm`.
    pressure
        Predict at these gauge pressures, with units, as in `--pressure 500kPa`.
    force
        Find the pressure at which the muscle pulls with each of these forces, up to the highest measured
        pressure, as in `--force 200N`.
    onset
        Find the pressure at which the force rises above zero at each length.
    rest_length
        Predict another muscle of the same series with this rest length, as in `--rest-length 200mm`. The
        error band is wide if one muscle was fitted; `famjax series` also estimates how specimens differ.
    history
        Predict the force, with hysteresis, for the sequence of lengths and pressures in this CSV file, with
        columns such as `time_s,length_mm,pressure_kPa`. First run `famjax assess --hysteresis` on the fit.
    column
        Assign an unrecognised column to its quantity (repeatable), as in `length="Weg [mm]"`.
    own
        Trust this module, which contains your own classes (repeatable), as in `--own my_rubber`. Other
        modules are not imported.
    units
        Choose the units for the tables: si, metric (mm, kPa, N) or us (in, psi, lbf).
    json_
        Print one JSON list in SI units and nothing else.
    """
    fitting = load_fitting()
    import numpy as np

    if own:
        add_cwd_to_path()
    options = {"--length": length, "--pressure": pressure, "--force": force, "--onset": onset,
               "--rest-length": rest_length, "--history": history}  # fmt: skip
    given = [name for name, value in options.items() if value]
    L, P, F = (
        np.array(parse_quantities(typed, kind))
        for typed, kind in ((length, "length"), (pressure, "pressure"), (force, "force"))
    )
    saved, heading, notes = None, "Force", list[str]()
    if not _is_card(muscle):
        saved = fitting.load_fit(muscle, own=own)
        warn_unidentified(muscle, saved.document.get("verdict"), saved.document.get("reasons"))
    if saved is None:
        _only(
            given,
            ("--length", "--pressure", "--onset"),
            "a card does not support {}: use a fit.json",
        )
        rows, heading = _by_card(muscle, L, P, own, onset=onset)
    elif history is not None:
        _only(given, ("--history",), "the history file defines the lengths and pressures: omit {}")
        heading = "Force along the history"
        rows, notes = _along(saved, history, parse_columns(column), units)
    elif force:
        _only(given, ("--length", "--force"), "--force can only be combined with --length: omit {}")
        rows, heading = fitting.prediction.pressures_for(saved, L, F), "Pressure"
        notes = ["for the error band of the force, predict the force at this pressure"]
    else:
        rest = None if rest_length is None else parse_quantity(rest_length, "length")
        rows = fitting.predict(saved, L, P, onset=onset, rest_length=rest)
        notes = _notes(saved, other=rest is not None, forces=bool(pressure))
    if json_:
        print_json(rows)
        return 0
    shown = in_units(rows, unit_system(units))
    pulls = [row for row in shown if force or "slack" in row]
    if pulls:
        _print_answers(heading, pulls, units)
    if len(pulls) < len(shown):
        _print_answers("Onset", shown[len(pulls) :], units)
    for note in notes:
        print(f"note: {note}")
    return 0


def _only(given: Sequence[str], allowed: Sequence[str], message: str) -> None:
    """Raise InputError with a message that lists the options that are not allowed, if any."""
    if others := [name for name in given if name not in allowed]:
        raise InputError(message.format(", ".join(others)))


def _is_card(muscle: str) -> bool:
    """Return whether the argument is the name of a bundled muscle or the path of a card."""
    from famjax.muscles import bundled_name

    path = Path(muscle)
    if path.is_file():
        return b'"famjax-card/' in path.read_bytes()[:99]
    return not path.exists() and bundled_name(muscle) is not None


def _by_card(
    muscle: str, lengths: Any, pressures: Any, own: Sequence[str], *, onset: bool
) -> tuple[list[dict[str, Any]], str]:
    """Return rows from a card's safe muscle at all lengths [m] and pressures [Pa], and their heading."""
    from famjax.muscles import open_card

    if not lengths.size or not (pressures.size or onset):
        raise InputError("specify --length, and --pressure or --onset, with their units")
    card = open_card(muscle, own=own)
    warn_unidentified(muscle, card.provenance.verdict, card.provenance.reasons)
    safe, region = card.safe(), card.region
    lock, straight = map(float, safe.continued.stops)

    def row(length: float, kind: str, pressure: float, answer: dict[str, Any]) -> dict[str, Any]:
        (short, long), (low, high) = region.length, region.pressure
        found, outside = {"length_m": length, kind: finite_or_none(pressure), **answer}, None
        if not lock <= length <= straight:
            found |= dict.fromkeys(answer or (kind,))
            outside = (
                f"the braid can only reach lengths of {lock * 1e3:.6g} to {straight * 1e3:.6g} mm"
            )
        elif not short <= length <= long:
            outside = f"the model covers only lengths of {short * 1e3:.6g} to {long * 1e3:.6g} mm"
        elif not low <= pressure <= high:
            outside = f"the model covers only pressures of {low / 1e3:.6g} to {high / 1e3:.6g} kPa"
        return found | {"inside": outside is None, "outside": outside}

    rows = []
    for length, pressure in itertools.product(lengths.tolist(), pressures.tolist()):
        pull, model = (float(of(length, pressure)) for of in (safe.force, safe.model_force))
        answer = {"force_N": pull, "model_force_N": model, "slack": pull <= 0}
        rows.append(row(length, "pressure_Pa", pressure, answer))
    if onset:
        begins = safe.onset_pressure(lengths, float(region.pressure[1]), throw=False)
        for length, pressure in zip(lengths.tolist(), begins.tolist(), strict=True):
            rows.append(row(length, "onset_pressure_Pa", pressure, {}))
    return rows, f"Force of {card.name}"


def _notes(saved: "Identification", *, other: bool, forces: bool) -> list[str]:
    """Return notes on predictions; `other`: for another rest length; `forces`: they include forces."""
    document, notes = saved.document, []
    if document.get("series_compliance_m_per_N"):
        notes.append(
            "the force is that of the muscle in its compliant rig, as in the readings; lengths include the "
            "deflection of the rig"
        )
    if other and "series" not in document:
        names = "; ".join(saved.outlook.other_lengths)
        band = "there is no error band, because famjax fit was given a law, a deadband or a rig"
        if names:
            band = (
                f"the force is the mean over all models that fit its force map ({names}), and the "
                "error band is their spread"
            )
        notes.append(
            "this prediction for another rest length is based on one specimen: "
            f"{band}. To base it on several specimens, use famjax series"
        )
    elif "series" in document and not other:
        one = document["data"]["specimen"]
        notes.append(
            f"the prediction is for {one['name']}, the first specimen of the series, with a rest length of "
            f"{1e3 * one['rest_length_m']:.4g} mm; choose another rest length with --rest-length"
        )
    elif forces and not other:
        error = saved.outlook.error
        if error is not None:
            notes.append(f"the 95 % bands cover {error.covers}")
        elif document["spread"]["directions"]:
            notes.append(
                "the bands are too narrow, because they include only the standard errors and not the model "
                "error: use a fit written by famjax fit, which includes held-out errors"
            )
        else:
            notes.append("there is no error band, because the fit has no standard errors")
    return notes


def _along(
    saved: "Identification", path: Path, columns: Mapping[str, str], system: str
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return rows along the history in a CSV file, and notes."""
    from fitting.prediction import predict_history
    from fitting.records import read_history

    rows = predict_history(saved, read_history(path, columns))
    if all(row["force_std_N"] is None for row in rows):
        return rows, []
    error = sentence_in_units(f"{saved.outlook.branches_error:.2g} N", system)
    held_out = "held-out" if saved.document["hysteresis"]["left_out"] else "in-sample"
    return rows, [f"the 95 % band includes the error of the static map and the {held_out} error of the "
                  f"hysteresis model, {error} RMS"]  # fmt: skip


def _print_answers(title: str, rows: Sequence[Mapping[str, Any]], system: str) -> None:
    """Print a table of predictions, with notes on slack states and states outside the region."""
    slack = any(row.get("slack") for row in rows)
    hidden = ("outside",) if slack else ("outside", "model_force_")
    print_rows(title, [{k: v for k, v in row.items() if not k.startswith(hidden)} for row in rows])
    if slack:
        print("note: the force of a slack muscle is zero; model force is the value before clipping")
    if not all(row["inside"] for row in rows):
        print("note: where inside is False, the state is outside the fitted lengths or pressures:")
        for reason in dict.fromkeys(row["outside"] for row in rows if not row["inside"]):
            print(f"- {sentence_in_units(reason, system)}")


def card(
    fit_json: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    name: str | None = None,
    sample: int = 32,
    without_rig: bool = False,
    own: tuple[str, ...] = (),
) -> int:
    """Write a fit as a muscle card: one file for a simulator, a controller or a colleague.

    A card contains the muscle, the range of the data, the fluid volume, the errors, muscles sampled from
    the uncertainty, the hysteresis if fitted, and the origin of the data. Read it with
    `famjax.cards.read_card`; its `safe()` returns a muscle that can also be used outside the range of the
    data.

    Parameters
    ----------
    fit_json
        Read this `fit.json`, written by `famjax fit`.
    output
        Write the card to this file; default: `card.json` in the folder that contains the fit.
    name
        Set the name of the muscle; default: the name of the specimen.
    sample
        Sample this number of muscles from the uncertainty of the fit; 0 for none. Sampling requires a fit
        with standard errors.
    without_rig
        Leave out a compliant test rig, for use of the muscle in another mounting.
    own
        Trust this module, which contains your own classes (repeatable), as in `--own my_rubber`. Other
        modules are not imported.
    """
    load_fitting()
    from famjax.boundary.files import Origin
    from famjax.cards import write_card
    from fitting.saved import card_of, load_fit

    if own:
        add_cwd_to_path()
    saved = load_fit(fit_json, own=own)
    with progress("sampling muscles"):
        found = card_of(
            saved, name=name, count=sample, origin=Origin.of_this_command(), rig=not without_rig
        )  # fmt: skip
    warn_unidentified(fit_json, found.provenance.verdict, found.provenance.reasons)
    path = write_card(found, fit_json.parent / "card.json" if output is None else output)
    mean = f", mean of {len(found.members)} models" * (len(found.members) > 1)
    print(f"{found.name}: RMSE {found.provenance.rmse_N:.3g} N{mean}")
    doubts = (
        found.provenance.reasons[:1] if found.provenance.verdict == "identified with doubts" else []
    )
    for note in (*doubts, *found.provenance.notes, *found.safe().notes):
        print(f"note: {note}")
    print(f"written: {path}")
    return 0


def export(
    muscle: str,
    *,
    to: tuple[Target, ...],
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("exported"),
    length: str | None = None,
    plant: Path | None = None,
    own: tuple[str, ...] = (),
) -> int:
    """Export a muscle as C code, tables, MATLAB or Python functions, or a model for a simulator.

    The header of each file names the muscle and states the largest deviation from its model. Targets:

    c: C99 code for a microcontroller: force, stiffness, and pressure for a given force; double or float.

    fmu: an FMI 2.0 unit for Simulink and OpenModelica: the muscle with its valve or pump, and pressure as a
    state.

    csv, mat: tables of force, stiffness and area over length and pressure.

    matlab: functions for MATLAB, Octave and Simulink's MATLAB Function block.

    python: functions that need only NumPy.

    mujoco: an XML model of a load hanging from the muscle, and the actuator callback.

    mjx: the muscle as a differentiable part of the MJX step; requires famjax.

    Parameters
    ----------
    muscle
        Export this card written by `famjax card`, this `fit.json` written by `famjax fit`, or this bundled
        muscle (DMSP-10 or DMSP-20).
    to
        Choose a target (repeatable).
    output
        Write the files to this folder; it is created if missing.
    length
        Cut the muscle to this rest length, with its unit, such as 300mm.
    plant
        Use the circuit and friction from this `famjax simulate` plan. The C and MuJoCo models then have
        pressure as a state. Without a plan they are static, and the FMU has the default pneumatic circuit.
    own
        Trust this module, which contains your own classes (repeatable), as in `--own my_rubber`. Other
        modules are not imported.
    """
    load_fitting()
    from famjax.export import export as export_to
    from famjax.plans import read_plant

    cut = None if length is None else parse_quantity(length, "length")
    if own:
        add_cwd_to_path()
    subject = _subject(muscle, cut, own)
    if plant is not None:
        subject = dataclasses.replace(subject, plant=read_plant(plant, subject.muscle))
    if subject.card is not None:
        made = subject.card.provenance
        warn_unidentified(muscle, made.verdict, made.reasons)
    with progress("exporting"):
        paths = [*export_to(subject, to, output)]
    for path in paths:
        print(f"written: {path}")
    return 0


def _subject(muscle: str, length: float | None, own: Sequence[str]) -> "Subject":
    """Open a fit, a card or a bundled muscle for export."""
    from famjax.boundary.files import Origin
    from famjax.export import Subject, made_of, read_subject

    origin, path = Origin.of_this_command(), Path(muscle)
    if not is_fit(muscle):
        return read_subject(muscle, length=length, origin=origin, own=own)
    from fitting.saved import card_of, load_fit

    card = card_of(load_fit(path, own=own), count=0, origin=origin)
    return Subject.of_card(
        card, length=length, origin=made_of(path.name, path.read_bytes(), origin)
    )
