"""Shapes over length and pressure: exact where measured, splines between, nan beyond."""

import equinox as eqx
import jax.numpy as jnp
import muscles as known
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import famjax
from famjax.braids import AbstractBraid, diameter_from_length
from famjax.profiles import FourierProfile
from famjax.surfaces import AbstractProfileFamily, MeasuredFamily, SampledSurface

EXACT = 1e-12


ROUNDING = 1e-11  # a small linear system has been solved
X = np.linspace(0, 1, 17)
INELASTIC = known.INELASTIC


def _profile(contraction: float) -> FourierProfile:
    """A made-up muscle: a wave number that varies with contraction, as measured ones do."""
    bulge = 0.2 + 2.0 * contraction
    return FourierProfile.symmetric(1.0 + bulge / 2, [-bulge / 3, -0.02], 5.6 - 1.5 * contraction)


def _family(contractions: np.ndarray, braid: AbstractBraid = INELASTIC, **kwargs: float):
    profiles = [_profile(contraction) for contraction in contractions]
    return MeasuredFamily(9.28 * (1 - contractions), profiles, 100.0, braid, **kwargs)


EVEN = np.array([0.0, 0.09, 0.18, 0.27, 0.35])


@eqx.filter_jit
def _diameter(family: AbstractProfileFamily, x: object, length: object, pressure: object):
    """Compiled once for each kind of family and shape of the arguments."""
    return family.diameter(x, length, pressure)


@pytest.mark.parametrize(
    "contractions", [EVEN, np.array([0, 0.02, 0.15, 0.2, 0.33]), EVEN[:4], EVEN[:3], EVEN[:2]]
)
def test_is_scipys_not_a_knot_spline_also_in_the_margin(contractions: np.ndarray) -> None:
    family = _family(contractions)
    table = np.stack([profile.diameter(X, 1.0) for profile in family.profiles])
    oracle = CubicSpline(contractions, table)
    lengths = np.linspace(*(float(end) for end in family.length_range()), 50)
    np.testing.assert_allclose(
        _diameter(family, X, lengths[:, None], 100.0), oracle(1 - lengths / 9.28), rtol=ROUNDING
    )


def test_pressure_scales_by_the_triangle() -> None:
    family = _family(EVEN, known.KEVLAR)
    L, P = jnp.array([6.5, 9.0])[:, None], 30.0
    scale = [
        diameter_from_length(L, known.KEVLAR.thread_length(L, jnp.array(pressure)), 1.09)
        for pressure in (P, 100.0)
    ]
    low, high = (np.asarray(_diameter(family, X, L, np.array(at))) for at in (P, 100.0))
    np.testing.assert_allclose(low, high * np.asarray(scale[0]) / np.asarray(scale[1]), rtol=EXACT)
    assert (low < high).all()
    rigid = np.asarray(_diameter(_family(EVEN), X, L, np.array(100.0)))
    np.testing.assert_allclose(high, rigid, rtol=ROUNDING)  # as measured, whatever the braid


STATIONS = np.linspace(0, 1, 21)
LENGTHS = np.array([0.30, 0.27, 0.25, 0.21])
PRESSURES = np.array([1e5, 5e5])
BRAID = famjax.Braid(0.32, 1.5, 3e-4)


def diameters() -> np.ndarray:
    wide = 0.02 + 0.02 * (0.30 - LENGTHS[:, None]) / 0.09 * np.sin(np.pi * STATIONS) ** 0.5
    return np.stack([wide, wide * (1 + 0.02 * STATIONS)])


@pytest.fixture
def surface() -> SampledSurface:
    return SampledSurface(LENGTHS, PRESSURES, diameters(), BRAID)


def test_between_them_it_is_the_spline_of_scipy(surface: SampledSurface) -> None:
    x, length, pressure = np.linspace(0, 1, 57), 0.233, 3.7e5
    along = CubicSpline(STATIONS, diameters(), axis=2)(x)
    over = CubicSpline(LENGTHS[::-1], along[:, ::-1], axis=1)(length)
    expected = over[0] + (pressure - 1e5) / 4e5 * (over[1] - over[0])
    np.testing.assert_allclose(surface.diameter(x, length, pressure), expected, rtol=1e-12)
