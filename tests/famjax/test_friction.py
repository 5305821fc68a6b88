import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.terms import (
    AbstractFriction,
    PressureFriction,
    ThreadFriction,
    smooth_sign,
    thread_contact_area,
)

EXACT = 1e-12

TERMS: dict[str, AbstractFriction] = {
    "thread": ThreadFriction(0.015, 2 * np.pi * 0.0115 * 0.296, np.deg2rad(62.0)),
    "pressure": PressureFriction(8.0, 6e-5),
}


def test_contact_area_is_tondu_and_lopez_in_contraction() -> None:
    """Their algebra, with the angle alpha to the axis and the contraction eps, written out."""
    S0, alpha0 = 0.02, np.deg2rad(25.0)
    eps = np.linspace(0, 0.25, 6)
    cosine = (1 - eps) * np.cos(alpha0)
    theirs = S0 * np.sin(alpha0) / ((1 - eps) * np.sqrt(1 - cosine**2))
    theta0, theta = np.pi / 2 - alpha0, np.pi / 2 - np.arccos(cosine)
    np.testing.assert_allclose(thread_contact_area(S0, theta0, theta), theirs, rtol=EXACT)
    np.testing.assert_allclose(thread_contact_area(S0, alpha0, np.arccos(cosine)), theirs)


def test_direction_is_odd_smooth_and_saturates() -> None:
    v = jnp.array([-1.0, -0.01, 0.0, 0.01, 1.0])
    direction = smooth_sign(v, 0.01)
    np.testing.assert_allclose(direction, np.tanh(v / 0.01), rtol=EXACT)
    np.testing.assert_allclose(direction, -direction[::-1], rtol=EXACT)
    assert float(jax.jit(jax.grad(smooth_sign))(0.0, 0.01)) == pytest.approx(100.0)


@pytest.mark.parametrize("term", TERMS.values(), ids=TERMS)
def test_lengthening_raises_the_pull_and_shortening_lowers_it(
    term: AbstractFriction, festo: famjax.Muscle
) -> None:
    L, P = 0.27, 4e5
    at = festo.geometry.dimensions(L, P)
    friction = float(term.amplitude(at, P))
    assert friction > 0
    assert float(term.force(at, P, smooth_sign(1.0, 1e-3))) == pytest.approx(friction, rel=EXACT)
    assert float(term.force(at, P, smooth_sign(-1.0, 1e-3))) == pytest.approx(-friction, rel=EXACT)
    assert float(term.force(at, P, 0)) == 0.0


def test_amplitudes_by_hand(festo: famjax.Muscle) -> None:
    L, P = 0.27, 4e5
    at = festo.geometry.dimensions(L, P)
    S = 2 * np.pi * 0.0115 * 0.296 * np.sin(np.deg2rad(124)) / np.sin(2 * float(at.braid_angle))
    assert float(TERMS["thread"].amplitude(at, P)) == pytest.approx(0.015 * S * P, rel=EXACT)
    assert float(TERMS["pressure"].amplitude(at, P)) == pytest.approx(8.0 + 24.0, rel=EXACT)
