"""Dynamics: steps of 2 ms against adaptive solutions, derivatives, and what a plant costs.

`steps`: fills, holds, strokes at 0.02 to 0.2 in/s, a vent and a dump, by steps and by diffrax at 1e-9.
`tuned`: tuned gains on plants not tuned for, 20 to 100 psi, 3.4 in at 0.04 in/s.
`identified`: plants found again from records with the noise of sensors, each from several records.
`costs`: 2 s of plant and controller, their gradient in every number, and 256 plants at once, over one.
"""

import time
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from row import CannotRunError, Case, tell

from famjax.app.dynamics import feed_forward
from famjax.control.tuning import Duty, drawn_circuits, expect, tune
from famjax.plant import (
    TICK,
    Command,
    DahlFriction,
    HydraulicCircuit,
    LinearMcKibben,
    Plant,
    PneumaticCircuit,
    PressureController,
    Regulated,
    simulate,
    solve_adaptively,
)
from famjax.units import INCH, LBF, PSI
from fitting.plant import FREE, PlantRecord, identify_plant

jax.config.update("jax_enable_x64", True)
CIRCUITS = {"air": PneumaticCircuit, "water": HydraulicCircuit}
# Signal, dump and rate [in/s] of each second.
TESTS = {
    "air": ((0.75, 0, 0), (0.5, 0, 0), (0.5, 0, -0.04), (0.5, 0, 0.04), (0.3, 0, 0), (0.9, 0, -0.2),
            (0.45, 0, 0.2), (0.502, 0, -0.02), (0, 1, 0)),
    "water": ((0.75, 0, 0), (0.6, 0, 0), (0.6, 0, -0.04), (0.6, 0, 0.04), (0.3, 0, 0), (0.9, 0, -0.2),
              (0.5, 0, 0.2), (0.5, 0, -0.02), (0, 1, 0)),
}  # fmt: skip


def _plant(fluid: str) -> Plant:
    return Plant(CIRCUITS[fluid](), LinearMcKibben(), friction=DahlFriction())


def steps(_: Case) -> dict[str, float]:
    """Root mean square of the difference over a whole test."""
    found, times = {}, np.arange(1, 501) * TICK
    for fluid, test in TESTS.items():
        plant = _plant(fluid)
        solve = eqx.filter_jit(solve_adaptively)
        state = precise = plant.start()
        apart = []
        for signal, dump, rate in test:
            command = Command(signal, float(dump), rate * INCH)
            many = Command(np.full(times.size, signal), float(dump), rate * INCH)
            stepped = simulate(plant, many, TICK, start=state)
            try:
                exact = solve(plant, precise, command, times)
            except ValueError as error:
                raise CannotRunError(str(error)) from None
            apart.append([stepped.pressure - exact.pressure, stepped.force - exact.force])
            state, precise = (jax.tree.map(lambda x: x[-1], one) for one in (stepped, exact))
        P, F = np.sqrt(np.mean(np.square(apart), axis=(0, 2)))
        found |= {f"{fluid}, pressure [psi]": P / PSI, f"{fluid}, force [lbf]": F / LBF}
    return {name: float(value) for name, value in found.items()}


def _seconds(run: Callable[[], Any], repeat: int) -> float:
    jax.block_until_ready(run())
    took = []
    for _ in range(repeat):
        begun = time.process_time()
        jax.block_until_ready(run())
        took.append(time.process_time() - begun)
    return min(took)


SEED = 0


def tuned(_: Case) -> dict[str, float]:
    """What tuned gains do with plants that were drawn after those of the tuning."""
    pressures = tuple(PSI * np.arange(20.0, 101.0, 20.0))
    duty, found, forces = Duty(pressures, 3.4 * INCH, 0.04 * INCH, 10.0, 115 * PSI), {}, []
    for fluid, circuit in CIRCUITS.items():
        drawn = drawn_circuits(circuit(), 16, SEED)
        plants = [Plant(c, LinearMcKibben(), friction=DahlFriction()) for c in drawn]
        forwards = np.array([feed_forward(c) for c in drawn])
        gained = tune(plants[:8], forwards[:8], duty, seed=SEED)
        others = plants[8:], forwards[8:]
        after = expect(*others, gained, duty, SEED + 1)
        forces.append(after.force)
        found |= {
            f"{fluid}, pressure RMS [psi]": after.rms.mean() / PSI,
            f"{fluid}, overshoot of 20 psi [%]": 100 * after.overshoot.max() / (20 * PSI),
            f"{fluid}, highest pressure [psi]": after.highest.max() / PSI,
        }
    found["force between fluids [lbf]"] = float(np.abs(forces[0] - forces[1]).max() / LBF)
    return {name: float(value) for name, value in found.items()}


