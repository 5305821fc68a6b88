"""Compiler options by purpose: programs that run once and briefly are not optimised.

A search runs for a tenth of a second and would compile for many: the compiler's passes cost more
than they save. What runs for long, such as a bootstrap, keeps full optimisation, which is JAX's
default and needs nothing of this.
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
"""Names and values, as `jax.jit(..., compiler_options=...)` takes them."""

_QUICK: Options = {
    "xla_backend_optimization_level": 0,
    # An MLIR pipeline for each fusion takes most of the time; JAX 0.12 no longer has the option.
    "xla_cpu_use_fusion_emitters": False,
    # One LLVM module for a program: a small one split over threads costs more than it saves.
    "xla_cpu_parallel_codegen_split_count": 1,
}


@functools.cache
def quick_options() -> Options:
    """Compiler options for the fastest compilation.

    Those that the installed XLA does not know are left out: each is tried once in a process, on a
    program that returns its argument (0.03 s for all).

    Returns:
        Names and values. Results agree with those of full optimisation to rounding.
    """
    return {name: value for name, value in _QUICK.items() if _known({name: value})}


def bulk_options() -> Options:
    """Options for programs that run hundreds of times: compile 1.5 times as long, run in a fifth."""
    return {
        name: value
        for name, value in quick_options().items()
        if name != "xla_backend_optimization_level"
    }


def _known(options: Options) -> bool:
    """Whether the installed XLA compiles with these options."""
    try:
        jax.jit(lambda x: x, compiler_options=options).lower(0.0).compile()
    except jax.errors.JaxRuntimeError as error:
        if "No such compile option" in str(error):
            return False
        raise
    return True


def quick_jit(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """`equinox.filter_jit` that compiles fast; the results agree to rounding.

    Within a trace of the caller's, such as their `jax.jit`, it is a part of the whole, which is
    compiled as they ask.
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
    """The same tree with its numbers as arrays, so that new values do not recompile under `quick_jit`."""
    return jax.tree.map(
        lambda leaf: np.asarray(leaf, float) if isinstance(leaf, float) else leaf, tree
    )
