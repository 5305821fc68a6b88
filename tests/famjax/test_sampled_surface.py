"""A surface of samples: exact at them, smooth between, nan beyond, differentiable everywhere."""

import jax
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import famjax
from famjax.surfaces import SampledSurface

X = np.linspace(0, 1, 21)
LENGTHS = np.array([0.30, 0.27, 0.25, 0.21])
PRESSURES = np.array([1e5, 5e5])
BRAID = famjax.Braid(0.32, 1.5, 3e-4)


def diameters() -> np.ndarray:
    wide = 0.02 + 0.02 * (0.30 - LENGTHS[:, None]) / 0.09 * np.sin(np.pi * X) ** 0.5
    return np.stack([wide, wide * (1 + 0.02 * X)])


@pytest.fixture
def surface() -> SampledSurface:
    return SampledSurface(LENGTHS, PRESSURES, diameters(), BRAID)


def test_it_goes_through_its_samples(surface: SampledSurface) -> None:
    for k, pressure in enumerate(PRESSURES):
        found = surface.diameter(X, LENGTHS[:, None], pressure)
        np.testing.assert_allclose(found, diameters()[k], rtol=1e-12)


def test_between_them_it_is_the_spline_of_scipy(surface: SampledSurface) -> None:
    x, length, pressure = np.linspace(0, 1, 57), 0.233, 3.7e5
    along = CubicSpline(X, diameters(), axis=2)(x)
    over = CubicSpline(LENGTHS[::-1], along[:, ::-1], axis=1)(length)
    expected = over[0] + (pressure - 1e5) / 4e5 * (over[1] - over[0])
    np.testing.assert_allclose(surface.diameter(x, length, pressure), expected, rtol=1e-12)


def test_one_pressure_is_a_shape_that_does_not_depend_on_it() -> None:
    one = SampledSurface(LENGTHS, [0.0], diameters()[:1], BRAID)
    low, high = (np.asarray(one.diameter(X, 0.26, P)) for P in (0.0, 7e5))
    np.testing.assert_array_equal(low, high)


def test_beyond_its_margin_the_shape_is_not_known(surface: SampledSurface) -> None:
    low, high = (float(one) for one in surface.length_range())
    assert (low, high) == pytest.approx((0.21 - 0.0045, 0.30 + 0.0045))
    found = surface.diameter(0.5, np.array([low - 1e-6, low, high, high + 1e-6]), 1e5)
    assert np.isfinite(found).tolist() == [False, True, True, False]


def test_its_derivatives_are_those_of_differences(surface: SampledSurface) -> None:
    at = (0.37, 0.262, 2.2e5)
    for k, step in enumerate((1e-5, 1e-6, 10.0)):
        exact = float(jax.jit(jax.grad(surface.diameter, k))(*at))
        up, down = (
            float(surface.diameter(*(v + s * step * (j == k) for j, v in enumerate(at))))
            for s in (1, -1)
        )
        assert exact == pytest.approx((up - down) / (2 * step), rel=1e-5, abs=1e-12)


@pytest.mark.slow
def test_a_muscle_of_that_shape_is_differentiable_by_every_sample(surface: SampledSurface) -> None:
    bladder = famjax.Bladder(0.30, 0.0194, 1e-3)

    def pull(samples: jax.Array) -> jax.Array:
        shape = SampledSurface(LENGTHS, PRESSURES, samples, BRAID)
        law = famjax.PolynomialMaterial([1e6])
        return famjax.Muscle(famjax.MeasuredGeometry(shape, bladder, 16), law).force(0.26, 3e5)

    given = np.asarray(diameters())
    slopes = np.asarray(jax.jit(jax.grad(pull))(given))
    assert np.isfinite(slopes).all()
    way = np.random.default_rng(0).normal(size=given.shape)
    step = 1e-7
    change = float(pull(given + step * way) - pull(given - step * way)) / (2 * step)
    assert float(np.sum(slopes * way)) == pytest.approx(change, rel=1e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lengths": LENGTHS[::-1]}, "lengths must fall"),
        ({"pressures": PRESSURES[::-1]}, "pressures rise"),
        ({"lengths": LENGTHS[:3]}, "must have the shape"),
        ({"pressures": np.array([1.0, 2.0, 3.0]), "diameters": np.ones((3, 4, 5))}, "one or two"),
        ({"diameters": diameters() - 0.03}, "must be > 0"),
        ({"margin": 0.5}, "0 to 0.25"),
    ],
)
def test_what_is_no_surface_is_refused(change: dict, message: str) -> None:
    given = {
        "lengths": LENGTHS, "pressures": PRESSURES, "diameters": diameters(), "braid": BRAID
    } | change  # fmt: skip
    with pytest.raises(ValueError, match=message):
        SampledSurface(**given)
