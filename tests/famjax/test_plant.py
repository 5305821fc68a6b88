"""Plants against adaptive solutions, closed forms and the firmware's controller."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from famjax import plant as plants
from famjax.boundary.errors import InputError
from famjax.plant import TICK, Command, LinearMcKibben, Plant, PneumaticCircuit, simulate
from famjax.slip import MaxwellSlip, SlipElements
from famjax.units import INCH, LBF, PSI
from rig.controller import DeviceControl, Latch
from rig.protocol import GAIN_UNIT, INTEGRAL_UNIT, PRESSURE_UNIT, RUN, ControlLaw

CLOSED = 1e-9
PRESSURE_RMS, FORCE_RMS = 0.005 * PSI, 0.02 * LBF  # of a whole test in ticks
# Signal, dump, rate [in/s], seconds: fills, strokes at 0.02 to 0.2 in/s, a vent, a dump.
TESTS = {
    "air": ((0.75, 0, 0, 1), (0.5, 0, 0, 1), (0.5, 0, -0.04, 1), (0.5, 0, 0.04, 1), (0.3, 0, 0, 1),
            (0.9, 0, -0.2, 1), (0.45, 0, 0.2, 1), (0.502, 0, -0.02, 1), (0, 1, 0, 1)),
    "water": ((0.75, 0, 0, 1), (0.6, 0, 0, 1), (0.6, 0, -0.04, 1), (0.6, 0, 0.04, 1), (0.3, 0, 0, 1),
              (0.9, 0, -0.2, 1), (0.5, 0, 0.2, 1), (0.5, 0, -0.02, 1), (0, 1, 0, 1)),
}  # fmt: skip
CIRCUITS = {"air": PneumaticCircuit, "water": plants.HydraulicCircuit}


def last(states):
    return jax.tree.map(lambda leaf: leaf[-1], states)


def rms(x) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


@pytest.mark.slow
@pytest.mark.parametrize("fluid", TESTS)
def test_a_whole_test_in_ticks_is_its_adaptive_solution(fluid):
    pytest.importorskip("diffrax")
    plant = Plant(CIRCUITS[fluid](), LinearMcKibben(), friction=plants.DahlFriction())
    solve = jax.jit(lambda state, command: plants.solve_adaptively(plant, state, command, times))
    state = precise = plant.start()
    pressures, forces = [], []
    for signal, dump, rate, seconds in TESTS[fluid]:
        times = np.arange(1, round(seconds / TICK) + 1) * TICK
        in_ticks = simulate(plant, Command(np.full(times.size, signal), dump, rate * INCH), TICK,
                            start=state)  # fmt: skip
        exact = solve(precise, Command(signal, dump, rate * INCH))
        state, precise = last(in_ticks), last(exact)
        pressures.append(in_ticks.pressure - exact.pressure)
        forces.append(in_ticks.force - exact.force)
    assert rms(pressures) < PRESSURE_RMS
    assert rms(forces) < FORCE_RMS


def air_rate(t: float, P: float, V: float, rate: float) -> float:
    """dP/dt [Pa/s] of the open valve from the supply and of its leak, written out."""
    p, supply, C, b = P + plants.ATMOSPHERE, 115 * PSI + plants.ATMOSPHERE, 3.9e-9, 0.3
    opening = 1 - np.exp(-t / 0.012)

    def share(r: float) -> float:
        return 1.0 if r <= b else np.sqrt(1 - ((r - b) / (1 - b)) ** 2)

    into = (0.004 + opening) * C * supply * share(p / supply)
    out = 0.004 * C * p * share(plants.ATMOSPHERE / p) if P > 0.06 * plants.ATMOSPHERE else 0.0
    return 1.2 * (1e5 * (into - out) - p * rate) / (V + 5e-6)


def water_rate(t: float, P: float, V: float, rate: float) -> float:
    """dP/dt [Pa/s] of the pump at full speed against its needle, written out."""
    full = 0.8e-6 * 5000 / 60
    into = full * (1 - np.exp(-t / 0.1))
    out = 0.8 * full * np.sqrt(max(P, 0.0) / (100 * PSI))
    return (into - out - rate) * 35e6 / (V + 20e-6)


@pytest.mark.parametrize(("fluid", "rate"), [("air", air_rate), ("water", water_rate)])
def test_a_fill_is_that_of_its_equations_written_out(fluid, rate):
    """By SciPy, without the plant's code: from 20 psi while the muscle shortens."""
    circuit = PneumaticCircuit() if fluid == "air" else plants.HydraulicCircuit(relief=None)
    plant, speed = Plant(circuit, LinearMcKibben()), -2e-3
    start = plant.start(pressure=20 * PSI)
    four, B, L0 = 4 * np.pi * 1.09**2, 9.89 * INCH, 9.28125 * INCH

    def slope(t: float, P: np.ndarray) -> list[float]:
        L = L0 + speed * t
        V = (B**2 * L - L**3) / four - 1.754 * INCH**3
        return [rate(t, float(P[0]), V, (B**2 - 3 * L**2) / four * speed)]

    times = np.arange(1, 101) * TICK
    how = {"method": "LSODA", "rtol": 1e-10, "atol": 1e-3, "t_eval": times}
    exact = solve_ivp(slope, (0, 0.2), [20 * PSI], **how)
    found = simulate(plant, Command(np.ones(100), 0.0, speed), TICK, start=start).pressure
    assert exact.y[0, -1] > 40 * PSI
    assert np.abs(found - exact.y[0]).max() < 0.02 * PSI


