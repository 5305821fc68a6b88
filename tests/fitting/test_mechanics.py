"""The shape from mechanics in fits: a made-up muscle comes back, and everything opens as it was."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import famjax
import fitting
from famjax.boundary.errors import InputError
from fitting.mechanics import EquilibriumSource

TRUTH = {
    "braid_diameter": 0.022, "braid_angle": 1.11, "deadband_pressure": 20e3, "end_diameter": 0.019,
}  # fmt: skip
OF_LAW = {"shear_modulus": 0.5e6, "ogden_exponent": -3.0}
LAW = famjax.materials.OgdenMaterial.template().with_parameters(OF_LAW)


@pytest.fixture(scope="module")
def data() -> fitting.ForceData:
    return _map(0.2)


def _map(rest: float) -> fitting.ForceData:
    """Readings of a muscle whose shape follows from mechanics, with 1 N of noise."""
    specimen = fitting.Specimen(f"{rest} m", rest, 1.5e-3, nominal_diameter=0.02)
    grid = np.meshgrid(rest * np.linspace(0.82, 1, 6), [2e5, 3.5e5, 5e5])
    length, pressure = (one.ravel() for one in grid)
    force = np.asarray(_muscle(specimen, TRUTH).force(length, pressure))
    noise = np.random.default_rng(3).normal(0, 1.0, force.size)
    return fitting.ForceData(force + noise, pressure, length, specimen)


def _muscle(specimen: fitting.Specimen, values: dict[str, float]) -> famjax.AbstractMuscle:
    numbers = {name: jnp.asarray(value) for name, value in values.items()}
    return EquilibriumSource(specimen).muscle(numbers, LAW, None)


@pytest.fixture(scope="module")
def fit(data: fitting.ForceData) -> fitting.Identification:
    return fitting.identify(data, law="ogden", ends="equilibrium", noise=1.0, starts=4)


@pytest.mark.slow
def test_a_known_muscle_comes_back_and_opens_as_it_was(fit, tmp_path):
    assert fit.errors.rmse < 1.2
    for name, true in {**TRUTH, **OF_LAW}.items():
        one = fit.estimate(name)
        assert abs(one.value - true) < 4 * one.stderr, name
    assert fit.certificate.shape_margin > 0
    assert fit.converged
    fitting.write_fit(fit, tmp_path)
    saved = fitting.load_fit(tmp_path / "fit.json")
    at = fit.data.length, fit.data.pressure
    np.testing.assert_array_equal(saved.predict(*at), fit.predict(*at))
    assert saved.certificate.shape_margin == fit.certificate.shape_margin
    assert np.sqrt(np.mean(fitting.validate(saved, "length", starts=1).error ** 2)) < 5


def _pictures(specimen: fitting.Specimen, error: float = 2e-5) -> fitting.shapes.Pictures:
    """Eight photographs of the made-up muscle, their diameters with this error [m]."""
    length, pressure = 0.2 * np.linspace(0.84, 1, 8), np.linspace(3e5, 5e5, 8)
    x = np.linspace(0, 1, 41)
    shape = _muscle(specimen, TRUTH).profile(length, pressure, 401)
    each = zip(length, shape.position, shape.radius, strict=True)
    exact = [np.interp(x * L, z, 2 * r) for L, z, r in each]
    noise = np.random.default_rng(5).normal(0, error, (8, x.size))
    names = tuple(f"{k}.jpg" for k in range(8))
    std = np.full(x.size, error)
    return fitting.shapes.Pictures(names, length, exact + noise, pressure, local_std=std)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_photographs_and_force_are_fitted_together(data, fit, tmp_path):
    pictures = _pictures(data.specimen)
    options = {"law": "ogden", "ends": "equilibrium", "noise": 1.0, "starts": 4}
    both = fitting.identify(data, **options, pictures=pictures)
    assert both.pictures is not None
    assert both.pictures.rmse < 4e-5
    for name, true in {**TRUTH, **OF_LAW}.items():
        one = both.estimate(name)
        assert abs(one.value - true) < 4 * one.stderr, name
        assert one.stderr < 1.05 * fit.estimate(name).stderr, name
    # The photographs show the fittings, which the force hardly feels.
    assert both.estimate("end_diameter").stderr < 0.3 * fit.estimate("end_diameter").stderr
    fitting.write_fit(both, tmp_path)
    saved = fitting.load_fit(tmp_path / "fit.json")
    assert saved.pictures.summary() == both.pictures.summary()
    np.testing.assert_allclose(saved.problem.priors[0].direction, both.pictures.priors[0].direction)
    assert "photographed and computed profiles" in (tmp_path / "report.html").read_text()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"ends": "round"}, "ends must be one of cylinder, equilibrium"),
        ({"terms": famjax.terms.VirtualWork()}, "combined with terms"),
        ({"ends": "cylinder", "pictures": 1e5}, "only if ends='equilibrium'"),
        ({"pictures": np.nan}, "every photograph needs a pressure"),
    ],
)
def test_what_does_not_go_with_it(data, options, words):
    if pressure := options.get("pictures"):
        shown = dataclasses.replace(_pictures(data.specimen), pressure=np.full(8, pressure))
        options = {**options, "pictures": shown}
    with pytest.raises(InputError, match=words):
        fitting.identify(data, **{"ends": "equilibrium", **options})


def test_a_fitting_of_unknown_diameter_is_asked_for(data):
    bare = dataclasses.replace(data.specimen, nominal_diameter=None)
    with pytest.raises(InputError, match="set the specimen's nominal_diameter"):
        EquilibriumSource(bare)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_series_tells_of_a_length_that_it_has_not_seen():
    maps, new = [_map(rest) for rest in (0.12, 0.2)], _map(0.15)
    found = fitting.identify_series(maps, laws="ogden", ends="equilibrium", starts=2)
    assert found.name == "ogden, shape from mechanics"
    force, _ = found.predict(0.15, new.length, new.pressure)
    assert np.sqrt(np.mean((force - new.force) ** 2)) < 2.0
    together = fitting.identify_together(maps, own=(), law="ogden", ends="equilibrium", starts=2)
    assert max(one.errors.rmse for one in together) < 1.5


@pytest.mark.slow
def test_a_muscle_that_is_cut_is_one_of_that_length(data):
    long, short = (_muscle(one.specimen, TRUTH) for one in (data, _map(0.1)))
    cut = famjax.cut_to_length(long, 0.1)
    np.testing.assert_allclose(cut.force(0.09, 4e5), short.force(0.09, 4e5), rtol=1e-9)
