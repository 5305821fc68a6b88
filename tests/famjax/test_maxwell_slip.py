import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax.slip import MaxwellSlip, SlipElements, slip

EXACT = 1e-12
STEP = 1e-6  # of central differences, relative
DIFFERENCE = 1e-6  # relative error of those in float64
REST, MODULUS = 0.3, 1e6
SLIP = MaxwellSlip(
    SlipElements([0.004, 0.02, 0.07], [3.0, 2.0, 6.0]),
    SlipElements([0.002, 0.015], [8.0, 20.0]),
    REST,
    MODULUS,
)


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
def test_force_is_what_the_play_operator_leaves_of_the_motion(seed: int) -> None:
    L, P = _history(seed)
    strain = L / REST - 1
    expected = np.zeros(L.size)
    for share, elements in ((1 + P / MODULUS, SLIP.wall), (P / MODULUS, SLIP.braid)):
        q = strain * share
        for delta, S in zip(elements.threshold, elements.strength, strict=True):
            expected += share * float(S) * (q - _play(q, float(delta))) / float(delta)
    np.testing.assert_allclose(SLIP.along(L, P), expected, rtol=1e-9, atol=1e-9)


def test_steps_of_a_simulator_are_the_scan() -> None:
    L, P = _history(1, 12)
    state, forces = SLIP.start(L[0], P[0]), []
    for length, pressure in zip(L, P, strict=True):
        state = SLIP.moved(state, length, pressure)
        forces.append(float(SLIP.force(state, pressure)))
    np.testing.assert_allclose(forces, SLIP.along(L, P), rtol=EXACT, atol=EXACT)


def test_points_on_the_way_change_nothing() -> None:
    L = np.concatenate([np.linspace(0.3, 0.26, 30), np.linspace(0.26, 0.28, 20)])
    P = np.full(L.size, 4e5)
    ends = [0, 29, 49]
    np.testing.assert_allclose(
        SLIP.along(L, P)[jnp.array(ends)], SLIP.along(L[ends], P[ends]), rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("seed", range(5))
def test_turning_points_are_remembered(seed: int) -> None:
    """A minor loop within the last two turning points leaves no trace."""
    rng = np.random.default_rng(seed)
    low, high = np.sort(rng.uniform(0.25, 0.3, 2))
    inner = rng.uniform(low, high, 6)
    for P in (np.zeros(1), np.full(1, 5e5)):
        plain = np.array([0.3, low, high])
        looped = np.concatenate([plain, inner[:3], [low], inner[3:], [high]])
        turned, after = (SLIP.states(L, np.repeat(P, L.size)) for L in (plain, looped))
        for name in ("wall", "braid"):
            # Back at the last turning point, by way of a loop that stays inside.
            np.testing.assert_allclose(
                getattr(after, name)[-1], getattr(turned, name)[-1], rtol=1e-9, atol=1e-12
            )


def test_a_branch_is_the_first_one_doubled() -> None:
    """Masing's rule: from a turning point everything happens at twice the size."""
    L, P = 0.27, np.linspace(0.0, 6e5, 61)
    first = SLIP.states(np.full(61, L), P)
    turned = SLIP.states(np.full(122, L), np.concatenate([P, P[::-1]]))
    for name in ("wall", "braid"):
        out, home = getattr(first, name), getattr(turned, name)[61:]
        np.testing.assert_allclose(home[60] - home[0], 2 * (out[0] - out[30]), rtol=1e-9)


def test_friction_of_full_sliding_is_a_constant_and_a_part_with_pressure() -> None:
    for P in (0.0, 2e5, 6e5):
        there_and_back = SLIP.along([0.3, 0.2, 0.3], [P] * 3)
        amplitude = 11.0 * (1 + P / MODULUS) + 28.0 * P / MODULUS
        np.testing.assert_allclose(there_and_back, [0.0, -amplitude, amplitude], rtol=EXACT)


def test_ramps_at_constant_length() -> None:
    P = np.array([0.0, 3e5, 6e5, 3e5])
    assert not SLIP.along(np.full(4, REST), P).any()
    short, shorter = (SLIP.along(np.full(4, L), P) for L in (0.28, 0.26))
    assert float(short[3]) > 0 > float(short[1])
    assert float(shorter[3] - shorter[1]) > float(short[3] - short[1])


def _work(L: np.ndarray, P: np.ndarray) -> np.ndarray:
    """What machine and fluid do in each step, F dL - V dP by the trapezoidal rule."""
    states = SLIP.states(L, P)
    F, V = np.asarray(SLIP.along(L, P)), np.asarray(jax.jit(jax.vmap(SLIP.volume))(states, L))
    return (F[1:] + F[:-1]) / 2 * np.diff(L) - (V[1:] + V[:-1]) / 2 * np.diff(P)


@pytest.mark.parametrize("seed", range(6))
def test_no_closed_cycle_gives_energy(seed: int) -> None:
    """Random polygons in length and pressure: work is what is stored and what becomes heat."""
    L, P = _history(seed, 7)
    fine = np.linspace(0, 7, 7 * 400 + 1)
    corners = np.arange(8)
    L, P = (np.interp(fine, corners, np.append(x, x[0])) for x in (L, P))
    once = fine.size - 1
    L, P = (np.append(x, x[1:]) for x in (L, P))
    work, heat = _work(L, P), float(SLIP.heat(L, P))
    stored = np.asarray(jax.jit(jax.vmap(SLIP.energy))(SLIP.states(L, P)))
    assert heat >= 0
    assert (stored >= 0).all()
    assert work.sum() == pytest.approx(heat + stored[-1], rel=1e-3)
    lost = work[once:].sum()  # of the second round, whose springs end as they begin
    assert stored[-1] == pytest.approx(stored[once], rel=1e-6)
    assert lost >= 0
    assert lost == pytest.approx(heat - float(SLIP.heat(L[: once + 1], P[: once + 1])), rel=2e-3)


def test_arrays_stay_what_they_are() -> None:
    assert isinstance(slip(np.zeros(2), np.ones(2), 0.5), np.ndarray)
    assert isinstance(slip(jnp.zeros(2), 1.0, 0.5), jax.Array)
