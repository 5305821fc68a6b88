"""Functions and methods that are compiled once for each shape of their arguments."""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
from jax.core import Tracer

from ._types import as_real

_P = ParamSpec("_P")
_T = TypeVar("_T")
_Method = TypeVar("_Method", bound=Callable[..., Any])

_jit: Any = eqx.filter_jit


def compiled(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """The function compiled, arrays of its arguments traced; part of the whole where it is traced.

    Args:
        function: of the module's own level, so that it is traced once and not at every call.

    Returns:
        The same function.
    """
    return _jit(function, inline=True)


def compiled_method(method: _Method) -> _Method:
    """The method of a module, one program where it is called outside of a trace.

    Operation by operation, its first call would compile a program for each and take up to four times as
    long.
    Within a trace it is the method itself.

    Args:
        method: of arrays and numbers alone.

    Returns:
        The same method.
    """
    whole = compiled(method)

    @functools.wraps(method)
    def called(*arguments: Any, **named: Any) -> Any:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((arguments, named))):
            return method(*arguments, **named)
        owner, *values = arguments
        numbers = {name: as_real(value) for name, value in named.items()}
        return whole(owner, *map(as_real, values), **numbers)

    return called  # type: ignore[return-value] # of the method's own signature
