"""Compiler options for programs that run only briefly and are therefore not optimised.

A search runs for a tenth of a second, and compiling it with full optimisation would take many times
longer. Optimisation would therefore cost more time than it saves. Programs that run for a long time,
such as a bootstrap, are fully optimised, which is JAX's default and does not require this module.
"""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from ._arrays import in_trace, promoting

_P = ParamSpec("_P")
_T = TypeVar("_T")

Options = dict[str, bool | int]
"""Compiler options by name, as accepted by `jax.jit(..., compiler_options=...)`."""

_QUICK: Options = {
    "xla_backend_optimization_level": 0,
    # An MLIR pipeline for each fusion takes most of the time; JAX 0.12 no longer has the option.
    "xla_cpu_use_fusion_emitters": False,
    # One LLVM module for a program: a small one split over threads costs more than it saves.
    "xla_cpu_parallel_codegen_split_count": 1,
}


@functools.cache
def quick_options() -> Options:
    """Return the compiler options for the fastest compilation.

    Options that the installed XLA does not support are omitted. Each option is tried once per process,
    on a program that returns its argument (0.03 s for all options).

    Returns:
        Options by name. Results agree with those of full optimisation to within rounding.
    """
    return {name: value for name, value in _QUICK.items() if _known({name: value})}


def bulk_options() -> Options:
    """Return the compiler options for programs that run hundreds of times.

    Compared with `quick_options`, compilation takes 1.5 times as long, but a run takes a fifth of the
    time.
    """
    return {
        name: value
        for name, value in quick_options().items()
        if name != "xla_backend_optimization_level"
    }


def _known(options: Options) -> bool:
    """Return True if the installed XLA accepts these options."""
    try:
        jax.jit(lambda x: x, compiler_options=options).lower(0.0).compile()
    except jax.errors.JaxRuntimeError as error:
        if "No such compile option" in str(error):
            return False
        raise
    return True


def quick_jit(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Apply `equinox.filter_jit` with options for fast compilation; results differ only by rounding.

    If the function is called inside a trace, such as a caller's `jax.jit`, it becomes part of the
    caller's program, which is compiled with the caller's options.
    """
    plain: Any = eqx.filter_jit
    traced = plain(function, inline=True)

    @functools.cache
    def jitted() -> Callable[_P, _T]:
        options: dict[str, Any] = {"compiler_options": quick_options()}
        return eqx.filter_jit(function, **options)

    @promoting
    @functools.wraps(function)
    def quick(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        tracing = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((args, kwargs)))
        return (traced if tracing or in_trace() else jitted())(*args, **kwargs)

    return quick


def as_arrays(tree: _T) -> _T:
    """Convert the floats in a tree to arrays, so that `quick_jit` does not recompile for new values."""
    return jax.tree.map(
        lambda leaf: np.asarray(leaf, float) if isinstance(leaf, float) else leaf, tree
    )
