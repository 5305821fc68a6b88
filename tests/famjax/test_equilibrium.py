"""The shape from mechanics against boundary values, quadrature and closed cycles; the work of a stroke."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from muscles import INELASTIC as BRAID, LATEX, SPECIMEN as TUBE
from shape_oracles import Specimen, boundary_values, long_muscle

import famjax
from famjax import Bladder, Braid, ElasticBraid, EquilibriumMuscle, EstimatedGeometry, Muscle
from famjax.boundary.errors import InputError
from famjax.braids import LinearThread
from famjax.equilibrium import REASONS, Section
from famjax.materials import MooneyRivlinMaterial
from famjax.work import work_budget

PRINT = Specimen()  # inches, psi, lbf
LENGTHS = PRINT.L0 * (1 - np.array([0.0, 0.05, 0.1, 0.15, 0.2]))
GAUSS, WEIGHTS = np.polynomial.legendre.leggauss(16)


@pytest.fixture(scope="module")
def muscle() -> EquilibriumMuscle:
    return EquilibriumMuscle(BRAID, TUBE, LATEX, end_diameter=PRINT.end)


def test_pull_and_profile_are_those_of_the_hamiltonian_form(muscle):
    length, pressure = np.meshgrid(LENGTHS, [100.0, 80.0, 60.0, 40.0, 20.0])
    force = np.asarray(muscle.force(length, pressure))
    shape = muscle.profile(length, pressure)
    half = np.linspace(0, 0.5, 51)
    for i, j in np.ndindex(length.shape):
        guess = np.asarray(shape.radius[i, j, :51])
        start = np.interp(np.linspace(0, 0.5, 201), half, guess)
        F, sol = boundary_values(PRINT, length[i, j], pressure[i, j], start, force[i, j] + 1)
        assert force[i, j] == pytest.approx(F, abs=1e-3)
        r, z, _ = sol(half)
        np.testing.assert_allclose(shape.radius[i, j, :51], r, rtol=0, atol=5e-5)
        np.testing.assert_allclose(shape.position[i, j, :51], z, rtol=0, atol=1e-4)
    np.testing.assert_allclose(shape.position[..., -1], length, rtol=1e-9)


# The quadrature takes the middle for a cylinder, which in a short muscle it is not quite.
@pytest.mark.parametrize(("aspect", "cylinder"), [(8.0, 2e-3), (12.0, 1e-4), (20.0, 1e-6)])
def test_a_long_muscle_has_a_cylinder_between_its_shoulders(aspect, cylinder):
    ratio = aspect * PRINT.end / PRINT.L0
    one = dataclasses.replace(PRINT, B=PRINT.B * ratio, N=PRINT.N * ratio, L0=PRINT.L0 * ratio)
    made = EquilibriumMuscle(Braid(one.B, one.N, one.braid), Bladder(one.L0, one.D0, one.t0), LATEX,
                             end_diameter=one.end, modes=36)  # fmt: skip
    length = 0.85 * one.L0
    force = float(made.force(length, 100.0))
    assert force == pytest.approx(long_muscle(one, length, 100.0), rel=cylinder)


def _cycle(made: EquilibriumMuscle, lengths: tuple, pressures: tuple) -> tuple[float, float]:
    """Work left over in a closed cycle, and the work F dL of its upper edge."""
    (L1, L2), (P1, P2) = lengths, pressures
    L, P = (L1 + L2 + (L2 - L1) * GAUSS) / 2, (P1 + P2 + (P2 - P1) * GAUSS) / 2
    state = made.state(np.concatenate([L, L, np.full(16, L1), np.full(16, L2)]),
                       np.concatenate([np.full(16, P1), np.full(16, P2), P, P]))  # fmt: skip
    low, high = np.asarray(state.force).reshape(4, -1)[:2] @ WEIGHTS * (L2 - L1) / 2
    one, two = np.asarray(state.volume).reshape(4, -1)[2:] @ WEIGHTS * (P2 - P1) / 2
    # F dL - V dP is exact: round the rectangle it sums to nothing.
    return low - two - high + one, abs(high)


def test_no_work_is_left_over_in_a_closed_cycle_and_energy_takes_it_up(muscle):
    left, work = _cycle(muscle, (7.0, 9.0), (50.0, 100.0))
    assert abs(left) < 1e-8 * work
    L1, L2, P = 7.0, 9.0, 100.0
    L = np.concatenate([(L1 + L2 + (L2 - L1) * GAUSS) / 2, [L1, L2]])
    state = muscle.state(np.resize(L, 64), P)  # of the shape that is compiled already
    work = np.asarray(state.force)[:16] @ WEIGHTS * (L2 - L1) / 2
    U, V = np.asarray(state.energy)[16:18], np.asarray(state.volume)[16:18]
    assert U[1] - U[0] == pytest.approx(work + P * (V[1] - V[0]), abs=1e-8 * work)
    assert np.all(np.asarray(state.margin) > 0)


def test_states_that_cannot_be_say_why(muscle):
    cases = {
        (5.4, 100.0): "overhangs", (11.0, 100.0): "straight-thread", (-1.0, 50.0): "straight-thread",
        (9.0, 0.0): "compression", (8.0, 1.0): "compression", (9.88, 50.0): "bore is closed",
        (9.0, np.nan): "not finite", (9.28, 100.0): "",
    }  # fmt: skip
    length, pressure = np.array([*cases]).T
    state = muscle.state(np.resize(length, 64), np.resize(pressure, 64))
    for code, force, words in zip(state.code, state.force, cases.values(), strict=False):
        assert words in REASONS[int(code)]
        assert bool(jnp.isnan(force)) == bool(words)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"end_diameter": 3.0}, "where the threads lie "),
        ({"end_diameter": -0.5}, "must be > 0"),
        ({"other_end_diameter": 3.0}, "where the threads lie "),
        ({"sections": [Section(0.5), Section(0.4)]}, "sum to 1"),
        ({"sections": [Section(1.5), Section(-0.5)]}, "must be > 0"),
        ({"bladder": Bladder(PRINT.L0, PRINT.D0, -0.06)}, "rest_thickness"),
        ({"sections": [Section(1.0, far_bladder=Bladder(PRINT.L0, 0.0, 0.06))]}, "rest_diameter"),
    ],
)
def test_what_no_muscle_can_be_is_refused(changes, words):
    given = {"bladder": TUBE, "end_diameter": PRINT.end} | changes
    bladder = given.pop("bladder")
    with pytest.raises(InputError, match=words):
        EquilibriumMuscle(BRAID, bladder, LATEX, **given)


def _short(**changes: object) -> EquilibriumMuscle:
    """A muscle of three diameters in length, tapered, of two angles, between unequal fittings."""
    braids = [Braid.from_rest(diameter=0.9, braid_angle=np.deg2rad(a), length=2.7, thickness=0.01)
              for a in (68.0, 72.0)]  # fmt: skip
    thin, thick = Bladder(2.7, 0.875, 0.04), Bladder(2.7, 0.875, 0.07)
    near = Section(0.6, braids[0], thin, far_bladder=thick)
    sections = [near, Section(0.4, braids[1], thick, MooneyRivlinMaterial(25.0, 15.0))]
    return EquilibriumMuscle(braids[0], thin, LATEX, end_diameter=0.86, other_end_diameter=0.95,
                             sections=sections, **changes)  # fmt: skip


@pytest.mark.slow
def test_a_short_tapered_unequal_muscle_of_sections():
    made, finer = _short(), _short(modes=2 * _short().modes)
    left, work = _cycle(made, (2.2, 2.5), (60.0, 100.0))
    assert abs(left) < 1e-8 * work
    at = np.array([2.2, 2.4, 2.6]), 80.0
    np.testing.assert_allclose(made.force(*at), finer.force(*at), rtol=1e-4)
    z, r = (np.asarray(one) for one in (made.profile(*at).position, made.profile(*at).radius))
    assert np.all(np.diff(z) >= -1e-9)  # the border of the sections stands there twice
    np.testing.assert_allclose(z[:, -1], at[0], rtol=1e-9)
    np.testing.assert_allclose(r[:, [0, -1]], [[0.43, 0.475]] * 3, rtol=1e-12)


@pytest.mark.slow
def test_elastic_threads_stretch_and_keep_the_books():
    def made(modulus: float) -> EquilibriumMuscle:
        braid = ElasticBraid(PRINT.B, PRINT.N, PRINT.braid, 144, LinearThread(modulus, 1.332e-4))
        return EquilibriumMuscle(braid, TUBE, LATEX, end_diameter=PRINT.end)

    rigid = EquilibriumMuscle(BRAID, TUBE, LATEX, end_diameter=PRINT.end).force(LENGTHS, 100.0)
    kevlar, stiff = made(11.6e6), made(11.6e9)
    np.testing.assert_allclose(stiff.force(LENGTHS, 100.0), rigid, rtol=1e-4)
    # The longer a thread, the less it pulls at the same length.
    assert np.all(kevlar.force(LENGTHS, 100.0) < rigid - 1)
    left, work = _cycle(kevlar, (7.0, 9.0), (50.0, 100.0))
    assert abs(left) < 1e-8 * work
    tension = kevlar.profile(PRINT.L0, 100.0).thread_tension[50] / 144
    assert float(tension) == pytest.approx(8.5, rel=0.1)  # of the reference work's table 5.1


@pytest.mark.slow
def test_a_state_that_cannot_be_leaves_derivatives_of_others(muscle):
    def total(made: EquilibriumMuscle, lengths: np.ndarray) -> jax.Array:
        return jnp.nansum(made.force(lengths, 100.0))

    one = eqx.filter_grad(total)(muscle, np.array([8.5]))
    both = eqx.filter_grad(total)(muscle, np.array([8.5, 5.0]))
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(both), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9)


SOFT = ElasticBraid(9.89, 1.09, 0.011, 96.0, LinearThread(2e5, 4e-4))


@pytest.mark.parametrize("braid", [BRAID, SOFT])
def test_a_bare_cylinder_closes(braid):
    """Gaylord's term on a cylinder is virtual work, also where the threads stretch."""
    bare = Muscle(EstimatedGeometry(braid, TUBE), famjax.PolynomialMaterial([0.0]))
    budget = work_budget(bare, 100.0, 9.28125, 6.5)
    assert float(abs(budget.left_over / budget.fluid)) < 1e-9
    assert (float(abs(budget.stored)) > 1) == (braid is SOFT)


def test_a_stroke_that_cannot_be_has_no_work():
    latex = Muscle(EstimatedGeometry(BRAID, TUBE), LATEX)
    assert np.isnan(work_budget(latex, 1.0, 9.0, 12.0).load)
