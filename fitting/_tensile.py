"""The bladder's stress law from a cyclic tensile test: softening, permanent set, polynomial fit."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

import famjax

from ._cycles import (
    Branch,
    Cycle,
    checked_columns,
    choose_cycles,
    lost_work,
    pair_cycles,
    split_branches,
)
from ._errors import InputError

BranchChoice = Literal["loading", "unloading", "both"]
"""Which branches of the chosen cycles a fit uses."""

_ZERO_WINDOW = (0.02, 0.20)  # of the peak force: readings from which zero force is found
_MAX_ORDER = 8


@dataclasses.dataclass(frozen=True)
class TensileRecord:
    """The record of a cyclic tensile test on a strip or tube, in order of time.

    Attributes:
        force: F [N], shape (n,), positive in tension.
        displacement: d [m], shape (n,), of the grips; zero at the gauge length.
        gauge_length: l0 [m], unloaded length between the grips before the test.
        area: A0 [m2], unloaded cross-section of the rubber before the test.
        time: [s], shape (n,), or None.
        source: where the numbers come from.
    """

    force: Float[np.ndarray, " n"]
    displacement: Float[np.ndarray, " n"]
    gauge_length: float
    area: float
    time: Float[np.ndarray, " n"] | None = None
    source: str = "arrays"

    def __post_init__(self) -> None:
        columns = {"force": self.force, "displacement": self.displacement, "time": self.time}
        for name, values in checked_columns(columns).items():
            object.__setattr__(self, name, values)
        for name, unit in (("gauge_length", "m"), ("area", "m2")):
            size = getattr(self, name)
            if not (np.isfinite(size) and size > 0):
                raise InputError(f"{name} must be > 0 and finite, got {size} {unit}")
        length = self.gauge_length + self.displacement.min()
        if length <= 0:
            raise InputError(
                f"a displacement of {self.displacement.min():.6g} m shortens the gauge length of "
                f"{self.gauge_length:.6g} m to {length:.6g} m: check the units and the zero"
            )

    @property
    def volume(self) -> float:
        """Volume [m3] of the rubber between the grips, A0 l0; constant."""
        return self.area * self.gauge_length

    @property
    def true_stress(self) -> Float[np.ndarray, " n"]:
        """True stress [Pa] at constant volume, F l / V with l = l0 + d: F/A (1 + eps)."""
        return self.force * (self.gauge_length + self.displacement) / self.volume


@dataclasses.dataclass(frozen=True)
class TensileCycle:
    """What one cycle of a tensile test shows.

    Attributes:
        number: from 1.
        max_strain: largest engineering strain [-] on the loading branch, of the gauge length
            before the test.
        peak_stress: true stress [Pa] on the loading branch at the largest displacement that all
            cycles reach.
        peak_ratio, peak_ratio_stderr: of that stress to the first cycle's [-].
        half_ratio, half_ratio_stderr: the same at half that displacement [-], where softening
            shows most.
        permanent_set, permanent_set_stderr: displacement [m] at which unloading brings the force
            back to zero; nan where the cycle does not return to it.
        gauge_length: unloaded length [m] after the cycle.
        lost_energy: work lost in the cycle per volume of rubber [J/m3].
        rate: mean speed [m/s] of the loading branch, or None where no time is known.
    """

    number: int
    max_strain: float
    peak_stress: float
    peak_ratio: float
    peak_ratio_stderr: float
    half_ratio: float
    half_ratio_stderr: float
    permanent_set: float
    permanent_set_stderr: float
    gauge_length: float
    lost_energy: float
    rate: float | None


@dataclasses.dataclass(frozen=True)
class TensileFit:
    """The odd polynomial through zero that fits the true stress of chosen cycles best.

    Attributes:
        coefficients: E_n [Pa], shape (order,).
        stderr: standard errors [Pa], shape (order,), with those of the unloaded lengths. They
            hold for independent readings; where hysteresis or a wrong order make neighbouring
            residuals alike, they are too small.
        mae, rmse: mean absolute and root mean square error [Pa].
        cycles, branch: what was fitted.
        strain: engineering strain [-] from each branch's own unloaded length, shape (readings,).
        stress: true stress [Pa], shape (readings,).
        residuals: law minus stress [Pa], shape (readings,).
    """

    coefficients: Float[np.ndarray, " order"]
    stderr: Float[np.ndarray, " order"]
    mae: float
    rmse: float
    cycles: tuple[int, ...]
    branch: BranchChoice
    strain: Float[np.ndarray, " readings"]
    stress: Float[np.ndarray, " readings"]
    residuals: Float[np.ndarray, " readings"]

    @property
    def material(self) -> famjax.PolynomialMaterial:
        """The law, for a `famjax.Muscle`."""
        return famjax.PolynomialMaterial(self.coefficients)


@dataclasses.dataclass(frozen=True)
class Characterisation:
    """A bladder's tensile test, evaluated.

    Attributes:
        cycles: every complete cycle.
        fit: the stress law.
        mullins: the second cycle is softer than the first at half displacement by more than
            three standard errors; False where there is only one cycle.
    """

    cycles: tuple[TensileCycle, ...]
    fit: TensileFit
    mullins: bool


def characterise_bladder(
    record: TensileRecord,
    *,
    order: int = 3,
    cycles: Sequence[int] = (3, 4, 5),
    branch: BranchChoice = "loading",
    min_travel: float = 0.5,
) -> Characterisation:
    """Softening, permanent set and stress law of a bladder from its cyclic tensile test.

    True stress follows from constant volume, sigma = F (l0 + d) / (A0 l0). Every branch's strain is
    counted from its own unloaded length, l0 + the displacement at which its force is zero. That
    displacement comes from a parabola through the true stress between 2 and 20 % of the peak force,
    so that slack or buckling below does not matter. The fit takes the readings with strain > 0.

    Args:
        record: the test.
        order: of the law sigma = sum E_n eps^n, 1 to 8.
        cycles: numbers of the cycles to fit, from 1; the first ones soften (Mullins).
        branch: "loading", "unloading" or "both".
        min_travel: least travel of a branch as a fraction of the whole, see `split_branches`.

    Returns:
        The evaluated test.

    Raises:
        InputError: no cycles, fewer than asked for, a chosen cycle that does not return to zero
            force, too few readings, or an option that is not known.

    References:
        Mullins 1969; Chambers 2021, chapter 6 (cycles 3 to 5, third order).
    """
    if not 1 <= order <= _MAX_ORDER:
        raise InputError(f"order must be 1 to {_MAX_ORDER}, got {order}")
    if branch not in {"loading", "unloading", "both"}:
        raise InputError(f'branch must be "loading", "unloading" or "both", got {branch!r}')
    found = pair_cycles(
        split_branches(record.displacement, min_travel=min_travel), rising_first=True
    )
    chosen = choose_cycles(found, cycles)
    fit = _fit(record, chosen, tuple(cycles), order, branch)
    reports = _reports(record, found)
    second = reports[1] if len(reports) > 1 else None
    softer = second is not None and 1 - second.half_ratio > 3 * second.half_ratio_stderr
    return Characterisation(cycles=reports, fit=fit, mullins=softer)


def _fit(
    record: TensileRecord,
    chosen: Sequence[Cycle],
    numbers: tuple[int, ...],
    order: int,
    branch: BranchChoice,
) -> TensileFit:
    loading = [cycle.first for cycle in chosen] if branch != "unloading" else []
    unloading = [cycle.second for cycle in chosen] if branch != "loading" else []
    strains, stresses, shifts = [], [], []
    for part in loading + unloading:
        zero, zero_stderr = _zero_force(record, part)
        if not np.isfinite(zero):
            low = record.force[part.rows].min()
            raise InputError(
                "a chosen cycle does not return to zero force, or noise or too few readings hide "
                f"where: from reading {part.start + 1} to {part.stop} the least force is {low:.6g} "
                "N. Choose other cycles or the other branch, or unload the specimen fully"
            )
        unloaded = record.gauge_length + zero
        strain = (record.displacement[part.rows] - zero) / unloaded
        strains.append(strain[strain > 0])
        stresses.append(record.true_stress[part.rows][strain > 0])
        # d eps / d zero times its error: one number shifts a whole branch.
        shifts.append((1 + strains[-1]) / unloaded * zero_stderr)
    strain, stress = np.concatenate(strains), np.concatenate(stresses)
    if strain.size <= order:
        raise InputError(
            f"{strain.size} readings under tension cannot give {order} coefficients and their "
            "errors: lower the order, or choose more cycles"
        )
    powers = np.arange(1, order + 1)
    scale = strain.max() ** powers
    inverse = np.linalg.pinv(strain[:, None] ** powers / scale) / scale[:, None]
    coefficients = inverse @ stress
    residuals = strain[:, None] ** powers @ coefficients - stress
    variance = residuals @ residuals / (strain.size - order)
    covariance = variance * inverse @ inverse.T
    slope = strain[:, None] ** (powers - 1) @ (powers * coefficients)
    ends = np.cumsum([len(part) for part in strains])
    for stop, shift in zip(ends, shifts, strict=True):
        rows = slice(stop - len(shift), stop)
        move = inverse[:, rows] @ (slope[rows] * shift)
        covariance += np.outer(move, move)
    return TensileFit(
        coefficients=coefficients,
        stderr=np.sqrt(np.diag(covariance)),
        mae=float(np.mean(np.abs(residuals))),
        rmse=float(np.sqrt(np.mean(residuals**2))),
        cycles=numbers,
        branch=branch,
        strain=strain,
        stress=stress,
        residuals=residuals,
    )


def _reports(record: TensileRecord, cycles: Sequence[Cycle]) -> tuple[TensileCycle, ...]:
    d, stress = record.displacement, record.true_stress
    common = min(d[cycle.first.rows].max() for cycle in cycles)
    first: tuple[tuple[float, float], ...] | None = None
    reports = []
    for number, cycle in enumerate(cycles, 1):
        rows = cycle.first.rows
        levels = tuple(_local_value(d[rows], stress[rows], at) for at in (common, common / 2))
        first = first or levels
        peak, half = (_ratio(level, base) for level, base in zip(levels, first, strict=True))
        permanent, permanent_stderr = _zero_force(record, cycle.second)
        time = None if record.time is None else np.ptp(record.time[rows])
        reports.append(
            TensileCycle(
                number=number,
                max_strain=float(d[rows].max() / record.gauge_length),
                peak_stress=levels[0][0],
                peak_ratio=peak[0],
                peak_ratio_stderr=peak[1],
                half_ratio=half[0],
                half_ratio_stderr=half[1],
                permanent_set=permanent,
                permanent_set_stderr=permanent_stderr,
                gauge_length=record.gauge_length + permanent,
                lost_energy=lost_work(d, record.force, cycle) / record.volume,
                rate=float(np.ptp(d[rows]) / time) if time else None,
            )
        )
    return tuple(reports)


def _zero_force(record: TensileRecord, branch: Branch) -> tuple[float, float]:
    """Displacement [m] at which a branch's force is zero, and its standard error; nan if never."""
    way = slice(None, None, 1 if branch.rising else -1)
    force, x, y = (
        column[branch.rows][way]
        for column in (record.force, record.displacement, record.true_stress)
    )
    # The window's ends are looked for in a running mean, so that noise does not draw them in.
    span = 2 * (force.size // 100) + 1
    smooth = np.convolve(np.pad(force, span // 2, mode="edge"), np.ones(span) / span, "valid")
    low, high = (part * smooth.max() for part in _ZERO_WINDOW)
    stop = int(np.argmax(smooth >= high))
    slack = np.flatnonzero(smooth[:stop] <= low)
    if smooth.max() <= 0 or not slack.size or stop - slack[-1] < 6:
        return np.nan, np.nan
    near = slice(int(slack[-1]) + 1, stop)
    (c0, c1, c2), covariance = _parabola(x[near] - x[near][0], y[near])
    square = c1**2 - 4 * c0 * c2
    if c1 <= 0 or square <= 0:
        return np.nan, np.nan
    t = -2 * c0 / (c1 + np.sqrt(square))
    row = np.array([1.0, t, t**2])
    return float(x[near][0] + t), float(np.sqrt(row @ covariance @ row / square))


def _local_value(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], at: float
) -> tuple[float, float]:
    """Value and standard error of noisy y at x, by a parabola through the readings near it."""
    count = min(max(9, x.size // 20), x.size)
    if count < 5:
        raise InputError(f"a branch has only {count} readings: record at least 5, better 100")
    near = np.argsort(np.abs(x - at), kind="stable")[:count]
    coefficients, covariance = _parabola(x[near] - at, y[near])
    return float(coefficients[0]), float(np.sqrt(covariance[0, 0]))


def _parabola(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Coefficients, constant first, of the parabola that fits best, and their covariance; n > 3."""
    scale = np.abs(x).max() ** np.arange(3)
    powers = np.vander(x, 3, increasing=True)
    inverse = np.linalg.pinv(powers / scale) / scale[:, None]
    residual = y - powers @ inverse @ y
    return inverse @ y, inverse @ inverse.T * (residual @ residual / (x.size - 3))


def _ratio(value: tuple[float, float], base: tuple[float, float]) -> tuple[float, float]:
    """Ratio of two values with its standard error; the base to itself is one, without error."""
    if value is base:
        return 1.0, 0.0
    ratio = value[0] / base[0]
    return ratio, float(np.hypot(value[1], ratio * base[1]) / abs(base[0]))
