"""The league table against scipy, against the project's study of peers, and against itself."""

import dataclasses
import math

import jax
import numpy as np
import pytest
from scipy import optimize

from fitting import ForceData, InputError
from fitting.comparison import PeerFit, compare, fit_peer
from fitting.validation import leave_out_each

pytestmark = pytest.mark.slow
STUDY = 6e-3  # figures known to two decimals


@pytest.fixture(scope="module")
def sarosi(dmsp10: ForceData) -> PeerFit:
    return fit_peer("sarosi_6", dmsp10)


def _error(fit: PeerFit, data: ForceData) -> np.ndarray:
    return fit.predicted - data.force[data.loaded]


def test_sarosi_6_is_the_optimum_that_scipy_finds(dmsp10, sarosi):
    """Variable projection by hand: a bracketed search over the rate, least squares inside."""
    at = dmsp10.loaded
    P, F = dmsp10.pressure[at] / 1e5, dmsp10.force[at]
    eps = 1 - dmsp10.length[at] / dmsp10.specimen.rest_length

    def residual(rate: float) -> np.ndarray:
        bent = np.exp(rate * eps)
        A = np.stack([P * bent, bent, P * eps, P, np.ones_like(P)], axis=1)
        return A @ np.linalg.lstsq(A, F, rcond=None)[0] - F

    def cost(rate: float) -> float:
        return float(np.sum(residual(rate) ** 2))

    grid = -np.geomspace(1, 300, 200)
    best = int(np.argmin([cost(rate) for rate in grid]))
    theirs = optimize.minimize_scalar(
        cost, bounds=(grid[best + 1], grid[best - 1]), method="bounded", options={"xatol": 1e-9}
    )
    assert np.sum(_error(sarosi, dmsp10) ** 2) == pytest.approx(theirs.fun, rel=1e-7)
    assert sarosi.values["a3"] == pytest.approx(theirs.x, rel=1e-4)  # flat at its minimum
    assert (sarosi.end.converged, sarosi.at_bound) == (True, ())


def test_sarosi_6_has_the_errors_of_the_study(dmsp10, sarosi):
    assert np.sqrt(np.mean(_error(sarosi, dmsp10) ** 2)) == pytest.approx(1.10, abs=STUDY)
    fits, kinds = [(sarosi.problem, sarosi.end.u)], {"pressure": (None, 8), "length": (None, 8)}
    (left_out,) = leave_out_each(fits, kinds, seed=0, settled=True, least=2)
    by_pressure, by_length = (left_out[kind] for kind in kinds)
    assert by_pressure.rmse == pytest.approx(1.36, abs=STUDY)
    assert by_length.interior_rmse == pytest.approx(8.1, abs=0.05)
    assert by_length.rmse == pytest.approx(81, abs=0.5)


def test_the_table_holds_every_model_the_best_first(dmsp10):
    seen: list[tuple[int, int]] = []
    found = compare(dmsp10, ["hildebrandt", "gaylord"], progress=lambda *state: seen.append(state))
    rows = {row.name: row for row in found.rows}
    out = [one for row in found.rows if math.isfinite(one := row.lolo_interior_rmse)]
    assert out == sorted(out)
    assert all(math.isnan(row.lolo_interior_rmse) for row in found.rows[len(out) :])
    assert rows["hildebrandt"].rmse == pytest.approx(1.12, abs=STUDY)
    assert rows["hildebrandt"].lopo_rmse == pytest.approx(1.43, abs=STUDY)
    assert rows["gaylord"].lolo_interior_rmse > rows["gaylord"].rmse
    assert seen[0] == (0, 2)
    assert seen[-1] == (2, 2)


def test_bad_requests_are_refused(dmsp10, monkeypatch):
    known = "unknown model 'sarosi'; available for this map: famjax_choice"
    with pytest.raises(InputError, match=known):
        compare(dmsp10, ["sarosi"])
    with pytest.raises(InputError, match="unknown published model 'hocking'"):
        fit_peer("hocking", dmsp10)
    with pytest.raises(InputError, match="starts must be a whole number >= 1, got 0"):
        fit_peer("hildebrandt", dmsp10, starts=0)
    inches = dataclasses.replace(dmsp10, length=dmsp10.length * 2.54)
    with pytest.raises(InputError, match="has a length of 635 mm, which is too long for a braid"):
        fit_peer("hildebrandt", inches)
    few = dmsp10.part(dmsp10.pressure > 6.4e5)
    with pytest.raises(InputError, match="has 8 parameters, but the map has 4 loaded readings"):
        fit_peer("hildebrandt", few)
    with pytest.raises(InputError, match="leaving out a pressure requires loaded readings"):
        compare(few, ["hildebrandt"])
    with monkeypatch.context() as patched:
        patched.setattr(jax.config, "read", lambda name: False)
        with pytest.raises(RuntimeError, match="fits need float64"):
            fit_peer("hildebrandt", dmsp10)
