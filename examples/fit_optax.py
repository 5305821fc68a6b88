"""Fit the public parameters of a muscle with optax (L-BFGS), within their bounds."""

import jax
import jax.numpy as jnp
import optax

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
    ["braid_diameter", "braid_angle", "deadband_pressure", "E_1", "E_2", "E_3"],
    bounds={"braid_diameter": (0.020, 0.0236), "braid_angle": (1.047, 1.222)},
)

residual = lambda z: apart.muscle(apart.scaled_from_unbounded(z)).force(L, P) - F  # noqa: E731
solver, z = optax.lbfgs(), apart.unbounded
for _ in range(2):  # parameters form ridges: whiten them again after each descent
    whiten = jnp.linalg.pinv(jnp.linalg.qr(jax.jacfwd(residual)(z), mode="r"), rtol=1e-9)
    loss = lambda w, z=z, whiten=whiten: jnp.mean(residual(z + whiten @ w) ** 2)  # noqa: E731

    def step(_, state, loss=loss):
        value, slope = optax.value_and_grad_from_state(loss)(state[0], state=state[1])
        move, memory = solver.update(slope, *state[::-1], value=value, grad=slope, value_fn=loss)
        return state[0] + move, memory

    w, _ = jax.lax.fori_loop(0, 100, step, (jnp.zeros(6), solver.init(jnp.zeros(6))))
    z = z + whiten @ w
print(f"optax: RMSE {jnp.sqrt(jnp.mean(residual(z) ** 2)):.4f} N")
