"""What must not be negative along an actuation path, per coefficient of a law."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

import famjax


class AbstractPathFunctions(eqx.Module):
    """phi_n(s) along paths: a constraint asks sum_n E_n phi_n(s) >= 0 for all s in [0, 1]."""

    @abc.abstractmethod
    def __call__(self, path: Int[Array, " k"], s: Float[Array, " k"]) -> Float[Array, "k order"]:
        """phi_n at positions s, each on the path of that index."""

    @property
    @abc.abstractmethod
    def cubic(self) -> Bool[Array, ""]:
        """Whether they are polynomials up to the third degree, which a `PathTable` is exactly."""


class SlopeFunctions(AbstractPathFunctions):
    """d(sigma)/d(eps) per E_n, n eps^(n - 1), over strains from zero to the largest of each path.

    Attributes:
        largest_strain: [-], shape (paths,).
        order: of the law.
    """

    largest_strain: Float[Array, " paths"]
    order: int = eqx.field(static=True)

    def __call__(self, path: Int[Array, " k"], s: Float[Array, " k"]) -> Float[Array, "k order"]:
        """The slope n eps^(n - 1) at the share s of the largest strain."""
        strain = s * self.largest_strain[path]
        factors = [jnp.ones_like(strain)]
        for _ in range(self.order - 1):
            factors.append(factors[-1] * strain)
        return jnp.arange(1, self.order + 1) * jnp.stack(factors, axis=-1)

    @property
    def cubic(self) -> Bool[Array, ""]:
        """Up to the fourth order of the law."""
        return jnp.asarray(self.order <= 4)


class DruckerFunctions(AbstractPathFunctions):
    """The path modulus per E_n, over lengths from rest to the end of each path.

    Attributes:
        geometry: of the muscle.
        pressure: of the paths [Pa], shape (paths,).
        end: length of each path's end [m], shape (paths,).
        order: of the law.
    """

    geometry: famjax.geometries.AbstractGeometry
    pressure: Float[Array, " paths"]
    end: Float[Array, " paths"]
    order: int = eqx.field(static=True)

    def __call__(self, path: Int[Array, " k"], s: Float[Array, " k"]) -> Float[Array, "k order"]:
        """The path modulus [-] of each power of the strain at the share s of the stroke."""
        rest = self.geometry.rest_length
        length = rest + s * (self.end[path] - rest)
        strains = famjax.materials.path_strains(self.geometry, length, self.pressure[path])

        def of_law(coefficients: Float[Array, " order"]) -> Float[Array, " k"]:
            return strains.modulus(famjax.PolynomialMaterial(coefficients))

        return jax.vmap(of_law, out_axes=-1)(jnp.eye(self.order))

    @property
    def cubic(self) -> Bool[Array, ""]:
        """Never."""
        return jnp.asarray(False)


class ScaledFunctions(AbstractPathFunctions):
    """Functions per scaled coefficient, which are then of the size of the largest modulus.

    Attributes:
        functions: per coefficient.
        unit: of each coefficient, shape (order,).
    """

    functions: AbstractPathFunctions
    unit: Float[Array, " order"]

    def __call__(self, path: Int[Array, " k"], s: Float[Array, " k"]) -> Float[Array, "k order"]:
        """phi_n times the unit of E_n."""
        return self.functions(path, s) * self.unit

    @property
    def cubic(self) -> Bool[Array, ""]:
        """As the functions."""
        return self.functions.cubic
