import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from muscles import GEOMETRIES, LATEX

import famjax
from famjax.materials import SaturatingMaterial

EXACT = 1e-12
DIFFERENCE = 1e-6  # central differences of a function of order one


def _states(muscle: famjax.Muscle) -> tuple[np.ndarray, np.ndarray]:
    rest = float(muscle.geometry.rest_length)
    pressure = 5e5 if rest < 1 else 80.0  # SI or psi
    return rest * np.linspace(0.72, 1.02, 7), pressure * np.linspace(0.1, 1.2, 7)


def test_force_is_the_sum_of_its_terms_by_hand(chambers: famjax.Muscle) -> None:
    """The force balance written out once more, in plain numpy, for the reference specimen."""
    L, P, N, B, V = 7.0, 80.0, 1.09, 9.89, np.pi * 0.0625 * (0.875 - 0.0625) * 9.28125
    R = np.sqrt(B**2 - L**2) / (2 * np.pi * N)
    outer = R - 0.011
    t = outer - np.sqrt(outer**2 - V / (np.pi * L))
    ez, ec = L / 9.28125 - 1, (outer - t / 2) / (0.4375 - 0.03125) - 1

    def law(e: float) -> float:
        return 257.8 * e - 57.9 * e * abs(e) + 32.7 * e**3

    by_hand = (
        P * np.pi * R**2 * (2 * (L / (2 * np.pi * R * N)) ** 2 - 1)
        + law(ez) * V / L
        - law(ec) * t * L**2 / (2 * np.pi * R * N**2)
    )
    assert float(chambers.force(L, P)) == pytest.approx(by_hand, rel=1e-12)


def test_stiffness_is_the_slope_of_the_force(muscle: famjax.Muscle) -> None:
    L, P = _states(muscle)
    h = 1e-6 * L[0]
    slope = (muscle.force(L + h, P) - muscle.force(L - h, P)) / (2 * h)
    np.testing.assert_allclose(muscle.stiffness(L, P), slope, rtol=DIFFERENCE)


@pytest.mark.parametrize("state", ["rest", "no pressure", "neutral"])
def test_values_and_gradients_are_finite_at_the_edges(muscle: famjax.Muscle, state: str) -> None:
    L, P = _states(muscle)
    length, pressure = {
        "rest": (muscle.geometry.rest_length, P[-1]),
        "no pressure": (L[3], np.zeros(())),
        "neutral": (muscle.geometry.braid.neutral_length, P[-1]),
    }[state]

    @eqx.filter_jit
    def everything(muscle: famjax.Muscle, length: jnp.ndarray, pressure: jnp.ndarray) -> tuple:
        return (
            jax.value_and_grad(muscle.force, argnums=(0, 1))(length, pressure),
            eqx.filter_grad(lambda m: m.force(length, pressure))(muscle),
            jax.hessian(muscle.force)(length, pressure),
        )

    for leaf in jax.tree.leaves(everything(muscle, length, pressure)):
        assert np.isfinite(leaf).all()


def test_force_is_homogeneous_in_units(festo: famjax.Muscle) -> None:
    inch, psi = 0.0254, 6894.757293168361
    braid, bladder = festo.geometry.braid, festo.geometry.bladder
    other = famjax.Muscle(
        famjax.EstimatedGeometry(
            famjax.Braid(braid.rest_thread_length / inch, braid.turns),
            famjax.Bladder(
                bladder.rest_length / inch,
                bladder.rest_diameter / inch,
                bladder.rest_thickness / inch,
                embedded=True,
            ),
        ),
        famjax.PolynomialMaterial(festo.material.coefficients / psi),
        festo.deadband_pressure / psi,
    )
    lbf = psi * inch**2
    np.testing.assert_allclose(
        other.force(0.27 / inch, 4e5 / psi) * lbf, festo.force(0.27, 4e5), rtol=EXACT
    )


def test_blocked_force_is_at_rest_length(muscle: famjax.Muscle) -> None:
    P = _states(muscle)[1]
    rest = muscle.geometry.rest_length
    np.testing.assert_array_equal(muscle.blocked_force(P), muscle.force(rest, P))


def test_free_contraction_has_no_force_and_load_is_carried(muscle: famjax.Muscle) -> None:
    P = _states(muscle)[1][2:]
    blocked = muscle.blocked_force(P)
    free = muscle.free_contraction(P)
    at = (1 - free) * muscle.geometry.rest_length
    np.testing.assert_allclose(muscle.force(at, P) / blocked, 0, atol=1e-11)
    loaded = muscle.length_at_load(0.4 * blocked, P)
    np.testing.assert_allclose(muscle.force(loaded, P), 0.4 * blocked, rtol=1e-11)
    assert (np.diff(free) > 0).all()


def test_without_bladder_the_free_contraction_is_the_braid_s(festo: famjax.Muscle) -> None:
    limp = famjax.Muscle(festo.geometry, famjax.PolynomialMaterial([0.0]))
    expected = 1 - festo.geometry.braid.neutral_length / festo.geometry.rest_length
    assert float(limp.free_contraction(3e5)) == pytest.approx(float(expected), abs=1e-12)


def test_unreachable_load_is_an_error_or_nan(festo: famjax.Muscle) -> None:
    with pytest.raises(RuntimeError, match="no equilibrium length"):
        festo.length_at_load(1e6, 4e5)
    lengths = festo.length_at_load(jnp.array([100.0, 1e6]), 4e5, throw=False)
    np.testing.assert_array_equal(np.isnan(lengths), [False, True])


def test_path_modulus_of_a_linear_law_is_its_modulus(muscle: famjax.Muscle) -> None:
    L, P = _states(muscle)
    linear = famjax.PolynomialMaterial([3.5])
    np.testing.assert_allclose(famjax.path_modulus(linear, muscle.geometry, L, P), 3.5, rtol=1e-12)


def test_a_caller_who_forbids_rank_promotion_still_has_forces() -> None:
    law = famjax.materials.OgdenMaterial([4e5], [2.0])
    braid = famjax.Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3)
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, 0.02, 0.002)), law)
    with jax.numpy_rank_promotion("raise"):
        assert muscle.force(jnp.array([0.28, 0.3]), 4e5).shape == (2,)
        assert famjax.path_modulus(law, muscle.geometry, jnp.array([0.28, 0.3]), 4e5).min() > 0


@pytest.mark.parametrize("name", ["inelastic", "toe", "saturating"])
def test_path_modulus_is_the_slope_of_stress_along_the_path(name: str) -> None:
    law = SaturatingMaterial(40.0, 20.0, 0.15) if name == "saturating" else LATEX
    geometry = GEOMETRIES["toe" if name == "toe" else "estimated"]()
    length, pressure, h = 7.5, 80.0, 1e-3

    def strains(L: np.ndarray) -> np.ndarray:
        at = geometry.dimensions(L, pressure)
        return np.stack([at.axial_strain, at.hoop_strain[:, 0]])

    steps = length + h * np.array([-2.0, -1.0, 1.0, 2.0])
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12 * h)  # central, of fourth order
    stress = np.stack(law.stresses(*strains(steps), pressure)) @ weights
    strain = strains(steps) @ weights
    modulus = famjax.path_modulus(law, geometry, length, pressure)
    assert float(modulus) == pytest.approx(stress @ strain / (strain @ strain), rel=1e-8)
