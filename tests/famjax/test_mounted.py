"""A rig that gives way in proportion to the force, and one that does by a power of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

import famjax
from famjax.muscle import SEATING_FORCE, give_way

C = 1.8e-5  # m/N
LINEAR_BELOW = 0.1  # N


@pytest.fixture(scope="module")
def muscle() -> famjax.Muscle:
    braid = famjax.Braid.from_rest(diameter=0.012, braid_angle=np.radians(65), length=0.28)
    bladder = famjax.Bladder(0.28, 0.012, 1.8e-3, embedded=True)
    return famjax.Muscle(
        famjax.EstimatedGeometry(braid, bladder), famjax.PolynomialMaterial([0.4e6]), 0.0
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


@pytest.mark.slow
def test_derivatives_of_what_gives_way() -> None:
    """In force, compliance and exponent, to the second order."""
    for force in (0.03, 0.5, 60.0):
        check_grads(
            jax.jit(lambda x, force=force: give_way(force * x[0], C * x[1], x[2]) / C),
            (jnp.array([1.0, 1.0, 0.5]),), order=2, atol=1e-5, rtol=1e-5,
        )  # fmt: skip


@pytest.mark.parametrize("exponent", [None, 1.0, 0.5, 0.3])
def test_a_mounted_muscle_balances(muscle: famjax.Muscle, exponent: float | None) -> None:
    mounted = famjax.MountedMuscle(muscle, C, exponent)
    x, P = jnp.linspace(0.24, 0.28, 7), 5e5
    force = mounted.force(x, P)
    np.testing.assert_allclose(force, muscle.force(x - mounted.gives_way(force), P), rtol=1e-11)
    assert (force < muscle.force(x, P)).all()
    if exponent == 1.0:
        np.testing.assert_allclose(force, famjax.MountedMuscle(muscle, C).force(x, P), rtol=1e-11)


@pytest.mark.slow
def test_derivatives_of_a_muscle_in_such_a_rig(muscle: famjax.Muscle) -> None:
    """In length, pressure, compliance and exponent, through the implicit solve."""

    def pull(x: jax.Array) -> jax.Array:
        return famjax.MountedMuscle(muscle, C * x[0], x[1]).force(0.28 * x[2], 1e6 * x[3]) / 100

    at = jnp.array([1.0, 0.5, 0.95, 0.5])
    check_grads(jax.jit(pull), (at,), order=1, atol=1e-6, rtol=1e-6)
    check_grads(jax.jit(jax.grad(pull)), (at,), order=1, modes=["fwd"], atol=1e-4, rtol=1e-4)


def test_rigs_are_vmapped(muscle: famjax.Muscle) -> None:
    exponents = jnp.array([1.0, 0.6, 0.3])

    def force(n: jax.Array) -> jax.Array:
        return famjax.MountedMuscle(muscle, C, n).force(0.26, 4e5)

    alone = [float(force(n)) for n in exponents]
    np.testing.assert_allclose(jax.jit(jax.vmap(force))(exponents), alone, rtol=1e-10)


def test_in_single_precision(muscle: famjax.Muscle) -> None:
    single = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), muscle)
    x = jnp.linspace(0.25, 0.28, 4, dtype=jnp.float32)
    mounted = famjax.MountedMuscle(single, jnp.float32(C), jnp.float32(0.5))
    force = mounted.force(x, jnp.float32(5e5))
    assert force.dtype == jnp.float32
    exact = famjax.MountedMuscle(muscle, C, 0.5).force(np.asarray(x, float), 5e5)
    np.testing.assert_allclose(force, exact, rtol=2e-4)


def test_another_muscle_in_the_same_rig(muscle: famjax.Muscle) -> None:
    mounted = famjax.MountedMuscle(muscle, C, 0.5)
    shorter = mounted.with_muscle(famjax.cut_to_length(muscle, 0.2))
    assert float(shorter.rest_length) == pytest.approx(0.2)
    assert (shorter.compliance, shorter.exponent) == (C, 0.5)


def test_its_numbers_are_declared(muscle: famjax.Muscle) -> None:
    declared = famjax.MountedMuscle(muscle, C, 0.5).declared()
    exponent = declared["series_exponent"]
    assert (exponent.low, exponent.high, exponent.linear) == (0.3, 1.0, False)
    assert "series_exponent" not in famjax.MountedMuscle(muscle, C).declared()
