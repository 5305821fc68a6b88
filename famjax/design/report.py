"""Designs as plain rows with the unit in each key, as a picture, and as a table of feasible ones."""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..boundary.files import as_png
from ..boundary.units import Row, entry, factor, unit_system
from .catalogue import Catalogue
from .combination import Combination, Feasibility, feasibility
from .search import COLUMNS, CONSTRAINTS, Search
from .swage import size_end_fittings, tube_strengths

_MOST_ROWS = 100_000  # of the table of feasible designs
_TUBE = {
    "modulus": "stress",
    "yield_stress": "stress",
    "free_length": "length",
    "supported_length": "length",
    "buckling_load": "force",
    "supported_buckling_load": "force",
    "yield_load": "force",
}


def _entries(source: Mapping[str, Any], kinds: Mapping[str, str], system: str) -> Row:
    row: Row = {}
    for name, kind in kinds.items():
        row |= entry(name, float(source[name]), kind, system)
    return row


def design_rows(found: Search, at: Sequence[int] | NDArray[np.int64], *, system: str) -> list[Row]:
    """Some candidates of a search, in their order; None where a number is not known.

    Args:
        found: from `search`.
        at: positions, such as `found.front`.
        system: "si", "metric" or "us".
    """
    return [
        _row(found, {name: values[k] for name, values in found.columns.items()}, system) for k in at
    ]


def _row(found: Search, numbers: Mapping[str, Any], system: str) -> Row:
    """A design: what to buy, the numbers of its columns, and how long to cut and wind its threads."""
    pair = found.pairs[int(numbers["pair"])]
    braid = Combination.of(pair.bladder, pair.braid, numbers["rest_length"]).braid
    return {
        "bladder": pair.bladder.name,
        "braid": pair.braid.name,
        "feasibility": str(pair.fit),
        "tube": pair.tube,
        **_entries(numbers, COLUMNS, system),
        **entry("thread_length", float(braid.rest_thread_length), "length", system),
        "turns": float(braid.turns),
    }


def exclusion_rows(found: Search, *, system: str) -> list[Row]:
    """How many candidates each constraint leaves out, the most first, and the best of all.

    `alone` counts those that keep to everything else.
    """
    fails, rows = ~(found.margins >= 0), []  # nan is not kept
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


def design_document(found: Search, catalogue: Catalogue, *, system: str) -> dict[str, Any]:
    """Everything that a search found but the table of feasible designs, JSON-ready.

    Args:
        found: from `search`.
        catalogue: that was searched.
        system: "si", "metric" or "us".

    Returns:
        `search` (what was asked for, in SI, and how many candidates there were), `front`, `refined`,
        `exclusions`, `nearest` (where nothing is feasible), `end_fittings`, `tube_buckling`, `notes`.
    """
    refined = []
    if found.refined is not None:
        (start,) = design_rows(found, found.front[:1], system=system)
        end = _row(found, found.refined, system)
        refined = [{"goal": "balanced", "gain": found.refined["gain"]} | end | {"start": start}]
    asked = dataclasses.asdict(found.requirement)
    return {
        "search": {
            "candidates": len(found.margins),
            "feasible": len(found.feasible),
            "objectives": list(found.objectives),
            "asked_si": {k: v if math.isfinite(v) else None for k, v in asked.items()},
            "ranges_si": {name: list(ends) for name, ends in found.ranges.items()},
            "pairs": [{"bladder": p.bladder.name, "braid": p.braid.name} for p in found.pairs],
            "pairs_left_out": found.left_out,
        },
        "front": design_rows(found, found.front, system=system),
        "refined": refined,
        "exclusions": exclusion_rows(found, system=system),
        "nearest": [] if refined else design_rows(found, found.nearest, system=system),
        "end_fittings": end_fitting_rows(catalogue, system=system),
        "tube_buckling": tube_buckling_rows(catalogue, system=system),
        "notes": list(found.notes),
    }


def end_fitting_rows(catalogue: Catalogue, *, system: str) -> list[Row]:
    """The end-fitting of every tube, bladder and braid that fit; compressions per length of radius."""
    unit = unit_system(system)["length"]
    sizes = {"diameter_on_braid": "length", "diameter_on_bladder": "length"}
    return [
        {
            "tube": one.tube.name,
            "bladder": one.bladder.name,
            "braid": one.braid.name,
            **_entries(vars(one), sizes, system),
            **entry("bladder_bore", one.bladder.bore, "length", system),
            "bore_stretch": one.bore_stretch,
            "feasible": one.feasible,
            f"braid_compression_per_{unit}": factor(unit, "length") / braid.thickness,
            f"bladder_compression_per_{unit}": factor(unit, "length") / one.bladder.thickness,
        }
        for braid in catalogue.braids
        for diameter in sorted({bladder.diameter for bladder in catalogue.bladders})
        if feasibility(diameter, braid) is not Feasibility.INFEASIBLE
        for one in size_end_fittings(catalogue, braid, diameter)
    ]


