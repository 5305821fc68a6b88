"""A fit of hysteresis in `fit.json`, on the terminal and in the report, and back from the file."""

from typing import Any

import numpy as np

from famjax.boundary.units import finite_or_none, from_si, unit_system
from famjax.cards import slip_as_dict

from .slip_fit import HysteresisFit

PREDICTS = 0.6
"""Error on what was left out, in parts of what was measured, above which a reader is warned."""

_SETS = ("wall", "braid")
_GROUPS = {"record": "", "length": "_m", "pressure": "_Pa"}


def hysteresis_as_dict(fit: HysteresisFit) -> dict[str, Any]:
    """The fit as JSON-ready data in SI; `famjax.cards.slip_from_dict` reads its elements."""
    pairs = fit.pairs
    records = np.unique(pairs.record).tolist()
    return {
        **slip_as_dict(fit.centred),
        "n_points": int(pairs.half_difference.size),
        "measured_rms_N": pairs.measured_rms,
        "rms_N": fit.rms,
        "left_out": {
            one.groups: {
                "rms_N": one.rms,
                "ratio": finite_or_none(one.ratio),
                f"values{_GROUPS[one.groups]}": one.values.tolist(),
                "group_rms_N": one.group_rms.tolist(),
            }
            for one in fit.left_out
        },
        "kkt_residual": fit.kkt_residual,
        "duality_gap": fit.duality_gap,
        "records": [pairs.names[k] for k in records],
        "lost_energy_J": [fit.heat(k) for k in records],
    }


def hysteresis_table(
    fit: HysteresisFit, system: str
) -> tuple[str, tuple[str, ...], list[tuple[str, ...]]]:
    """The fit as a table of text in a unit system: title, header, rows."""
    unit, measured = unit_system(system)["force"], fit.pairs.measured_rms

    def row(name: str, value: float) -> tuple[str, str, str]:
        share = f"{100 * value / measured:.3g} %" if measured > 0 else "none"
        return name, f"{from_si(value, unit, 'force'):.4g}", share

    lost = [1e3 * fit.heat(k) for k in np.unique(fit.pairs.record).tolist()]
    n = sum(int(np.sum(np.asarray(getattr(fit.slip, name).strength) > 0)) for name in _SETS)
    rows = [
        row("measured", measured),
        row("error of the fit", fit.rms),
        *(row(f"error with one {one.groups} left out", one.rms) for one in fit.left_out),
        ("elements with a strength", str(n), ""),
        ("energy lost per cycle, mJ", f"{min(lost):.3g} to {max(lost):.3g}", ""),
        ("KKT residual", f"{fit.kkt_residual:.1e}", ""),
        ("duality gap", f"{fit.duality_gap:.1e}", ""),
    ]
    title = (
        f"Hysteresis: half the difference of the branches, RMS over {fit.pairs.record.size} points"
    )
    return title, ("", unit, "of measured"), rows


def hysteresis_warnings(fit: HysteresisFit) -> tuple[str, ...]:
    """Where the hysteresis is not to be relied on."""
    found = []
    strength = np.concatenate([np.asarray(getattr(fit.slip, name).strength) for name in _SETS])
    if not (strength > 0).any():
        found.append(
            "No element of the hysteresis has a strength: the branches lie the other way round, or "
            "at rest length alone, where the model has no loop."
        )
    found += [
        f"The hysteresis does not predict a {one.groups} that was left out: its error is "
        f"{one.ratio:.0%} of the half-difference measured."
        for one in fit.left_out
        if not one.ratio <= PREDICTS
    ]
    if not fit.left_out:
        found.append(
            "There is one record at one length: the hysteresis could not be tested on another."
        )
    return tuple(found)
