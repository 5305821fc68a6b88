"""`famjax predict` of a muscle that is a card, or bundled."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from famjax.boundary.sentence import Quantity, Sentence

from ..loading import schema_of, warn_unidentified

if TYPE_CHECKING:
    from famjax.muscle import Region, SafeMuscle


def is_card(muscle: str) -> bool:
    """Whether this is a bundled muscle's name or the file of a card."""
    from famjax.muscles import bundled_name

    path = Path(muscle)
    if not path.exists():
        return bundled_name(muscle) is not None
    return schema_of(path).startswith("famjax-card/")


def predict_by_card(
    muscle: str,
    length: Sequence[str],
    pressure: Sequence[str],
    units: str | None,
    others: Mapping[str, object],
    *,
    onset: bool,
    as_json: bool,
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
    """
    import numpy as np

    from famjax.boundary.errors import InputError
    from famjax.boundary.units import parse_quantities
    from famjax.cards import read_card
    from famjax.commands.options.answers import (
        answer_units,
        force_and_onset,
        in_units,
        print_answers,
        print_as_json,
    )
    from famjax.muscles import bundled_card

    asked = [name for name, value in others.items() if value]
    if asked:
        raise InputError(
            f"{', '.join(asked)} needs a fit: give the fit.json of famjax fit. Of a card or a bundled "
            "muscle famjax.control.pressure_for_force answers forces, and famjax export --length cuts it"
        )
    if not length or not (pressure or onset):
        raise InputError("give --length, and --pressure or --onset, with their units")
    card = read_card(muscle) if Path(muscle).exists() else bundled_card(muscle)
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
    asked_units = answer_units(units, length, pressure)
    if as_json:
        print_as_json(rows, units, asked_units)
        return 0
    for title, chosen in force_and_onset(in_units(rows, asked_units)).items():
        print_answers(f"{title} of {card.name}", chosen, units)
    print("note: of a card; rows that are not inside are continued beyond the model's own region")
    return 0


def _impossible(safe: "SafeMuscle", length: float) -> Sentence | None:
    """Why no muscle has that length, or None."""
    lock, straight = (float(end) for end in safe.continued.stops)
    if length < lock:
        return Sentence("the length is below the braid's lock, ", Quantity(lock, "length"))
    if length > straight:
        return Sentence("the length is beyond the thread's, ", Quantity(straight, "length"))
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
