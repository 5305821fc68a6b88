"""`famjax predict` of a muscle that is a card, or bundled."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..loading import schema_of, warn_unidentified
from ..terminal import print_rows


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
    safe, region = card.safe(), card.region
    L, P = (
        np.array(parse_quantities(length, "length")),
        np.array(parse_quantities(pressure, "pressure")),
    )
    rows: list[dict[str, Any]] = []
    if P.size:
        force = np.asarray(safe.force(L[:, None], P))
        rows += [
            {"length_m": float(L[i]), "pressure_Pa": float(P[j]), "force_N": float(force[i, j]),
             "slack": bool(force[i, j] <= 0), "inside": _within(region, L[i], P[j])}
            for i in range(L.size) for j in range(P.size)
        ]  # fmt: skip
    if onset:
        begins = np.asarray(safe.onset_pressure(L, float(region.pressure[1]), throw=False))
        rows += [
            {"length_m": float(one), "onset_pressure_Pa": None if np.isnan(at) else float(at),
             "inside": _within(region, one, at)}
            for one, at in zip(L, begins, strict=True)
        ]  # fmt: skip
    asked_units = answer_units(units, length, pressure)
    if as_json:
        print_as_json(rows, units, asked_units)
        return 0
    for title, chosen in force_and_onset(in_units(rows, asked_units)).items():
        print_rows(f"{title} of {card.name}", chosen)
    print("note: of a card; rows that are not inside are continued beyond the model's own region")
    return 0


def _within(region: Any, length: float, pressure: float) -> bool:
    """Whether a state is the model's own."""
    (shortest, longest), (lowest, highest) = region.length, region.pressure
    return bool(shortest <= length <= longest and lowest <= pressure <= highest)
