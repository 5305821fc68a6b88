"""The bladder's stress law from a cyclic tensile test: a polynomial through chosen cycles."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from .cycles import Cycle, choose_cycles, pair_cycles, split_branches
from .tensile_cycle import TensileCycle, tensile_cycles
from .tensile_record import TensileRecord, zero_force

BranchChoice = Literal["loading", "unloading", "both"]
"""Which branches of the chosen cycles a fit uses."""

_MAX_ORDER = 8


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
    found = pair_cycles(
        split_branches(record.displacement, min_travel=min_travel), rising_first=True
    )
    chosen = choose_cycles(found, cycles)
    fit = _fit(record, chosen, tuple(cycles), order, branch)
    reports = tensile_cycles(record, found)
    second = reports[1] if len(reports) > 1 else None
    softer = second is not None and 1 - second.half_ratio > 3 * second.half_ratio_stderr
    return BladderCharacterisation(cycles=reports, fit=fit, mullins=softer)


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
        zero, zero_stderr = zero_force(record, part)
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
