"""Threads, braids and rubber: closed forms, energies, the triangle, Gaylord's force, root solves."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import muscles as known
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from muscles import AREA, B0, L0, N
from scipy.optimize import brentq

import famjax
from famjax.braids import AbstractThread, LinearThread, ToeThread, strain_under_line, thread_tension

EXACT = 1e-12  # a few roundings


@pytest.mark.parametrize("embedded", [False, True])
def test_rubber_keeps_its_volume_from_a_rest_without_strain(*, embedded):
    bladder = famjax.Bladder(0.3, 0.02, 0.0018, embedded=embedded)
    assert float(bladder.axial_strain(0.3)) == 0
    assert float(bladder.hoop_strain(0.3, 0.01)) == pytest.approx(0, abs=1e-15)
    assert float(bladder.thickness(0.3, 0.01)) == pytest.approx(0.0018, rel=EXACT)
    length, radius = jnp.linspace(0.2, 0.33, 20), jnp.linspace(0.016, 0.009, 20)
    t = bladder.thickness(length, radius)
    mid = radius if embedded else radius - t / 2
    np.testing.assert_allclose(2 * jnp.pi * mid * t * length, bladder.volume, rtol=EXACT)


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.floats(0.2, 1.5), st.floats(0.005, 0.1), st.floats(0.05, 2.0))
def test_triangle_round_trips(angle, diameter, length):
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle, length=length)
    assert float(braid.diameter(length)) == pytest.approx(diameter, rel=1e-10)
    assert float(braid.braid_angle(length)) == pytest.approx(angle, rel=EXACT)
    shorter = 0.8 * length
    by_diameter = famjax.braids.braid_angle_from_diameter(braid.diameter(shorter), diameter, angle)
    assert float(by_diameter) == pytest.approx(float(braid.braid_angle(shorter)), rel=1e-8)


def test_gaylord_force_is_the_virtual_work_of_the_braid_volume(festo):
    """F_G = -P dV/dL with the cylinder's volume: an oracle that shares no formula with F_G."""
    braid = festo.geometry.braid
    lengths = jnp.linspace(0.2, 0.33, 40)
    slope = jax.jit(jax.vmap(jax.grad(lambda L: jnp.pi / 4 * braid.diameter(L) ** 2 * L)))(lengths)
    radius, angle = braid.diameter(lengths) / 2, braid.braid_angle(lengths)
    force = famjax.braids.gaylord_force(4e5, radius, angle)
    np.testing.assert_allclose(force, -4e5 * slope, rtol=1e-11, atol=1e-9)


ROUNDED = 1e-13  # a few roundings in the laws of threads
TENSIONS = np.concatenate([[0.0], np.geomspace(1e-9, 1e4, 40)])


@pytest.mark.parametrize("thread", known.THREADS.values(), ids=known.THREADS)
def test_laws_keep_the_contract_of_the_root_solve(thread):
    """Concave, from zero, between T / k and T / k + offset, with the compliance going to 1 / k."""
    k = float(thread.far_stiffness)
    strain = np.asarray(thread.strain(TENSIONS))
    compliance = np.asarray(jax.jit(jax.vmap(jax.grad(thread.strain)))(jnp.asarray(TENSIONS)))
    assert strain[0] == 0
    assert np.all(np.diff(compliance) <= 0)
    assert np.all(compliance * k >= 1 - ROUNDED)
    assert np.all(strain >= TENSIONS / k)
    assert np.all(strain <= TENSIONS / k + float(thread.offset_strain) + ROUNDED)
    assert compliance[-1] * k == pytest.approx(1, abs=1e-6)


def test_toe_law_by_hand():
    """Half the toe strain at the toe tension; rest modulus from the slopes of both terms."""
    toe, k = known.TOE, 16.9e6 * known.AREA
    assert float(toe.strain(2.0)) == pytest.approx(2 / k + 0.001, rel=ROUNDED)
    at_rest = float(jax.jit(jax.grad(toe.tension))(0.0))
    assert at_rest == pytest.approx(k / (1 + k * 0.002 / 2.0), rel=ROUNDED)
    searched = brentq(lambda T: float(toe.strain(T)) - 0.004, 0.0, 100.0, xtol=1e-13)
    assert float(toe.tension(0.004)) == pytest.approx(searched, rel=1e-12)


def test_tension_holds_pull_and_pressure():
    """n threads at the angle theta, projected on the axis, carry F + P pi R^2."""
    T = thread_tension(500.0, 3e5, 0.012, 1.1, 96)
    assert float(96 * T * jnp.sin(1.1)) == pytest.approx(500 + 3e5 * np.pi * 0.012**2, rel=EXACT)


n = 144.0
AXES = np.linspace(0, 200, 21), L0 * np.linspace(1.05, 0.55, 11), np.geomspace(0.05e6, 30e6, 14)
P, L, E = (grid.ravel() for grid in np.meshgrid(*AXES, indexing="ij"))
SHARE = B0 * P * L / (2 * np.pi * N**2 * n * AREA * E)  # of the thread's stiffness


@jax.jit
@jax.vmap
def lengths_of(thread: AbstractThread, length: jax.Array, pressure: jax.Array) -> jax.Array:
    return famjax.braids.ElasticBraid(B0, N, 0.011, n, thread).thread_length(length, pressure)


def over_grid(make: Callable[[jax.Array], AbstractThread]) -> np.ndarray:
    return np.asarray(lengths_of(jax.vmap(make)(E), L, P))


