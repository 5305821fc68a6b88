"""Half-differences of measured muscles, of records and lengths that were left out of the fit."""

import numpy as np
import pytest

from fitting.records import BranchPairs, HysteresisFit, fit_hysteresis, leave_out, ramp_pairs
from tests.fitting import bpa10, festo10

LIMIT = 0.6  # of the measured root mean square
CERTIFIED = 1e-10


def _fit(pairs: BranchPairs) -> HysteresisFit:
    fit = leave_out(fit_hysteresis(pairs))
    assert fit.duality_gap < CERTIFIED
    assert fit.kkt_residual < CERTIFIED
    assert all(fit.heat(k) >= 0 for k in np.unique(pairs.record).tolist())
    return fit


@pytest.mark.slow
def test_bpa10_records_and_lengths_left_out() -> None:
    if not bpa10.FOLDER.is_dir():
        pytest.skip(bpa10.ABSENT)
    for name, made in bpa10.bpa10_maps().items():
        rest_length = bpa10.LENGTHS[name]["Unkink"]
        fit = _fit(ramp_pairs(made.points, rest_length=rest_length))
        ratios = {one.groups: one.ratio for one in fit.left_out}
        assert set(ratios) == {"record", "length"}
        assert max(ratios.values()) <= LIMIT, (name, ratios)


@pytest.mark.slow
def test_festo10_lengths_left_out() -> None:
    if not festo10.FOLDER.is_dir():
        pytest.skip(festo10.ABSENT)
    fits = {name: _fit(pairs) for name, pairs in festo10.festo10_pairs().items()}
    left = {
        name: next(one for one in f.left_out if one.groups == "length") for name, f in fits.items()
    }
    assert len(left) == 5
    assert max(one.ratio for one in left.values()) <= LIMIT
    errors = np.concatenate([one.predicted - one.measured for one in left.values()])
    measured = np.concatenate([one.measured for one in left.values()])
    assert np.sqrt(np.mean(errors**2) / np.mean(measured**2)) <= LIMIT