def tube_buckling_rows(catalogue: Catalogue, *, system: str) -> list[Row]:
    """What each swage tube bears; `assumed` names the numbers that the catalogue does not give."""
    return [
        {
            "tube": one.tube.name,
            **_entries(vars(one), _TUBE, system),
            "gain": one.gain,
            "yields_first": one.yields_first,
            "assumed": list(one.assumed),
        }
        for one in tube_strengths(catalogue)
    ]


def feasible_table(found: Search, *, system: str) -> bytes:
    """The feasible candidates of a search as CSV, an even choice of at most 100,000 of them."""
    at = found.feasible
    at = at[:: max(1, -(-len(at) // _MOST_ROWS))]
    units = {name: unit_system(system)[kind] for name, kind in COLUMNS.items()}
    lines = [",".join(["bladder", "braid", *(f"{k}_{u}" if u else k for k, u in units.items())])]
    pairs = found.columns["pair"][at]
    names = [f"{found.pairs[k].bladder.name},{found.pairs[k].braid.name}" for k in pairs]
    numbers = [
        found.columns[name][at] / factor(units[name], kind) for name, kind in COLUMNS.items()
    ]
    for name, row in zip(names, np.stack(numbers, axis=-1).tolist(), strict=True):
        lines.append(",".join([name, *(f"{value:.9g}" for value in row)]))
    return ("\n".join(lines) + "\n").encode()


def summary(found: Search, rows: Iterable[Row]) -> list[str]:
    """How many candidates meet everything and how many pairs are left out, and why: sentences.

    Args:
        found: from `search`.
        rows: from `exclusion_rows`, said where nothing is feasible.
    """
    said = [
        f"{len(found.feasible):,} of {len(found.margins):,} candidates, of {len(found.pairs)} pairs of "
        "bladder and braid, meet everything."
    ]
    reasons = {
        "braid": "the braid does not fit the bladder",
        "end_fitting": "no swage tube of the catalogue fits",
        "untested": "the strength of their threads is not known",
    }
    left_out = [f"{n}: {reasons[reason]}" for reason, n in found.left_out.items() if n]
    if left_out:
        said.append(f"Pairs left out: {', '.join(left_out)}.")
    if not len(found.feasible):
        said += [_excluded(row) for row in rows]
    return said


def _excluded(row: Row) -> str:
    name, side = row["constraint"], CONSTRAINTS[row["constraint"]][1]
    (limit, asked), (_, best) = (
        (k, v) for k, v in row.items() if k.startswith(("limit", "closest"))
    )
    unit = limit.removeprefix("limit").removeprefix("_")
    reached = "none that can be reached" if best is None else f"{best:.4g} {unit}".rstrip()
    return (
        f"{row['excluded']:,} fail the {name.replace('_', ' ')}, {row['alone']:,} of them that alone: "
        f"asked for is at {side} {asked:.4g} {unit}".rstrip()
        + f", the best of all is {reached}."
    )


def design_picture(found: Search, *, system: str) -> bytes:
    """The feasible designs and their front over two objectives, and what there is to build, as PNG."""
    from matplotlib.figure import Figure  # noqa: PLC0415 -- slow to load

    figure = Figure(figsize=(12, 5.8), layout="constrained")
    others = [name for name in ("pressure", "rest_length") if name not in found.objectives]
    axes = [*found.objectives, *others][:2], ("rest_length", "pressure")
    grey = found.feasible[:: 1 + len(found.feasible) // 20_000]
    pairs = found.columns["pair"][found.front]
    for ax, names in zip(figure.subplots(1, 2), axes, strict=True):
        units = [unit_system(system)[COLUMNS[name]] for name in names]
        scales = [factor(u, COLUMNS[name]) for u, name in zip(units, names, strict=True)]
        x, y = (found.columns[name] / by for name, by in zip(names, scales, strict=True))
        ax.scatter(x[grey], y[grey], s=2, color="0.85", rasterized=True)
        for pair in np.unique(pairs):
            mine, of = found.front[pairs == pair], found.pairs[pair]
            ax.scatter(x[mine], y[mine], s=12, label=f"{of.bladder.name} under {of.braid.name}")
        if found.refined is not None:
            at = [found.refined[name] / by for name, by in zip(names, scales, strict=True)]
            ax.plot(*at, "*", ms=15, mec="black", mfc="#f4a582", label="refined")
        x_label, y_label = (
            f"{name.replace('_', ' ')}, {unit}" for name, unit in zip(names, units, strict=True)
        )
        ax.set(xlabel=x_label, ylabel=y_label)
    figure.legend(*figure.axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=3,
                  fontsize=8, frameon=False)  # fmt: skip
    return as_png(figure)
