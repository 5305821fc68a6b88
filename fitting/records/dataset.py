"""A characterisation as the table that `famjax fit` reads."""

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError

from .branch import bend_of
from .characterisation import Characterisation, Isobar

TURN = 0.03
"""Part of a stroke after a turn that is left out: friction turns round there, so that the mean of both
branches is not the muscle's own force."""

_ALIKE = 1e-3  # of a pressure: differences of branches below that are noise


def dataset_text(
    found: Characterisation,
    *,
    specimen: Mapping[str, object] | None = None,
    branch: str = "mean",
    points: int = 30,
) -> str:
    """A table of pressure, length and force in SI, with the specimen in comment lines.

    The lengths are common to all isobars, and each reading has the pressure that was measured there,
    which dips and rises as the machine turns, with the scatter of its readings. The part `TURN` of
    the stroke at either end is left out. Forces that are not positive stay in: they say where the
    muscle is slack.

    Args:
        found: the characterisation.
        specimen: further entries, unit in the key, such as {"wall_thickness_mm": 1.6}.
        branch: the mean of both, or one of them.
        points: lengths over the range of the longest isobar. With more than a third of the
            characterisation's lengths, neighbours share rows and errors.

    Returns:
        The text of the file.

    Raises:
        InputError: an unknown branch, or fewer than two points.
    """
    if branch not in {"mean", "shortening", "lengthening"} or points < 2:
        raise InputError(
            "branch must be one of mean, shortening, lengthening and points >= 2, "
            f"got {branch!r}, {points}"
        )
    turnless = _turnless(found.isobars)
    own = [bar.length[use] for bar, use in zip(found.isobars, turnless, strict=True)]
    common = np.linspace(max(at[0] for at in own), min(at[-1] for at in own), points)
    friction = _friction(found.isobars, turnless)
    readings = [
        _readings(bar, use, common, branch, friction)
        for bar, use in zip(found.isobars, turnless, strict=True)
    ]
    lines = [f"# note: {note}" for note in found.notes]
    lines += [f"# specimen: {key} = {value}" for key, value in _entries(found, specimen).items()]
    tolerance = _tolerance([rows[:, 0] for rows in readings])
    if tolerance is not None:
        lines.append(f"# level: pressure_tolerance_Pa = {tolerance!r}")
    lines.append("pressure_Pa,length_m,force_N,pressure_std_Pa")
    lines += [",".join(map(repr, row)) for rows in readings for row in rows.tolist()]
    return "\n".join(lines) + "\n"


def _entries(found: Characterisation, specimen: Mapping[str, object] | None) -> dict[str, str]:
    """The specimen as text, with the record's rest length."""
    entries = {"rest_length_m": repr(found.rest_length)}
    for key, value in (specimen or {}).items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        if key.rpartition("_")[0] == "rest_length":
            raise InputError(
                f"the specimen's {key} = {text} stands beside the {found.rest_length} m of the record: "
                "give it once"
            )
        if "\n" in f"{key}{text}":
            raise InputError(f"the specimen's {key!r} holds a line end")
        entries[key] = text
    return entries


def _turnless(isobars: Sequence[Isobar]) -> list[np.ndarray]:
    """Which values of each isobar lie further than `TURN` of the longest stroke from its turns."""
    turn = TURN * max(float(np.ptp(bar.length)) for bar in isobars)
    found = []
    for bar in isobars:
        margin = min(turn, float(np.ptp(bar.length)) / 4)
        inside = (bar.length <= bar.length[0] - margin) & (bar.length >= bar.length[-1] + margin)
        found.append(inside)
    return found


