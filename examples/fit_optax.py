"""The same fit by optax (L-BFGS), from the muscle's public parameters; bounds are kept."""

import jax
import jax.numpy as jnp
import optax

import famjax
import fitting

jax.config.update("jax_enable_x64", True)
data = fitting.load_bundled("DMSP-20-300")
F, L, P = (jnp.asarray(c[data.loaded]) for c in (data.force, data.length, data.pressure))

rest, wall = data.specimen.rest_length, data.specimen.wall_thickness
braid = famjax.Braid.from_rest(diameter=0.0225, braid_angle=1.1, length=rest)
bladder = famjax.Bladder(rest, 0.0225, wall, embedded=True)
start = famjax.Muscle(
    famjax.EstimatedGeometry(braid, bladder), famjax.PolynomialMaterial([4e6, -5e6, 5e6]), 30e3
)
apart = famjax.take_apart(
    start,
    free=["braid_diameter", "braid_angle", "deadband_pressure", "E_1", "E_2", "E_3"],
    bounds={"braid_diameter": (0.020, 0.0236), "braid_angle": (1.047, 1.222),
            "deadband_pressure": (0.0, 1e5)},
)  # fmt: skip


def residual(w):
    return apart.muscle(apart.bounded(apart.unbounded + whitened @ w)).force(L, P) - F


# Parameters of a muscle lie on ridges: directions in which the force moves alike.
whitened = jnp.eye(6)
whitened = jnp.linalg.inv(jnp.linalg.qr(jax.jacfwd(residual)(jnp.zeros(6)), mode="r"))
solver, w = optax.lbfgs(memory_size=30), jnp.zeros(6)
loss = lambda w: jnp.mean(residual(w) ** 2)  # noqa: E731


def step(_, state):
    w, memory = state
    value, slope = optax.value_and_grad_from_state(loss)(w, state=memory)
    change, memory = solver.update(slope, memory, w, value=value, grad=slope, value_fn=loss)
    return optax.apply_updates(w, change), memory


w, _ = jax.jit(lambda s: jax.lax.fori_loop(0, 600, step, s))((w, solver.init(w)))
print(f"optax: RMSE {jnp.sqrt(loss(w)):.4f} N")