@pytest.mark.parametrize("at", [0.05, 0.7, 0.0])
def test_an_orifice_has_no_kink(at):
    below, above = (jax.grad(plants.choked_share)(at + side, 0.3) for side in (-1e-9, 1e-9))
    assert float(below) == pytest.approx(float(above), rel=1e-6, abs=1e-7)


def test_a_closed_air_volume_is_polytropic():
    plant = Plant(PneumaticCircuit(leak=0.0), LinearMcKibben())
    start = plant.start(pressure=3e5)
    states = simulate(plant, Command(np.full(1000, 128 / 255), 0.0, -0.01), TICK, start=start)
    V = np.asarray(plant.muscle.volume(states.position, 0.0)) + 5e-6
    V0 = float(plant.muscle.volume(start.position, 0.0)) + 5e-6
    exact = (3e5 + plants.ATMOSPHERE) * (V0 / V) ** 1.2 - plants.ATMOSPHERE
    np.testing.assert_allclose(states.pressure, exact, rtol=CLOSED)


def test_only_the_relief_valve_stops_a_blocked_needle():
    """The needle blocks at 50 psi; above 115 psi the pump is stopped and the dump valve opened."""

    def peak(**circuit) -> float:
        blocked = plants.HydraulicCircuit(needle=0.0, bulk_modulus=200e6, **circuit)
        plant = Plant(blocked, LinearMcKibben())
        start = plant.start(pressure=50 * PSI)
        start = dataclasses.replace(start, opening=jnp.array(0.8))
        running = simulate(plant, Command(np.full(400, 200 / 255)), 1e-3, start=start)
        over = int(np.argmax(running.pressure > 115 * PSI))
        stopped = jax.tree.map(lambda leaf: leaf[over], running)
        after = simulate(plant, Command(np.zeros(400), 1.0), 1e-3, start=stopped)
        return float(jnp.maximum(after.pressure.max(), running.pressure[over])) / PSI

    assert peak(relief=None, dump=0.0) > 500  # the pump's run-down alone
    assert peak(relief=None) > 125
    assert peak() < 120


def test_a_stepped_plant_is_the_plant():
    plant = Plant(PneumaticCircuit(), LinearMcKibben(), friction=plants.DahlFriction())
    command = Command(np.repeat([0.8, 0.0], 20), np.repeat([0.0, 1.0], 20), -1e-3)
    states = simulate(plant, command, TICK)
    stepped = plants.SteppedPlant(plant, TICK)
    for signal, dump, length in zip(command.signal, command.dump, states.position, strict=True):
        stepped.step(float(signal), float(dump), float(length))
    assert stepped.pressure == pytest.approx(float(states.pressure[-1]), rel=CLOSED)
    assert stepped.force == pytest.approx(float(states.force[-1]), rel=CLOSED)


