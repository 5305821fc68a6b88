"""A safe muscle anywhere, and hysteresis: finite, slack, rising, C1, no closed loop gives energy."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, example, given, settings, strategies as st
from maps import cylinder

import famjax
from famjax.boundary.errors import InputError
from famjax.continuation import SafeMuscle, taut
from famjax.muscle import MeanMuscle
from famjax.slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements

ROUNDING = 1e-9  # of the largest slope in the batch: of nested derivatives in float64
JUMP = 1e-5  # of the same: what a C1 slope changes over 2e-8 of the range, bent on 1e-3 of it
SAME = 1e-11  # relative, of forces that begin at a thousandth of the largest: the compiler's order
N = 400
QUICK = settings(
    max_examples=15, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
numbers = st.floats(0.0, 1.0)


def polynomial(u: list[float]) -> famjax.Muscle:
    """A muscle of three coefficients, of which any may be negative: it need not be monotone."""
    diameter, angle = 0.012 + 0.02 * u[0], 1.0 + 0.25 * u[1]
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle, length=0.3)
    bladder = famjax.Bladder(0.3, 0.011 + 0.018 * u[0], 0.0012 + 0.0008 * u[2], embedded=True)
    rubber = famjax.PolynomialMaterial(1e6 * (np.array(u[3:6]) * [1.5, 3, 3] - [0.0, 1.0, 1.0]))
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), rubber, 6e4 * u[6])


def compliant(u: list[float]) -> famjax.AbstractMuscle:
    """The mean of two: soft threads and rounded ends, and the plain one of the same numbers."""
    plain = polynomial(u)
    shape = plain.geometry
    soft = famjax.braids.CompliantBraid.of(shape.braid, 4e-6 * u[7])
    cylinder = famjax.EstimatedGeometry(soft, shape.bladder)
    ends = famjax.geometries.EndEffectGeometry(cylinder, 1 + 0.2 * u[8])
    rubber = famjax.materials.OgdenMaterial([-1e6 * (0.1 + u[3])], [-1 - 6 * u[4]])
    return MeanMuscle([famjax.Muscle(ends, rubber, 6e4 * u[6]), plain])


KINDS = {"polynomial": polynomial, "mean": compliant}


@eqx.filter_jit
def slopes(of: SafeMuscle, L: jax.Array, P: jax.Array) -> tuple[jax.Array, ...]:
    """Force, stiffness and area; force and area as if it could push; all by one program."""

    def in_both(of: famjax.AbstractMuscle) -> tuple[jax.Array, jax.Array, jax.Array]:
        force, (stiffness, area) = jax.vmap(jax.value_and_grad(of.force, (0, 1)))(L, P)
        return force, stiffness, area

    return *in_both(of), *in_both(of.continued)


def safe(kind: str, u: list[float], contraction: float, top: float) -> SafeMuscle:
    lengths, pressures = [0.3 * (1 - contraction), 0.3], [3e4, top]
    try:
        return SafeMuscle.of(KINDS[kind](u), lengths, pressures)
    except InputError:
        assume(False)
        raise


def random_states(of: SafeMuscle, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Over +-100 % strain and twice the pressure; half of them at a length or pressure of the data."""
    rng = np.random.default_rng(seed)
    L, P = 0.6 * rng.random(N), 2 * float(of.data.pressure[1]) * rng.random(N)
    inside = rng.random(N) < 0.25, rng.random(N) < 0.25
    (l0, l1), (p0, p1) = (np.asarray(one) for one in (of.region.length, of.region.pressure))
    L = np.where(inside[0], l0 + (l1 - l0) * rng.random(N), L)
    return L, np.where(inside[1], p0 + (p1 - p0) * rng.random(N), P)


def outside(of: SafeMuscle, L: np.ndarray, P: np.ndarray) -> np.ndarray:
    (l0, l1), (p0, p1) = (np.asarray(one) for one in (of.region.length, of.region.pressure))
    return (l0 > L) | (l1 < L) | (p0 > P) | (p1 < P)


