import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from famjax.braids import AbstractThread, LinearThread, ToeThread, thread_tension

EXACT = 1e-13  # a few roundings
DIFFERENCE = 1e-7  # central differences: step squared, and rounding over the step

AREA = 1.332e-4  # in2
THREADS: dict[str, AbstractThread] = {
    "linear": LinearThread(11.6e6, AREA),
    "toe": ToeThread(16.9e6, AREA, 0.002, 2.0),
    "sharp toe": ToeThread(16.9e6, AREA, 0.01, 1e-3),
    "no toe": ToeThread(16.9e6, AREA, 0.0, 2.0),
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
    assert np.all(compliance * k >= 1 - EXACT)
    assert np.all(strain >= TENSIONS / k)
    assert np.all(strain <= TENSIONS / k + float(thread.offset_strain) + EXACT)
    assert compliance[-1] * k == pytest.approx(1, abs=1e-6)


def test_toe_law_by_hand() -> None:
    """Half the toe strain at the toe tension; rest modulus from the slopes of both terms."""
    toe = ToeThread(16.9e6, AREA, 0.002, 2.0)
    k = 16.9e6 * AREA
    assert float(toe.strain(2.0)) == pytest.approx(2 / k + 0.001, rel=EXACT)
    at_rest = float(jax.jit(jax.grad(toe.tension))(0.0))
    assert at_rest == pytest.approx(k / (1 + k * 0.002 / 2.0), rel=EXACT)
    searched = brentq(lambda T: float(toe.strain(T)) - 0.004, 0.0, 100.0, xtol=1e-13)
    assert float(toe.tension(0.004)) == pytest.approx(searched, rel=1e-12)


def test_no_toe_is_linear() -> None:
    linear = LinearThread(16.9e6, AREA)
    np.testing.assert_allclose(
        THREADS["no toe"].tension(np.linspace(-5e-4, 0.02, 7)),
        linear.tension(np.linspace(-5e-4, 0.02, 7)),
        rtol=1e-12,
        atol=EXACT,
    )


def test_slack_toe_thread_pushes_less_than_its_toe_tension() -> None:
    toe = THREADS["toe"]
    assert -2.0 < float(toe.tension(-10.0)) < -1.99
    assert np.isnan(float(toe.strain(-2.5)))
    assert np.isfinite(float(jax.jit(jax.grad(lambda T: jnp.nan_to_num(toe.strain(T))))(-2.5)))


@pytest.mark.parametrize("tension", [-1e-4, 0.0, 0.3, 20.0])
def test_derivatives_match_differences(thread: AbstractThread, tension: float) -> None:
    """Steps of 1e-4 of the tension, or of the sharpest toe, whichever is larger."""
    h = 1e-4 * max(abs(tension), 1e-3)
    slope = float(jax.jit(jax.grad(thread.strain))(tension))
    differences = (thread.strain(tension + h) - thread.strain(tension - h)) / (2 * h)
    assert slope == pytest.approx(float(differences), rel=DIFFERENCE)
    strain, h = float(thread.strain(tension)), h * slope
    differences = (thread.tension(strain + h) - thread.tension(strain - h)) / (2 * h)
    assert float(jax.jit(jax.grad(thread.tension))(strain)) == pytest.approx(
        float(differences), rel=DIFFERENCE
    )
    assert float(jax.jit(jax.grad(thread.tension))(strain)) * slope == pytest.approx(1, rel=1e-9)


def test_jit_and_vmap_change_nothing(thread: AbstractThread) -> None:
    strain = jnp.linspace(0, 0.02, 9)
    expected = np.array([float(thread.tension(one)) for one in strain])
    np.testing.assert_allclose(eqx.filter_jit(thread.tension)(strain), expected, rtol=EXACT)
    np.testing.assert_allclose(jax.jit(jax.vmap(thread.tension))(strain), expected, rtol=EXACT)


def test_float32_stays_float32() -> None:
    values = jnp.asarray([16.9e6, AREA, 0.002, 2.0], jnp.float32)
    toe = ToeThread(*values)
    tension = jnp.asarray(8.5, jnp.float32)
    assert toe.strain(tension).dtype == jnp.float32
    assert float(toe.tension(toe.strain(tension))) == pytest.approx(8.5, rel=1e-5)


def test_tension_of_the_specimen_is_the_printed_one() -> None:
    """Blocked force and D at 100 psi; 8.5 lbf is printed to the tenth."""
    angle = np.arctan(9.28125 / (np.pi * 1.09 * 1.044))
    assert float(thread_tension(1058, 100, 1.044 / 2, angle, 144)) == pytest.approx(8.5, abs=0.05)


def test_tension_holds_pull_and_pressure() -> None:
    """n threads at the angle theta, projected on the axis, carry F + P pi R^2."""
    T = thread_tension(500.0, 3e5, 0.012, 1.1, 96)
    assert float(96 * T * jnp.sin(1.1)) == pytest.approx(500 + 3e5 * np.pi * 0.012**2, rel=EXACT)
