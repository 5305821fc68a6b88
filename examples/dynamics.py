"""A valve fills a muscle, which lifts 40 kg and lets it down: simulated, and what the valve's lag does.

python examples/dynamics.py           # prints, and writes dynamics.svg
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from famjax.plant import (
    TICK,
    Command,
    LinearMcKibben,
    MovingLoad,
    Plant,
    PneumaticCircuit,
    simulate,
)

plant = Plant(PneumaticCircuit(), LinearMcKibben(), MovingLoad.hung(40.0, damping=200.0))
command = Command(np.repeat([0.70, 0.50, 0.30, 0.50], 250))  # of the full output, 0.5 s each
start = plant.start(0.22, 2e5)


@eqx.filter_jit
@eqx.filter_value_and_grad
def lift(circuit: PneumaticCircuit) -> jax.Array:
    own = eqx.tree_at(lambda one: one.circuit, plant, circuit)
    return jnp.max(0.22 - simulate(own, command, TICK, start=start).position)


if __name__ == "__main__":
    from matplotlib.figure import Figure

    height, slope = lift(plant.circuit)
    print(f"lift {1e3 * height:.1f} mm; {slope.lag:.3f} mm for each ms of the valve's lag")
    states, time = simulate(plant, command, TICK, start=start), TICK * np.arange(1, 1001)
    figure = Figure(layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(time, states.pressure / 1e3)
    upper.set_ylabel("pressure [kPa]")
    lower.plot(time, 1e3 * states.position)
    lower.set(xlabel="time [s]", ylabel="length [mm]")
    figure.savefig("dynamics.svg")
