"""A force map in a CSV file to a report and a prediction with its band."""

# %%
from pathlib import Path

import jax
import numpy as np

import fitting

jax.config.update("jax_enable_x64", True)  # the identification needs float64
measured = fitting.load_bundled("DMSP-20-300").to_pandas()
measured[["pressure_Pa", "length_m", "force_N"]].to_csv("map.csv", index=False)

# %% [markdown]
# The columns name their units. What the file does not say of the muscle is given beside it.

# %%
specimen = {
    "name": "my muscle", "rest_length": 0.296, "nominal_diameter": 0.02, "wall_thickness": 0.0018,
    "embedded": True,
}  # fmt: skip
data = fitting.read_csv("map.csv", specimen)
chosen = fitting.choose(data)  # as `famjax fit map.csv` does
best = chosen.chosen
print(f"chosen: {chosen.name}, RMSE {best.errors.rmse:.2f} N")
print(f"stable: {best.certificate.stability_margin > 0}")

# %%
fitting.write_fit(best, Path("fit"), choice=chosen)  # with fit/report.html, for fitting.load_fit
(row,) = fitting.predict(best, np.array([0.27]), np.array([5e5]))
print(
    f"{row['force_N']:.0f} N, 95 % of readings from {row['low_95_N']:.0f} to {row['high_95_N']:.0f}"
)
print(f"blocked force at 5 bar: {best.muscle.blocked_force(5e5):.0f} N")
fitting.plot_fit(best).savefig("fit_a_map.svg", metadata={"Date": None})
