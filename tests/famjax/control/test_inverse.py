"""The pressure for a force: a round trip, codes, derivatives, odd muscles."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import famjax
from famjax.control import Antagonist, Outcome, Pulley, pressure_for_force

HIGH = 6e5
ROUND_TRIP = 1e-6  # Pa
ROUND_TRIP_32 = 1.0  # Pa, of 600 kPa in float32


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


def test_round_trip_in_float32(festo: famjax.Muscle) -> None:
    single = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), festo)
    P = jnp.linspace(2e5, 5e5, 9, dtype=jnp.float32)
    F = single.force(jnp.float32(0.27), P)
    found = pressure_for_force(single, F, jnp.float32(0.27), (jnp.float32(0), jnp.float32(HIGH)))
    assert found.pressure.dtype == jnp.float32
    np.testing.assert_allclose(found.pressure, P, atol=ROUND_TRIP_32)


def test_what_is_not_attained_has_the_nearest_and_a_code(festo: famjax.Muscle) -> None:
    F, L = np.array([1e5, -5.0, 100.0, np.nan, 100.0]), np.array([0.28, 0.28, 0.28, 0.28, -1.0])
    found = pressure_for_force(festo, F, L, (2e5, HIGH))
    names = [Outcome(code).name for code in found.code.tolist()]
    assert names == ["FORCE_HIGH", "FORCE_LOW", "FORCE_LOW", "NO_STATE", "NO_STATE"]
    np.testing.assert_array_equal(found.pressure, [HIGH, 2e5, 2e5, np.nan, np.nan])
    np.testing.assert_allclose(found.force[:3], festo.force(0.28, found.pressure[:3]), rtol=1e-12)
    assert len({outcome.message for outcome in Outcome}) == len(Outcome)


def test_no_force_is_the_onset(festo: famjax.Muscle) -> None:
    found = pressure_for_force(festo, 0.0, 0.26, (0.0, HIGH))
    assert int(found.code) == Outcome.FEASIBLE
    np.testing.assert_allclose(found.pressure, festo.onset_pressure(0.26, HIGH), rtol=1e-9)


class Turning:
    """A pull that turns round: the lowest of the pressures that give it is answered."""

    def force(self, length: jax.Array, pressure: jax.Array) -> jax.Array:
        return 1e3 * length * jnp.sin(np.pi * pressure / HIGH)


def test_a_force_that_turns_round() -> None:
    found = pressure_for_force(Turning(), 100.0, 0.2, (0.0, HIGH))
    np.testing.assert_allclose(found.pressure, HIGH / 6, rtol=1e-12)
    assert int(pressure_for_force(Turning(), 201.0, 0.2, (0.0, HIGH)).code) == Outcome.FORCE_HIGH


@pytest.mark.slow
def test_derivatives_jit_and_vmap(festo: famjax.Muscle) -> None:
    def pressure(x: jax.Array) -> jax.Array:
        return pressure_for_force(festo, 400 * x[0], 0.27 * x[1], (0.0, HIGH)).pressure / HIGH

    check_grads(jax.jit(pressure), (jnp.array([1.0, 1.0]),), order=1, atol=1e-5, rtol=1e-5)
    x = jnp.array([[1.0, 1.0], [0.5, 1.02], [2.0, 0.99]])
    loop = [float(pressure(one)) for one in x]
    np.testing.assert_allclose(jax.jit(jax.vmap(pressure))(x), loop, rtol=1e-12)


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


def test_codes_to_words_in_one_call() -> None:
    codes = jnp.array([[0, 1], [8, 11]])
    assert Outcome.words(codes).tolist() == [
        ["FEASIBLE", "FORCE_LOW"],
        ["NO_STATE", "BEYOND_ANGLES"],
    ]
    assert Outcome.words(jnp.array(2)) == "FORCE_HIGH"
    assert Outcome.words(2, messages=True) == f"FORCE_HIGH: {Outcome.FORCE_HIGH.message}"
    assert str(Outcome.SLACK).startswith("SLACK: a muscle is too short for the least pull")
    with pytest.raises(ValueError, match="99"):
        Outcome.words([0, 99])


def test_an_answer_shows_its_numbers_and_words(festo: famjax.Muscle) -> None:
    one = pressure_for_force(festo, 100.0, 0.28, (0.0, HIGH))
    assert repr(one) == (
        f"InversePressure(pressure={float(one.pressure):.6g}, force={float(one.force):.6g}, "
        "outcome=FEASIBLE)"
    )
    assert one.outcome == "FEASIBLE"
    many = pressure_for_force(festo, np.array([100.0, 1e5]), 0.28, (0.0, HIGH))
    assert many.outcome.tolist() == ["FEASIBLE", "FORCE_HIGH"]
    assert "600000" in repr(many)
    assert "FORCE_HIGH" in repr(many)
    traced = []
    jax.jit(lambda force: traced.append(repr(pressure_for_force(festo, force, 0.28, (0.0, HIGH)))))(
        1.0
    )
    assert "InversePressure" in traced[0]  # without numbers, which are not known yet


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
