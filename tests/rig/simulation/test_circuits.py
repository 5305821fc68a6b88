"""Circuits against closed forms and an adaptive solver that shares no code with them."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig import RigError
from rig.plant import iso_6358_flow
from rig.simulation import (
    HydraulicCircuit,
    Plant,
    PneumaticCircuit,
    SimulatedMuscle,
    machine_for,
    mckibben,
)

PSI = 6894.757293168361
ATMOSPHERE = 101325.0
V = 90e-6  # m3, about the 7/8 in muscle

TICK = 2e-3  # s, the step of the simulated rig
FILLING = 0.02 * PSI  # second order in a tick, during a fill of 100 psi in half a second
AFTER_FILL = 1e-3 * PSI  # at test rates


def flow(p1: float, p2: float, C: float, b: float) -> float:
    """ISO 6358-1, equations 1 and 2, with the linear end at 0.95."""
    r = p2 / p1
    if r <= b:
        return C * p1
    if r < 0.95:
        return C * p1 * math.sqrt(1 - ((r - b) / (1 - b)) ** 2)
    return C * p1 * math.sqrt(1 - ((0.95 - b) / (1 - b)) ** 2) * (1 - r) / 0.05


@pytest.mark.parametrize("ratio", [0.1, 0.29, 0.31, 0.6, 0.94, 0.96, 0.999])
def test_orifice_and_its_slopes(ratio: float) -> None:
    p1, C, b, h = 6e5, 4e-9, 0.3, 1.0
    Q, to_up, to_down = iso_6358_flow(p1, ratio * p1, C, b)
    assert pytest.approx(flow(p1, ratio * p1, C, b), rel=1e-12) == Q
    up = (flow(p1 + h, ratio * p1, C, b) - flow(p1 - h, ratio * p1, C, b)) / (2 * h)
    down = (flow(p1, ratio * p1 + h, C, b) - flow(p1, ratio * p1 - h, C, b)) / (2 * h)
    assert to_up == pytest.approx(up, rel=1e-5)
    assert to_down == pytest.approx(down, rel=1e-5, abs=1e-15)


def test_a_closed_air_volume_is_polytropic() -> None:
    circuit = PneumaticCircuit(leak=0.0).start()
    circuit.pressure = 3e5
    rate, dt, n = 2e-6, 1e-4, 20_000
    volume = V
    for _ in range(n):
        circuit.step(128, False, volume, rate, 0.0, dt)
        volume += rate * dt
    dead = circuit.circuit.dead_volume
    exact = (3e5 + ATMOSPHERE) * ((V + dead) / (volume + dead)) ** 1.2 - ATMOSPHERE
    assert circuit.pressure == pytest.approx(exact, abs=2.0)  # Pa, first order in 0.1 ms


@pytest.mark.parametrize("output", [255, 180, 60, 0])
def test_air_follows_an_adaptive_solver(output: int) -> None:
    c = PneumaticCircuit()
    start = 0.0 if output > 128 else 90 * PSI
    rate = -1.5e-6

    def slope(t: float, y: np.ndarray) -> list[float]:
        P, s = y
        p = P + ATMOSPHERE
        above = output - 128
        target = (above - 3) / 124 if above > 3 else (above + 3) / 125 if above < -3 else 0.0
        fill = c.conductance * (c.leak + max(s, 0.0))
        vent = c.conductance * (c.leak + max(-s, 0.0))
        supply = c.supply + ATMOSPHERE
        Q = flow(supply, p, fill, 0.3) if p < supply else -flow(p, supply, fill, 0.3)
        Q -= flow(p, ATMOSPHERE, vent, 0.3) if P > 0 else -flow(ATMOSPHERE, p, vent, 0.3)
        gas = V + rate * t + c.dead_volume
        return [c.exponent / gas * (1e5 * Q - p * rate), (target - s) / c.lag]

    exact = solve_ivp(slope, (0, 1), [start, 0.0], method="LSODA", rtol=1e-10, atol=1e-6,
                      t_eval=np.arange(1, 11) / 10, max_step=5e-3)  # fmt: skip
    errors = []
    for dt in (TICK, TICK / 4):
        run, volume, found = c.start(), V, []
        run.pressure = start
        for k in range(round(1 / dt)):
            run.step(output, False, volume, rate, 0.0, dt)
            volume += rate * dt
            if (k + 1) % round(0.1 / dt) == 0:
                found.append(run.pressure)
        errors.append(np.abs(np.array(found) - exact.y[0]).max())
    assert errors[0] < FILLING
    assert errors[1] < max(errors[0] / 8, 2.0)  # second order: a sixteenth, down to 2 Pa of kinks


def test_water_follows_an_adaptive_solver() -> None:
    c = HydraulicCircuit(relief=None)
    give = 2e-13

    def rate(t: float) -> float:
        return 3.5e-6 if t < 1.0 else -3.5e-6

    def slope(t: float, y: np.ndarray) -> list[float]:
        P, w = y
        inflow = c.displacement * w - c.needle * math.copysign(math.sqrt(abs(P)), P) - rate(t)
        stiff = (V + c.dead_volume) / c.bulk_modulus + give
        return [inflow / stiff, (c.full_speed * 150 / 255 - w) / c.lag]

    exact = solve_ivp(slope, (0, 2), [0.0, 0.0], method="LSODA", rtol=1e-10, atol=1e-6,
                      t_eval=[0.5, 0.9, 1.5, 1.9], max_step=0.01)  # fmt: skip
    run, found = c.start(), []
    for k in range(1000):
        # volume itself changes by 3 % of the stiffness: kept constant in both
        v = rate(k * TICK)
        run.step(150, False, V - 0.5 * v * TICK, v, give, TICK)
        if (k + 1) in (250, 450, 750, 950):
            found.append(run.pressure)
    error = np.abs(np.array(found) - exact.y[0])
    assert error[0] < FILLING  # still filling
    assert error[1:].max() < AFTER_FILL


def test_a_dumped_water_circuit_falls_to_zero_and_stays() -> None:
    """The orifice has no slope at zero: a midpoint rule alone would swing there for ever."""
    run = HydraulicCircuit().start()
    run.pressure, run.dump = 0.5 * PSI, 1.0
    course = []
    for _ in range(200):
        run.step(0, True, V, 0.0, 0.0, TICK)
        course.append(run.pressure)
    assert course[0] < 0.1 * PSI
    assert np.abs(course[3:]).max() < 1e-6  # Pa


def peak(circuit: HydraulicCircuit, volume: float) -> float:
    """Highest pressure [psi] after the needle blocks at 50 psi, under a trip at 115 psi."""
    run = circuit.start()
    run.pressure, run.speed = 50 * PSI, 0.8 * circuit.full_speed
    highest, output = 0.0, 200
    for _ in range(1000):
        run.step(output, output == 0, volume, 0.0, 0.0, 1e-3)
        output = 0 if run.pressure > 115 * PSI else output
        highest = max(highest, run.pressure / PSI)
    return highest


def test_only_the_relief_valve_stops_a_blocked_needle() -> None:
    bare = HydraulicCircuit(needle=0.0, relief=None, dump=0.0, bulk_modulus=200e6)
    assert peak(bare, V) > 500  # the pump's run-down alone; the study found 709 psi
    assert peak(HydraulicCircuit(needle=0.0, relief=None, bulk_modulus=200e6), V) > 125
    assert peak(HydraulicCircuit(needle=0.0, bulk_modulus=200e6), V) < 120


@pytest.mark.parametrize(
    ("circuit", "outputs"),
    [(PneumaticCircuit(), (200, 128, 122, 133)), (HydraulicCircuit(), (190, 150, 150, 170))],
)
def test_a_plant_in_ticks_is_the_plant_in_fine_steps(circuit, outputs: tuple[int, ...]) -> None:
    """Fill, hold, shorten, turn, dump: the same outputs in ticks and in steps twenty times finer."""

    def course(parts: int) -> np.ndarray:
        muscle, found = mckibben(), []
        machine = machine_for(muscle)
        plant = Plant(circuit.start(), muscle, machine)
        for k in range(1500):
            if k == 400:
                machine.start(1, 2e-3, stroke=1.5e-3)  # 0.08 in/s, there and back in 1.5 s
            for part in range(1, parts + 1):
                at = (k + part / parts) * TICK
                plant.step(at, TICK / parts, outputs[k // 350] if k < 1400 else 0, k >= 1400)
            found.append(plant.circuit.pressure)
        return np.array(found)

    error = np.abs(course(1) - course(20)) / PSI
    assert error[:1400].max() < 0.015
    assert error[1400:].max() < 0.25  # water falls by 4 psi in a tick


def test_muscle_table_holds_what_it_was_given() -> None:
    def force(L: float, P: float) -> float:
        return P * (3 * L**2 - 0.1) + 40 * L

    def volume(L: float, P: float) -> float:
        return 1e-4 + 1e-5 * L + 1e-12 * P

    lengths, pressures = np.linspace(0.15, 0.23, 201), np.linspace(0, 120 * PSI, 25)
    grid = lengths[:, None], pressures[None, :]
    muscle = SimulatedMuscle(
        lengths, pressures, force(*grid), volume(*grid), rest_length=0.23, friction=0.0
    )
    rng = np.random.default_rng(3)
    for L, P in zip(rng.uniform(0.15, 0.23, 200), rng.uniform(-1e4, 2e6, 200), strict=True):
        F, V_, dV_dL, dV_dP = muscle.at(float(L), float(P))
        # Both laws are linear in P; the square in L is interpolated over 0.4 mm.
        assert pytest.approx(force(L, P), abs=3 * abs(P) * (4e-4) ** 2 + 1e-9) == F
        assert pytest.approx(volume(L, P), rel=1e-9) == V_
        assert dV_dL == pytest.approx(1e-5, rel=1e-6)
        assert dV_dP == pytest.approx(1e-12, rel=1e-6)
    with pytest.raises(RigError, match="outside the muscle's table"):
        muscle.at(0.1499, 0.0)


def test_mckibben_does_virtual_work_and_meets_the_printed_muscle() -> None:
    ideal = mckibben(stiffness=0.0, deadband_pressure=0.0)
    for L in (0.16, 0.19, 0.2299):
        F, _, dV_dL, _ = ideal.at(L, 3e5)
        assert pytest.approx(-3e5 * dV_dL, rel=2e-3) == F  # dV/dL of a cell, F at a point of it
    muscle = mckibben()
    tested = {
        20: (180, 0.237),
        40: (403, 0.312),
        60: (628, 0.336),
        80: (850, 0.348),
        100: (1058, 0.354),
    }
    for psi, (blocked, free) in tested.items():
        assert muscle.force(muscle.rest_length, psi * PSI) / 4.448222 == pytest.approx(
            blocked, rel=0.05
        )
        shares = np.linspace(0, 0.37, 2000)
        F = [muscle.force(muscle.rest_length * (1 - e), psi * PSI) for e in shares]
        if psi >= 40:
            assert shares[np.argmax(np.array(F) < 0)] == pytest.approx(free, abs=0.03)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: PneumaticCircuit(supply=-1.0), "supply must be a number > 0 and finite"),
        (lambda: PneumaticCircuit(critical_ratio=1.0), "critical_ratio"),
        (lambda: HydraulicCircuit(needle=-1.0), "needle must be a number >= 0"),
        (lambda: HydraulicCircuit(lag=math.nan), "lag must be a number > 0 and finite, got nan"),
        (lambda: mckibben(rest_length=0.3), "volume must be positive"),
        (
            lambda: SimulatedMuscle(
                [0.1, 0.2], [0.0, 1e5], np.ones((2, 2)), -np.ones((2, 2)), rest_length=0.2
            ),
            "volume",
        ),
    ],
)
def test_what_cannot_be_is_refused(make, match: str) -> None:
    with pytest.raises(RigError, match=match):
        make()