@pytest.mark.slow
@QUICK
@given(
    kind=st.sampled_from(list(KINDS)),
    u=st.lists(numbers, min_size=9, max_size=9),
    contraction=st.floats(0.1, 0.25),
    top=st.floats(2e5, 8e5),
    seed=st.integers(0, 1000),
)
@example(  # the stiffness at the lowest rising pressure fell between two lines of the grid
    kind="polynomial", contraction=0.1875, top=2e5, seed=2,
    u=[0.57421875, 0.205078125, 0.9296875, 0.0, 0.0, 0.36328125, 0.205078125, 0.0, 0.0],
)  # fmt: skip
def test_a_safe_muscle_is_the_model_inside_and_goes_on_outside(kind, u, contraction, top, seed):
    of = safe(kind, u, contraction, top)
    outside_nothing_falls_and_all_is_finite(of, seed)
    the_force_is_c1_across_every_edge(of, top, seed)
    inside_it_is_the_model(of, seed)


def outside_nothing_falls_and_all_is_finite(of: SafeMuscle, seed: int) -> None:
    L, P = random_states(of, seed)
    F, K, A, G, G_L, G_P = (np.asarray(one) for one in slopes(of, L, P))
    assert all(np.isfinite(one).all() for one in (F, K, A, G, G_L, G_P))
    away = outside(of, L, P)
    assert away.sum() > N / 2
    assert (F >= 0).all()
    for slope, taut_ones in ((K, away), (A, away), (G_L, away & (G > 0)), (G_P, away & (G > 0))):
        assert slope[taut_ones].min(initial=0.0) >= -ROUNDING * np.abs(slope).max()
    np.testing.assert_array_equal(F[G <= 0], 0.0)  # slack is slack
    at_lock = float(of.continued.stops[0] - 0.05 * of.rest_length)
    assert (F[at_lock > L] == 0).all()  # whatever the pressure


def the_force_is_c1_across_every_edge(of: SafeMuscle, top: float, seed: int) -> None:
    """Slopes on both sides of the region's edges and of the stops, at random places along them."""
    rng = np.random.default_rng(seed)
    n = N // 8
    anywhere = 0.6 * rng.random(n), 2 * top * rng.random(n)
    region, stops = of.region, np.asarray(of.continued.stops)
    edges = [(np.full(n, float(at)), anywhere[1], 6e-9, 0.0) for at in (*region.length, *stops)]
    edges += [(anywhere[0], np.full(n, float(at)), 0.0, 1e-8 * top) for at in region.pressure]
    every = ([np.broadcast_to(edge[k], n) for edge in edges] for k in range(4))
    L, P, dL, dP = map(np.concatenate, every)
    below, above = (slopes(of, L + s * dL, P + s * dP)[:3] for s in (-1, 1))
    for one, other in zip(below, above, strict=True):
        scale = float(np.abs(np.asarray(one)).max())
        np.testing.assert_allclose(one, other, rtol=0, atol=JUMP * scale)


def inside_it_is_the_model(of: SafeMuscle, seed: int) -> None:
    rng = np.random.default_rng(seed)
    (l0, l1), (p0, p1) = (np.asarray(one) for one in (of.region.length, of.region.pressure))
    L, P = l0 + (l1 - l0) * rng.random(N), p0 + (p1 - p0) * rng.random(N)
    model = eqx.filter_jit(of.continued.muscle.force)(L, P)
    force = slopes(of, L, P)[0]
    loaded = np.asarray(model) >= float(of.slack_width)
    np.testing.assert_allclose(np.asarray(force)[loaded], np.asarray(model)[loaded], rtol=SAME)


LATEX = polynomial([0.5, 0.5, 0.5, 0.6, 0.4, 0.4, 0.5])


