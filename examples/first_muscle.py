"""A muscle that comes with famjax, its equilibria and their derivatives; no data are needed."""

# %%
import jax
import jax.numpy as jnp
from matplotlib.figure import Figure

import famjax

jax.config.update("jax_enable_x64", True)
card = famjax.muscles.bundled_card("DMSP-20").cut(0.3)  # a Festo DMSP-20 of 300 mm
muscle = card.muscle
print(f"pull at rest length and 5 bar: {muscle.force(0.3, 5e5):.0f} N")

# %% [markdown]
# The length at which it carries a load is an equilibrium. Derivatives go through it: how far the
# load is lifted for each bar. One compiled program does a whole batch of pressures.


# %%
def hung(pressure):
    return muscle.length_at_load(200.0, pressure)  # m, with 200 N


pressures = jnp.linspace(1e5, 6e5, 26)
lengths, slopes = jax.jit(jax.vmap(jax.value_and_grad(hung)))(pressures)
print(f"with 200 N at 5 bar: {1e3 * lengths[20]:.1f} mm, lifted {-1e8 * slopes[20]:.2f} mm/bar")

# %%
figure = Figure(figsize=(9, 3.4), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(pressures / 1e5, 1e3 * lengths)
left.set(xlabel="pressure, bar", ylabel="length with 200 N, mm")
right.plot(pressures / 1e5, -1e8 * slopes)
right.set(xlabel="pressure, bar", ylabel="lift, mm/bar")
figure.savefig("first_muscle.svg", metadata={"Date": None})
