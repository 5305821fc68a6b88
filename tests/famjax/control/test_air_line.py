"""Times to fill and to vent against closed forms and against an integration in small steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.integrate import solve_ivp

import famjax
from famjax.control import AirLine, HeldLength, HeldLoad, Outcome, fluid_volume
from rig.plant import SLOW_FLOW, iso_6358_flow

CLOSED = 1e-12  # quadrature of a constant: rounding
STEPPED = 1e-7  # what solve_ivp leaves at rtol 1e-10, relative
TANK, ATMOSPHERE, REFERENCE = 4e-4, 101325.0, 1e5
LINE = AirLine(2e-9, 6e5, critical_ratio=0.35, exponent=1.2, dead_volume=5e-6, temperature=300.0)
SPEED = 2e-9 * REFERENCE * np.sqrt(300.0 / 293.15)


def tank(pressure: jax.Array) -> jax.Array:
    return TANK + 0 * pressure


def _stepped(line: AirLine, volume, start: float, *, filling: bool, until: float):
    """Pressure over time by small steps, from the flow and the gas in it, in NumPy."""
    C, b, n = (float(one) for one in (line.conductance, line.critical_ratio, line.exponent))
    supply, T = float(line.supply), float(line.temperature)

    def psi(r: float) -> float:
        return 1.0 if r <= b else float(np.sqrt(max(0.0, 1 - ((r - b) / (1 - b)) ** 2)))

    def rate(_: float, state: np.ndarray) -> list[float]:
        p, V, dV = state[0] + ATMOSPHERE, *volume(float(state[0]))
        up, down = (supply + ATMOSPHERE, p) if filling else (p, ATMOSPHERE)
        amount = REFERENCE * C * up * np.sqrt(T / 293.15) * psi(down / up)
        return [(amount if filling else -amount) / ((V + float(line.dead_volume)) / n + p * dV)]

    return solve_ivp(
        rate, (0, until), [start], rtol=1e-10, atol=1e-6, dense_output=True, max_step=until / 200
    ).sol


def test_sonic_filling_and_venting_in_closed_form() -> None:
    up, V = 6e5 + ATMOSPHERE, (TANK + 5e-6) / 1.2
    filled = LINE.fill(tank, 0.0, 1e5)
    assert float(filled.time) == pytest.approx(V * 1e5 / (SPEED * up), rel=CLOSED)
    vented = LINE.vent(tank, 5.5e5, 3e5)
    ratio = (5.5e5 + ATMOSPHERE) / (3e5 + ATMOSPHERE)
    assert float(vented.time) == pytest.approx(V * np.log(ratio) / SPEED, rel=CLOSED)


def test_the_supply_is_reached_in_the_time_of_the_quarter_circle() -> None:
    up, V, b = 6e5 + ATMOSPHERE, (TANK + 5e-6) / 1.2, 0.35
    sonic = V * (b * up - ATMOSPHERE) / (SPEED * up)
    whole = LINE.fill(tank, 0.0, 6e5)
    assert float(whole.time) == pytest.approx(sonic + V * (1 - b) * np.pi / 2 / SPEED, rel=CLOSED)


@pytest.mark.slow
@pytest.mark.parametrize("filling", [True, False], ids=["fill", "vent"])
@pytest.mark.parametrize("held", ["length", "load"])
def test_a_muscle_against_small_steps(festo: famjax.Muscle, held: str, filling: bool) -> None:
    volume = HeldLength(festo, 0.27) if held == "length" else HeldLoad(festo, 200.0)
    start, end = (1.6e5, 5.8e5) if filling else (5.8e5, 1.6e5)
    passage = (LINE.fill if filling else LINE.vent)(volume, start, end)
    assert int(passage.code) == Outcome.FEASIBLE
    until = 1.05 * float(passage.time)
    grid = jnp.linspace(1.5e5, 6.0e5, 400)
    table = np.asarray(volume(grid))  # smooth: a spline of it is good to STEPPED
    from scipy.interpolate import make_interp_spline

    V = make_interp_spline(np.asarray(grid), table, k=5)
    steps = _stepped(LINE, lambda P: (V(P), V.derivative()(P)), start, filling=filling, until=until)
    assert float(steps(float(passage.time))[0]) == pytest.approx(end, rel=STEPPED)


@pytest.mark.slow
def test_a_muscle_that_swells_takes_longer_than_one_that_is_held(festo: famjax.Muscle) -> None:
    moving, start = HeldLoad(festo, 200.0), 1.6e5
    length = festo.length_at_load(200.0, start)
    held = HeldLength(festo, length)
    assert float(LINE.fill(moving, start, 5e5).time) > 1.2 * float(LINE.fill(held, start, 5e5).time)
    assert float(moving(start)) == pytest.approx(
        float(fluid_volume(festo, length, start)), rel=1e-9
    )


def test_codes() -> None:
    start, end = np.array([0.0, 2e5, 0.0, np.nan]), np.array([3e5, 1e5, 7e5, 1e5])
    filled = LINE.fill(tank, start, end)
    expected = [Outcome.FEASIBLE, Outcome.BEYOND_LINE, Outcome.BEYOND_LINE, Outcome.NO_STATE]
    assert filled.code.tolist() == expected
    assert np.isfinite(filled.time).tolist() == [True, False, False, False]
    vented = LINE.vent(tank, np.array([3e5, 1e5, 1e5]), np.array([0.0, 2e5, -1.0]))
    assert vented.code.tolist() == [0, Outcome.BEYOND_LINE, Outcome.BEYOND_LINE]


def carrying(pressure: jax.Array) -> jax.Array:
    """Of a muscle that does not carry its load below 2 bar."""
    return jnp.where(pressure > 2e5, TANK, jnp.nan)


def test_without_an_equilibrium_the_other_times_are_known() -> None:
    falling = LINE.vent(carrying, 5e5, np.array([5e5, 3e5, 1e5]))
    assert falling.code.tolist() == [0, 0, Outcome.NO_STATE]

    def total(conductance: jax.Array) -> jax.Array:
        line = AirLine(conductance, 6e5, critical_ratio=0.35)
        return jnp.nansum(line.vent(carrying, 5e5, jnp.array([4e5, 1e5])).time)

    assert np.isfinite(jax.grad(total)(2e-9))


@pytest.mark.slow
def test_derivatives() -> None:
    def time(x: jax.Array) -> jax.Array:
        line = AirLine(x[0] * 1e-9, x[1] * 6e5, x[2], x[3])
        return line.fill(lambda P: TANK * (1 + P / 1e6), 1e5, x[4] * 1e5).time

    check_grads(
        jax.jit(time), (jnp.array([2.0, 1.0, 0.35, 1.2, 5.0]),), order=1, atol=1e-5, rtol=1e-5
    )


def test_flow_of_the_simulated_rig_and_no_flow_backwards() -> None:
    plain = AirLine(3e-9, 6e5, critical_ratio=0.3)
    for ratio in (0.1, 0.3, 0.6, 0.94):
        up, down = 5e5, ratio * 5e5
        flow = float(plain.flow(up - ATMOSPHERE, down - ATMOSPHERE))
        assert ratio < SLOW_FLOW
        assert flow == pytest.approx(iso_6358_flow(up, down, 3e-9, 0.3)[0], rel=CLOSED)
    assert float(plain.flow(1e5, 2e5)) == 0.0
    assert np.isfinite(jax.grad(lambda P: plain.flow(P, 2e5))(1e5))


def test_float32_keeps_four_digits() -> None:
    line = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), LINE)
    found = line.fill(tank, jnp.float32(0), jnp.float32(5e5)).time
    assert found.dtype == jnp.float32
    assert float(found) == pytest.approx(float(LINE.fill(tank, 0.0, 5e5).time), rel=1e-5)


def test_a_model_without_a_geometry_says_so() -> None:
    class Rod:
        def force(self, length: float, pressure: float) -> jax.Array:
            return jnp.zeros(())

    with pytest.raises(ValueError, match="needs a muscle with a geometry, got Rod"):
        fluid_volume(Rod(), 0.2, 1e5)