@pytest.mark.slow
@pytest.mark.parametrize("fluid", CIRCUITS)
def test_gradients_of_two_seconds_in_every_number(fluid):
    friction = plants.DahlFriction(dry=2.0)
    plant = Plant(CIRCUITS[fluid](), LinearMcKibben(), friction=friction, viscosity=50.0)
    command = Command(np.repeat([0.72, 0.5, 0.3, 0.95], 250), np.repeat([0.0, 0.0, 0.0, 0.3], 250),
                      np.repeat([0.0, -1e-3, 2e-3, 0.0], 250))  # fmt: skip
    names, values = zip(*plant.parameters().items(), strict=True)
    x = np.array(values, float)

    @jax.jit
    def mean(scaled):
        own = plant.with_parameters(dict(zip(names, x * scaled, strict=True)))
        states = simulate(own, command, TICK)
        return jnp.mean(states.pressure[::7]) / 1e5 + jnp.mean(states.force[::5]) / 100

    slopes, one = jax.grad(mean)(np.ones(x.size)), np.ones(x.size)

    def central(h: float, step: np.ndarray) -> float:
        return float(mean(one + h * step) - mean(one - h * step)) / (2 * h)

    for k, (name, step) in enumerate(zip(names, np.eye(x.size), strict=True)):
        found = (4 * central(1e-5, step) - central(2e-5, step)) / 3
        assert float(slopes[k]) == pytest.approx(found, rel=1e-6, abs=1e-9), name


