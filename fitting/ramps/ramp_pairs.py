"""Both branches of raw ramps, point by point: what hysteresis is identified from."""

from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError

from ..hysteresis.branch_pairs import BranchPairs
from .branch_curves import branch_curves, common_pressures
from .points import LEAST_READINGS
from .quasi_static_ramp import QuasiStatic


def ramp_pairs(points: QuasiStatic, *, rest_length: float, step: float = 25e3) -> BranchPairs:
    """The branches of every record at common pressures, where both pull.

    Args:
        points: of records at one length or several; the curves through them are those of
            `static_map`.
        rest_length: L0 [m] of the muscle.
        step: of the pressures [Pa], its multiples from zero up.

    Returns:
        The pairs, a record for each that has any.

    Raises:
        InputError: a step that is not > 0, or no record with both branches.
    """
    pressures = common_pressures(points, step)
    curves = branch_curves(points, range(len(points.records)), pressures)
    parts = []
    for k, record in enumerate(points.records):
        turn = _turn(points, k)
        both = curves.fill_pulls[k] & curves.vent_pulls[k] & (pressures <= turn)
        if both.any():
            parts.append(
                BranchPairs.ramp(
                    record.length,
                    pressures[both],
                    (curves.vent[k] - curves.fill[k])[both] / 2,
                    turn_pressure=turn,
                    rest_length=rest_length,
                    name=record.source,
                )
            )
    if not parts:
        raise InputError(
            "no record has both branches where the muscle pulls: hysteresis needs records that are "
            "filled and vented"
        )
    return BranchPairs.joined(parts)


def _turn(points: QuasiStatic, record: int) -> float:
    """Gauge pressure [Pa] at which a record turns round: its highest hold, or its highest readings.

    Of a continuous ramp a few readings are passed over, which may be spikes.
    """
    held = float(points.pressure[points.record == record].max())
    if points.kinds[record] == "staircase":
        return held
    readings = np.sort(points.records[record].pressure) - points.atmosphere[record]
    return max(held, float(readings[-LEAST_READINGS]))


_BRANCHES = ("record", "rest_length_m", "length_m", "pressure_Pa", "half_difference_N",
             "turn_pressure_Pa")  # fmt: skip


def branches_csv(pairs: BranchPairs) -> str:
    """The branches of ramps as CSV in SI, a row for each point; `read_branches` reads it."""
    lines = [",".join(_BRANCHES)]
    for k, number in enumerate(pairs.record):
        numbers = (pairs.rest_length, pairs.length[k], pairs.pressure[k], pairs.half_difference[k],
                   pairs.turn_pressure[k])  # fmt: skip
        name = pairs.names[number].replace(",", ";")
        lines.append(",".join((name, *(repr(float(one)) for one in numbers))))
    return "\n".join(lines) + "\n"


def read_branches(path: Path) -> BranchPairs:
    """The branches of ramps from the `branches.csv` of `famjax ramps`.

    Raises:
        InputError: no such file, or what is wrong with it.
    """
    try:
        header, *rows = path.read_text(encoding="utf-8").splitlines()
        cells = [row.split(",") for row in rows]
        numbers = np.array([row[1:] for row in cells], float)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError:
        header, cells, numbers = "", [], np.zeros((0, len(_BRANCHES) - 1))
    if header != ",".join(_BRANCHES) or not numbers.size:
        raise InputError(f"{path} is not the branches.csv that famjax ramps writes")
    names = np.array([row[0] for row in cells])
    parts = []
    for name in dict.fromkeys(names.tolist()):
        rest, length, pressure, half, turn = numbers[names == name].T
        parts.append(
            BranchPairs.ramp(
                length[0], pressure, half, turn_pressure=turn[0], rest_length=rest[0], name=name
            )
        )
    return BranchPairs.joined(parts)