def _readings(
    bar: Isobar, use: np.ndarray, common: np.ndarray, branch: str, friction: float
) -> np.ndarray:
    """Pressure, length, force and scatter of the pressure at the common lengths, shape (n, 4).

    Each is of a line through the isobar's own values within half a step of the common lengths, about a
    polynomial through all of them, so that readings of short strokes are as precise as those of long
    ones and a bend does not shift them.
    """
    if branch == "mean":
        pressure, force = _mean_pressure(bar, friction), bar.force
    else:
        pressure, force = getattr(bar, f"{branch}_pressure"), getattr(bar, branch)
    own = bar.length[use]
    reach = max(float(common[0] - common[1]) / 2, 1.01 * float(own[0] - own[1]))
    at = common[(common <= own[0] + 1e-9) & (common >= own[-1] - 1e-9)]
    at = at if at.size > 1 else own[[0, -1]]
    away = own - at[:, None]
    near = np.abs(away) <= reach
    # Near a turn there are values on one side only: a mean of what the polynomial leaves would be off.
    line = np.where(near, away, 0.0)
    count, first, second = near.sum(axis=1), line.sum(axis=1), (line**2).sum(axis=1)
    spread = count * second - first**2
    straight = spread > 0
    columns = []
    for curve in (pressure[use], force[use]):
        bend = bend_of(own, curve)
        left = curve - bend(own)
        mean, slope = near @ left, line @ left
        here = np.divide(second * mean - first * slope, spread, where=straight, out=mean / count)
        columns.append(bend(at) + here)
    scatter = np.sqrt((near @ bar.bin_pressure_std[use] ** 2) / count)
    return np.stack([columns[0], at, columns[1], scatter], axis=1)


def _friction(isobars: Sequence[Isobar], turnless: Sequence[np.ndarray]) -> float:
    """Part f of the force that friction takes on either branch, of all isobars together.

    The branches of one isobar differ by 2 f F and by what their pressures differ. An isobar tells f
    the better, the less its pressures differ in parts of its own: by the square of that it is weighed.
    """
    shares, weights = [], []
    for bar, use in zip(isobars, turnless, strict=True):
        apart = np.abs(bar.lengthening_pressure - bar.shortening_pressure)
        alike = (
            use & (apart <= np.median(apart[use])) & (bar.shortening > 0) & (bar.lengthening > 0)
        )
        if not alike.any():
            continue
        share = (bar.lengthening - bar.shortening)[alike] / (2 * bar.force[alike])
        shares.append(float(np.median(share)))
        weights.append(
            (bar.pressure / max(float(np.median(apart[alike])), _ALIKE * bar.pressure)) ** 2
        )
    return float(np.average(shares, weights=weights)) if shares else 0.0


def _mean_pressure(bar: Isobar, friction: float) -> np.ndarray:
    """The pressure [Pa] to which half the sum of both branches' forces belongs, shape (n,).

    Where friction takes the part f of the force, F = D (P - P_d) gives
    ((1 - f) F(P_s) + (1 + f) F(P_l))/2 = F(((1 - f) P_s + (1 + f) P_l)/2).
    """
    low, high = bar.shortening_pressure, bar.lengthening_pressure
    return ((1 - friction) * low + (1 + friction) * high) / 2


def _tolerance(pressures: list[np.ndarray]) -> float | None:
    """What divides the isobars' own pressures [Pa] from one another; None where nothing does."""
    inside = sorted((np.sort(values) for values in pressures), key=lambda values: values[0])
    within = max(float(np.diff(values).max()) for values in inside)
    wide = max(float(np.ptp(values)) for values in inside)
    between = min((float(b[0] - a[-1]) for a, b in itertools.pairwise(inside)), default=2 * wide)
    return math.sqrt(within * between) if 0 < within < between > wide else None


def write_dataset(
    found: Characterisation,
    path: str | Path,
    *,
    specimen: Mapping[str, object] | None = None,
    branch: str = "mean",
    points: int = 30,
) -> Path:
    """Write `dataset_text` to a file; one that is there is replaced.

    Returns:
        The path.

    Raises:
        InputError: as `dataset_text`, or the file cannot be written.
    """
    text = dataset_text(found, specimen=specimen, branch=branch, points=points)
    path = Path(path)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    return path
