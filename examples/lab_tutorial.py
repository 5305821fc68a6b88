"""Lab: from readings in a CSV file to a fit, its checks and a prediction."""

# %% [markdown]
# ## Lab: from a CSV file to a fit and its checks
# A force map is a CSV file whose column names include the units. This tutorial uses a published map
# of a Festo DMSP-20 instead of your own file.

# %%
from pathlib import Path

import jax
import numpy as np

import fitting
from fitting.evidence import Evidence

jax.config.update("jax_enable_x64", True)  # a fit needs float64
columns = ["pressure_Pa", "length_m", "force_N"]
fitting.load_bundled("DMSP-20-300").to_pandas()[columns].to_csv("map.csv", index=False)
print("".join(Path("map.csv").read_text().splitlines(keepends=True)[:3]))

# %% [markdown]
# The file does not contain the dimensions of the specimen, so state them here in SI units. Then check
# that the number of readings and the largest force match your test. This check reveals errors in units.

# %%
size = {"rest_length": 0.296, "nominal_diameter": 0.02, "wall_thickness": 0.0018}  # m
data = fitting.read_csv("map.csv", {"name": "mine", "embedded": True, **size})
print(data)

# %% [markdown]
# `choose` does the same as `famjax fit`. It fits five bladder laws, each once with a deadband and once
# with a compliant rig, and keeps the model with the smallest cross-validation error.

# %%
choice = fitting.choose(data)
fit, held_out = choice.chosen, choice.left_out
print(f"{choice.name}: in-sample RMSE {fit.errors.rmse:.2f} N")
print(f"held-out pressures: RMSE {held_out['pressure'].rmse:.2f} N")
print(f"held-out interior lengths: RMSE {held_out['length'].interior_rmse:.2f} N")

# %% [markdown]
# Check the parameters. A parameter at a bound has no standard error. The warnings list ridges, which
# are groups of parameters that the readings determine only jointly.

# %%
for one in fit.estimates:
    at_bound = ", AT A BOUND" if one.at_bound else ""
    print(f"{one.name:18} {one.value:11.5g} +- {one.stderr:.2g}{at_bound}")
print(*fit.warnings, sep="\n")
print(f"stability margin {fit.certificate.stability_margin / 1e6:.2f} MPa (stable if positive)")

# %% [markdown]
# Look for cliffs. A cliff is a place between two measured lengths where the model's force falls much
# more steeply than from one measured length to the next. No reading confirms such a drop.

# %%
levels = np.unique(data.length)
mean_slope = np.diff(fit.mounted.force(levels, 5e5)) / np.diff(levels)
lengths = np.linspace(levels[0], levels[-1], 202)[1:-1]
slope = jax.jit(jax.vmap(jax.grad(fit.mounted.force), (0, None)))(lengths, 5e5)
steeper = slope / mean_slope[np.searchsorted(levels, lengths) - 1]
print(f"at most {steeper.max():.2f} times as steep as the mean slope between neighbouring lengths")
fitting.plot_fit(fit).savefig("lab_fit.svg", metadata={"Date": None})

# %% [markdown]
# Save the fit. Then predict a force, with the interval that contains 95 % of individual readings.

# %%
fitting.write_fit(fit, Path("fit"), evidence=Evidence(error=choice.error), choice=choice)
(row,) = fitting.predict(fitting.load_fit("fit/fit.json"), np.array([0.27]), np.array([5e5]))
print(f"270 mm, 5 bar: {row['force_N']:.0f} N, {row['low_95_N']:.0f} to {row['high_95_N']:.0f} N")
