"""Rounded ends, compliant braids, and rigs that give way: what each reduces to, and by what it differs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from muscles import CHAMBERS, CYLINDER_10, GEOMETRIES, LATEX

import famjax
from famjax.materials import SaturatingMaterial
from famjax.muscle import SEATING_FORCE, give_way

DIFFERENCE = 1e-6  # central differences of a function of order one


def _states(muscle: famjax.Muscle) -> tuple[np.ndarray, np.ndarray]:
    rest = float(muscle.geometry.rest_length)
    pressure = 5e5 if rest < 1 else 80.0  # SI or psi
    return rest * np.linspace(0.72, 1.02, 7), pressure * np.linspace(0.1, 1.2, 7)


def test_force_is_the_sum_of_its_terms_by_hand() -> None:
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
    assert float(CHAMBERS.force(L, P)) == pytest.approx(by_hand, rel=1e-12)


def test_stiffness_is_the_slope_of_the_force(muscle: famjax.Muscle) -> None:
    L, P = _states(muscle)
    h = 1e-6 * L[0]
    slope = (muscle.force(L + h, P) - muscle.force(L - h, P)) / (2 * h)
    np.testing.assert_allclose(muscle.stiffness(L, P), slope, rtol=DIFFERENCE)


def test_free_contraction_has_no_force_and_load_is_carried(muscle: famjax.Muscle) -> None:
    P = _states(muscle)[1][2:]
    blocked = muscle.blocked_force(P)
    free = muscle.free_contraction(P)
    at = (1 - free) * muscle.geometry.rest_length
    np.testing.assert_allclose(muscle.force(at, P) / blocked, 0, atol=1e-11)
    loaded = muscle.length_at_load(0.4 * blocked, P)
    np.testing.assert_allclose(muscle.force(loaded, P), 0.4 * blocked, rtol=1e-11)
    assert (np.diff(free) > 0).all()


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


def test_end_factor_is_a_dead_length(festo: famjax.Muscle) -> None:
    """k = 1/(1 - l/L0): the part that contracts is shorter by l and otherwise the same muscle."""
    k, rest = 1.12, 0.296
    active = rest / k
    short = festo.with_parameters({"rest_length": active})
    ends = famjax.geometries.EndEffectGeometry(festo.geometry, k)
    muscle = famjax.Muscle(ends, festo.material, festo.deadband_pressure)
    L = jnp.linspace(0.25, 0.296, 7)
    np.testing.assert_allclose(
        muscle.force(L, 5e5), short.force(L - (rest - active), 5e5), rtol=1e-10
    )
    free = muscle.free_contraction(5e5)
    assert float(free) == pytest.approx(float(festo.free_contraction(5e5)) / k, rel=1e-9)


def test_compliant_braid_is_the_elastic_braid_of_linear_threads() -> None:
    thread = famjax.braids.LinearThread(60e9, 2e-8)
    elastic = famjax.ElasticBraid(0.33, 2.2, 0.0, 200.0, thread)
    rigid = famjax.Braid(0.33, 2.2)
    compliant = famjax.braids.CompliantBraid.of(rigid, 1 / (200.0 * 60e9 * 2e-8))
    L, P = jnp.linspace(0.24, 0.3, 5), jnp.linspace(0, 8e5, 5)
    np.testing.assert_allclose(
        compliant.thread_length(L, P), elastic.thread_length(L, P), rtol=1e-12
    )
    none = famjax.braids.CompliantBraid.of(rigid, 0.0)
    np.testing.assert_array_equal(none.thread_length(L, P), np.full(5, 0.33))
    slope = jax.jit(
        jax.grad(lambda c: famjax.braids.CompliantBraid.of(rigid, c).thread_length(0.28, 5e5))
    )
    h = 1e-9
    wider = famjax.braids.CompliantBraid.of(rigid, h).thread_length(0.28, 5e5)
    assert float(slope(0.0)) == pytest.approx(float(wider - 0.33) / h, rel=1e-4)
    assert np.isnan(famjax.braids.CompliantBraid.of(rigid, 1.0).thread_length(0.28, 5e5))


def test_onset_pressure_is_where_the_force_begins(festo: famjax.Muscle) -> None:
    L = jnp.array([0.25, 0.27, 0.296])
    onset = festo.onset_pressure(L, 2e6)
    np.testing.assert_allclose(festo.force(L, onset), 0.0, atol=1e-8)
    assert float(onset[2]) == pytest.approx(40e3, rel=1e-9)  # at rest: the deadband itself
    assert np.isnan(festo.onset_pressure(0.25, 1e4, throw=False))


C = 1.8e-5  # m/N


MUSCLE = famjax.Muscle(
    CYLINDER_10.with_parameters({"braid_angle": np.radians(65), "rest_length": 0.28}),
    famjax.PolynomialMaterial([0.4e6]),
)


@pytest.mark.parametrize("exponent", [1.0, 0.7, 0.5, 0.3])
def test_every_rig_gives_way_alike_at_the_seating_force(exponent: float) -> None:
    at = float(give_way(SEATING_FORCE, C, exponent))
    assert at == pytest.approx(C * SEATING_FORCE, rel=1e-6)
    force = np.array([5.0, 40.0, 400.0])
    power = C * SEATING_FORCE * (force / SEATING_FORCE) ** exponent
    np.testing.assert_allclose(give_way(force, C, exponent), power, rtol=2e-4)
    np.testing.assert_allclose(give_way(-force, C, exponent), -give_way(force, C, exponent))


@pytest.mark.parametrize("exponent", [None, 1.0, 0.5, 0.3])
def test_a_mounted_muscle_balances(exponent: float | None) -> None:
    mounted = famjax.MountedMuscle(MUSCLE, C, exponent)
    x, P = jnp.linspace(0.24, 0.28, 7), 5e5
    force = mounted.force(x, P)
    np.testing.assert_allclose(force, MUSCLE.force(x - mounted.gives_way(force), P), rtol=1e-11)
    assert (force < MUSCLE.force(x, P)).all()
    if exponent == 1.0:
        np.testing.assert_allclose(force, famjax.MountedMuscle(MUSCLE, C).force(x, P), rtol=1e-11)


REST, OTHER = 0.3, 0.083
BLADDER = famjax.Bladder(REST, 0.0098, 0.0016)
BRAID = famjax.Braid.from_rest(diameter=0.0112, braid_angle=1.1, length=REST, thickness=3e-4)
THREAD = famjax.braids.LinearThread(8e10, 8.6e-8)
BRAIDS = {
    "inextensible": BRAID,
    "compliant": famjax.braids.CompliantBraid.of(BRAID, 4e-6),
    "elastic": famjax.ElasticBraid(
        BRAID.rest_thread_length, BRAID.turns, BRAID.thickness, 144, THREAD
    ),
}
LAW = famjax.PolynomialMaterial([1.2e6, -0.4e6, 0.3e6])


def muscle(kind: str) -> famjax.Muscle:
    return famjax.Muscle(famjax.EstimatedGeometry(BRAIDS[kind], BLADDER), LAW, 2e4)


@pytest.mark.parametrize("kind", BRAIDS)
def test_without_ends_the_force_depends_on_contraction_alone(kind: str) -> None:
    long, c = muscle(kind), jnp.linspace(0, 0.25, 6)
    short = famjax.cut_to_length(long, OTHER)
    assert float(short.geometry.rest_length) == OTHER
    np.testing.assert_allclose(
        short.force(OTHER * (1 - c), 4e5), long.force(REST * (1 - c), 4e5), rtol=1e-9
    )  # the elastic root is found to 1e-10


class Wrapped(famjax.geometries.AbstractGeometry):
    """A geometry of a modeller's own, which says how it is cut."""

    inner: famjax.geometries.AbstractGeometry

    def dimensions(self, length, pressure):
        return self.inner.dimensions(length, pressure)

    def length_range(self):
        return self.inner.length_range()

    def cut_to_length(self, rest_length):
        return Wrapped(self.inner.cut_to_length(rest_length))

    rest_length = property(lambda self: self.inner.rest_length)


def test_a_geometry_of_ones_own_is_cut_and_has_a_volume() -> None:
    plain = muscle("inextensible")
    own = famjax.cut_to_length(famjax.Muscle(Wrapped(plain.geometry), LAW, 2e4), OTHER)
    short = famjax.cut_to_length(plain, OTHER)
    at = 0.9 * OTHER, 4e5
    assert float(own.force(*at)) == float(short.force(*at))
    assert float(own.volume(*at)) == float(short.volume(*at))
    np.testing.assert_array_equal(own.stops(), own.length_range())  # it names no braid
    lock, straight = short.stops()
    assert float(lock) < OTHER < float(straight) == float(short.geometry.braid.rest_thread_length)
