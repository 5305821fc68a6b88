"""Braids, threads and the bladder: the triangle, Gaylord's force, the laws of threads."""

import math

import jax
import jax.numpy as jnp
import muscles as known
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import brentq

import famjax
from famjax.braids import AbstractThread, LinearThread, ToeThread, thread_tension

EXACT = 1e-12  # a few roundings


def test_reference_bladder_volume() -> None:
    """Chambers 2021 prints 1.481 in3 for 7/8 in x 1/16 in x 9-9/32 in."""
    assert float(famjax.Bladder(9.28125, 0.875, 0.0625).volume) == pytest.approx(1.481, abs=5e-4)


@pytest.mark.parametrize("embedded", [False, True])
def test_rest_state_has_no_strain_and_the_rest_thickness(*, embedded: bool) -> None:
    bladder = famjax.Bladder(0.3, 0.02, 0.0018, embedded=embedded)
    assert float(bladder.axial_strain(0.3)) == 0
    assert float(bladder.hoop_strain(0.3, 0.01)) == pytest.approx(0, abs=1e-15)
    assert float(bladder.thickness(0.3, 0.01)) == pytest.approx(0.0018, rel=EXACT)


@pytest.mark.parametrize("embedded", [False, True])
def test_rubber_volume_is_constant(*, embedded: bool) -> None:
    bladder = famjax.Bladder(0.3, 0.02, 0.0018, embedded=embedded)
    length, radius = jnp.linspace(0.2, 0.33, 20), jnp.linspace(0.016, 0.009, 20)
    t = bladder.thickness(length, radius)
    mid = radius if embedded else radius - t / 2
    np.testing.assert_allclose(2 * jnp.pi * mid * t * length, bladder.volume, rtol=EXACT)


def test_rubber_that_does_not_fit_is_nan() -> None:
    assert np.isnan(famjax.geometries.bladder_thickness(0.3, 0.001, 4e-5))


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.floats(0.2, 1.5), st.floats(0.005, 0.1), st.floats(0.05, 2.0))
def test_triangle_round_trips(angle: float, diameter: float, length: float) -> None:
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle, length=length)
    assert float(braid.diameter(length)) == pytest.approx(diameter, rel=1e-10)
    assert float(braid.braid_angle(length)) == pytest.approx(angle, rel=EXACT)
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
    values = {"braid_diameter": 0.0236, "braid_angle": np.deg2rad(angle)}
    muscle = known.FESTO.with_parameters(values)
    P = jnp.linspace(1e5, 6e5, 6)
    found = famjax.braids.braid_angle_from_blocked_force(P, muscle.blocked_force(P), 0.0236)
    assert float(found) == pytest.approx(np.deg2rad(angle), rel=1e-10)
    both = jnp.stack([P, P])
    forces = jnp.stack([muscle.blocked_force(P), -2 * P * jnp.pi * 0.0236**2])
    batch = famjax.braids.braid_angle_from_blocked_force(both, forces, 0.0236)
    np.testing.assert_allclose(batch, [found, np.nan], rtol=1e-14)  # roundings


ROUNDED = 1e-13  # a few roundings in the laws of threads
THREADS: dict[str, AbstractThread] = {
    "linear": known.KEVLAR.thread,
    "toe": known.TOE,
    "sharp toe": ToeThread(16.9e6, known.AREA, 0.01, 1e-3),
    "no toe": ToeThread(16.9e6, known.AREA, 0.0, 2.0),
}


@pytest.fixture(params=THREADS)
def thread(request: pytest.FixtureRequest) -> AbstractThread:
    return THREADS[request.param]


TENSIONS = np.concatenate([[0.0], np.geomspace(1e-9, 1e4, 40)])


def test_tension_inverts_strain(thread: AbstractThread) -> None:
    np.testing.assert_allclose(thread.tension(thread.strain(TENSIONS)), TENSIONS, rtol=1e-12)


def test_strain_inverts_tension_in_compression(thread: AbstractThread) -> None:
    strain = -np.geomspace(1e-9, 1e-4, 20)
    np.testing.assert_allclose(thread.strain(thread.tension(strain)), strain, rtol=1e-8)


def test_laws_keep_the_contract_of_the_root_solve(thread: AbstractThread) -> None:
    """Concave, from zero, between T / k and T / k + offset, with the compliance going to 1 / k."""
    k = float(thread.far_stiffness)
    strain = np.asarray(thread.strain(TENSIONS))
    compliance = np.asarray(jax.jit(jax.vmap(jax.grad(thread.strain)))(jnp.asarray(TENSIONS)))
    assert strain[0] == 0
    assert np.all(np.diff(compliance) <= 0)
    assert np.all(compliance * k >= 1 - ROUNDED)
    assert np.all(strain >= TENSIONS / k)
    assert np.all(strain <= TENSIONS / k + float(thread.offset_strain) + ROUNDED)
    assert compliance[-1] * k == pytest.approx(1, abs=1e-6)


def test_toe_law_by_hand() -> None:
    """Half the toe strain at the toe tension; rest modulus from the slopes of both terms."""
    toe, k = known.TOE, 16.9e6 * known.AREA
    assert float(toe.strain(2.0)) == pytest.approx(2 / k + 0.001, rel=ROUNDED)
    at_rest = float(jax.jit(jax.grad(toe.tension))(0.0))
    assert at_rest == pytest.approx(k / (1 + k * 0.002 / 2.0), rel=ROUNDED)
    searched = brentq(lambda T: float(toe.strain(T)) - 0.004, 0.0, 100.0, xtol=1e-13)
    assert float(toe.tension(0.004)) == pytest.approx(searched, rel=1e-12)


def test_no_toe_is_linear() -> None:
    linear = LinearThread(16.9e6, known.AREA)
    np.testing.assert_allclose(
        THREADS["no toe"].tension(np.linspace(-5e-4, 0.02, 7)),
        linear.tension(np.linspace(-5e-4, 0.02, 7)),
        rtol=1e-12,
        atol=ROUNDED,
    )


def test_slack_toe_thread_pushes_less_than_its_toe_tension() -> None:
    toe = THREADS["toe"]
    assert -2.0 < float(toe.tension(-10.0)) < -1.99
    assert np.isnan(float(toe.strain(-2.5)))
    assert np.isfinite(float(jax.jit(jax.grad(lambda T: jnp.nan_to_num(toe.strain(T))))(-2.5)))


def test_tension_of_the_specimen_is_the_printed_one() -> None:
    """Blocked force and D at 100 psi; 8.5 lbf is printed to the tenth."""
    angle = np.arctan(9.28125 / (np.pi * 1.09 * 1.044))
    assert float(thread_tension(1058, 100, 1.044 / 2, angle, 144)) == pytest.approx(8.5, abs=0.05)


def test_tension_holds_pull_and_pressure() -> None:
    """n threads at the angle theta, projected on the axis, carry F + P pi R^2."""
    T = thread_tension(500.0, 3e5, 0.012, 1.1, 96)
    assert float(96 * T * jnp.sin(1.1)) == pytest.approx(500 + 3e5 * np.pi * 0.012**2, rel=ROUNDED)
