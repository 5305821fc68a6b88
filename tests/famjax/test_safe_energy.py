"""A mass on a safe muscle in a simulator's loop: no energy comes from nowhere, in the data or beyond."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import famjax
from famjax.continuation import SafeMuscle
from famjax.slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements

STEPS, DT = 100_000, 1e-3  # a step that a simulator of robots takes
RK4_ERROR = 1e-3  # of the largest kinetic energy: where it runs into a stop, omega dt = 0.2
EULER_WAVE = 0.2  # of the same: the semi-implicit step's energy swings by omega dt, without a trend
FINER = 0.5  # of either is left at a quarter of the step, or more would not be the integrator's
ONSETS = 3e-5  # of the same: a step across the onset of a stop gains or loses as it falls
DRIFT = 1e-3  # of the same, between the first tenth of the run and the last
ROUNDING = 1e-9  # of force times path

BRAID = famjax.Braid.from_rest(diameter=0.022, braid_angle=1.1, length=0.3)
SHAPE = famjax.EstimatedGeometry(BRAID, famjax.Bladder(0.3, 0.02, 0.0018, embedded=True))
MUSCLE = famjax.Muscle(SHAPE, famjax.PolynomialMaterial([6e5, 2e5, 1e5]), 4e4)
LOOPS = CentredSlip(
    MaxwellSlip(
        SlipElements([0.004, 0.02], [8.0, 15.0]),
        SlipElements([0.002, 0.01], [10.0, 40.0]),
        0.3,
        1e6,
    ),
    ReferenceCycle("ramp", 0.0, 6e5, True),
)
G = 9.81

# Length at the start, pressure, mass: about the middle of the data; from the braid's straight
# threads at little pressure; at twice the pressure of the data, dropped from beyond the stop and
# from far below the lock; and a light mass thrown through slack.
STARTS = np.array([
    [0.27, 3e5, 20.0], [0.24, 5e5, 40.0], [0.345, 1e4, 10.0], [0.36, 1.2e6, 60.0],
    [0.12, 1.2e6, 60.0], [0.05, 3e5, 20.0],
])  # fmt: skip


@pytest.fixture(scope="module")
def plain() -> SafeMuscle:
    return SafeMuscle.of(MUSCLE, [0.235, 0.3], [5e4, 6e5])


@pytest.fixture(scope="module")
def loops() -> SafeMuscle:
    return SafeMuscle.of(MUSCLE, [0.235, 0.3], [5e4, 6e5], hysteresis=LOOPS)


State = tuple[jax.Array, jax.Array]


def euler(pull: Callable, L: jax.Array, v: jax.Array, m: jax.Array, dt: float) -> State:
    v = v + dt * (G - pull(L) / m)
    return L + dt * v, v


def rk4(pull: Callable, L: jax.Array, v: jax.Array, m: jax.Array, dt: float) -> State:
    def rate(y: jax.Array) -> jax.Array:
        return jnp.stack([y[1], G - pull(y[0]) / m])

    y = jnp.stack([L, v])
    a = rate(y)
    b = rate(y + dt / 2 * a)
    c = rate(y + dt / 2 * b)
    y = y + dt / 6 * (a + 2 * b + 2 * c + rate(y + dt * c))
    return y[0], y[1]


@eqx.filter_jit
def hung(of: SafeMuscle, starts: jax.Array, step: Callable, dt: jax.Array) -> State:
    """Length and velocity of a mass that hangs on the muscle, (starts, STEPS + 1)."""

    def run(start: jax.Array) -> tuple[jax.Array, jax.Array]:
        L0, P, m = start

        def one(carry: tuple, _: None) -> tuple:
            L, v, state = carry
            L, v = step(lambda at: of.pull(state, at, P), L, v, m, dt)
            after = L, v, of.moved(state, L, P)
            return after, after[:2]

        first = L0, jnp.zeros_like(L0), of.start(L0, P)
        _, (L, v) = jax.lax.scan(one, first, None, length=STEPS)
        return jnp.append(L0, L), jnp.append(0.0, v)

    return jax.vmap(run)(starts)


def energies(of: SafeMuscle, L: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic, potential and elastic energy [J] of every run along its static map, and a scale."""
    found, scales = [], []
    for k, (_, P, m) in enumerate(STARTS):
        at = np.linspace(L[k].min(), L[k].max(), 200_001)
        F = np.asarray(of.force(at, P))
        U = np.append(0.0, np.cumsum((F[1:] + F[:-1]) / 2 * np.diff(at)))
        kinetic = 0.5 * m * v[k] ** 2
        found.append(kinetic + np.interp(L[k], at, U) - m * G * L[k])
        scales.append(kinetic.max())
    return np.array(found), np.array(scales)


