"""Records, lengths and pressures predicted by fits that have not seen them."""

import dataclasses

import numpy as np
from jaxtyping import Float

from .branch_pairs import BranchPairs
from .slip_fit import HysteresisFit, HysteresisLeftOut, fit_hysteresis


def leave_out(fit: HysteresisFit) -> HysteresisFit:
    """The fit with what it predicts of each record, length and pressure that is left out of it.

    Thresholds are chosen anew from what is left. Whatever there is only one of cannot be left out;
    the pressures are those of strokes.

    Args:
        fit: of `fit_hysteresis`.

    Returns:
        The same fit with `left_out`.
    """
    pairs = fit.pairs
    kinds = {"record": pairs.record.astype(float), "length": _constant(pairs, "length")}
    kinds["pressure"] = _constant(pairs, "pressure")
    found = [_left_out(fit, kind, group) for kind, group in kinds.items() if _several(group)]
    return dataclasses.replace(fit, left_out=tuple(found))


def _several(group: Float[np.ndarray, " n"]) -> bool:
    return bool(np.isfinite(group).all()) and np.unique(group).size > 1


def _constant(pairs: BranchPairs, quantity: str) -> Float[np.ndarray, " n"]:
    """The median of a quantity in the record of each point; nan where the cycle changes it."""
    moves = ~pairs.is_ramp if quantity == "length" else pairs.is_ramp
    values = getattr(pairs, quantity)
    medians = {k: float(np.median(values[pairs.record == k])) for k in np.unique(pairs.record)}
    return np.where(moves, np.nan, np.array([medians[k] for k in pairs.record.tolist()]))


def _left_out(fit: HysteresisFit, kind: str, group: Float[np.ndarray, " n"]) -> HysteresisLeftOut:
    pairs, measured = fit.pairs, fit.pairs.half_difference
    predicted, values = np.zeros(measured.size), np.unique(group)
    for value in values:
        out = group == value
        without = fit_hysteresis(
            pairs.at(~out), cycle=fit.centred.cycle, modulus=float(fit.slip.modulus)
        )
        predicted[out] = without.half_difference(pairs.at(out))
    errors = [predicted[group == value] - measured[group == value] for value in values]
    return HysteresisLeftOut(
        groups=kind,
        values=values,
        predicted=predicted,
        measured=measured,
        group_rms=np.array([np.sqrt(np.mean(error**2)) for error in errors]),
    )
