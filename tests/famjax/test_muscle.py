"""Muscles: force by hand, terms and models of all kinds, ends, rigs, cuts, members that cannot be."""

import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import muscles as known
import numpy as np
import pytest
from jaxtyping import Array, Float
from muscles import CYLINDER, GEOMETRIES, L0, LATEX, MUSCLES, REST
from slow_cases import slow_after

import famjax
from famjax.materials import SaturatingMaterial
from famjax.muscle import SEATING_FORCE, give_way


def test_force_is_the_sum_of_its_terms_by_hand():
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
    assert float(known.CHAMBERS.force(L, P)) == pytest.approx(by_hand, rel=1e-12)


@pytest.mark.parametrize(("name", "pressure"), [("FESTO", 5e5), ("CHAMBERS", 80.0)])
def test_stiffness_is_the_slope_free_contraction_has_no_force_and_load_is_carried(name, pressure):
    muscle = getattr(known, name)
    L, P = muscle.rest_length * np.linspace(0.72, 1.02, 7), pressure * np.linspace(0.1, 1.2, 7)
    h = 1e-6 * L[0]
    slope = (muscle.force(L + h, P) - muscle.force(L - h, P)) / (2 * h)
    np.testing.assert_allclose(muscle.stiffness(L, P), slope, rtol=1e-6)
    P = P[2:]
    blocked = muscle.blocked_force(P)
    free = muscle.free_contraction(P)
    at = (1 - free) * muscle.geometry.rest_length
    np.testing.assert_allclose(muscle.force(at, P) / blocked, 0, atol=1e-11)
    loaded = muscle.length_at_load(0.4 * blocked, P)
    np.testing.assert_allclose(muscle.force(loaded, P), 0.4 * blocked, rtol=1e-11)
    assert (np.diff(free) > 0).all()


@pytest.mark.parametrize("name", ["inelastic", "elastic", "saturating"])
def test_path_modulus_is_the_slope_of_stress_along_the_path(name):
    law = SaturatingMaterial(40.0, 20.0, 0.15) if name == "saturating" else LATEX
    geometry = GEOMETRIES["elastic" if name == "elastic" else "estimated"]()
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


def test_end_factor_is_a_dead_length(festo):
    """k = 1/(1 - l/L0): the part that contracts is shorter by l and otherwise the same muscle."""
    k, rest = 1.12, 0.296
    active = rest / k
    short = festo.with_parameters({"rest_length": active})
    ends = famjax.geometries.EndEffectGeometry(festo.geometry, k)
    muscle = famjax.Muscle(ends, festo.material, festo.deadband_pressure)
    L = jnp.linspace(0.25, 0.296, 7)
    dead = rest - active  # stays when the muscle is cut
    np.testing.assert_allclose(muscle.force(L, 5e5), short.force(L - dead, 5e5), rtol=1e-10)
    free = muscle.free_contraction(5e5)
    assert float(free) == pytest.approx(float(festo.free_contraction(5e5)) / k, rel=1e-9)
    cut = famjax.cut_to_length(muscle, 0.2)
    other = festo.with_parameters({"rest_length": 0.2 - dead})
    np.testing.assert_allclose(cut.force(0.19, 5e5), other.force(0.19 - dead, 5e5), rtol=1e-10)


def test_compliant_braid_is_the_elastic_braid_of_linear_threads():
    thread = famjax.braids.LinearThread(60e9, 2e-8)
    elastic = famjax.ElasticBraid(0.33, 2.2, 0.0, 200.0, thread)
    rigid = famjax.Braid(0.33, 2.2)
    compliant = famjax.braids.CompliantBraid.of(rigid, 1 / (200.0 * 60e9 * 2e-8))
    L, P = jnp.linspace(0.24, 0.3, 5), jnp.linspace(0, 8e5, 5)
    one, other = compliant.thread_length(L, P), elastic.thread_length(L, P)
    np.testing.assert_allclose(one, other, rtol=1e-12)
    none = famjax.braids.CompliantBraid.of(rigid, 0.0)
    np.testing.assert_array_equal(none.thread_length(L, P), np.full(5, 0.33))
    assert np.isnan(famjax.braids.CompliantBraid.of(rigid, 1.0).thread_length(0.28, 5e5))


def test_onset_pressure_is_where_the_force_begins(festo):
    L = jnp.array([0.25, 0.27, 0.296])
    onset = festo.onset_pressure(L, 2e6)
    np.testing.assert_allclose(festo.force(L, onset), 0.0, atol=1e-8)
    assert float(onset[2]) == pytest.approx(40e3, rel=1e-9)  # at rest: the deadband itself
    assert np.isnan(festo.onset_pressure(0.25, 1e4, throw=False))


