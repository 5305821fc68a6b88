import jax
import numpy as np
import pytest

from famjax.slip import MaxwellSlip, SlipElements

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
