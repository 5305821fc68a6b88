"""Convert designs to rows with units in the keys, and to a table of feasible designs."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..boundary.units import Row, entry, factor, unit_system
from ..braids import turns_from_angle
from ..cards import MuscleCard, Provenance
from ..continuation import Region
from ..muscle import MountedMuscle
from .search import COLUMNS, CONSTRAINTS, Search


def _entries(source: Mapping[str, Any], kinds: Mapping[str, str], system: str) -> Row:
    row: Row = {}
    for name, kind in kinds.items():
        row |= entry(name, float(source[name]), kind, system)
    return row


def design_rows(found: Search, at: Sequence[int] | NDArray[np.int64], *, system: str) -> list[Row]:
    """Return candidates from a search as rows, with None for unknown numbers.

    Each row lists the parts to buy, the sizes of the end-fitting, the columns of the search, and the
    length and turns of the threads.

    Args:
        found: result of `search`.
        at: indices of the candidates, such as `found.front`.
        system: "si", "metric" or "us".
    """
    return [
        _row(found, {name: values[k] for name, values in found.columns.items()}, system) for k in at
    ]


def _row(found: Search, numbers: Mapping[str, Any], system: str) -> Row:
    pair, angle = found.pairs[int(numbers["pair"])], numbers["braid_angle"]
    length, diameter = numbers["rest_length"], pair.bladder.diameter
    fitting: Row = {}
    if pair.fitting is not None:
        sizes = {"diameter_on_braid": "length", "diameter_on_bladder": "length"}
        fitting = {"tube": pair.fitting.tube.name, **_entries(vars(pair.fitting), sizes, system)}
    return {
        "bladder": pair.bladder.name,
        "braid": pair.braid.name,
        **fitting,
        **_entries(numbers, COLUMNS, system),
        **entry("thread_length", length / math.sin(angle), "length", system),
        "turns": float(turns_from_angle(length, diameter, angle)),
    }


def exclusion_rows(found: Search, *, system: str) -> list[Row]:
    """Return the number of candidates that each constraint excludes, and the best value found.

    The largest number comes first. `alone` is the number of candidates that meet all other constraints.
    """
    fails, rows = ~(found.margins >= 0), []  # nan fails
    for k, (name, (column, side)) in enumerate(CONSTRAINTS.items()):
        if fails[:, k].any():
            best = np.fmin.reduce if side == "most" else np.fmax.reduce
            numbers = {
                "limit": getattr(found.requirement, name),
                "closest": best(found.columns[column]),
            }
            rows.append({
                "constraint": name,
                **_entries(numbers, dict.fromkeys(numbers, COLUMNS[column]), system),
                "excluded": int(fails[:, k].sum()),
                "alone": int((fails[:, k] & (fails.sum(axis=-1) == 1)).sum()),
            })  # fmt: skip
    return sorted(rows, key=lambda row: -row["excluded"])


def design_document(found: Search, *, system: str) -> dict[str, Any]:
    """Return the result of a search as JSON-ready data, without the table of feasible designs.

    Args:
        found: result of `search`.
        system: "si", "metric" or "us".

    Returns:
        `search` (requirement in SI and number of candidates), `front`, `refined`, `exclusions`,
        `nearest` (empty if a candidate is feasible).
    """
    asked = dataclasses.asdict(found.requirement)
    refined = [] if found.refined is None else [_row(found, found.refined, system)]
    return {
        "search": {
            "candidates": len(found.margins),
            "feasible": len(found.feasible),
            "objectives": list(found.objectives),
            "asked_si": {k: v if math.isfinite(v) else None for k, v in asked.items()},
            "ranges_si": {name: list(ends) for name, ends in found.ranges.items()},
            "pairs_left_out": found.left_out,
        },
        "front": design_rows(found, found.front, system=system),
        "refined": refined,
        "exclusions": exclusion_rows(found, system=system),
        "nearest": [] if refined else design_rows(found, found.nearest, system=system),
    }


def design_card(found: Search) -> MuscleCard | None:
    """Return a card of the refined design for simulators; None if no candidate is feasible.

    The card covers the design's stroke and all pressures up to the required pressure. It states no
    uncertainty, because nothing was measured.
    """
    if found.refined is None or found.muscle is None:
        return None
    pair, length = found.pairs[found.refined["pair"]], found.refined["rest_length"]
    lengths = length * (1 - found.refined["contraction"]), length
    return MuscleCard(
        f"{pair.bladder.name}, {pair.braid.name}", (MountedMuscle(found.muscle, 0.0),), np.ones(1),
        Region.of(lengths, (0.0, found.requirement.pressure)),
        provenance=Provenance(notes=["designed by famjax design, not measured"]),
    )  # fmt: skip


def feasible_table(found: Search, *, system: str) -> bytes:
    """Return the feasible candidates as CSV."""
    at = found.feasible
    units = {name: unit_system(system)[kind] for name, kind in COLUMNS.items()}
    columns = [found.columns[n][at] / factor(units[n], kind) for n, kind in COLUMNS.items()]
    lines = [",".join(["bladder", "braid", *(f"{n}_{u}".rstrip("_") for n, u in units.items())])]
    for k, row in zip(found.columns["pair"][at], np.stack(columns, axis=-1).tolist(), strict=True):
        bought = found.pairs[k].bladder.name, found.pairs[k].braid.name
        lines.append(",".join([*bought, *(f"{value:.9g}" for value in row)]))
    return ("\n".join(lines) + "\n").encode()


def summary(found: Search, *, system: str) -> list[str]:
    """Return sentences that state how many candidates are feasible and why pairs were excluded.

    If no candidate is feasible, further sentences state how many of them each constraint excludes.

    Args:
        found: result of `search`.
        system: "si", "metric" or "us".
    """
    said = [
        f"{len(found.feasible):,} of {len(found.margins):,} candidates ({len(found.pairs)} pairs of "
        "bladder and braid) meet all requirements."
    ]
    if left_out := [f"{n} ({reason})" for reason, n in found.left_out.items()]:
        said.append(f"Excluded pairs: {', '.join(left_out)}.")
    for row in [] if len(found.feasible) else exclusion_rows(found, system=system):
        column, side = CONSTRAINTS[row["constraint"]]
        unit = unit_system(system)[COLUMNS[column]]
        asked, best = (row[f"{key}_{unit}".rstrip("_")] for key in ("limit", "closest"))
        reached = "unknown" if best is None else f"{best:.6g} {unit}".rstrip()
        said.append(
            f"{row['excluded']:,} fail the {row['constraint'].replace('_', ' ')} requirement (at {side} "
            f"{f'{asked:.4g} {unit}'.rstrip()}), {row['alone']:,} of them only this one; the best "
            f"value is {reached}."
        )
    return said
