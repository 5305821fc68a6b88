"""Compiler options: programs that run once, and briefly, are not optimised.

A search runs for a tenth of a second but would take many times longer to compile, so optimisation
costs more than it saves. Programs that run for a long time, such as a bootstrap, keep full
optimisation, which is JAX's default and does not need this module.
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
"""Names and values accepted by `jax.jit(..., compiler_options=...)`."""

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
        Names and values. Results agree with full optimisation to within rounding.
    """
    return {name: value for name, value in _QUICK.items() if _known({name: value})}


def bulk_options() -> Options:
    """Return options for programs that run hundreds of times.

    Compared with `quick_options`, compilation takes 1.5 times as long and running a fifth of the time.
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
    """Apply `equinox.filter_jit` with fast compilation; results agree to within rounding.

    Inside a caller's trace, such as their `jax.jit`, the function becomes part of the caller's program,
    which is compiled with the caller's options.
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
    """Return the tree with its numbers as arrays, so that new values do not recompile under `quick_jit`."""
    return jax.tree.map(
        lambda leaf: np.asarray(leaf, float) if isinstance(leaf, float) else leaf, tree
    )
