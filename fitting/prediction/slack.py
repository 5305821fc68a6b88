"""What is reported where a model is below zero: a muscle buckles, and does not push.

A model is smooth through zero, as roots and gradients need it. What a reading can be is not: below
zero it is 0 N, and so are both ends of its band.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .onset import SAME

_ROUNDING = 1e-9  # N: what is left of a force of zero
_EXACT = 1e-9  # of a pressure: the same in another unit


@dataclasses.dataclass(frozen=True)
class Reported:
    """Forces at the fittings, nan where the model has none.

    Attributes:
        force: [N], >= 0: that of the model, 0 where the muscle is slack.
        slack: whether the model does not pull.
        low: lower end of the 95 % band [N], >= 0; 0 wherever the muscle is or was slack.
        high: upper end [N], > 0.
    """

    force: Float[np.ndarray, " n"]
    slack: Bool[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]
    high: Float[np.ndarray, " n"]


def reported(
    model_force: Float[np.ndarray, " n"],
    half: Float[np.ndarray, " n"],
    seen_slack: Bool[np.ndarray, " n"],
    narrowest: float = 0.0,
) -> Reported:
    """What a reading would be by a model that may be below zero.

    Args:
        model_force: [N], not clipped.
        half: half of its 95 % band [N], nan where nothing is known of it.
        seen_slack: where a reading says that the muscle does not pull, see `seen_slack`.
        narrowest: half of the band where the model is known best [N], see `ModelError.narrowest`: by so
            much a reading may be above 0 where the model is below.
    """
    slack = model_force <= _ROUNDING
    low = np.where(slack | seen_slack, np.minimum(model_force - half, 0.0), model_force - half)
    return Reported(
        force=np.where(slack, 0.0, model_force),
        slack=slack,
        low=np.maximum(low, 0.0),
        high=np.maximum(model_force + half, narrowest),
    )


def seen_slack(
    document: Mapping[str, Any], length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Where a reading says that the muscle does not pull.

    A muscle that was slack is so, too, when it is shorter and under less pressure. A reading that is
    contradicted, by a pull at no greater length and no higher pressure, says nothing.

    Args:
        document: of a saved fit, with its readings.
        length: active lengths [m] of the muscle that was measured.
        pressure: gauge pressures [Pa].
    """
    readings = document["data"]["readings"]
    columns = (readings[name] for name in ("length_m", "pressure_Pa", "force_N"))
    L, P, force = (np.asarray(one, float) for one in columns)
    pulls, slack = force > 0, force <= 0
    contradicted = ((L[pulls] <= L[slack, None]) & (P[pulls] <= P[slack, None])).any(axis=1)
    L, P = L[slack][~contradicted], P[slack][~contradicted]
    within = (length[:, None] <= (1 + SAME) * L) & (pressure[:, None] <= (1 + _EXACT) * P)
    return np.asarray(within.any(axis=1))
