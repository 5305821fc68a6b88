"""Tests of rubber and thread: softening and stress law, and the modulus of threads in the muscle."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

import famjax
from famjax.boundary.errors import InputError

from .record import Branch, Column, check_positive, checked_columns, set_columns, split_branches

BranchChoice = Literal["loading", "unloading", "both"]
"""Which branches of the chosen cycles a fit uses."""

_MAX_ORDER = 8
_ZERO_WINDOW = (0.02, 0.20)  # of the peak force: readings from which zero force is found


@dataclasses.dataclass(frozen=True)
class TensileRecord:
    """The record of a cyclic tensile test on a strip or tube, in order of time.

    Attributes:
        force: F [N], shape (n,), positive in tension.
        displacement: d [m], shape (n,), of the grips; zero at the gauge length.
        gauge_length: l0 [m], unloaded length between the grips before the test.
        area: A0 [m2], unloaded cross-section of the rubber before the test.
        time: [s], shape (n,), or None.
    """

    force: Column
    displacement: Column
    gauge_length: float
    area: float
    time: Column | None = None

    def __post_init__(self) -> None:
        set_columns(self, "force", "displacement", "time")
        check_positive(gauge_length=self.gauge_length, area=self.area)
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
    def true_stress(self) -> Column:
        """True stress [Pa] at constant volume, F l / V with l = l0 + d: F/A (1 + eps)."""
        return self.force * (self.gauge_length + self.displacement) / self.volume


@dataclasses.dataclass(frozen=True)
class TensileCycle:
    """What one cycle of a tensile test shows.

    Attributes:
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
        strain: engineering strain [-] from each branch's own unloaded length, shape (readings,).
        stress: true stress [Pa], shape (readings,).
        residuals: law minus stress [Pa], shape (readings,).
    """

    coefficients: Float[np.ndarray, " order"]
    stderr: Float[np.ndarray, " order"]
    mae: float
    rmse: float
    strain: Column
    stress: Column
    residuals: Column

    @property
    def material(self) -> famjax.PolynomialMaterial:
        """The law, for a `famjax.Muscle`."""
        return famjax.PolynomialMaterial(self.coefficients)


@dataclasses.dataclass(frozen=True)
class BladderCharacterisation:
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
) -> BladderCharacterisation:
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
    branches = split_branches(record.displacement, min_travel=min_travel)
    found = [pair for pair in itertools.pairwise(branches) if pair[0].rising]
    if not found:
        raise InputError(
            "no complete cycle was found: the position must go there and back at least once; check "
            "the column, or lower min_travel if the cycles differ in amplitude"
        )
    if not cycles or min(cycles) < 1 or len(set(cycles)) != len(cycles):
        raise InputError(f"cycles must be different numbers from 1 up, got {list(cycles)}")
    if max(cycles) > len(found):
        raise InputError(
            f"cycle {max(cycles)} was asked for, but the record has {len(found)} complete: choose "
            "among these, or record more"
        )
    chosen = [found[number - 1] for number in cycles]
    loading = [there for there, _ in chosen] if branch != "unloading" else []
    unloading = [back for _, back in chosen] if branch != "loading" else []
    fit = _fit_law(record, loading + unloading, order)
    reports = _cycles(record, found)
    second = reports[1] if len(reports) > 1 else None
    softer = second is not None and 1 - second.half_ratio > 3 * second.half_ratio_stderr
    return BladderCharacterisation(cycles=reports, fit=fit, mullins=softer)


def _fit_law(record: TensileRecord, branches: Sequence[Branch], order: int) -> TensileFit:
    strains, stresses, shifts = [], [], []
    for part in branches:
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
    design = strain[:, None] ** powers
    inverse = np.linalg.pinv(design)
    coefficients = inverse @ stress
    residuals = design @ coefficients - stress
    covariance = inverse @ inverse.T * (residuals @ residuals / (strain.size - order))
    slope = strain[:, None] ** (powers - 1) @ (powers * coefficients)
    stop = 0
    for shift in shifts:
        rows = slice(stop, stop := stop + shift.size)
        move = inverse[:, rows] @ (slope[rows] * shift)
        covariance += np.outer(move, move)
    return TensileFit(
        coefficients=coefficients,
        stderr=np.sqrt(np.diag(covariance)),
        mae=float(np.mean(np.abs(residuals))),
        rmse=float(np.sqrt(np.mean(residuals**2))),
        strain=strain,
        stress=stress,
        residuals=residuals,
    )


def _cycles(
    record: TensileRecord, cycles: Sequence[tuple[Branch, Branch]]
) -> tuple[TensileCycle, ...]:
    """What each of the cycles of a record shows."""
    d, F = record.displacement, record.force
    common = min(d[there.rows].max() for there, _ in cycles)
    levels = [_stress_at(record, there, np.array([common, common / 2])) for there, _ in cycles]
    first, first_stderr = levels[0]
    reports = []
    for (there, back), (stress, stderr) in zip(cycles, levels, strict=True):
        ratio = stress / first
        ratio_stderr = np.hypot(stderr, ratio * first_stderr) / np.abs(first)
        if not reports:
            ratio_stderr = np.zeros(2)  # the first to itself
        permanent, permanent_stderr = _zero_force(record, back)
        x, pull = d[there.start : back.stop], F[there.start : back.stop]
        time = None if record.time is None else np.ptp(record.time[there.rows])
        reports.append(
            TensileCycle(
                max_strain=float(d[there.rows].max() / record.gauge_length),
                peak_stress=float(stress[0]),
                peak_ratio=float(ratio[0]),
                peak_ratio_stderr=float(ratio_stderr[0]),
                half_ratio=float(ratio[1]),
                half_ratio_stderr=float(ratio_stderr[1]),
                permanent_set=permanent,
                permanent_set_stderr=permanent_stderr,
                gauge_length=record.gauge_length + permanent,
                lost_energy=_lost_work(x, pull) / record.volume,
                rate=float(np.ptp(d[there.rows]) / time) if time else None,
            )
        )
    return tuple(reports)


def _lost_work(x: Column, force: Column) -> float:
    """Work [J] lost in a cycle, the integral of F dx; its ends are joined by a straight line."""
    return float(np.trapezoid(np.append(force, force[0]), np.append(x, x[0])))


def _stress_at(record: TensileRecord, branch: Branch, places: Column) -> tuple[Column, Column]:
    """True stress [Pa] and standard error at displacements, by parabolas through the readings near."""
    x, y = record.displacement[branch.rows], record.true_stress[branch.rows]
    count = min(max(9, x.size // 20), x.size)
    if count < 5:
        raise InputError(f"a branch has only {count} readings: record at least 5, better 100")
    found = []
    for at in places:
        near = np.argsort(np.abs(x - at), kind="stable")[:count]
        parabola, covariance = np.polyfit(x[near] - at, y[near], 2, cov=True)
        found.append((parabola[-1], np.sqrt(covariance[-1, -1])))
    values, stderr = np.array(found).T
    return values, stderr


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
    (c2, c1, c0), covariance = np.polyfit(x[near] - x[near][0], y[near], 2, cov=True)
    square = c1**2 - 4 * c0 * c2
    if c1 <= 0 or square <= 0:
        return np.nan, np.nan
    t = -2 * c0 / (c1 + np.sqrt(square))
    row = np.array([t**2, t, 1.0])
    return float(x[near][0] + t), float(np.sqrt(row @ covariance @ row / square))


@dataclasses.dataclass(frozen=True)
class ModulusFit:
    """A line through stress against strain.

    Attributes:
        modulus: its slope E_b [Pa].
        modulus_stderr: [Pa]; infinite where the points are as many as the numbers fitted.
        intercept: stress [Pa] at zero strain; zero where the line is constrained through the origin.
        intercept_stderr: [Pa]; zero where the line is constrained through the origin.
        count: points fitted.
    """

    modulus: float
    modulus_stderr: float
    intercept: float
    intercept_stderr: float
    count: int


@dataclasses.dataclass(frozen=True)
class InSitu:
    """State of the threads at each reading, and the moduli that follow.

    Attributes:
        thread_length: B [m], shape (n,).
        braid_angle: theta [rad], from the circumference, shape (n,).
        strain: B / B0 - 1 [-], shape (n,).
        tension: T [N] of one thread, shape (n,).
        stress: T / A_b [Pa], shape (n,).
        rest_thread_length: B0 [m].
        linear: line through all points.
        proportional: line through all points and the origin, the law of `LinearThread`. An error
            of B0 enters it whole: all strains shift alike. The slopes of the others do not notice.
        high_pressure: line through the points at high pressure, beyond the toe region.
    """

    thread_length: Column
    braid_angle: Column
    strain: Column
    tension: Column
    stress: Column
    rest_thread_length: float
    linear: ModulusFit
    proportional: ModulusFit
    high_pressure: ModulusFit


def thread_in_situ(
    diameter: ArrayLike,
    force: ArrayLike,
    pressure: ArrayLike,
    *,
    length: float,
    turns: float,
    n_threads: int,
    area: float,
    rest_thread_length: float | None = None,
    high_pressure: float | None = None,
) -> InSitu:
    """Strain, stress and modulus of the threads while they hold a muscle at its resting length.

    B = sqrt(L^2 + (pi N D)^2),  T = (F + P pi R^2) / (n sin(theta)),  sin(theta) = L / B

    The ends, where the muscle is narrower than its diameter, are neglected.

    Args:
        diameter: braid diameter D [m] at each reading, shape (n,), > 0.
        force: pull F [N], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,), >= 0.
        length: active length L [m], the same at every reading.
        turns: N [-].
        n_threads: n [-], threads of both families.
        area: A_b [m2], section of the fibres of one thread.
        rest_thread_length: B0 [m]; if None, the mean of B at the readings with P = 0.
        high_pressure: least pressure [Pa] of the high-pressure line; if None, half the largest.

    Returns:
        The states and the moduli, each with its standard error.

    Raises:
        InputError: what is wrong with the readings.

    References:
        Chambers 2021, section 5.1.
    """
    readings = {"diameter": diameter, "force": force, "pressure": pressure}
    D, F, P = checked_columns(readings, least=2).values()
    assert D is not None
    assert F is not None
    assert P is not None
    if D.min() <= 0 or P.min() < 0:
        raise InputError(
            f"diameters must be > 0 and gauge pressures >= 0, got {D.min():.6g} m and {P.min():.6g} "
            "Pa at the least"
        )
    check_positive(length=length, turns=turns, n_threads=n_threads, area=area)
    B = np.hypot(length, np.pi * turns * D)
    if rest_thread_length is None:
        if not (P == 0).any():
            raise InputError(
                "strain is counted from the unpressurised thread: give a reading at zero pressure, "
                "or rest_thread_length in m"
            )
        rest_thread_length = float(B[P == 0].mean())
    check_positive(rest_thread_length=rest_thread_length)
    strain = B / rest_thread_length - 1
    tension = (F + P * np.pi * D**2 / 4) * B / (n_threads * length)
    stress = tension / area
    threshold = P.max() / 2 if high_pressure is None else high_pressure
    high = threshold <= P
    slope = float(strain @ stress / (strain @ strain))
    off = stress - slope * strain
    error = float(np.sqrt(off @ off / (strain.size - 1) / (strain @ strain)))
    return InSitu(
        thread_length=B,
        braid_angle=np.arcsin(length / B),
        strain=strain,
        tension=tension,
        stress=stress,
        rest_thread_length=rest_thread_length,
        linear=_line(strain, stress, "at all pressures"),
        proportional=ModulusFit(slope, error, 0.0, 0.0, strain.size),
        high_pressure=_line(strain[high], stress[high], f"at or above {threshold:.4g} Pa"),
    )


def _line(x: Column, y: Column, where: str) -> ModulusFit:
    """The least-squares line y = E x + c."""
    if np.unique(x).size < 2:
        raise InputError(
            f"a modulus needs readings at two different strains; {where} there are "
            f"{np.unique(x).size}: give more pressures, or another high_pressure"
        )
    from scipy.stats import linregress  # noqa: PLC0415 -- SciPy's statistics take 0.5 s

    found = linregress(x, y)
    slope, intercept = float(found.slope), float(found.intercept)
    if x.size == 2:  # which leave nothing to tell an error by
        return ModulusFit(slope, np.inf, intercept, np.inf, 2)
    return ModulusFit(slope, float(found.stderr), intercept, float(found.intercept_stderr), x.size)
