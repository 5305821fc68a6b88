"""Inverse maps and antagonistic pairs: round trips, brute force over pressures, codes, derivatives."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from muscles import Lever

import famjax
from famjax.control import AbstractPath, Antagonist, Outcome, Pulley, pressure_for_force

HIGH = 6e5


def test_round_trip(festo):
    L, P = np.linspace(0.22, 0.298, 7)[:, None], np.linspace(0.0, HIGH, 13)
    F = np.asarray(festo.force(L, P))
    found = pressure_for_force(festo, F, L, (0.0, HIGH))
    taut = F >= 0
    assert taut.sum() > 40
    off = np.asarray(found.pressure) - P
    np.testing.assert_allclose(off[taut], 0, atol=1e-6)  # Pa
    assert not np.any(np.asarray(found.code)[taut])
    assert (np.asarray(found.code)[~taut] == Outcome.FORCE_LOW).all()


def test_what_is_not_attained_has_the_nearest_and_a_code(festo):
    F, L = np.array([1e5, -5.0, 100.0, np.nan, 100.0]), np.array([0.28, 0.28, 0.28, 0.28, -1.0])
    found = pressure_for_force(festo, F, L, (2e5, HIGH))
    names = [Outcome(code).name for code in found.code.tolist()]
    assert names == ["FORCE_HIGH", "FORCE_LOW", "FORCE_LOW", "NO_STATE", "NO_STATE"]
    np.testing.assert_array_equal(found.pressure, [HIGH, 2e5, 2e5, np.nan, np.nan])
    np.testing.assert_allclose(found.force[:3], festo.force(0.28, found.pressure[:3]), rtol=1e-12)
    assert len({outcome.message for outcome in Outcome}) == len(Outcome)


def test_one_not_attained_leaves_the_derivatives_of_the_others(festo):
    def total(deadband: jax.Array, forces: jax.Array, lengths: jax.Array) -> jax.Array:
        muscle = famjax.Muscle(festo.geometry, festo.material, deadband)
        return jnp.nansum(pressure_for_force(muscle, forces, lengths, (0.0, HIGH)).pressure)

    slope = jax.jit(jax.grad(total))
    alone = slope(40e3, jnp.array([400.0]), jnp.array([0.27]))
    among = slope(40e3, jnp.array([400.0, 1e5, 10.0]), jnp.array([0.27, 0.27, -1.0]))
    np.testing.assert_allclose(among, alone, rtol=1e-12)
    np.testing.assert_allclose(alone, 1.0, rtol=1e-9)  # the deadband shifts all pressures


def bounds_of(pair: Antagonist, angle: Any, torque: Any = 0.0) -> tuple:
    """Least and largest stiffness, and where the torque is possible."""
    low, high = (pair.pressures_for(angle, far, torque) for far in (-1e9, 1e9))
    return low.stiffness, high.stiffness, low.code == Outcome.STIFFNESS_LOW


@pytest.mark.slow
def test_a_pair_without_a_solution_has_the_nearest_and_a_code(festo):
    pair = Antagonist(festo, festo, (Pulley(0.02, 0.275), Pulley(-0.02, 0.275)), (0.0, HIGH))
    asked = np.array([-1.0, 1e3, np.nan, 10.0, 10.0, 10.0])
    found = pair.pressures_for(0.1, asked, np.array([0.0, 0.0, 0.0, 1e3, -1e3, np.nan]))
    codes = "STIFFNESS_LOW STIFFNESS_HIGH NO_STATE TORQUE_HIGH TORQUE_LOW NO_STATE"
    assert Outcome.words(found.code).tolist() == codes.split()
    assert np.isnan(found.stiffness).tolist() == [False, False, True, False, False, True]
    assert 0 < found.stiffness[0] < found.stiffness[1]
    assert np.all(np.abs(found.torque[3:5]) < 100)


GRID = 4001  # pressures of the brute force, whose ends are exact
STEP = 1e-5  # rad, of its central differences


class Bent(eqx.Module):
    """A muscle whose stiffness turns round with the pressure, so that extrema lie inside."""

    area: float = 4e-4

    def force(self, length: jax.Array, pressure: jax.Array) -> jax.Array:
        x = pressure / HIGH
        contraction = 1 - length / 0.3
        turned = 3000 * x * (1 - x) * (contraction - 0.1)
        return self.area * pressure * (1 - 3 * contraction) - turned


def _pair(flexor: object, extensor: object, kind: str = "pulley", **more: float) -> Antagonist:
    paths: tuple[AbstractPath, AbstractPath] = (Pulley(0.02, 0.275), Pulley(-0.018, 0.272))
    if kind == "lever":
        paths = (Lever([-0.03, 0.0], [-0.01, -0.3], 0.025), Lever([0.03, 0.0], [0.01, -0.3], 0.025))
    return Antagonist(flexor, extensor, paths, (0.0, HIGH), **more)


@pytest.fixture
def softer(festo: famjax.Muscle) -> famjax.Muscle:
    return famjax.Muscle(festo.geometry, famjax.PolynomialMaterial([4e6, -12e6, 16e6]), 30e3)


PATHS = {"pulley": Pulley(0.02, 0.28), "lever": Lever([0.03, 0.004], [0.01, -0.3], 0.02)}


@pytest.mark.parametrize("kind", PATHS)
def test_moment_arm_is_the_slope_and_the_distance_from_the_line(kind):
    path, angle = PATHS[kind], np.linspace(-0.8, 0.8, 9)
    central = -(path.length(angle + 1e-6) - path.length(angle - 1e-6)) / 2e-6
    np.testing.assert_allclose(path.moment_arm(angle), central, rtol=1e-7)
    if isinstance(path, Lever):
        c, s = np.cos(angle), np.sin(angle)
        a = np.array([0.03 * c - 0.004 * s, 0.03 * s + 0.004 * c])
        b = np.array([0.01, -0.3])[:, None]
        along = (b - a) / np.linalg.norm(b - a, axis=0)
        # The pull at the pin of the link, towards the base: its moment about the joint.
        np.testing.assert_allclose(path.moment_arm(angle), a[0] * along[1] - a[1] * along[0])


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pulley", "lever"])
def test_round_trip_of_a_pair(festo, softer, kind):
    pair = _pair(festo, softer, kind)
    axes = np.linspace(-0.6, 0.6, 5), np.linspace(0.05, 0.95, 4), np.array([-3.0, 0.0, 2.0])
    angle, share, torque = np.meshgrid(*axes, indexing="ij")
    lowest, highest, feasible = bounds_of(pair, angle, torque)
    stiffness = lowest + share * (highest - lowest)
    found = pair.pressures_for(angle, stiffness, torque)
    inside = np.asarray(feasible)
    assert inside.sum() > 40
    np.testing.assert_array_equal(np.asarray(found.code)[inside], 0)
    made = pair.torque(angle, found.flexor, found.extensor)
    np.testing.assert_allclose(np.asarray(made)[inside], torque[inside], atol=1e-9)
    before, after = (pair.torque(angle + d, found.flexor, found.extensor) for d in (-STEP, STEP))
    slope = np.asarray(before - after)[inside] / (2 * STEP)
    np.testing.assert_allclose(slope, np.asarray(stiffness)[inside], rtol=1e-6)


def _brute(pair: Antagonist, angle: float, torque: float) -> tuple[float, float] | None:
    """Bounds of the stiffness over a dense grid of pressures, by differences and in NumPy."""
    grid = np.linspace(0.0, HIGH, GRID)
    muscles = (pair.flexor, pair.extensor)

    def each(at: float) -> list[np.ndarray]:
        pairs = zip(muscles, pair.paths, strict=True)
        return [
            np.asarray(jax.vmap(of.force, (None, 0))(path.length(at), grid)) for of, path in pairs
        ]

    arms = [float(path.moment_arm(angle)) for path in pair.paths]
    pulls = each(angle)
    least = float(pair.least_pull)
    wanted = (arms[0] * pulls[0] - torque) / -arms[1]
    ends = (max(least, pulls[1][0]), pulls[1][-1])
    taut = (pulls[0] >= least) & (wanted >= ends[0]) & (wanted <= ends[1])
    if not taut.any():
        return None
    share = np.interp(wanted[taut], pulls[1], grid)
    parts = []
    for sign in (1, -1):
        at = angle + sign * STEP
        lever = [float(path.moment_arm(at)) for path in pair.paths]
        flexor, extensor = each(at)
        parts.append(lever[0] * flexor[taut] + lever[1] * np.interp(share, grid, extensor))
    stiffness = -(parts[0] - parts[1]) / (2 * STEP)
    return float(stiffness.min()), float(stiffness.max())


@pytest.mark.slow
@pytest.mark.parametrize("case", ["festo", "lever", "pretension", "bent"])
def test_feasible_set_against_brute_force(festo, softer, case):
    """Nothing of the grid is outside the range, and its ends are attained to the grid's step."""
    pair = {
        "festo": lambda: _pair(festo, softer),
        "lever": lambda: _pair(festo, softer, "lever"),
        "pretension": lambda: _pair(festo, softer, least_pull=50.0),
        "bent": lambda: _pair(Bent(), Bent(5e-4)),
    }[case]()
    angles, torques = np.meshgrid(np.linspace(-0.6, 0.6, 5), np.array([-2.0, 0.0, 1.5]))
    lowest, highest, feasible = bounds_of(pair, angles, torques)
    checked = 0
    for k in np.ndindex(angles.shape):
        brute = _brute(pair, float(angles[k]), float(torques[k]))
        assert bool(feasible[k]) == (brute is not None)
        if brute is None:
            continue
        low, high = float(lowest[k]), float(highest[k])
        rounding = 1e-6 * high  # of the differences
        assert low - rounding <= brute[0] <= low + 2e-3 * (high - low)
        assert high - 2e-3 * (high - low) <= brute[1] <= high + rounding
        checked += 1
    assert checked >= 9


@pytest.mark.slow
def test_derivatives_of_bounds_at_pressures_inside_the_range():
    def bounds(x: jax.Array) -> jax.Array:
        return jnp.stack(bounds_of(_pair(Bent(), Bent(5e-4)), 0.2 * x[0], x[1])[:2])

    check_grads(jax.jit(bounds), (jnp.array([1.0, 0.5]),), order=1, atol=1e-5, rtol=1e-5)
