"""Rounded ends, compliant braids, and rigs that give way: what each reduces to, and by what it differs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from muscles import CYLINDER_10

import famjax
from famjax.muscle import SEATING_FORCE, give_way

EXACT = 1e-12


DIFFERENCE = 1e-6  # central differences of a function of order one


def test_end_factor_of_one_is_no_end_effect(festo: famjax.Muscle) -> None:
    ends = famjax.geometries.EndEffectGeometry(festo.geometry, 1.0)
    muscle = famjax.Muscle(ends, festo.material, festo.deadband_pressure)
    L, P = jnp.linspace(0.24, 0.296, 5), 4e5
    np.testing.assert_allclose(muscle.force(L, P), festo.force(L, P), rtol=EXACT)
    assert [float(end) for end in ends.length_range()] == pytest.approx(
        [float(end) for end in festo.geometry.length_range()], rel=EXACT
    )


def test_end_factor_is_a_dead_length(festo: famjax.Muscle) -> None:
    """k = 1/(1 - l/L0): the part that contracts is shorter by l and otherwise the same muscle."""
    k, rest = 1.12, 0.296
    active = rest / k
    short = festo.with_parameters({"rest_length": active})
    ends = famjax.geometries.EndEffectGeometry(festo.geometry, k)
    muscle = famjax.Muscle(ends, festo.material, festo.deadband_pressure)
    L = jnp.linspace(0.25, 0.296, 7)
    np.testing.assert_allclose(
        muscle.force(L, 5e5), short.force(L - (rest - active), 5e5), rtol=1e-10
    )
    free = muscle.free_contraction(5e5)
    assert float(free) == pytest.approx(float(festo.free_contraction(5e5)) / k, rel=1e-9)


def test_compliant_braid_is_the_elastic_braid_of_linear_threads() -> None:
    thread = famjax.braids.LinearThread(60e9, 2e-8)
    elastic = famjax.ElasticBraid(0.33, 2.2, 0.0, 200.0, thread)
    rigid = famjax.Braid(0.33, 2.2)
    compliant = famjax.braids.CompliantBraid.of(rigid, 1 / (200.0 * 60e9 * 2e-8))
    L, P = jnp.linspace(0.24, 0.3, 5), jnp.linspace(0, 8e5, 5)
    np.testing.assert_allclose(
        compliant.thread_length(L, P), elastic.thread_length(L, P), rtol=1e-12
    )
    none = famjax.braids.CompliantBraid.of(rigid, 0.0)
    np.testing.assert_array_equal(none.thread_length(L, P), np.full(5, 0.33))
    slope = jax.jit(
        jax.grad(lambda c: famjax.braids.CompliantBraid.of(rigid, c).thread_length(0.28, 5e5))
    )
    h = 1e-9
    wider = famjax.braids.CompliantBraid.of(rigid, h).thread_length(0.28, 5e5)
    assert float(slope(0.0)) == pytest.approx(float(wider - 0.33) / h, rel=1e-4)
    assert np.isnan(famjax.braids.CompliantBraid.of(rigid, 1.0).thread_length(0.28, 5e5))


def test_onset_pressure_is_where_the_force_begins(festo: famjax.Muscle) -> None:
    L = jnp.array([0.25, 0.27, 0.296])
    onset = festo.onset_pressure(L, 2e6)
    np.testing.assert_allclose(festo.force(L, onset), 0.0, atol=1e-8)
    assert float(onset[2]) == pytest.approx(40e3, rel=1e-9)  # at rest: the deadband itself
    assert np.isnan(festo.onset_pressure(0.25, 1e4, throw=False))


def test_without_deadband_a_muscle_at_rest_pulls_from_zero_pressure_on(
    festo: famjax.Muscle,
) -> None:
    """At rest rounding alone keeps the force from zero; a stretched one pulls without pressure."""
    for end_factor in (1.0, 1.1, 1.3):
        ends = famjax.geometries.EndEffectGeometry(festo.geometry, end_factor)
        muscle = famjax.Muscle(ends, festo.material, 0.0)
        L0 = float(ends.rest_length)
        assert float(muscle.onset_pressure(L0, 2e6)) == pytest.approx(0.0, abs=1e-3)  # Pa
        assert np.isnan(muscle.onset_pressure(1.02 * L0, 2e6, throw=False))


C = 1.8e-5  # m/N
LINEAR_BELOW = 0.1  # N


MUSCLE = famjax.Muscle(
    CYLINDER_10.with_parameters({"braid_angle": np.radians(65), "rest_length": 0.28}),
    famjax.PolynomialMaterial([0.4e6]),
)


@pytest.mark.parametrize("exponent", [1.0, 0.7, 0.5, 0.3])
def test_every_rig_gives_way_alike_at_the_seating_force(exponent: float) -> None:
    at = float(give_way(SEATING_FORCE, C, exponent))
    assert at == pytest.approx(C * SEATING_FORCE, rel=1e-6)
    force = np.array([5.0, 40.0, 400.0])
    power = C * SEATING_FORCE * (force / SEATING_FORCE) ** exponent
    np.testing.assert_allclose(give_way(force, C, exponent), power, rtol=2e-4)
    np.testing.assert_allclose(give_way(-force, C, exponent), -give_way(force, C, exponent))


def test_a_power_of_one_is_in_proportion() -> None:
    force = np.array([-20.0, 0.0, 1e-3, 300.0])
    np.testing.assert_allclose(give_way(force, C, 1.0), C * force, rtol=1e-15)
    np.testing.assert_array_equal(give_way(force, C), C * force)


def test_near_no_force_every_rig_is_linear() -> None:
    force = np.array([1e-9, 1e-4, 1e-3])
    slope = give_way(force, C, 0.4) / force
    np.testing.assert_allclose(slope, slope[0], rtol=1e-3)
    assert np.isfinite(float(jax.grad(lambda F: give_way(F, C, 0.4))(0.0)))
    # As stiff as the power is at the force below which it is linear.
    assert slope[0] == pytest.approx(C * (LINEAR_BELOW / SEATING_FORCE) ** -0.6, rel=1e-6)


@pytest.mark.parametrize("exponent", [None, 1.0, 0.5, 0.3])
def test_a_mounted_muscle_balances(exponent: float | None) -> None:
    mounted = famjax.MountedMuscle(MUSCLE, C, exponent)
    x, P = jnp.linspace(0.24, 0.28, 7), 5e5
    force = mounted.force(x, P)
    np.testing.assert_allclose(force, MUSCLE.force(x - mounted.gives_way(force), P), rtol=1e-11)
    assert (force < MUSCLE.force(x, P)).all()
    if exponent == 1.0:
        np.testing.assert_allclose(force, famjax.MountedMuscle(MUSCLE, C).force(x, P), rtol=1e-11)


def test_another_muscle_in_the_same_rig() -> None:
    mounted = famjax.MountedMuscle(MUSCLE, C, 0.5)
    shorter = mounted.with_muscle(famjax.cut_to_length(MUSCLE, 0.2))
    assert float(shorter.rest_length) == pytest.approx(0.2)
    assert (shorter.compliance, shorter.exponent) == (C, 0.5)


def test_its_numbers_are_declared() -> None:
    declared = famjax.MountedMuscle(MUSCLE, C, 0.5).declared()
    exponent = declared["series_exponent"]
    assert (exponent.low, exponent.high, exponent.linear) == (0.3, 1.0, False)
    assert "series_exponent" not in famjax.MountedMuscle(MUSCLE, C).declared()