C = 1.8e-5  # m/N

STEEP = famjax.Muscle(known.CYLINDER_10, famjax.PolynomialMaterial([0.4e6]))
STEEP = STEEP.with_parameters({"braid_angle": np.radians(65), "rest_length": 0.28})


@pytest.mark.parametrize("exponent", [1.0, 0.7, 0.5, 0.3])
def test_every_rig_gives_way_alike_at_the_seating_force(exponent):
    at = float(give_way(SEATING_FORCE, C, exponent))
    assert at == pytest.approx(C * SEATING_FORCE, rel=1e-6)
    force = np.array([5.0, 40.0, 400.0])
    power = C * SEATING_FORCE * (force / SEATING_FORCE) ** exponent
    np.testing.assert_allclose(give_way(force, C, exponent), power, rtol=2e-4)
    np.testing.assert_allclose(give_way(-force, C, exponent), -give_way(force, C, exponent))


@pytest.mark.parametrize("exponent", [None, 1.0, 0.5, 0.3])
def test_a_mounted_muscle_balances(exponent):
    mounted = famjax.MountedMuscle(STEEP, C, exponent)
    x, P = jnp.linspace(0.24, 0.28, 7), 5e5
    force = mounted.force(x, P)
    np.testing.assert_allclose(force, STEEP.force(x - mounted.gives_way(force), P), rtol=1e-11)
    assert (force < STEEP.force(x, P)).all()
    if exponent == 1.0:
        np.testing.assert_allclose(force, famjax.MountedMuscle(STEEP, C).force(x, P), rtol=1e-11)


@pytest.mark.parametrize("kind", ["estimated", "compliant", "elastic"])
def test_without_ends_the_force_depends_on_contraction_alone(kind):
    long, c = famjax.Muscle(GEOMETRIES[kind](), LATEX, 3.0), jnp.linspace(0, 0.25, 6)
    short = famjax.cut_to_length(long, 2.5)
    assert float(short.geometry.rest_length) == 2.5
    found, wanted = short.force(2.5 * (1 - c), 60.0), long.force(L0 * (1 - c), 60.0)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


class Wrapped(famjax.geometries.AbstractGeometry):
    inner: famjax.geometries.AbstractGeometry

    def dimensions(self, length, pressure):
        return self.inner.dimensions(length, pressure)

    def length_range(self):
        return self.inner.length_range()

    def cut_to_length(self, rest_length):
        return Wrapped(self.inner.cut_to_length(rest_length))

    rest_length = property(lambda self: self.inner.rest_length)


def test_a_geometry_of_ones_own_is_cut_and_has_a_volume():
    own = famjax.cut_to_length(famjax.Muscle(Wrapped(CYLINDER), LATEX, 3.0), 2.5)
    short = famjax.cut_to_length(famjax.Muscle(CYLINDER, LATEX, 3.0), 2.5)
    at = 2.25, 60.0
    assert float(own.force(*at)) == float(short.force(*at))
    assert float(own.volume(*at)) == float(short.volume(*at))
    np.testing.assert_array_equal(own.stops(), own.length_range())  # it names no braid
    lock, straight = short.stops()
    assert float(lock) < 2.5 < float(straight) == float(short.geometry.braid.rest_thread_length)


P = 60.0
EXACT = 1e-12
SOLVED = 1e-9  # roots to a few digits less than the precision
GOOD = jnp.array([0.99 * L0, 0.8 * L0])

# ---- every term


def test_terms_add_flat_in_any_order():
    braid, wall, spring = known.TERMS["pressurised braid"], known.TERMS["wall"], Coulomb(3.0)
    for terms in (
        (braid + wall) + spring,
        braid + (wall + spring),
        famjax.terms.SumOfTerms([braid, wall + spring]),
    ):
        assert [*map(type, terms.terms)] == [*map(type, (braid, wall, spring))]
        total = famjax.Muscle(CYLINDER, terms).force(GOOD, P)
        each = [famjax.Muscle(CYLINDER, term).force(GOOD, P) for term in (braid, wall, spring)]
        np.testing.assert_allclose(total, sum(each), rtol=EXACT)
    np.testing.assert_allclose(each[2], -3.0, rtol=EXACT)


def test_a_material_stands_for_braid_and_wall():
    short = famjax.Muscle(CYLINDER, LATEX, 3.0)
    long = famjax.Muscle(CYLINDER, PULL)
    np.testing.assert_allclose(short.force(GOOD, P), long.force(GOOD, P), rtol=EXACT)
    for muscle in (short, long):
        assert eqx.tree_equal(muscle.material, LATEX)
        assert float(muscle.deadband_pressure) == 3.0
        total = muscle.braid_force(GOOD, P) + muscle.bladder_force(GOOD, P)
        np.testing.assert_allclose(muscle.force(GOOD, P), total, rtol=EXACT)


