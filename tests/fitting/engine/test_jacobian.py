"""The derivative of a fit's residual through its convex programme is that of the residual."""

import numpy as np

from fitting import Parameter, load_bundled
from fitting.engine.stack import Stack
from fitting.search.posing import pose_one

STEP = 1e-5  # of the box
NOISE = 1e-7  # of a difference so made, of the largest derivative
RIG = {"series_compliance": Parameter(min=1e-6, max=2e-5, unit="m/N")}


def fits(stack, points):
    members = np.zeros(len(points), int)
    return members, stack.solve(members, stack.parameters(members, points))


def two_points(stack):
    """Of the unit box: one with an active row away from the start of a path, and one with none."""
    points = np.random.default_rng(0).uniform(0.02, 0.98, (60, len(stack.free)))
    _, found = fits(stack, points)
    own = found.linear[0].rows.shape[1]
    pushed = np.array([((rows > 0) & (rows < own)).any() for rows in found.optimum.rows])
    assert 0 < pushed.sum() < pushed.size
    return np.stack([points[pushed][0], points[~pushed][0]])


def moved(stack, point):
    """Residuals at a step to either side along every parameter."""
    p = len(point)
    residual = fits(stack, point + STEP * np.concatenate([np.eye(p), -np.eye(p)]))[1].residual
    return residual[:p], residual[p:]


def test_a_row_that_is_active_has_its_part_in_the_derivative():
    stack = Stack([pose_one(load_bundled("DMSP-20-300"), order=2).problem])
    points = two_points(stack)
    for point, found in zip(points, stack.jacobian(*fits(stack, points)), strict=True):
        above, below = moved(stack, point)
        difference = (above - below).T / (2 * STEP)
        np.testing.assert_allclose(found, difference, rtol=0, atol=NOISE * np.abs(difference).max())


def test_in_a_rig_that_gives_way_it_is_that_of_the_cost():
    # What moves the linear model's derivative is left out (Kaufman 1975), which the cost does not see.
    stack = Stack([pose_one(load_bundled("DMSP-20-300"), parameters=RIG).problem])
    points = two_points(stack)
    members, found = fits(stack, points)
    slopes = (found.residual[:, None] @ stack.jacobian(members, found))[:, 0]
    for point, slope in zip(points, slopes, strict=True):
        above, below = ((one**2).sum(axis=1) / 2 for one in moved(stack, point))
        difference = (above - below) / (2 * STEP)
        np.testing.assert_allclose(slope, difference, rtol=0, atol=NOISE * np.abs(slope).max())
