"""`equinox.error_if` as one operation, which whatever reads a trace can see for what it is."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Bool, Float

_PRIMITIVE = Primitive("refuse_if")


def refuse_if(x: Float[Array, "..."], bad: Bool[Array, "..."], message: str) -> Float[Array, "..."]:
    """The array, where nothing is bad.

    Args:
        x: what is returned.
        bad: what must not be, anywhere.
        message: what the error says.

    Raises:
        RuntimeError: something is bad; from a compiled function when it runs.
    """
    return _PRIMITIVE.bind(jnp.asarray(x), jnp.any(bad), message=message)


def _checked(x: Any, bad: Any, *, message: str) -> Any:
    return eqx.error_if(x, bad, message)


def _along(primals: Any, tangents: Any, *, message: str) -> Any:
    x, bad = primals
    return _PRIMITIVE.bind(x, bad, message=message), tangents[0]


def _batched(arguments: Any, axes: Any, *, message: str) -> Any:
    x, bad = arguments
    return _PRIMITIVE.bind(x, jnp.any(bad), message=message), axes[0]


_PRIMITIVE.def_impl(_checked)
_PRIMITIVE.def_abstract_eval(lambda x, *_, **__: x)
ad.primitive_jvps[_PRIMITIVE] = _along
batching.primitive_batchers[_PRIMITIVE] = _batched
mlir.register_lowering(_PRIMITIVE, mlir.lower_fun(_checked, multiple_results=False))
