"""A fit of hysteresis in `fit.json`, on the terminal and in the report, and back from the file."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import from_si, unit_system
from famjax.terms import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements

from .slip_fit import HysteresisFit

PREDICTS = 0.6
"""Error on what was left out, in parts of what was measured, above which a reader is warned."""

_SETS = ("wall", "braid")
_UNITS = {"ramp": "Pa", "stroke": "m"}
_GROUPS = {"record": "", "length": "_m", "pressure": "_Pa"}


def hysteresis_as_dict(fit: HysteresisFit) -> dict[str, Any]:
    """The fit as JSON-ready data in SI."""
    slip, cycle, pairs = fit.slip, fit.centred.cycle, fit.pairs
    unit = _UNITS[cycle.kind]
    records = np.unique(pairs.record).tolist()
    return {
        "rest_length_m": float(slip.rest_length),
        "modulus_Pa": float(slip.modulus),
        **{
            name: {
                "thresholds": np.asarray(getattr(slip, name).threshold).tolist(),
                "strengths_N": np.asarray(getattr(slip, name).strength).tolist(),
            }
            for name in _SETS
        },
        "cycle": {
            "kind": cycle.kind,
            f"start_{unit}": cycle.start,
            f"turn_{unit}": cycle.turn,
            "cycled": cycle.cycled,
        },
        "n_points": int(pairs.half_difference.size),
        "measured_rms_N": pairs.measured_rms,
        "rms_N": fit.rms,
        "left_out": {
            one.groups: {
                "rms_N": one.rms,
                "ratio": one.ratio if math.isfinite(one.ratio) else None,
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


def hysteresis_from_dict(document: Mapping[str, Any]) -> CentredSlip:
    """The elements and their cycle back from `hysteresis_as_dict`.

    Raises:
        InputError: something is missing or is no number.
    """
    try:
        cycle = document["cycle"]
        unit = _UNITS[cycle["kind"]]
        wall, braid = (
            SlipElements(
                np.array(document[name]["thresholds"], float),
                np.array(document[name]["strengths_N"], float),
            )
            for name in _SETS
        )
        rest_length, modulus = float(document["rest_length_m"]), float(document["modulus_Pa"])
        start, turn = (float(cycle[f"{end}_{unit}"]) for end in ("start", "turn"))
        reference = ReferenceCycle(cycle["kind"], start, turn, bool(cycle["cycled"]))
        return CentredSlip(MaxwellSlip(wall, braid, rest_length, modulus), reference)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"the hysteresis of the fit cannot be read ({type(error).__name__}: {error}): write "
            "the file anew with famjax fit --hysteresis"
        ) from None


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
