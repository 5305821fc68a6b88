"""The shape from mechanics in fits: a made-up muscle comes back, and everything opens as it was."""

import dataclasses
from pathlib import Path

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
    """A map of a muscle whose shape follows from mechanics, with 1 N of noise."""
    specimen = fitting.Specimen(
        name="made up", rest_length=0.2, wall_thickness=1.5e-3, nominal_diameter=0.02
    )
    length, pressure = (
        grid.ravel() for grid in np.meshgrid(0.2 * np.linspace(0.82, 1, 6), [2e5, 3.5e5, 5e5])
    )
    force = np.asarray(_muscle(specimen, TRUTH).force(length, pressure))
    noise = np.random.default_rng(3).normal(0, 1.0, force.size)
    return fitting.ForceData(
        length=length, pressure=pressure, force=force + noise, specimen=specimen
    )


def _muscle(specimen: fitting.Specimen, values: dict[str, float]) -> famjax.AbstractMuscle:
    numbers = {name: jnp.asarray(value) for name, value in values.items()}
    return EquilibriumSource(specimen).muscle(numbers, LAW, None)


@pytest.fixture(scope="module")
def fit(data: fitting.ForceData) -> fitting.Identification:
    return fitting.identify(data, law="ogden", ends="equilibrium", noise=1.0, starts=4)


@pytest.mark.slow
def test_a_known_muscle_comes_back(fit: fitting.Identification) -> None:
    assert fit.errors.rmse < 1.2
    for name, true in {**TRUTH, **OF_LAW}.items():
        one = fit.estimate(name)
        assert abs(one.value - true) < 4 * one.stderr, name
    assert fit.certificate.shape_margin > 0
    assert fit.converged


@pytest.mark.slow
def test_it_opens_as_it_was(fit: fitting.Identification, tmp_path: Path) -> None:
    fitting.write_fit(fit, tmp_path)
    saved = fitting.load_fit(tmp_path / "fit.json")
    at = fit.data.length, fit.data.pressure
    np.testing.assert_array_equal(saved.predict(*at), fit.predict(*at))
    assert saved.certificate.shape_margin == fit.certificate.shape_margin
    left_out = fitting.validate(saved, "length", starts=1)
    assert np.sqrt(np.mean(left_out.error**2)) < 5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"ends": "round"}, "ends must be one of cylinder, equilibrium"),
        ({"ends": "equilibrium", "terms": famjax.terms.Spring(1.0, 0.2)}, "leave out terms"),
        ({"ends": "equilibrium", "dependence": "linear"}, "leave out dependence"),
    ],
)
def test_what_does_not_go_with_it(data: fitting.ForceData, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        fitting.identify(data, **options)


def test_a_fitting_of_unknown_diameter_is_asked_for(data: fitting.ForceData) -> None:
    nameless = dataclasses.replace(
        data, specimen=dataclasses.replace(data.specimen, nominal_diameter=None)
    )
    with pytest.raises(InputError, match="give nominal_diameter"):
        EquilibriumSource.of(nameless)