class Coulomb(famjax.terms.AbstractForceTerm):
    amount: Float[Array, ""] = famjax.parameter("N", low=0.0, linear=True, name="coulomb")

    def force(self, at: famjax.geometries.Dimensions, pressure: famjax.Real) -> jax.Array:
        return jnp.broadcast_to(-self.amount, jnp.shape(at.length))


def test_a_term_of_somebody_else_takes_part_in_everything():
    plain = MUSCLES["muscle"]
    muscle = famjax.Muscle(plain.geometry, plain.terms + Coulomb(20.0))
    np.testing.assert_allclose(muscle.force(0.22, 4e5), plain.force(0.22, 4e5) - 20, rtol=EXACT)
    assert float(muscle.free_contraction(4e5)) < float(plain.free_contraction(4e5))
    assert float(muscle.blocked_force(4e5)) == pytest.approx(float(plain.blocked_force(4e5)) - 20)
    other = muscle.with_parameters({"coulomb": 0.0})
    np.testing.assert_allclose(other.force(0.22, 4e5), plain.force(0.22, 4e5), rtol=EXACT)


# ---- every model

CALLS: dict[str, tuple] = {
    "force": (0.93 * REST, 4e5), "stiffness": (0.93 * REST, 4e5), "blocked_force": (4e5,),
    "length_at_load": (20.0, 4e5), "free_contraction": (4e5,), "onset_pressure": (0.9 * REST, 6e5),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", MUSCLES)
def test_every_method_of_every_model(name, caplog):
    """Jit and vmap equal eager, and what was called once is not traced again."""
    for method, at in CALLS.items():
        call = getattr(MUSCLES[name], method)
        # Not every surface has an equilibrium.
        if method in ("length_at_load", "free_contraction", "onset_pressure"):
            call = functools.partial(call, throw=False)
        found = call(*at)
        caplog.clear()
        with jax.log_compiles():
            call(*(1.01 * argument for argument in at))
        assert not caplog.records, (method, caplog.records[0].getMessage())
        mapped = jax.jit(jax.vmap(call))(*(argument * jnp.array([1.0, 0.8]) for argument in at))
        np.testing.assert_allclose(mapped[0], found, rtol=SOLVED, err_msg=method)


# ---- the declared parameters of all of them


@pytest.mark.parametrize("name", [*MUSCLES, *GEOMETRIES])
def test_parameters_and_back(name):
    model = MUSCLES[name] if name in MUSCLES else famjax.Muscle(GEOMETRIES[name](), LATEX, 3.0)
    values, declared = model.parameters(), model.declared()
    assert values.keys() == declared.keys()
    assert all(one.name == key for key, one in declared.items())
    assert all(value.shape == () for value in values.values())
    again = model.with_parameters(values)
    assert jax.tree.structure(again) == jax.tree.structure(model)
    for mine, theirs in zip(jax.tree.leaves(again), jax.tree.leaves(model), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-14)
    moved = {key: float(value) * 1.01 + 0.01 for key, value in values.items()}
    got = model.with_parameters(moved).parameters()
    for key, value in moved.items():
        assert float(got[key]) == pytest.approx(value, rel=EXACT), key


def test_the_linear_ones_are_linear():
    """Along any two parameters declared linear the force has no curvature."""
    for name, model in MUSCLES.items():
        linear = [key for key, one in model.declared().items() if one.linear]
        values = {key: float(model.parameters()[key]) or 1.0 for key in linear}
        if not linear:
            continue

        def force(scale: jax.Array, model=model, values=values) -> jax.Array:
            return model.with_parameters({k: v * scale for k, v in values.items()}).force(0.23, 4e5)

        at = [float(force(jnp.asarray(scale))) for scale in (0.0, 0.5, 1.0)]
        assert at[1] == pytest.approx((at[0] + at[2]) / 2, rel=1e-9), name
        assert at[0] != at[2], name


def test_a_batch_of_muscles_is_refused_and_mapped_instead():
    def force(deadband: jax.Array) -> jax.Array:
        return famjax.Muscle(CYLINDER, LATEX, deadband).force(9.0, P)

    deadbands = jnp.array([0.0, 3.0])
    for make in (force, jax.jit(force)):
        with pytest.raises(ValueError, match=r"one muscle: Muscle\.terms\.terms\[1\]\.dead"):
            make(deadbands)
    each = [float(force(deadband)) for deadband in deadbands]
    np.testing.assert_allclose(jax.vmap(force)(deadbands), each, rtol=EXACT)
    geometry = famjax.EstimatedGeometry(
        known.INELASTIC, famjax.Bladder(jnp.full(3, L0), 0.875, 0.0625)
    )
    with pytest.raises(ValueError, match=r"apply jax\.vmap or equinox\.filter_vmap"):
        famjax.Muscle(geometry, LATEX)
    muscles = eqx.filter_vmap(lambda P_d: famjax.Muscle(CYLINDER, LATEX, P_d))(deadbands)
    got = eqx.filter_vmap(lambda muscle: muscle.force(9.0, P))(muscles)
    np.testing.assert_allclose(got, each, rtol=EXACT)
    with pytest.raises(ValueError, match="an instance represents one muscle"):
        muscles.force(9.0, P)


class Tapered(Wrapped):
    """A cylinder that grows thin as it shortens: written as one would, with no thought of nan."""

    taper: Float[Array, ""] = famjax.parameter(low=0.0, high=0.5, default=0.1)

    def dimensions(self, length, pressure):
        at = self.inner.dimensions(length, pressure)
        return dataclasses.replace(at, radius=at.radius * (1 - self.taper * (1 - length / 0.25)))


OWN = famjax.Muscle(Tapered(known.CYLINDER_10, 0.1), known.RUBBER.material, 3e4)
PULL = famjax.terms.PressurisedBraid(3.0) + famjax.terms.BladderWall(LATEX)
WHOLE = {
    "a geometry of one's own": OWN,
    **{name: MUSCLES[name] for name in ("sarosi", "gaylord", "tondu_lopez")},
    "one's own in a rig": famjax.MountedMuscle(OWN, 1e-5),
}
PARTS = jnp.array([0.99, -0.9, 0.8, 3.6, jnp.nan, 0.96])  # of the length at rest
PRESSED = jnp.array([1.0, 1.0, 1.25, 1.0, 1.0, jnp.nan])


@pytest.mark.parametrize("name", slow_after(len(WHOLE) - 1, [*WHOLE, *GEOMETRIES]))
def test_members_that_cannot_be_spoil_nothing(name):
    """Values, and derivatives in every number, forward and reverse, of a batch and of a good one."""
    model = WHOLE[name] if name in WHOLE else famjax.Muscle(GEOMETRIES[name](), PULL)
    rest, pressure = (REST, 4e5) if name in WHOLE else (L0, P)
    numbers, others = eqx.partition(model, eqx.is_inexact_array)

    def forces(numbers: Any, lengths: jax.Array, pressures: jax.Array) -> jax.Array:
        force = eqx.combine(numbers, others).force
        return (force if name in WHOLE else jax.vmap(force))(lengths, pressures)

    @jax.jit
    def everything(lengths: jax.Array, pressures: jax.Array) -> tuple:
        def moved(numbers: Any, more: jax.Array) -> jax.Array:  # all members share the pressure
            return forces(numbers, lengths, pressures + more)

        at = numbers, jnp.asarray(0.0)
        slopes = jax.vmap(model.stiffness)(lengths, pressures)
        whole = jax.grad(lambda *at: jnp.nansum(forces(*at)), (0, 1))(numbers, lengths, pressures)
        rates = (way(moved, (0, 1))(*at) for way in (jax.jacrev, jax.jacfwd))
        return (moved(*at), *rates, slopes), whole

    lengths, pressures = rest * PARTS, pressure * PRESSED
    mixed, of_mixed = everything(lengths, pressures)
    is_good = np.isfinite(mixed[0])
    assert is_good[[0, 2]].all()
    assert not is_good[[1, 4, 5] if name in WHOLE else [1, 3, 4, 5]].any()
    np.testing.assert_array_equal(np.isnan(mixed[3]), ~is_good)
    good, of_good = everything(
        jnp.where(is_good, lengths, 0.9 * rest), jnp.where(is_good, pressures, pressure)
    )
    for got, want in zip(jax.tree.leaves(mixed), jax.tree.leaves(good), strict=True):
        assert np.isfinite(want).all()
        size = max(np.abs(want).max(), 1e-6)
        both = (np.asarray(each)[is_good] / size for each in (got, want))
        np.testing.assert_allclose(*both, atol=SOLVED)
    if name in WHOLE:  # those of a sum
        sums, each = jax.tree.leaves(of_mixed[0]), jax.tree.leaves(good[1][0])
        for got, rows in zip(sums, each, strict=True):
            want, size = np.asarray(rows)[is_good].sum(axis=0), max(np.abs(rows).max(), 1e-6)
            np.testing.assert_allclose(got, want, rtol=SOLVED, atol=SOLVED * size)
    np.testing.assert_allclose(of_mixed[1][is_good], of_good[1][is_good], rtol=SOLVED)
