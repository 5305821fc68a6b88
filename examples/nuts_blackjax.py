"""Sample the posterior of a muscle's public parameters with NUTS (blackjax), within their bounds."""

import blackjax
import jax
import jax.numpy as jnp

import famjax
import fitting

jax.config.update("jax_enable_x64", True)
data = fitting.load_bundled("DMSP-20-300")
F, L, P = (jnp.asarray(c[data.loaded]) for c in (data.force, data.length, data.pressure))
braid = famjax.Braid.from_rest(diameter=0.0230, braid_angle=1.08, length=0.296)
shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.0230, 0.0018, embedded=True))
start = famjax.Muscle(shape, famjax.PolynomialMaterial([6e6, -19e6, 26e6]), 40e3)
free = ["braid_diameter", "braid_angle", "deadband_pressure", "E_1", "E_2", "E_3"]
apart = famjax.take_apart(start, free, bounds={"braid_diameter": (0.020, 0.0236)})


def log_density(z):  # flat prior within the bounds, with the Jacobian of the transform
    residual = (
        apart.muscle(apart.scaled_from_unbounded(z)).force(L, P) - F
    ) / 8.0  # N, noise of one reading
    return (
        jnp.log(jnp.abs(jnp.diagonal(jax.jacfwd(apart.scaled_from_unbounded)(z)))).sum()
        - residual @ residual / 2
    )


warmup = blackjax.window_adaptation(blackjax.nuts, log_density, is_mass_matrix_diagonal=False)
(state, tuned), _ = warmup.run(jax.random.key(0), apart.unbounded, num_steps=400)
nuts = blackjax.nuts(log_density, **tuned)
_, (z, told) = blackjax.util.run_inference_algorithm(
    jax.random.key(1), nuts, 400, initial_state=state, transform=lambda s, told: (s.position, told)
)
values = jax.vmap(lambda z: apart.values(apart.scaled_from_unbounded(z)))(z)
print(*(f"{name} {v.mean():.4g} +- {v.std():.2g}" for name, v in values.items()), sep="\n")
print(f"accepted {told.acceptance_rate.mean():.2f}, divergent {int(told.is_divergent.sum())}")
