"""Functions that are compiled once for each shape of their arguments."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx

_P = ParamSpec("_P")
_T = TypeVar("_T")

_jit: Any = eqx.filter_jit


def compiled(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """The function compiled, arrays of its arguments traced; part of the whole where it is traced.

    Args:
        function: of the module's own level, so that it is traced once and not at every call.

    Returns:
        The same function.
    """
    return _jit(function, inline=True)
