"""The inverse of a prediction: the pressure at which a saved muscle pulls with a force."""

from typing import Any

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import finite_or_none
from famjax.control import Outcome, pressure_for_force

from ..saved.saved_fit import SavedFit
from .inside import reach_of


def pressures_for(
    fit: SavedFit, length: Float[np.ndarray, " lengths"], force: Float[np.ndarray, " forces"]
) -> list[dict[str, Any]]:
    """At which gauge pressure a saved muscle pulls with each force at each length.

    Args:
        fit: from `load_fit`.
        length: active lengths [m] as the rig of the fit measures them, > 0.
        force: [N], >= 0.

    Returns:
        Rows with `length_m, force_N, pressure_Pa, inside, outside`: the lowest pressure up to the
        highest measured that gives the force, null where none does; for no force the highest at which
        the muscle is slack. Inside that contraction and pressure lie within the fitted data, and
        outside why they do not, or why there is no pressure.

    Raises:
        InputError: lengths or forces that no muscle has.
    """
    if not (length.size and force.size):
        raise InputError("a pressure is sought for a length and a force: give one of each or more")
    if not (np.isfinite(length).all() and (length > 0).all()):
        raise InputError(f"lengths must be > 0, got {length.min():.6g} m")
    if not (np.isfinite(force).all() and (force >= 0).all()):
        raise InputError(f"forces must be >= 0, as a muscle only pulls, got {force.min():.6g} N")
    muscle = famjax.muscle.MeanMuscle((fit.mounted, *fit.others), fit.weights)
    reach = reach_of(fit, None)
    found = pressure_for_force(muscle, force, length[:, None], (0.0, reach.pressures[1]))
    rows = []
    for (k, j), code in np.ndenumerate(np.asarray(found.code)):
        pull = float(found.force[k, j])
        why = reach.refuses(float(length[k]), pull)
        # Slack up to the highest pressure: no force is what it pulls at that one, too.
        attained = code == Outcome.FEASIBLE or (code == Outcome.FORCE_HIGH and force[j] == 0)
        pressure = finite_or_none(float(found.pressure[k, j])) if attained and why is None else None
        if pressure is not None:
            why = reach.leaves(float(length[k]), pressure, float(force[j]))
        elif why is None:
            why = Outcome(int(code)).message
        rows.append(
            {
                "length_m": float(length[k]), "force_N": float(force[j]), "pressure_Pa": pressure,
                "inside": why is None, "outside": why,
            }
        )  # fmt: skip
    return rows
