import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.terms import (
    AbstractFriction,
    PressureFriction,
    ThreadFriction,
    crossing_area,
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


def test_crossing_area_counts_crossings_of_a_drawn_braid() -> None:
    """Crossings of two families of straight lines on the unrolled cylinder, counted one by one."""
    n, turns, width, theta = 12, 1.25, 1e-3, 1.0
    phase = 2 * np.pi * np.arange(n // 2) / (n // 2)
    count = 0
    for a in phase:
        for b in phase + 0.1:  # not at a multiple of the end, where a crossing is shared
            turn = (b - a + 4 * np.pi * turns * np.array([0.0, 1.0])) / (2 * np.pi)
            count += int(np.floor(turn[1]) - np.floor(turn[0]))
    assert count == pytest.approx(n**2 * turns / 2, abs=n / 2)
    got = float(crossing_area(n, turns, width, theta))
    assert got == pytest.approx(n**2 * turns / 2 * width**2 / np.sin(2 * theta), rel=EXACT)


def test_crossing_area_and_contact_area_are_one_law() -> None:
    theta = np.linspace(0.7, 1.3, 5)
    S = crossing_area(144, 1.09, 4e-4, theta)
    np.testing.assert_allclose(thread_contact_area(S[-1], theta[-1], theta), S, rtol=EXACT)


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
