"""Define Gent's bladder law, which stiffens towards a stretch limit, and fit it to a bundled map.

python examples/own_law.py            # or, in this folder: famjax fit --law own_law:Gent
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

import famjax

jax.config.update("jax_enable_x64", True)


class Gent(famjax.materials.AbstractHyperelastic):
    """W = -mu/2 J ln(1 - (I1 - 3)/J), where mu is a linear parameter and J is bounded."""

    shear_modulus: Float[Array, ""] = famjax.parameter("Pa", kind="stress", low=0.0, linear=True)
    stretch_limit: Float[Array, ""] = famjax.parameter(low=2.0, high=30.0)

    def energy(self, axial_stretch, hoop_stretch):
        """Return the strain energy per volume, W [J/m3]."""
        excess = axial_stretch**2 + hoop_stretch**2 + (axial_stretch * hoop_stretch) ** -2 - 3
        return (
            -self.shear_modulus * self.stretch_limit / 2 * jnp.log1p(-excess / self.stretch_limit)
        )

    initial_shear_modulus = property(lambda self: self.shear_modulus)


if __name__ == "__main__":
    import fitting

    result = fitting.identify(fitting.load_bundled("DMSP-20-300"), law=Gent)
    for one in result.estimates:
        print(one.name, f"{one.value:.4g} +- {one.stderr:.2g}")
    print(f"RMSE {result.errors.rmse:.3f} N, stable: {result.certificate.stability_margin > 0}")
