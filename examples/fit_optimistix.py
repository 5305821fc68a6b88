"""Fit the public parameters of a muscle with optimistix, within their bounds."""

import jax
import jax.numpy as jnp
import optimistix as optx

import famjax
import fitting

jax.config.update("jax_enable_x64", True)
data = fitting.load_bundled("DMSP-20-300")
F, L, P = (jnp.asarray(c[data.loaded]) for c in (data.force, data.length, data.pressure))

braid = famjax.Braid.from_rest(diameter=0.0225, braid_angle=1.1, length=0.296)
shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.0225, 0.0018, embedded=True))
start = famjax.Muscle(shape, famjax.PolynomialMaterial([4e6, -5e6, 5e6]), 30e3)
apart = famjax.take_apart(
    start,
    free=["braid_diameter", "braid_angle", "deadband_pressure", "E_1", "E_2", "E_3"],
    bounds={"braid_diameter": (0.020, 0.0236), "braid_angle": (1.047, 1.222)},
)


def residual(z, _):
    return apart.muscle(apart.scaled_from_unbounded(z)).force(L, P) - F


solver = optx.LevenbergMarquardt(rtol=1e-10, atol=1e-10)
found = optx.least_squares(residual, solver, apart.unbounded, max_steps=2000, throw=False)
rmse = jnp.sqrt(jnp.mean(residual(found.value, None) ** 2))
print(f"optimistix: RMSE {rmse:.4f} N")
print({k: f"{v:.5g}" for k, v in apart.values(apart.scaled_from_unbounded(found.value)).items()})
