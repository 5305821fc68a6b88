"""Robot: a bundled muscle, pressures for given forces, a load in MuJoCo, and C code."""

# %% [markdown]
# ## Robot: from a muscle card to MuJoCo and C
# A card is a file that describes a muscle. famjax includes two cards, and `famjax card` writes a card
# from a fit. `card.safe()` returns a muscle for use in simulators: it never pushes, and its force is
# finite at any length.

# %%
import sys

import jax
import jax.numpy as jnp
from matplotlib.figure import Figure

import famjax
from famjax.control import Outcome, pressure_for_force

jax.config.update("jax_enable_x64", True)
card = famjax.muscles.bundled_card("DMSP-20").cut(0.3)  # a Festo DMSP-20, 300 mm long at rest
muscle = card.safe()
print(card)
print("forces at 4 bar:", *(f"{muscle.force(L, 4e5):.0f} N" for L in (0.30, 0.27, 0.24, 0.10)))

# %% [markdown]
# `pressure_for_force` returns the pressure that produces a given force. If no pressure does, it returns
# the nearest pressure and a code, so one such force does not stop a batch.

# %%
found = pressure_for_force(card.muscle, jnp.array([200.0, 500.0, 5000.0]), 0.28, (0.0, 6e5))
for pressure, word in zip(found.pressure, Outcome.words(found.code), strict=True):
    print(f"{pressure / 1e3:.1f} kPa, {word}")

# %% [markdown]
# A hanging load comes to rest at the length where the muscle's force equals the weight of the load.
# This equilibrium can be differentiated, so one program computes the length, and the lift per bar, for
# all pressures.

# %%
pressures = jnp.linspace(1e5, 6e5, 26)
hung = jax.value_and_grad(lambda pressure: card.muscle.length_at_load(200.0, pressure))
lengths, slopes = jax.jit(jax.vmap(hung))(pressures)
print(f"200 N at 5 bar: {1e3 * lengths[20]:.1f} mm, lifted {-1e8 * slopes[20]:.2f} mm/bar")

# %% [markdown]
# Export the muscle. `robot.c` needs no library. The XML file for MuJoCo models a load that hangs from
# the muscle; its weight is not 200 N, but is chosen for the muscle. `install` connects the muscle to
# the actuator, whose control input is the pressure in Pa.

# %%
subject = famjax.export.Subject("robot", muscle, card)
print(*(file.name for file in famjax.export.export(subject, ["c", "mujoco"], "exported")))

# %%
import mujoco

sys.path.append("exported")
import robot_mujoco

model = mujoco.MjModel.from_xml_path("exported/robot.xml")
robot_mujoco.install(model, {"robot": robot_mujoco.PULL})
data, track = mujoco.MjData(model), []
for step in range(4000):
    data.ctrl[0] = 3e5 if step < 2000 else 5e5
    mujoco.mj_step(model, data)
    track.append(1e3 * data.ten_length[0])
print(f"{track[1999]:.1f} mm at 3 bar, {track[-1]:.1f} mm at 5 bar")

# %%
figure = Figure(figsize=(9, 3.2), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(pressures / 1e5, 1e3 * lengths)
left.set(xlabel="pressure, bar", ylabel="length with 200 N, mm")
right.plot(jnp.arange(4000) * model.opt.timestep, track)
right.set(xlabel="time, s", ylabel="length in MuJoCo, mm")
figure.savefig("robot_load.svg", metadata={"Date": None})
