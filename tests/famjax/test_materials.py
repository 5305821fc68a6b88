"""Laws of the bladder's rubber against closed forms, energies and quadrature."""

from collections.abc import Callable

import equinox as eqx
import jax
import muscles as known
import numpy as np
import pytest

import famjax
from famjax.materials import (
    AbstractHyperelastic,
    AbstractMaterial,
    AbstractUniaxialLaw,
)

EXACT = 1e-12  # closed forms, float64


MU, C10, C01, YEOH = 0.8, 0.3, 0.1, np.array([0.4, -0.02, 0.003])
OGDEN, ALPHA = map(np.array, known.OGDEN)
HYPERELASTIC = known.HYPERELASTIC
ENERGETIC = {name: known.LAWS[name] for name in [*HYPERELASTIC, "saturating"]}


@eqx.filter_jit
def _stresses(law: AbstractMaterial, axial: jax.Array, hoop: jax.Array, pressure: jax.Array):
    return law.stresses(axial, hoop, pressure)


@eqx.filter_jit
def _alone(law: AbstractHyperelastic, strain: jax.Array) -> jax.Array:
    return law.uniaxial_stress(strain)


def _closed_form(name: str, a: float, b: float) -> float:
    """Cauchy stress along the stretch a, the other in-plane stretch being b."""
    c = 1 / (a * b)
    I1 = a**2 + b**2 + c**2
    return {
        "neo-hookean": MU * (a**2 - c**2),
        "mooney-rivlin": 2 * (a**2 - c**2) * (C10 + C01 * b**2),
        "yeoh": 2 * (a**2 - c**2) * sum((i + 1) * C * (I1 - 3) ** i for i, C in enumerate(YEOH)),
        "ogden": float(np.sum(OGDEN * (a**ALPHA - c**ALPHA))),
    }[name]


STATES: dict[str, Callable[[float], float]] = {
    "equibiaxial": lambda stretch: stretch,
    "uniaxial": lambda stretch: stretch**-0.5,
    "pure shear": lambda stretch: 1.0,
}


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", HYPERELASTIC)
def test_cauchy_stresses_equal_closed_forms(name: str, state: str) -> None:
    law = HYPERELASTIC[name]
    stretches = np.array([0.6, 0.95, 1.0, 1.3, 2.5])
    others = np.array([STATES[state](stretch) for stretch in stretches])
    everything = (
        *_stresses(law, stretches - 1, others - 1, np.array(1e5)),
        _alone(law, stretches - 1),
    )
    for stretch, other, axial, hoop, along in zip(stretches, others, *everything, strict=True):
        size = abs(_closed_form(name, stretch, other)) + 1
        assert float(axial) == pytest.approx(_closed_form(name, stretch, other), abs=EXACT * size)
        assert float(hoop) == pytest.approx(_closed_form(name, other, stretch), abs=EXACT * size)
        if state == "uniaxial":
            assert float(hoop) == pytest.approx(0, abs=EXACT * size)
            assert float(along) == pytest.approx(float(axial), abs=EXACT * size)


@pytest.mark.parametrize("law", HYPERELASTIC.values(), ids=HYPERELASTIC)
def test_modulus_at_small_strain_is_that_of_poissons_ratio_one_half(
    law: AbstractHyperelastic,
) -> None:
    mu = float(law.initial_shear_modulus)
    assert mu > 0
    assert float(law.initial_modulus) == pytest.approx(3 * mu)
    assert float(jax.jit(jax.grad(law.uniaxial_stress))(0.0)) == pytest.approx(3 * mu, rel=EXACT)


@pytest.mark.parametrize("law", ENERGETIC.values(), ids=ENERGETIC)
def test_bladder_force_is_the_slope_of_the_stored_energy(
    law: AbstractMaterial, festo: famjax.Muscle
) -> None:
    """Virtual work: where threads and mid-wall coincide, F dL = V dW with no other term."""
    assert isinstance(law, AbstractHyperelastic | AbstractUniaxialLaw)
    muscle = eqx.tree_at(lambda m: m.material, festo, law)

    def stored(length: jax.Array) -> jax.Array:
        at = muscle.geometry.dimensions(length, 2e5)
        return at.bladder_volume * law.energy(1 + at.axial_strain, 1 + at.hoop_strain[0])

    lengths = np.array([0.22, 0.26, 0.296, 0.3])
    want = np.asarray(jax.jit(jax.vmap(jax.grad(stored)))(lengths))
    assert np.asarray(muscle.bladder_force(lengths, 2e5)) == pytest.approx(want, rel=1e-10)


def test_monotone_law_is_its_modulus_integrated() -> None:
    knots, moduli = (0.0, 0.05, 0.2), np.array([6e6, 2e6, 4e6])
    law = famjax.materials.MonotoneMaterial(knots, moduli)
    strain = np.linspace(-0.4, 0.4, 41)
    modulus = np.interp(np.abs(strain), knots, moduli)
    np.testing.assert_allclose(law.tangent_modulus(strain), modulus, rtol=1e-12)
    fine = np.linspace(0, 0.4, 400001)
    trapezoid = np.interp(fine, knots, moduli)
    area = np.sum((trapezoid[1:] + trapezoid[:-1]) / 2) * (fine[1] - fine[0])
    assert float(law.stress(0.4)) == pytest.approx(area, rel=1e-9)
    assert float(law.stress(-0.4)) == pytest.approx(-area, rel=1e-9)