HUNG = plants.MovingLoad.hung
MOVED = {
    "hung": (lambda circuit: Plant(circuit, LinearMcKibben(), HUNG(40.0, damping=200.0)), 0.21),
    "sprung": (
        lambda circuit: Plant(
            circuit, LinearMcKibben(), HUNG(5.0, stiffness=4e3, relaxed=0.25, damping=100.0),
            viscosity=150.0,
        ), 0.22,
    ),
    "joint": (
        lambda circuit: Plant(
            (circuit, circuit), (LinearMcKibben(), LinearMcKibben()),
            plants.MovingLoad.joint(
                0.02, radii=np.array([0.02, -0.02]), lengths=np.full(2, 0.21), damping=0.5),
        ), 0.0,
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("load", MOVED)
def test_a_moving_load_is_its_adaptive_solution(load):
    pytest.importorskip("diffrax")
    make, position = MOVED[load]
    plant = make(PneumaticCircuit())
    start = plant.start(position, 2e5)
    signal = np.array([0.6, 0.45]) if load == "joint" else 0.55
    times = np.arange(1, 251) * TICK
    exact = jax.jit(lambda: plants.solve_adaptively(plant, start, Command(signal), times))()
    steps = np.broadcast_to(signal, (1000, *np.shape(signal)))
    fine = jax.tree.map(lambda x: x[3::4], simulate(plant, Command(steps), TICK / 4, start=start))
    ticks = simulate(plant, Command(steps[:250]), TICK, start=start)
    travel = float(np.ptp(exact.position))
    errors = [float(jnp.abs(found.position - exact.position).max()) for found in (ticks, fine)]
    assert errors[0] < 0.02 * travel
    assert errors[1] < errors[0] / 8  # second order
    assert rms(fine.pressure - exact.pressure) < PRESSURE_RMS


def test_slip_elements_are_a_friction():
    L0 = LinearMcKibben().rest_length
    elements = MaxwellSlip(SlipElements([0.002], [20.0]), SlipElements.none(), L0, 1e6)
    plain = Plant(PneumaticCircuit(leak=0.0), LinearMcKibben())
    rough = Plant(PneumaticCircuit(leak=0.0), LinearMcKibben(), friction=elements)
    command = Command(np.full(1000, 0.6), 0.0, np.repeat([-2e-3, 2e-3], 500))
    smooth, found = (simulate(one, command, TICK) for one in (plain, rough))
    lengths, pressures = (np.asarray(one) for one in (smooth.position, smooth.pressure))
    added = elements.along([float(L0), *lengths], [0.0, *pressures])[1:]
    np.testing.assert_allclose(found.force - smooth.force, added, atol=1e-6)


def test_the_controller_is_the_firmware_s():
    """Random readings through both: set points, gains, records of five ticks, limits of the integral."""
    law = ControlLaw(20 * PRESSURE_UNIT, 100 * GAIN_UNIT, 3 * GAIN_UNIT, 40 * GAIN_UNIT, -30, 30)
    device = DeviceControl(1, 0, 1, 1020, Latch())
    for verb, values in ((b"trip", [1020]), (b"floor", [0]), (b"ceiling", [1023]), (b"jump", [1023]),
                         (b"hbms", [10000]), (b"frozen", [255, 2000]), (b"still", [60000])):  # fmt: skip
        device.execute(verb, values)
    device.next_law, device.changed = law, True
    device.execute(b"run", [])
    controller = plants.PressureController(
        3 / 255 / PSI, 40 / 255 / PSI, [100 / 255], low=-30 / 255, high=30 / 255
    )
    rng = np.random.default_rng(1)
    counts = (102 + 60 * np.sin(np.arange(600) / 40) + rng.normal(0, 3, 600)).astype(int)
    tick = jax.jit(lambda state, P: controller.step(state, 20 * PSI, P, TICK))
    state, outputs, integrals, reached = controller.start(), [], [], []
    for count in counts.tolist():
        device.step(count, 0)
        state, signal = tick(state, count * 200 / 1024 * PSI)
        outputs.append(255 * float(signal) - device.output)
        integrals.append(255 * float(state.integral) - device._integral / INTEGRAL_UNIT)
        reached.append(device._integral / INTEGRAL_UNIT)
    assert device.state == RUN
    assert min(reached) == -30
    assert max(reached) == 30
    assert np.abs(integrals).max() < 0.02  # counts: it rounds each record's error to 1/128 psi
    assert np.abs(outputs).max() < 0.55  # and the output to counts


def test_a_regulated_plant_holds_its_set_pressure_through_a_stroke():
    plant = Plant(PneumaticCircuit(), LinearMcKibben(), friction=plants.DahlFriction())
    regulated = plants.Regulated(plant, plants.PressureController(4 / 255 / PSI, 2 / 255 / PSI))
    command = Command(np.full(6000, 40 * PSI), 0.0, np.repeat([0.0, -1e-3, 1e-3], 2000))
    pressures = simulate(regulated, command, TICK).plant.pressure / PSI
    assert float(jnp.abs(pressures[1500:] - 40).max()) < 2.0
    assert float(pressures[1999]) == pytest.approx(40.0, abs=0.4)


def test_each_muscle_of_a_regulated_joint_holds_its_own_set_pressure():
    muscle = LinearMcKibben()
    load = plants.MovingLoad.joint(0.02, radii=(0.03, -0.03), lengths=(0.22, 0.22), damping=0.5)
    joint = Plant((PneumaticCircuit(),) * 2, (muscle,) * 2, load)
    regulated = plants.Regulated(joint, plants.PressureController(4 / 255 / PSI, 2 / 255 / PSI))
    states = simulate(regulated, Command(np.tile([40 * PSI, 20 * PSI], (4000, 1))), TICK)
    np.testing.assert_allclose(states.plant.pressure[-1] / PSI, [40.0, 20.0], atol=0.5)
    assert float(states.plant.position[-1]) > 0.1


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: PneumaticCircuit(supply=-1.0), "supply must be finite and at least 0 Pa, got -1"),
        (lambda: plants.HydraulicCircuit(lag=float("nan")), "lag must be finite and at least 0.0001 s"),
        (lambda: Plant((PneumaticCircuit(),) * 2, (LinearMcKibben(),) * 2), "two muscles need a"),
        (lambda: Plant(PneumaticCircuit(), LinearMcKibben(rest_length=0.3)).start(),
         "must contain fluid at the start"),
        (lambda: simulate(Plant(PneumaticCircuit(), LinearMcKibben()), Command(0.5), TICK),
         "one value per step"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(make, match):
    with pytest.raises(InputError, match=match):
        make()
