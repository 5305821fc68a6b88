"""Intervals cover as they should, over 200 replicates; what data cannot tell is said to be so."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

import famjax
from fitting import ForceData, Parameter, Specimen, identify
from fitting.covariance import covariance
from fitting.engine import solve
from fitting.summary import joint_derivatives
from fitting.validation import best_ends

pytestmark = pytest.mark.slow

REPLICATES, NOISE = 200, 2.0
SPECIMEN = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)


def _data() -> ForceData:
    braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=math.radians(65), length=0.3)
    bladder = famjax.Bladder(0.3, 0.022, 0.002, embedded=True)
    law = famjax.PolynomialMaterial([4e6, -6e6, 6e6])
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 30e3)
    L, P = (g.ravel() for g in np.meshgrid(np.linspace(0.3, 0.25, 8), np.linspace(3e5, 7e5, 5)))
    return ForceData(np.asarray(muscle.force(L, P)), P, L, SPECIMEN)


def test_intervals_cover_over_200_replicates() -> None:
    """The hit rates lie within the 99.9 % range of a binomial with the promised probability."""
    data = _data()
    exact = identify(data, starts=8)
    truth = np.array([e.value for e in exact.estimates])
    noise = np.random.default_rng(11).normal(0, NOISE, (REPLICATES, data.force.size))
    batch = [exact.problem.with_readings(force=exact.problem.force + drawn) for drawn in noise]
    ends = best_ends(batch, [exact.end.u[None]] * REPLICATES)
    assert all(end.converged for end in ends)
    points = [end.point for end in ends]
    values = np.array([np.concatenate([point.parameters, point.x]) for point in points])
    errors = []
    for problem, point in zip(batch, points, strict=True):
        residual, jacobian, _ = joint_derivatives(solve(problem, point.parameters))
        held = np.zeros(jacobian.shape[1], bool)
        errors.append(covariance(jacobian, residual, np.zeros((0, held.size)), held).stderr)
    pulls = np.abs(values - truth) / np.array(errors)
    freedom = data.force.size - truth.size
    for level in (0.68, 0.95):
        inside = (pulls < stats.t.ppf((1 + level) / 2, freedom)).sum(axis=0)
        low, high = stats.binom.ppf([0.0005, 0.9995], REPLICATES, level)
        assert (low <= inside).all(), (level, inside)
        assert (inside <= high).all(), (level, inside)


def test_a_ridge_is_reported_as_such() -> None:
    """Rest length and deadband together are not told apart by a map without any bladder strain."""
    data = _data()
    two = np.isin(data.length, np.unique(data.length)[-2:])
    part = dataclasses.replace(
        data, force=data.force[two], pressure=data.pressure[two], length=data.length[two]
    )
    result = identify(
        part,
        order=1,
        parameters={
            "rest_length": Parameter(min=297.0, max=303.0, unit="mm"),
            "end_factor": Parameter(),
        },
        starts=4,
    )
    told = " ".join(result.warnings)
    assert "Ridge" in told or "do not determine every parameter" in told
    for estimate in result.estimates:
        assert math.isnan(estimate.stderr) or estimate.stderr > 0
    if "do not determine every parameter" in told:
        assert all(math.isnan(e.stderr) for e in result.estimates)


@pytest.mark.parametrize("std", [0.0, -1.0, math.nan])
def test_priors_need_a_spread(std: float) -> None:
    from fitting import InputError

    with pytest.raises(InputError, match="a mean and a standard deviation > 0"):
        identify(
            _data(),
            parameters={"rest_length": Parameter(prior=(300.0, std), unit="mm")},
            noise=1.0,
        )