def test_a_model_that_falls_is_taken_where_it_rises_and_that_is_said():
    falling = polynomial([0.5, 0.5, 0.5, 0.2, 0.1, 0.1, 0.9])
    of = SafeMuscle.of(falling, [0.24, 0.3], [0.0, 6e5])
    assert float(of.region.pressure[0]) > 0
    assert any(
        "rises with length and pressure only for" in note and "kPa" in note for note in of.notes
    )
    assert SafeMuscle.of(LATEX, [0.27, 0.3], [2e5, 6e5]).notes == ()
    kind = famjax.Muscle(LATEX.geometry, famjax.PolynomialMaterial([-9e7]), 0.0)
    with pytest.raises(InputError, match="cannot be continued safely"):
        SafeMuscle.of(kind, [0.24, 0.3], [5e4, 6e5])
    with pytest.raises(InputError, match="needs two different lengths"):
        SafeMuscle.of(LATEX, [0.3], [5e4, 6e5])
    with pytest.raises(InputError, match="pressures must be finite and >= 0"):
        SafeMuscle.of(LATEX, [0.24, 0.3], [-5e4, 6e5])


def test_the_pull_fades_into_slack_smoothly_and_carries_loads_there_too():
    G, width = jnp.linspace(-1, 3, 401), jnp.asarray(2.0)
    np.testing.assert_array_equal(taut(G, width), jnp.where(G >= 2, G, taut(G, width)))
    np.testing.assert_array_equal(taut(G[G <= 0], width), 0.0)
    slope = jax.vmap(jax.grad(taut), (0, None))(jnp.array([1e-9, 2 - 1e-9]), width)
    np.testing.assert_allclose(slope, [0.0, 1.0], atol=1e-7)
    assert float(taut(width * (1 - 1e-9), width)) == pytest.approx(2.0, rel=1e-8)
    of = SafeMuscle.of(LATEX, [0.24, 0.3], [2e5, 6e5])
    loads = of.slack_width * jnp.array([0.01, 0.3, 0.9, 1.1, 3.0])
    length = of.length_at_load(loads, 4e5)
    np.testing.assert_allclose(of.force(length, 4e5), loads, rtol=1e-7)
    assert np.isnan(of.length_at_load(-1.0, 4e5, throw=False))


MUSCLE = famjax.Muscle(cylinder(angle=63.0), famjax.PolynomialMaterial([6e5, 2e5, 1e5]), 4e4)
WALL, BRAIDED = SlipElements([0.004, 0.02], [8.0, 15.0]), SlipElements([0.002, 0.01], [10.0, 40.0])
SLIPS = MaxwellSlip(WALL, BRAIDED, 0.3, 1e6)
CYCLES = ReferenceCycle("ramp", 0.0, 6e5, True), ReferenceCycle("stroke", 0.3, 0.25, False)


@pytest.mark.slow
@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(0.02, 0.5), min_size=2, max_size=6),
    st.floats(0.0, 1.2e6),
    st.sampled_from(CYCLES),
)
def test_every_closed_loop_takes_energy_up(turns, P, cycle):
    """Also where the muscle is slack for a part of it; the second round closes the state as well."""
    loops = CentredSlip(SLIPS, cycle)
    of = SafeMuscle.of(MUSCLE, [0.235, 0.3], [5e4, 6e5], hysteresis=loops)
    padded = np.array((turns * 6)[:6])
    work, path = closed_loop(of, jnp.append(padded, padded[0]), jnp.asarray(P))
    assert float(work) >= -ROUNDING * 3000.0 * float(path)


