"""The engine: derivatives through the convex fit, batches, padded sizes, several specimens."""

import pickle

import numpy as np
import pytest

from fitting import ForceData, Parameter
from fitting.engine import Batch, partial, predict, solve
from fitting.posing import pose
from fitting.problem import Problem
from fitting.search import descend, descend_many, latin_hypercube

STEP = 1e-5  # of the box
NOISE = 1e-7  # of a difference so made, of the largest derivative
ROUNDING = 1e-12  # relative: operations in another order
RIG = {"series_compliance": Parameter(min=1e-6, max=2e-5, unit="m/N")}


def fits(problem: Problem, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, list]:
    """Residuals, Jacobians and points at some places of the unit box."""
    batch, members = Batch([problem]), np.zeros(len(u), int)
    found = batch.evaluate(members, batch.parameters(members, u))
    points = [chunk.point(row) for chunk, row in found]
    return *batch.residual_and_jacobian(members, found), points


def two_points(problem: Problem) -> np.ndarray:
    """Of the unit box: one with an active row away from the start of a path, and one with none."""
    u = np.random.default_rng(0).uniform(0.02, 0.98, (40, len(problem.free)))
    own = sum(problem.path_rows)
    points = fits(problem, u)[2]
    pushed = np.array([((one.rows > 0) & (one.rows < own)).any() for one in points])
    assert 0 < pushed.sum() < pushed.size
    return np.stack([u[pushed][0], u[~pushed][0]])


@pytest.mark.parametrize("options", [{"order": 2}, {"parameters": RIG}], ids=["rigid", "compliant"])
def test_the_derivative_through_the_convex_fit_is_that_of_differences(
    dmsp20: ForceData, options: dict
) -> None:
    problem = pose((dmsp20,), **options).problem
    for u in two_points(problem):
        (r,), (J,), _ = fits(problem, u[None])
        moves = STEP * np.eye(u.size)
        above, below = (fits(problem, u + sign * moves)[0] for sign in (1, -1))
        if options == {"order": 2}:
            found, difference = J, (above - below).T / (2 * STEP)
        else:  # what moves the linear model of a rig is left out (Kaufman 1975): the cost sees none of it
            found = r @ J
            difference = ((above**2).sum(axis=1) - (below**2).sum(axis=1)) / (4 * STEP)
        np.testing.assert_allclose(found, difference, rtol=0, atol=NOISE * np.abs(found).max())


def test_partial_derivatives_are_those_at_constant_coefficients(dmsp20: ForceData) -> None:
    known = Parameter(prior=(dmsp20.specimen.rest_length, 1e-3), unit="m")
    problem = pose((dmsp20,), order=2, noise=5.0, parameters={"rest_length": known}).problem
    p = problem.low + 0.4 * (problem.high - problem.low)
    point, width = solve(problem, p), problem.high - problem.low
    d_residual, d_slack = partial(point)
    for k in problem.free:
        step = 1e-6 * width[k] * np.eye(p.size)[k]
        above, below = solve(problem, p + step), solve(problem, p - step)
        moved = [one.A @ point.x - one.b for one in (above, below)]
        slack = [one.G @ point.x - one.h for one in (above, below)]
        for found, (up, down) in ((d_residual, moved), (d_slack, slack)):
            largest = np.abs(found * width).max() / width[k]
            difference = (up - down) / (2 * step[k])
            np.testing.assert_allclose(found[:, k], difference, rtol=0, atol=NOISE * largest)


def test_a_batch_is_the_fits_one_by_one(dmsp20: ForceData) -> None:
    problem = pose((dmsp20,), order=2).problem
    whole = np.ones(problem.force.size)
    some = whole.copy()
    some[::5] = 0.0
    problems = [problem.with_readings(factor=factor) for factor in (whole, some)]
    starts = latin_hypercube(problem.free.size, 5, seed=1)
    many = descend_many([one for one in problems for _ in starts], [*starts, *starts])
    alone = [descend(one, start) for one in problems for start in starts]
    for one, other in zip(many, alone, strict=True):
        assert one.converged
        assert one.steps == other.steps
        assert one.cost == pytest.approx(other.cost, rel=ROUNDING)
        np.testing.assert_allclose(one.u, other.u, rtol=0, atol=1e-9)


def test_a_problem_that_was_sent_is_the_same(dmsp10: ForceData) -> None:
    problem = pose((dmsp10,), order=2).problem
    sent = pickle.loads(pickle.dumps(problem))
    start = latin_hypercube(3, 1, seed=4)[0]
    here, there = descend(problem, start), descend(sent, start)
    np.testing.assert_array_equal(here.point.residual, there.point.residual)
    np.testing.assert_array_equal(here.u, there.u)


def test_parts_of_a_joint_problem_are_the_problems_alone(
    dmsp20: ForceData, dmsp10: ForceData
) -> None:
    own = ("deadband_pressure", "braid_diameter", "braid_angle")
    joint = pose([dmsp20, dmsp10], own=own, own_law=True, order=2).problem
    p = joint.low + 0.3 * (joint.high - joint.low)
    both = solve(joint, p)
    for place, data in enumerate((dmsp20, dmsp10)):
        alone, part = pose((data,), order=2).problem, joint.parts[place]
        one = solve(alone, p[part.at])
        np.testing.assert_allclose(both.x[part.coefficients], one.x, rtol=1e-9)
        np.testing.assert_allclose(
            both.residual[joint.readings[place]], one.residual, atol=1e-9 * np.abs(one.b).max()
        )
        length = np.linspace(0.8, 1.0, 9) * data.specimen.rest_length
        at = length, np.full(9, 3e5)
        np.testing.assert_allclose(
            predict(joint, place, p, both.x, *at),
            predict(alone, 0, p[part.at], one.x, *at),
            rtol=1e-9,
        )
