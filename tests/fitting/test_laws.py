"""Every family of laws: exact readings of a known muscle give back its numbers."""

import math

import numpy as np
import pytest

import famjax
from fitting import ForceData, Specimen, identify
from fitting.families import known_laws
from fitting.saved import summary_as_dict

pytestmark = pytest.mark.slow

RECOVERED = 1e-6  # relative: noise-free readings, as the project promises
SPECIMEN = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
HELD = {
    "braid_diameter": (0.022, 0.022),
    "braid_angle": (math.radians(65),) * 2,
    "deadband_pressure": (3e4, 3e4),
}
KNOTS = (0.0, 0.02, 0.15)
TRUTHS: dict[str, tuple[object, famjax.materials.AbstractMaterial, dict[str, float]]] = {
    "polynomial": (
        famjax.PolynomialMaterial.template(order=2),
        famjax.PolynomialMaterial([3e6, -2e6]),
        {"E_1": 3e6, "E_2": -2e6},
    ),
    "ogden": (
        "ogden",
        famjax.materials.OgdenMaterial([2 * 1.2e6 / -6.0], [-6.0]),
        {"shear_modulus": 1.2e6, "ogden_exponent": -6.0},
    ),
    "mooney-rivlin": (
        "mooney-rivlin",
        famjax.materials.MooneyRivlinMaterial(0.5e6, 0.2e6),
        {"C10": 0.5e6, "C01": 0.2e6},
    ),
    "saturating": (
        "saturating",
        famjax.materials.SaturatingMaterial(2e6, 0.2e6, 0.03),
        {"final_modulus": 2e6, "saturation_stress": 0.2e6, "strain_scale": 0.03},
    ),
    "monotone": (
        famjax.materials.MonotoneMaterial.template(knots=KNOTS),
        famjax.materials.MonotoneMaterial(KNOTS, [8e6, 3e6, 2e6]),
        {"modulus_at_0": 8e6, "modulus_at_0.02": 3e6, "modulus_at_0.15": 2e6},
    ),
    "neo-hookean": (
        famjax.materials.NeoHookeanMaterial,
        famjax.materials.NeoHookeanMaterial(0.7e6),
        {"shear_modulus": 0.7e6},
    ),
    "yeoh": (
        famjax.materials.YeohMaterial([1e6, 1e6, 1e6]),
        famjax.materials.YeohMaterial([0.4e6, -0.05e6, 0.02e6]),
        {"C_1": 0.4e6, "C_2": -0.05e6, "C_3": 0.02e6},
    ),
}


def readings(material: famjax.materials.AbstractMaterial) -> ForceData:
    L, P = (g.ravel() for g in np.meshgrid(np.linspace(0.3, 0.25, 7), np.linspace(3e5, 7e5, 4)))
    braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=math.radians(65), length=0.3)
    geometry = famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, 0.022, 0.002, embedded=True))
    force = np.asarray(famjax.Muscle(geometry, material, 3e4).force(L, P))
    return ForceData(force, P, L, SPECIMEN)


def test_every_family_is_here() -> None:
    assert set(TRUTHS) == set(known_laws())


@pytest.mark.parametrize("name", TRUTHS)
def test_the_law_is_recovered(name: str) -> None:
    law, material, truth = TRUTHS[name]
    result = identify(readings(material), law=law, bounds=HELD, starts=4)
    assert result.converged
    assert result.certificate.stability_margin > 0
    for parameter, value in truth.items():
        assert result.estimate(parameter).value == pytest.approx(value, rel=RECOVERED), parameter


def test_bounds_of_coefficients_at_each_pressure_are_kept() -> None:
    """A law linear in pressure, one coefficient held from above: bounds and stop are saved."""
    law = famjax.materials.PressurePolynomialMaterial([3e5, 7e5], [[4e6, -3e6], [3e6, -1e6]])
    result = identify(
        readings(law), order=2, dependence="linear", starts=1, constraint="none",
        bounds=HELD | {"E_1": (0.0, 3.5e6)},
    )  # fmt: skip
    saved = summary_as_dict(result)["parameters"]
    low, high = saved["E_1_at_300kPa"], saved["E_1_at_700kPa"]
    assert (low["min"], low["max"], low["at_bound"], low["stderr"]) == (0.0, 3.5e6, True, None)
    assert low["value"] == pytest.approx(3.5e6)
    assert (high["max"], high["at_bound"]) == (3.5e6, False)
    assert saved["E_2_at_700kPa"]["max"] is None
    assert result.n_parameters == 4
