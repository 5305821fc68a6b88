"""Lengths of the shapes that others assume."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from famjax.profiles import EllipticToroidEnds, kothera_length, tondu_lopez_length

EXACT = 1e-12


MIDDLE, END, LENGTH = 2.2, 0.9, 6.0
CIRCULAR = EllipticToroidEnds(MIDDLE, END, (MIDDLE - END) / 2)


def test_kothera_is_the_length_between_the_arcs() -> None:
    first, second = CIRCULAR.breakpoints(LENGTH)
    between = float((second - first) * LENGTH)
    assert float(kothera_length(LENGTH, MIDDLE / 2, END / 2)) == pytest.approx(between, rel=EXACT)


def test_tondu_lopez() -> None:
    length = jnp.array([0.30, 0.27, 0.24])
    np.testing.assert_allclose(tondu_lopez_length(length, 0.3, 1.0), length, rtol=EXACT)
    # Their force, pi r0^2 P (a (1 - k eps)^2 - b), is Gaylord's at this length.
    r0, angle, k, P = 0.01, 1.2, 1.25, 3e5
    a, b = 3 * math.tan(angle) ** 2, 1 / math.cos(angle) ** 2
    contraction = 1 - length / 0.3
    published = math.pi * r0**2 * P * (a * (1 - k * contraction) ** 2 - b)
    thread, turns = 0.3 / math.sin(angle), 0.3 / (2 * math.pi * r0 * math.tan(angle))
    L = tondu_lopez_length(length, 0.3, k)
    gaylord = P * (3 * L**2 - thread**2) / (4 * math.pi * turns**2)
    np.testing.assert_allclose(gaylord, published, rtol=EXACT)
