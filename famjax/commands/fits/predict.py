"""`famjax predict`."""

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..loading import load_fitting, look_here, warn_unidentified
from .hysteresis import print_history
from .predict_card import is_card, predict_by_card

if TYPE_CHECKING:
    from fitting.saved import SavedFit


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
    units: Literal["si", "metric", "us"] | None = None,
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
        `time_s,length_mm,pressure_kPa`: the force on either branch, of a fit with --hysteresis.
    units
        Of the answer: si, metric (mm, kPa, N) or us (in, psi, lbf). The table has the units of the
        question unless given, and JSON has SI.
    json_
        Print one JSON list to standard output and nothing else there.
    """
    fitting = load_fitting()
    import numpy as np

    from famjax.boundary.units import parse_quantities, parse_quantity, quantity_unit
    from famjax.commands.options.answers import (
        answer_units,
        force_and_onset,
        in_units,
        print_answers,
        print_as_json,
    )

    look_here()
    if history is None and is_card(muscle):
        others = {"--force": force, "--rest-length": rest_length, "--length-std": length_std}
        return predict_by_card(muscle, length, pressure, units, others, onset=onset, as_json=json_)
    saved = fitting.load_fit(muscle)
    warn_unidentified(muscle, saved.document.get("verdict"), saved.document.get("reasons"))
    if history is not None:
        return print_history(
            saved, history, units, as_json=json_,
            others={"length": length, "pressure": pressure, "onset": onset,
                    "rest-length": rest_length, "length-std": length_std},
        )  # fmt: skip
    lengths = np.array(parse_quantities(length, "length"))
    if force:
        if pressure or onset or rest_length is not None or length_std is not None:
            raise fitting.InputError(
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
    asked = {**answer_units(units, length, pressure)}
    if force and units is None:
        asked["force"] = quantity_unit(force[0])
    if json_:
        print_as_json(rows, units, asked)
        return 0
    shown = in_units(rows, asked)
    for title, chosen in ({"Pressure": shown} if force else force_and_onset(shown)).items():
        print_answers(title, chosen, units)
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
        print(f"note: the 95 % band is of {saved.error.covers}")
    elif forces and not (saved.document.get("spread") or {}).get("directions"):
        print("note: no error band, as the fit has no standard errors")