def test_linear_thread_meets_the_closed_form_on_the_whole_grid():
    B = over_grid(lambda modulus: LinearThread(modulus, AREA))
    assert np.sum(SHARE >= 1) > 100  # both sides of the limit are on the grid
    with np.errstate(divide="ignore"):
        expected = np.where(SHARE < 1, B0 / (1 - SHARE), np.nan)  # tension P L B / (2 pi N^2 n)
    np.testing.assert_array_equal(np.isnan(B), np.isnan(expected))
    # The equation itself amplifies rounding by 1 / (1 - share).
    assert np.nanmax(np.abs(B / expected - 1) * np.abs(1 - SHARE)) < 1e-14


@pytest.mark.parametrize(
    ("toe_strain", "toe_tension"), [(0.002, 2.0), (0.05, 1e-3), (0.01, 100.0), (0.5, 0.01)]
)
def test_toe_thread_meets_its_quadratic_on_the_whole_grid(toe_strain, toe_tension):
    """T = kappa (1 + eps(T)) is a quadratic equation in T; the limit is the linear thread's."""
    B = over_grid(lambda modulus: ToeThread(modulus, AREA, toe_strain, toe_tension))
    inside = SHARE < 1
    share = np.where(inside, SHARE, 0.0)
    kappa = share * AREA * E
    a, c = 1 - share, -kappa * toe_tension
    b = toe_tension * (1 - share) - kappa * (1 + toe_strain)
    T = (-b + np.sqrt(b**2 - 4 * a * c)) / (2 * a)
    strain = T / (AREA * E) + toe_strain * T / (T + toe_tension)
    np.testing.assert_array_equal(np.isnan(B), ~inside)
    assert np.max((np.abs(B / (B0 * (1 + strain)) - 1) * (1 - share))[inside]) < 1e-14


@pytest.mark.parametrize("distance", [1e-2, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("toe_strain", [0.0, 0.01, 10.0])
def test_the_solve_ends_up_to_the_limit(distance, toe_strain):
    """eps = m (1 + eps) + e_t / (1 + T_t / T) with T = m (1 + eps), m short of 1 by `distance`."""
    thread = ToeThread(1.0, 1.0, toe_strain, 0.002)
    strain, found = strain_under_line(thread, jnp.asarray(1 - distance))
    assert bool(found)
    # Far out the toe is used up: (1 + e_t) / distance, but for parts of the order of `distance`
    assert float(1 + strain) * distance == pytest.approx(1 + toe_strain, rel=1e-3 + distance)


MU, C10, C01, YEOH = 0.8, 0.3, 0.1, np.array([0.4, -0.02, 0.003])
OGDEN, ALPHA = map(np.array, known.OGDEN)
HYPERELASTIC = known.HYPERELASTIC


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
    "equibiaxial": lambda a: a, "uniaxial": lambda a: a**-0.5, "pure shear": lambda a: 1.0,
}  # fmt: skip


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", HYPERELASTIC)
def test_cauchy_stresses_equal_closed_forms(name, state):
    law = HYPERELASTIC[name]
    stretches = np.array([0.6, 0.95, 1.0, 1.3, 2.5])
    others = np.array([STATES[state](stretch) for stretch in stretches])
    both = eqx.filter_jit(law.stresses)(stretches - 1, others - 1, np.array(1e5))
    everything = *both, eqx.filter_jit(law.uniaxial_stress)(stretches - 1)
    for stretch, other, axial, hoop, along in zip(stretches, others, *everything, strict=True):
        size = abs(_closed_form(name, stretch, other)) + 1
        assert float(axial) == pytest.approx(_closed_form(name, stretch, other), abs=EXACT * size)
        assert float(hoop) == pytest.approx(_closed_form(name, other, stretch), abs=EXACT * size)
        if state == "uniaxial":
            assert float(hoop) == pytest.approx(0, abs=EXACT * size)
            assert float(along) == pytest.approx(float(axial), abs=EXACT * size)


@pytest.mark.parametrize("law", HYPERELASTIC.values(), ids=HYPERELASTIC)
def test_modulus_at_small_strain_is_that_of_poissons_ratio_one_half(law):
    mu = float(law.initial_shear_modulus)
    assert mu > 0
    assert float(law.initial_modulus) == pytest.approx(3 * mu)
    assert float(jax.jit(jax.grad(law.uniaxial_stress))(0.0)) == pytest.approx(3 * mu, rel=EXACT)


@pytest.mark.parametrize("law", HYPERELASTIC.values(), ids=HYPERELASTIC)
def test_bladder_force_is_the_slope_of_the_stored_energy(law, festo):
    """Virtual work: where threads and mid-wall coincide, F dL = V dW with no other term."""
    muscle = eqx.tree_at(lambda m: m.material, festo, law)

    def stored(length: jax.Array) -> jax.Array:
        at = muscle.geometry.dimensions(length, 2e5)
        return at.bladder_volume * law.energy(1 + at.axial_strain, 1 + at.hoop_strain[0])

    lengths = np.array([0.22, 0.26, 0.296, 0.3])
    want = np.asarray(jax.jit(jax.vmap(jax.grad(stored)))(lengths))
    assert np.asarray(muscle.bladder_force(lengths, 2e5)) == pytest.approx(want, rel=1e-10)


def test_saturating_law_is_its_closed_form():
    E, S, s = 0.5, 0.3, 0.2
    law, eps = famjax.materials.SaturatingMaterial(E, S, s), np.linspace(-0.5, 2.0, 11)
    expected = E * eps + S * np.sign(eps) * (1 - np.exp(-np.abs(eps) / s))
    np.testing.assert_allclose(law.stress(eps), expected, rtol=EXACT)
