"""A function of modules and arrays done once, in NumPy: nothing is lowered or compiled for it."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from famjax.compile_options import quick_jit

from . import tape_store
from .tape import UnknownPrimitiveError, record


def in_numpy(function: Callable[..., Any], *arguments: Any) -> list[np.ndarray]:
    """What a function returns, by its tape; one with an operation that has no rule is compiled.

    Args:
        function: of a module's own level, by whose name its tape is kept; it returns an array or
            several.
        arguments: modules, arrays and words.

    Returns:
        The arrays.
    """
    leaves, treedef = jax.tree.flatten(arguments)
    arrays = [np.asarray(leaf) for leaf in leaves if eqx.is_array_like(leaf)]
    key = tape_store.identity(function, arguments)
    tape = tape_store.load(key)
    if tape is None:

        def of_arrays(*values: Any) -> Any:
            given = iter(values)
            filled = [next(given) if eqx.is_array_like(leaf) else leaf for leaf in leaves]
            return jax.tree.leaves(function(*jax.tree.unflatten(treedef, filled)))

        try:
            tape = record(of_arrays, *arrays)
        except UnknownPrimitiveError:
            return [np.asarray(one) for one in jax.tree.leaves(quick_jit(function)(*arguments))]
        tape_store.save(key, tape)
    return [found[..., 0] for found in tape.run(*(array[..., None] for array in arrays))]
