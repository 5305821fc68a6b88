"""Codes as words, answers that show their numbers, and outcomes that say what to do."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.control import Antagonist, Outcome, Pulley, pressure_for_force

HIGH = 6e5


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


@pytest.mark.parametrize(
    ("outcome", "do"),
    [("STIFFNESS_LOW", "stiffness_range"), ("STIFFNESS_HIGH", "stiffness_range"),
     ("NO_STATE", "muscle.length_range()"), ("BEYOND_ANGLES", "Antagonist.angles")],
)  # fmt: skip
def test_messages_say_what_to_do(outcome: str, do: str) -> None:
    assert do in Outcome[outcome].message


def test_the_volume_of_a_safe_muscle_is_its_models_and_goes_on(festo: famjax.Muscle) -> None:
    safe = famjax.SafeMuscle.of(festo, [0.26, 0.29], [1e5, HIGH])
    L, P = float(np.mean(safe.region.length)), float(np.mean(safe.region.pressure))
    np.testing.assert_allclose(safe.volume(L, P), festo.volume(L, P), rtol=1e-12)
    assert float(safe.volume(0.1, P)) > 0


def test_where_the_force_is_nan_its_derivative_is_none_and_the_others_are_right(
    festo: famjax.Muscle,
) -> None:
    lengths = jnp.array([0.28, 0.6, 0.27])  # the second is longer than the threads
    force, slope = jax.vmap(jax.value_and_grad(lambda L: festo.force(L, 3e5)))(lengths)
    assert np.isnan(force).tolist() == [False, True, False]
    assert float(slope[1]) == 0.0
    np.testing.assert_allclose(slope[::2], festo.stiffness(lengths[::2], 3e5), rtol=1e-12)
    shared = jax.grad(lambda P: jnp.nansum(festo.force(lengths, P)))(3e5)
    each = [jax.grad(lambda P, L=L: festo.force(L, P))(3e5) for L in (0.28, 0.27)]
    np.testing.assert_allclose(shared, sum(each), rtol=1e-12)
