import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import famjax

EXACT = 1e-12  # a few roundings


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.floats(0.2, 1.5), st.floats(0.005, 0.1), st.floats(0.05, 2.0))
def test_triangle_round_trips(angle: float, diameter: float, length: float) -> None:
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle, length=length)
    B, N = braid.rest_thread_length, braid.turns
    assert float(braid.diameter(length)) == pytest.approx(diameter, rel=1e-10)
    assert float(braid.braid_angle(length)) == pytest.approx(angle, rel=EXACT)
    assert float(famjax.braids.length_from_diameter(diameter, B, N)) == pytest.approx(
        length, rel=1e-10
    )
    shorter = 0.8 * length
    by_diameter = famjax.braids.braid_angle_from_diameter(braid.diameter(shorter), diameter, angle)
    assert float(by_diameter) == pytest.approx(float(braid.braid_angle(shorter)), rel=1e-8)


def test_neutral_angle_has_no_magnification() -> None:
    assert math.degrees(famjax.braids.NEUTRAL_ANGLE) == pytest.approx(35.26, abs=0.005)
    assert float(famjax.braids.force_magnification(famjax.braids.NEUTRAL_ANGLE)) == pytest.approx(
        0, abs=1e-15
    )


def test_neutral_length_is_the_zero_of_the_braid_force(festo: famjax.Muscle) -> None:
    at = festo.geometry.braid.neutral_length
    assert float(festo.braid_force(at, 5e5)) == pytest.approx(0, abs=1e-9)


def test_longer_than_the_thread_is_nan_not_a_number() -> None:
    assert np.isnan(famjax.braids.diameter_from_length(0.35, 0.34, 2.1))
    assert np.isnan(famjax.braids.braid_angle_from_length(0.35, 0.34))


def test_gaylord_force_is_the_virtual_work_of_the_braid_volume(festo: famjax.Muscle) -> None:
    """F_G = -P dV/dL with the cylinder's volume: an oracle that shares no formula with F_G."""
    import jax

    braid = festo.geometry.braid
    lengths = jnp.linspace(0.2, 0.33, 40)
    slope = jax.jit(
        jax.vmap(jax.grad(lambda L: famjax.geometries.cylinder_volume(L, braid.diameter(L) / 2)))
    )(lengths)
    force = famjax.braids.gaylord_force(
        4e5, braid.diameter(lengths) / 2, braid.braid_angle(lengths)
    )
    np.testing.assert_allclose(force, -4e5 * slope, rtol=1e-11, atol=1e-9)


def test_gaylord_closed_form(festo: famjax.Muscle) -> None:
    """P (3 L^2 - B^2) / (4 pi N^2), the form of Chou & Hannaford 1996."""
    braid, L = festo.geometry.braid, jnp.linspace(0.2, 0.33, 40)
    B, N = braid.rest_thread_length, braid.turns
    force = famjax.braids.gaylord_force(4e5, braid.diameter(L) / 2, braid.braid_angle(L))
    np.testing.assert_allclose(
        force, 4e5 * (3 * L**2 - B**2) / (4 * jnp.pi * N**2), rtol=1e-11, atol=1e-9
    )


@pytest.mark.parametrize("angle", [40.0, 60.0, 75.0])
def test_angle_from_the_slope_of_blocked_force(angle: float) -> None:
    """Whatever the bladder and the deadband take away: the slope is the braid's own."""
    braid = famjax.Braid.from_rest(diameter=0.0236, braid_angle=jnp.deg2rad(angle), length=0.296)
    bladder = famjax.Bladder(0.296, 0.0236, rest_thickness=0.0018, embedded=True)
    latex = famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6])
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), latex, 40e3)
    P = jnp.linspace(1e5, 6e5, 6)
    found = famjax.braids.braid_angle_from_blocked_force(P, muscle.blocked_force(P), 0.0236)
    assert float(found) == pytest.approx(np.deg2rad(angle), rel=1e-10)
    both = jnp.stack([P, P])
    forces = jnp.stack([muscle.blocked_force(P), -2 * P * jnp.pi * 0.0236**2])
    batch = famjax.braids.braid_angle_from_blocked_force(both, forces, 0.0236)
    np.testing.assert_allclose(batch, [found, np.nan], rtol=1e-14)  # roundings