@eqx.filter_jit
def closed_loop(of: SafeMuscle, turns: jax.Array, P: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Work [J] of the second round of a closed path, and its length [m].

    Both branches through a place are asked at the same places, so that their integrals by the same
    rule differ as the branches do.
    """
    grid = jnp.linspace(0.02, 0.5, 400)
    ways = jnp.concatenate([turns[:-1], turns])

    def way(state, ends: tuple[jax.Array, jax.Array]):
        a, b = ends
        at = jnp.where(b > a, grid, grid[::-1])
        at = jnp.clip(at, jnp.minimum(a, b), jnp.maximum(a, b))
        force = jax.vmap(lambda L: of.pull(state, L, P))(at)
        return of.moved(state, b, P), jnp.sum((force[1:] + force[:-1]) / 2 * jnp.diff(at))

    state = of.start(ways[0], P)
    _, works = jax.lax.scan(way, state, (ways[:-1], ways[1:]))
    return jnp.sum(works[len(turns) - 1 :]), jnp.sum(jnp.abs(jnp.diff(turns)))


REST, MODULUS = 0.3, 1e6
OF_WALL = SlipElements([0.004, 0.02, 0.07], [3.0, 2.0, 6.0])
SLIP = MaxwellSlip(OF_WALL, SlipElements([0.002, 0.015], [8.0, 20.0]), REST, MODULUS)


def _history(seed: int, n: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Random lengths up to a fifth shorter, and pressures up to 0.8 MPa."""
    rng = np.random.default_rng(seed)
    return REST * (1 - 0.2 * rng.uniform(size=n)), 8e5 * rng.uniform(size=n)


def _play(history: np.ndarray, threshold: float) -> np.ndarray:
    """The other operator of the pair: the slider's path, by its own textbook recursion."""
    slider, path = history[0], []
    for q in history:
        slider = max(q - threshold, min(q + threshold, slider))
        path.append(slider)
    return np.array(path)


@pytest.mark.parametrize("seed", range(5))
def test_force_is_what_the_play_operator_leaves_of_the_motion(seed):
    L, P = _history(seed)
    strain = L / REST - 1
    expected = np.zeros(L.size)
    for share, elements in ((1 + P / MODULUS, SLIP.wall), (P / MODULUS, SLIP.braid)):
        q = strain * share
        for delta, S in zip(elements.threshold, elements.strength, strict=True):
            expected += share * float(S) * (q - _play(q, float(delta))) / float(delta)
    np.testing.assert_allclose(SLIP.along(L, P), expected, rtol=1e-9, atol=1e-9)


def _work(L: np.ndarray, P: np.ndarray) -> np.ndarray:
    """What machine and fluid do in each step, F dL - V dP by the trapezoidal rule."""
    states = SLIP.states(L, P)
    F = np.asarray(SLIP.along(L, P))
    both = SLIP.wall.force(states.wall) + SLIP.braid.force(states.braid)
    V = (REST - L) / MODULUS * np.asarray(both)  # the elements' share of the fluid
    return (F[1:] + F[:-1]) / 2 * np.diff(L) - (V[1:] + V[:-1]) / 2 * np.diff(P)


@pytest.mark.parametrize("seed", range(6))
def test_no_closed_cycle_gives_energy(seed):
    """Random polygons in length and pressure: work is what is stored and what becomes heat."""
    L, P = _history(seed, 7)
    fine = np.linspace(0, 7, 7 * 400 + 1)
    corners = np.arange(8)
    L, P = (np.interp(fine, corners, np.append(x, x[0])) for x in (L, P))
    once = fine.size - 1
    L, P = (np.append(x, x[1:]) for x in (L, P))
    work, heat = _work(L, P), float(SLIP.heat(L, P))
    states = SLIP.states(L, P)
    stored = REST * sum(
        np.sum(np.asarray(one.strength * s**2 / (2 * one.threshold)), axis=-1)
        for one, s in ((SLIP.wall, states.wall), (SLIP.braid, states.braid))
    )
    assert heat >= 0
    assert (stored >= 0).all()
    assert work.sum() == pytest.approx(heat + stored[-1], rel=1e-3)
    lost = work[once:].sum()  # of the second round, whose springs end as they begin
    assert stored[-1] == pytest.approx(stored[once], rel=1e-6)
    assert lost >= 0
    assert lost == pytest.approx(heat - float(SLIP.heat(L[: once + 1], P[: once + 1])), rel=2e-3)