@pytest.mark.slow
@pytest.mark.parametrize("step", [euler, rk4])
def test_a_mass_gains_no_energy_in_1e5_steps(plain: SafeMuscle, step: Callable) -> None:
    L, v = (np.asarray(one) for one in hung(plain, STARTS, step, jnp.asarray(DT)))
    assert np.isfinite(L).all()
    E, scale = energies(plain, L, v)
    above = (E - E[:, :1]).max(axis=1) / scale
    assert (above <= (RK4_ERROR if step is rk4 else EULER_WAVE)).all(), above
    tenth = STEPS // 10
    drift = (E[:, -tenth:].max(axis=1) - E[:, :tenth].max(axis=1)) / scale
    assert (drift <= DRIFT).all(), drift
    assert (v**2).max() > 1.0  # it did move
    finer = hung(plain, STARTS, step, jnp.asarray(DT / 4))
    E, scale = energies(plain, *(np.asarray(one) for one in finer))
    left = (E - E[:, :1]).max(axis=1) / scale
    assert (left <= FINER * above + ONSETS).all(), (left, above)


@pytest.mark.slow
@pytest.mark.parametrize("step", [euler, rk4])
def test_with_hysteresis_the_mass_comes_to_rest(loops: SafeMuscle, step: Callable) -> None:
    L, v = (np.asarray(one) for one in hung(loops, STARTS, step, jnp.asarray(DT)))
    E, scale = energies(loops, L, v)
    tenth = STEPS // 10
    # What the springs have stored at the start is given back at most: less than the loops' width.
    stored = 73.0 * 2 * 0.02 * 0.3 * 2
    above = (E - E[:, :1]).max(axis=1)
    assert (above <= stored + (RK4_ERROR if step is rk4 else EULER_WAVE) * scale).all(), above
    last = E[:, -tenth:].max(axis=1) - E[:, :tenth].max(axis=1)
    assert (last <= 0).all()
    # Of up to 400 J small motions are left: within the elements' thresholds nothing slides.
    assert (0.5 * STARTS[:, 2] * (v[:, -tenth:] ** 2).max(axis=1) < 0.1).all()


@pytest.mark.slow
@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(0.02, 0.5), min_size=2, max_size=6),
    st.floats(0.0, 1.2e6),
    st.integers(0, 1),
)
def test_every_closed_loop_takes_energy_up(turns: list[float], P: float, kind: int) -> None:
    """Also where the muscle is slack for a part of it; the second round closes the state as well."""
    of = LOOPED[kind]()
    padded = np.array((turns * 6)[:6])
    work, path = closed_loop(of, jnp.append(padded, padded[0]), jnp.asarray(P))
    assert float(work) >= -ROUNDING * 3000.0 * float(path)


def _looped() -> SafeMuscle:
    return SafeMuscle.of(MUSCLE, [0.235, 0.3], [5e4, 6e5], hysteresis=LOOPS)


def _after_strokes() -> SafeMuscle:
    strokes = CentredSlip(LOOPS.slip, ReferenceCycle("stroke", 0.3, 0.25, False))
    return SafeMuscle.of(MUSCLE, [0.235, 0.3], [5e4, 6e5], hysteresis=strokes)


LOOPED = (_looped, _after_strokes)


@eqx.filter_jit
def closed_loop(of: SafeMuscle, turns: jax.Array, P: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Work [J] of the second round of a closed path, and its length [m].

    Both branches through a place are asked at the same places, so that their integrals by the same
    rule differ as the branches do.
    """
    n = 400
    grid = jnp.linspace(0.02, 0.5, n)
    ways = jnp.concatenate([turns[:-1], turns])

    def way(state, ends: tuple[jax.Array, jax.Array]):
        a, b = ends
        at = jnp.where(b > a, grid, grid[::-1])
        at = jnp.clip(at, jnp.minimum(a, b), jnp.maximum(a, b))
        force = jax.vmap(lambda L: of.pull(state, L, P))(at)
        work = jnp.sum((force[1:] + force[:-1]) / 2 * jnp.diff(at))
        return of.moved(state, b, P), work

    state = of.start(ways[0], P)
    _, works = jax.lax.scan(way, state, (ways[:-1], ways[1:]))
    second = len(turns) - 1
    return jnp.sum(works[second:]), jnp.sum(jnp.abs(jnp.diff(turns)))


def test_without_hysteresis_the_state_is_empty(plain: SafeMuscle) -> None:
    state = plain.start(0.28, 3e5)
    assert state.wall.size == state.braid.size == 0
    assert eqx.tree_equal(plain.moved(state, 0.25, 2e5), state)
    np.testing.assert_array_equal(plain.pull(state, 0.26, 3e5), plain.force(0.26, 3e5))


@pytest.mark.slow
def test_both_branches_lie_about_the_static_map(loops: SafeMuscle) -> None:
    """A ramp of pressure at one length, as in the records that the loops were fitted to."""
    P = np.append(np.linspace(0, 6e5, 61), np.linspace(6e5, 0, 61))
    state, pulls = loops.start(0.27, 0.0), []
    for at in P:
        pulls.append(float(loops.pull(state, 0.27, at)))
        state = loops.moved(state, 0.27, at)
    there, back = np.array(pulls[:61]), np.array(pulls[61:])[::-1]
    static = np.asarray(loops.force(0.27, P[:61]))
    loaded = (there > float(loops.slack_width)) & (static > float(loops.slack_width))
    np.testing.assert_allclose((there + back)[loaded] / 2, static[loaded], rtol=1e-9, atol=1e-6)
    assert (back - there)[loaded].min() > -1e-9
    assert (back - there).max() > 5.0
