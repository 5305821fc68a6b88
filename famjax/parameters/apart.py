"""A muscle taken apart: its free parameters as one vector of order one, and the rest."""

from collections.abc import Iterable, Mapping
from typing import Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from .._types import Real, RealArray, as_real
from .declared import Declared
from .parametrised import Parametrised

_Model = TypeVar("_Model", bound=Parametrised)


class Apart(eqx.Module, Generic[_Model]):
    """The free parameters of a model, scaled and bounded, and the model that they are parts of.

    A parameter with two finite bounds is scaled to 0 at the lower and 1 at the upper one; another
    is divided by its scale.

    Attributes:
        whole: the model, whose other parameters stay.
        names: of the free parameters.
        scaled: their present values, scaled, shape (free,).
        low, high: their bounds, scaled, shape (free,); infinite where there is none.
        offset, scale: value = offset + scale * scaled, in the declared units, shape (free,).
    """

    whole: _Model
    names: tuple[str, ...] = eqx.field(static=True)
    scaled: Float[Array, " free"]
    low: Float[Array, " free"]
    high: Float[Array, " free"]
    offset: Float[Array, " free"]
    scale: Float[Array, " free"]

    def values(self, scaled: Real) -> dict[str, RealArray]:
        """The parameters by name, in their declared units."""
        values = self.offset + self.scale * as_real(scaled)
        return {name: values[i] for i, name in enumerate(self.names)}

    def muscle(self, scaled: Real) -> _Model:
        """The model with these scaled parameters, put together again; jit, grad and vmap safe.

        It is for the caller to keep `scaled` between `low` and `high`, or to work in R^n with
        `unbounded` and `bounded`.
        """
        return self.whole.with_parameters(self.values(scaled))

    def bounded(self, z: Real) -> Float[Array, " free"]:
        """From R^n to the box, smooth and one to one: scaled parameters strictly within bounds.

        A logistic curve between two bounds, softplus above or below one, and z itself where there
        is none.
        """
        z = as_real(z)
        both, below, above = self._finite
        low, high = jnp.where(below, self.low, 0.0), jnp.where(above, self.high, 0.0)
        return jnp.select(
            [both, below, above],
            [
                low + (high - low) * jax.nn.sigmoid(z),
                low + jax.nn.softplus(z),
                high - jax.nn.softplus(-z),
            ],
            z,
        )

    @property
    def unbounded(self) -> Float[Array, " free"]:
        """The z of the present values: the inverse of `bounded`.

        Raises:
            ValueError: a present value is not strictly within its bounds.
        """
        inside = (self.scaled > self.low) & (self.scaled < self.high)
        if not isinstance(inside, Tracer) and not np.all(inside):
            outside = [
                n for n, good in zip(self.names, np.asarray(inside), strict=True) if not good
            ]
            raise ValueError(
                f"{', '.join(outside)}: no point of R^n stands for a value at or beyond its bounds. "
                "Start strictly within them, or give other bounds"
            )
        both, below, above = self._finite
        width = jnp.where(both, self.high - self.low, 1.0)
        share = jnp.where(both, (self.scaled - self.low) / width, 0.5)
        up = jnp.where(below & ~both, self.scaled - self.low, 1.0)
        down = jnp.where(above & ~both, self.high - self.scaled, 1.0)
        return jnp.select(
            [both, below, above],
            [jnp.log(share) - jnp.log1p(-share), _inverse_softplus(up), -_inverse_softplus(down)],
            self.scaled,
        )

    @property
    def _finite(
        self,
    ) -> tuple[Bool[Array, " free"], Bool[Array, " free"], Bool[Array, " free"]]:
        """Which parameters have both bounds, a lower one, an upper one."""
        below, above = jnp.isfinite(self.low), jnp.isfinite(self.high)
        return below & above, below, above


def take_apart(
    model: _Model,
    free: Iterable[str] | None = None,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Apart[_Model]:
    """A model as a flat vector of free parameters of order one, with bounds, and the rest.

    Args:
        model: a muscle, or any other module with declared parameters.
        free: names of the parameters that may change; by default all that are declared.
        bounds: (low, high) in the declared units by name, in place of the declared ranges.

    Returns:
        `Apart`: `.scaled`, `.low`, `.high`, `.names`, and `.muscle(scaled)`, the way back.

    Raises:
        ValueError: an unknown name, one that is given twice, bounds of a parameter that is not
            free, or a lower bound that is not below the upper one.

    >>> from famjax.materials import NeoHookeanMaterial
    >>> apart = take_apart(NeoHookeanMaterial(2e5), bounds={"shear_modulus": (0.0, 1e6)})
    >>> print(apart.names, apart.scaled, apart.muscle(apart.scaled * 2).shear_modulus)
    ('shear_modulus',) [0.2] 400000.0
    """
    known, values = model.declared(), model.parameters()
    names = tuple(known if free is None else free)
    given = {} if bounds is None else dict(bounds)
    for name in (*names, *given):
        if name not in known:
            raise ValueError(
                f"{type(model).__name__} has no parameter {name!r}; it has {', '.join(known)}"
            )
    if len(set(names)) < len(names):
        raise ValueError(f"each free parameter is named once, got {', '.join(names)}")
    for name, (low, high) in given.items():
        if name not in names:
            raise ValueError(f"bounds are for free parameters; {name!r} is not one of them")
        if not low < high:
            raise ValueError(
                f"the lower bound of {name!r} must be below the upper one, got {low} and {high}. "
                "To hold a parameter leave it out of `free`"
            )
    at = jnp.stack([values[name] for name in names]) if names else jnp.zeros(0)
    ends = [given.get(name, (known[name].low, known[name].high)) for name in names]
    low, high = (jnp.asarray(end, at.dtype) for end in np.array(ends, float).reshape(-1, 2).T)
    ranged = jnp.isfinite(low) & jnp.isfinite(high)
    offset = jnp.where(ranged, low, 0.0)
    magnitude = jnp.stack([_scale(known[n], values[n]) for n in names]) if names else at
    scale = jnp.where(ranged, high - low, magnitude)
    return Apart(
        whole=model,
        names=names,
        scaled=(at - offset) / scale,
        low=(low - offset) / scale,
        high=(high - offset) / scale,
        offset=offset,
        scale=scale,
    )


def _scale(declared: Declared, value: RealArray) -> RealArray:
    """The declared scale, or the size of the value at hand, or 1 where it is zero."""
    if declared.scale is not None:
        return jnp.asarray(declared.scale, value.dtype)
    size = jax.lax.stop_gradient(jnp.abs(value))
    return jnp.where(size > 0, size, 1.0)


def _inverse_softplus(x: RealArray) -> RealArray:
    """Z with log(1 + exp(z)) = x > 0."""
    return x + jnp.log(-jnp.expm1(-x))
