"""Hysteresis as plain data with the unit in every key, and back."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..boundary.errors import InputError
from ..slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements

_SETS = ("wall", "braid")
_UNITS = {"ramp": "Pa", "stroke": "m"}


def slip_as_dict(centred: CentredSlip) -> dict[str, Any]:
    """Elements and reference cycle as JSON-ready data in SI, exact to the last digit."""
    slip, cycle = centred.slip, centred.cycle
    unit = _UNITS[cycle.kind]
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
    }


def slip_from_dict(document: Mapping[str, Any]) -> CentredSlip:
    """The elements and their cycle back from `slip_as_dict`; further entries are left alone.

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
            f"the hysteresis cannot be read ({type(error).__name__}: {error}): write the file anew "
            "with famjax assess --hysteresis"
        ) from None
