"""The pressure for a force: a round trip, codes, derivatives, odd muscles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.control import Antagonist, Outcome, Pulley, pressure_for_force

HIGH = 6e5
ROUND_TRIP = 1e-6  # Pa


def _states(muscle: famjax.Muscle) -> tuple[np.ndarray, np.ndarray]:
    return np.linspace(0.22, 0.298, 7)[:, None], np.linspace(0.0, HIGH, 13)


def test_round_trip(festo: famjax.Muscle) -> None:
    L, P = _states(festo)
    F = np.asarray(festo.force(L, P))
    found = pressure_for_force(festo, F, L, (0.0, HIGH))
    taut = F >= 0
    assert taut.sum() > 40
    np.testing.assert_allclose(
        np.asarray(found.pressure)[taut], np.broadcast_to(P, F.shape)[taut], atol=ROUND_TRIP
    )
    assert not np.any(np.asarray(found.code)[taut])
    assert (np.asarray(found.code)[~taut] == Outcome.FORCE_LOW).all()
    np.testing.assert_array_equal(found.feasible, taut)


def test_what_is_not_attained_has_the_nearest_and_a_code(festo: famjax.Muscle) -> None:
    F, L = np.array([1e5, -5.0, 100.0, np.nan, 100.0]), np.array([0.28, 0.28, 0.28, 0.28, -1.0])
    found = pressure_for_force(festo, F, L, (2e5, HIGH))
    names = [Outcome(code).name for code in found.code.tolist()]
    assert names == ["FORCE_HIGH", "FORCE_LOW", "FORCE_LOW", "NO_STATE", "NO_STATE"]
    np.testing.assert_array_equal(found.pressure, [HIGH, 2e5, 2e5, np.nan, np.nan])
    np.testing.assert_allclose(found.force[:3], festo.force(0.28, found.pressure[:3]), rtol=1e-12)
    assert len({outcome.message for outcome in Outcome}) == len(Outcome)


def test_one_that_is_not_attained_leaves_the_derivatives_of_the_others(
    festo: famjax.Muscle,
) -> None:
    def total(deadband: jax.Array, forces: jax.Array, lengths: jax.Array) -> jax.Array:
        muscle = famjax.Muscle(festo.geometry, festo.material, deadband)
        return jnp.nansum(pressure_for_force(muscle, forces, lengths, (0.0, HIGH)).pressure)

    slope = jax.jit(jax.grad(total))
    alone = slope(40e3, jnp.array([400.0]), jnp.array([0.27]))
    among = slope(40e3, jnp.array([400.0, 1e5, 10.0]), jnp.array([0.27, 0.27, -1.0]))
    np.testing.assert_allclose(among, alone, rtol=1e-12)
    np.testing.assert_allclose(alone, 1.0, rtol=1e-9)  # the deadband shifts all pressures


@pytest.mark.slow
def test_an_angle_beyond_the_joint_has_an_outcome_of_its_own(festo: famjax.Muscle) -> None:
    pair = Antagonist(
        festo, festo, (Pulley(0.02, 0.275), Pulley(-0.02, 0.275)), (0.0, HIGH), (-0.1, 0.1)
    )
    angles = np.array([-0.1, 0.1, 0.3, -0.3])
    expected = ["FEASIBLE", "FEASIBLE", "BEYOND_ANGLES", "BEYOND_ANGLES"]
    assert pair.torque_range(angles).outcome.tolist() == expected
    range_ = pair.stiffness_range(angles)
    assert range_.outcome.tolist() == expected
    assert np.isnan(range_.lowest).tolist() == [False, False, True, True]
    found = pair.pressures_for(angles, float(range_.lowest[0] + range_.highest[0]) / 2)
    assert found.outcome.tolist() == expected
    assert np.isnan(found.flexor).tolist() == [False, False, True, True]