RECORDS, NOISE = 5, (0.05 * PSI, 0.5)  # of each plant; Pa and N of a reading
_STEP, _HELD = 0.01, 0.4  # s between readings, and between commands


def recorded(plant: Plant, random: np.random.Generator, seconds: float = 12.0) -> PlantRecord:
    """A record of random commands while the length moves, with noise; the first is held to begin."""
    time, ticks = np.arange(0, seconds, _STEP), round(_STEP / TICK)
    held = random.uniform(0.1, 0.95, int(seconds / _HELD) + 1)
    signal = held[(time / _HELD).astype(int)]
    share = 0.05 * (1 - np.cos(2 * np.pi * time / 5)) + 0.03 * np.sin(2 * np.pi * time / 1.7) ** 2
    length = float(plant.muscle.rest_length) * (1 - share)
    rate = np.repeat(np.diff(length) / _STEP, ticks)
    states = simulate(plant, Command(np.repeat(signal[:-1], ticks), 0.0, rate), TICK,
                      start=plant.start(length[0]))  # fmt: skip
    read = (
        np.append(0.0, one[ticks - 1 :: ticks]) + std * random.standard_normal(time.size)
        for one, std in zip((states.pressure, states.force), NOISE, strict=True)
    )
    pressure, force = read
    return PlantRecord(time, signal, pressure, length, force).part(30, time.size)


def identified(_: Case) -> dict[str, float]:
    """Errors of the parameters, and how many of their 95 % intervals hold the truth.

    What a fit does not look for is known, as from a data sheet.
    """
    random, errors, inside = np.random.default_rng(SEED), [], []
    for circuit in CIRCUITS.values():
        nominal = circuit()
        for one in drawn_circuits(nominal, 6, SEED + 7)[1:]:
            friction = DahlFriction(share=random.uniform(0.01, 0.04))
            truth = Plant(
                one, LinearMcKibben(), friction=friction, viscosity=random.uniform(100, 400)
            )
            known = {
                **one.parameters(),
                "friction.share": friction.share,
                "viscosity": truth.viscosity,
            }
            start = {name: nominal.parameters()[name] for name in FREE[circuit]}
            assumed = Plant(one.with_parameters(start), LinearMcKibben(), friction=DahlFriction())
            for _record in range(RECORDS):
                fit = identify_plant(recorded(truth, random), assumed)
                off = [
                    (e.value / float(known[e.name]) - 1, e) for e in fit.estimates if e.stderr > 0
                ]
                errors += [d for d, _ in off]
                inside += [abs(d * float(known[e.name])) <= 1.96 * e.stderr for d, e in off]
                tell(f"{circuit.__name__}: {np.mean(inside):.3f} of {len(inside)} inside, worst "
                     f"{100 * np.abs(errors).max():.2g} %")  # fmt: skip
    return {
        "intervals": float(len(inside)),
        "part of the 95 % intervals with the truth": float(np.mean(inside)),
        "root mean square error [%]": 100 * float(np.sqrt(np.mean(np.square(errors)))),
    }


def costs(case: Case) -> dict[str, float]:
    """Processor time over that of one simulation of 2 s."""
    regulated = Regulated(_plant("air"), PressureController(4 / 255 / PSI, 2 / 255 / PSI))
    command = Command(np.full(1000, 40 * PSI), 0.0, np.repeat([-1e-3, 1e-3], 500))

    def end(plant: Regulated) -> jax.Array:
        return simulate(plant, command, TICK).plant.pressure[-1]

    def of_lag(lag: jax.Array) -> jax.Array:
        return end(eqx.tree_at(lambda one: one.plant.circuit.lag, regulated, lag))

    lags = jnp.linspace(0.01, 0.02, 256)
    one, slopes = eqx.filter_jit(end), eqx.filter_jit(eqx.filter_grad(end))
    many = jax.jit(jax.vmap(of_lag))
    least = _seconds(lambda: one(regulated), case.repeat)
    return {
        "gradient over simulation": _seconds(lambda: slopes(regulated), case.repeat) / least,
        "256 plants over one": _seconds(lambda: many(lags), case.repeat) / least,
    }
