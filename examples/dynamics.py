"""Simulate a bundled muscle that lifts 20 kg, and differentiate the lift with respect to the valve lag.

python examples/dynamics.py           # print the lift, and write dynamics.svg
"""

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from famjax.muscles import dmsp_20
from famjax.plant import TICK, Command, MovingLoad, Plant, PlantState, PneumaticCircuit, simulate

MUSCLE, LOAD = dmsp_20(), MovingLoad.hung(20.0, damping=200.0)
COMMAND = Command(np.repeat([0.70, 0.50, 0.30, 0.50], 250))  # fraction of full output, 0.5 s each


def states(lag: float) -> PlantState:
    plant = Plant(PneumaticCircuit(supply=7e5, lag=lag), MUSCLE, LOAD)
    return simulate(plant, COMMAND, TICK, start=plant.start(0.29, 1e5))


def lift(lag: float) -> jax.Array:
    return jnp.max(0.29 - states(lag).position)


if __name__ == "__main__":
    from matplotlib.figure import Figure

    height, slope = jax.value_and_grad(lift)(0.012)
    print(f"lift {1e3 * height:.1f} mm; changes by {1e3 * slope:.0f} mm per second of valve lag")
    found, time, figure = states(0.012), TICK * np.arange(1, 1001), Figure(layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(time, found.pressure / 1e3)
    upper.set_ylabel("pressure [kPa]")
    lower.plot(time, 1e3 * found.position)
    lower.set(xlabel="time [s]", ylabel="length [mm]")
    figure.savefig("dynamics.svg")
