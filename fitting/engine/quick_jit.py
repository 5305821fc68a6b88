"""Compilation without the compiler's optimisation, for what runs once and briefly.

A search runs for a tenth of a second and compiles for many: LLVM's passes cost more than they save.
"""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx

_P = ParamSpec("_P")
_T = TypeVar("_T")

QUICK_COMPILATION = {"xla_backend_optimization_level": 0}
"""Options of the compiler."""


def quick_jit(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """`equinox.filter_jit` that compiles fast; the results agree to rounding."""
    options: dict[str, Any] = {"compiler_options": QUICK_COMPILATION}
    return eqx.filter_jit(function, **options)
