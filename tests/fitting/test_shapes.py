"""The surface through photographs: near the truth, honest about its distance, deaf to single faults."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from rendering import INCH, PUBLISHED_CONTRACTIONS, published_shape

import famjax
from famjax.boundary.errors import InputError
from fitting.data import Specimen
from fitting.shapes import Pictures, fit_fourier, shape_surface
from tests.fitting.pictured import BRAID, PSI, REST, photographed, true_diameter, true_family

X = np.linspace(0, 1, 201)
SPECIMEN = Specimen(
    name="7/8 in", rest_length=REST, wall_thickness=0.0625 * INCH, braid_thickness=0.011 * INCH,
    bladder_diameter=0.875 * INCH,
)  # fmt: skip
LAW = famjax.PolynomialMaterial(np.array([257.8, -57.9, 32.7]) * PSI)
LENGTHS, PRESSURES = REST * (1 - np.linspace(0.01, 0.34, 12)), np.array([20.0, 55.0, 95.0]) * PSI


def force(geometry: famjax.geometries.AbstractGeometry) -> np.ndarray:
    muscle = famjax.Muscle(geometry, LAW)
    return np.asarray(eqx.filter_jit(muscle.force)(LENGTHS, PRESSURES[:, None]))


@pytest.mark.slow
def test_force_from_photographs_is_that_of_the_true_profiles() -> None:
    bladder = famjax.Bladder(REST, 0.875 * INCH, 0.0625 * INCH)
    true = force(famjax.MeasuredGeometry(true_family(), bladder))
    found = shape_surface(photographed(noise=0.0006 * INCH))
    error = force(found.geometry(SPECIMEN, braid=BRAID)) - true
    assert np.sqrt(np.mean(error**2)) < 1e-4 * true.max()
    assert found.pressures == pytest.approx((np.nan, np.nan), nan_ok=True)
    assert "does not change with the pressure" in found.notes[-1]
    assert not found.left_out


@pytest.mark.slow
def test_a_braid_that_gives_is_seen_in_the_shape() -> None:
    found = shape_surface(photographed(noise=0.0006 * INCH, stretch=2e-4))
    assert found.form.with_pressure >= 0
    family = found.family(BRAID)
    for pressure in PRESSURES:
        true = true_diameter(X, LENGTHS, np.full(12, pressure), 2e-4)
        error = np.asarray(family.diameter(X, LENGTHS[:, None], pressure)) - true
        assert np.sqrt(np.mean(error**2)) < 0.0004 * INCH


@pytest.mark.slow
def test_its_bands_cover_the_truth() -> None:
    """Of 24 campaigns, each with its noise."""
    inside = []
    for seed in range(24):
        found = shape_surface(photographed(80, 0.001 * INCH, seed), seed=seed)
        low, high = np.quantile(found.draws[:, 0], [0.025, 0.975], axis=0)
        true = true_diameter(X, found.lengths, np.full(len(found.lengths), 55 * PSI), 0.0)
        inside.append(np.mean((low <= true) & (true <= high)))
    assert 0.88 < np.mean(inside) < 0.99


def test_pictures_held_out_are_as_near_as_expected() -> None:
    found = shape_surface(photographed(200, 0.0006 * INCH)).held_out
    assert found.pictures == 40
    assert found.rms == pytest.approx(0.0006 * INCH, rel=0.15)
    assert found.standardised == pytest.approx(1.0, abs=0.15)
    assert abs(found.mean) < 0.0001 * INCH


def test_pictures_off_the_surface_are_left_out_and_named() -> None:
    sound = photographed(120, 0.0006 * INCH)
    diameter = sound.diameter.copy()
    diameter[17] *= 1.02
    diameter[60, 80:120] += 0.02 * INCH
    found = shape_surface(dataclasses.replace(sound, diameter=diameter))
    assert set(found.left_out) == {"DSC_0017.JPG", "DSC_0060.JPG"}
    assert "2 pictures lie off the surface" in found.notes[0]


def test_pictures_of_two_muscles_are_no_surface() -> None:
    one = photographed(120, 0.0006 * INCH)
    other = one.diameter * np.where(np.arange(120) % 4 == 0, 1.05, 1.0)[:, None]
    with pytest.raises(InputError, match="scatter by 2"):
        shape_surface(dataclasses.replace(one, diameter=other))


def test_the_triangle_of_true_threads_is_found() -> None:
    """Of cylinders, for which it holds."""
    rng = np.random.default_rng(0)
    length = REST * (1 - 0.3 * rng.uniform(size=60))
    wide = np.asarray(famjax.braids.diameter_from_length(length, 9.89 * INCH, 1.09))
    shape = np.repeat(wide[:, None], 201, axis=1)
    names = tuple(map(str, range(60)))
    found = shape_surface(Pictures(names, length, shape, np.full(60, np.nan))).threads
    assert found.turns == pytest.approx(1.09, rel=1e-6)
    assert found.length == pytest.approx(9.89 * INCH, rel=1e-6)


Z = np.linspace(0, 1, 801)


@pytest.mark.parametrize("contraction", PUBLISHED_CONTRACTIONS)
def test_three_terms_of_a_series_are_found_again(contraction: float) -> None:
    true = np.asarray(published_shape(contraction)(Z))
    assert fit_fourier(Z, true).rmse < 2e-5 * true.max()


@pytest.mark.parametrize("w", [1.3, 2.2, 3.7, 5.6, 6.28, 9.0, 11.5])
def test_the_wave_number_is_found_wherever_it_is(w: float) -> None:
    a, b = 0.003 * np.random.default_rng(int(10 * w)).normal(size=(2, 2))
    angle = np.arange(1, 3) * w * Z[:, None]
    true = 0.03 + np.cos(angle) @ a + np.sin(angle) @ b
    fit = fit_fourier(Z, true, n_terms=2)
    assert fit.rmse < 1e-9  # m; the terms of a wide profile cancel to a hundredth of their size
    np.testing.assert_allclose(fit.diameter(Z), true, atol=1e-8)


def test_a_series_is_the_muscles_own_profile() -> None:
    fit = fit_fourier(Z, np.asarray(published_shape(0.2625)(Z)))
    profile = famjax.profiles.FourierProfile(fit.mean, fit.cosines, fit.sines, fit.frequency)
    spread = np.abs(fit.cosines).sum() + np.abs(fit.sines).sum() + abs(fit.mean)
    np.testing.assert_allclose(profile.diameter(Z, 1.0), fit.diameter(Z), atol=1e-9 * spread)


@pytest.mark.parametrize(
    ("x", "d", "match"),
    [
        (Z[:10], Z[:10], "one shape"),
        (Z, Z[:-1], "one shape"),
        (Z, np.full(Z.shape, np.nan), "finite"),
    ],
)
def test_profiles_that_cannot_be_fitted(x: np.ndarray, d: np.ndarray, match: str) -> None:
    with pytest.raises(InputError, match=match):
        fit_fourier(x, d)
