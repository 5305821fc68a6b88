"""JAX: gradients, a batch of bladder laws, and your own law."""

# %% [markdown]
# ## JAX: gradients, batches of laws, your own law
# A muscle is an equinox module, a pytree of arrays. `jit`, `vmap` and `grad` accept it directly.

# %%
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from matplotlib.figure import Figure

import famjax

jax.config.update("jax_enable_x64", True)
braid = famjax.Braid.from_rest(diameter=0.0236, braid_angle=jnp.deg2rad(61.7), length=0.296)
shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.0236, 0.0018, embedded=True))
E = jnp.array([5.9e6, -19.0e6, 25.8e6])  # E_1, E_2, E_3 in Pa
muscle = famjax.Muscle(shape, famjax.PolynomialMaterial(E), deadband_pressure=40e3)
print(f"force at 270 mm and 5 bar: {muscle.force(0.27, 5e5):.1f} N")

# %% [markdown]
# `with_parameters` makes the force a function of all parameters of the muscle, so `grad` returns all
# sensitivities at once. Equilibria can also be differentiated, with the implicit function theorem.

# %%
numbers = muscle.parameters()
slopes = jax.grad(lambda p: muscle.with_parameters(p).force(0.27, 5e5))(numbers)
for name, slope in slopes.items():
    print(f"{name:18} {0.01 * slope * numbers[name]:7.2f} N for 1 %")
print(f"free contraction grows by {1e5 * jax.grad(muscle.free_contraction)(5e5):.4f} per bar")

# %% [markdown]
# To evaluate a batch of bladder laws, apply `vmap` to the coefficients. With `throw=False`, the result is
# nan if a muscle has no equilibrium, so one such muscle does not stop the batch.


# %%
@jax.jit
@jax.vmap
def blocked_and_free(coefficients):
    one = famjax.Muscle(shape, famjax.PolynomialMaterial(coefficients), 40e3)
    return one.blocked_force(5e5), one.free_contraction(5e5, throw=False)


stiffness = jnp.linspace(0.5, 1.5, 101)
blocked, free = blocked_and_free(stiffness[:, None] * E)
print(f"101 laws: free contraction {free[0]:.3f} to {free[-1]:.3f}")

# %% [markdown]
# To define your own law, write a class with a method that returns the strain energy. famjax computes the
# stresses by differentiation. The law can be used in any equilibrium, card or fit, for example with
# `famjax fit --law my_module:Fung`.


# %%
class Fung(famjax.materials.AbstractHyperelastic):
    """W = mu (exp(b (I1 - 3)) - 1) / (2 b): rubber that stiffens exponentially."""

    shear_modulus: Float[Array, ""] = famjax.parameter("Pa", kind="stress", low=0.0, linear=True)
    stiffening: Float[Array, ""] = famjax.parameter(low=0.01, high=5.0)

    def energy(self, axial_stretch, hoop_stretch):
        """Return the strain energy per volume, W [J/m3]."""
        excess = axial_stretch**2 + hoop_stretch**2 + (axial_stretch * hoop_stretch) ** -2 - 3
        return self.shear_modulus * jnp.expm1(self.stiffening * excess) / (2 * self.stiffening)

    initial_shear_modulus = property(lambda self: self.shear_modulus)


own = famjax.Muscle(shape, Fung(1.2e6, 0.5), 40e3)
print(f"Fung's law: {own.force(0.27, 5e5):.1f} N, free contraction {own.free_contraction(5e5):.3f}")

# %%
figure = Figure(figsize=(9, 3.2), layout="constrained")
left, right = figure.subplots(1, 2)
left.plot(stiffness, free)
left.set(xlabel="stiffness of the bladder, relative", ylabel="free contraction at 5 bar")
lengths = jnp.linspace(0.23, 0.296, 80)
for one, label in ((muscle, "polynomial"), (own, "own law")):
    right.plot(1e3 * lengths, one.force(lengths, 5e5), label=label)
right.set(xlabel="length, mm", ylabel="force at 5 bar, N")
right.legend(frameon=False)
figure.savefig("jax_laws.svg", metadata={"Date": None})
