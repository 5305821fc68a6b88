"""What NumPy and JAX write differently, so that one piece of code serves both drivers of a fit.

Such code takes arrays with a leading axis of members. One of length one is shared by all members.
"""

import dataclasses
import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

if TYPE_CHECKING:
    AnyArray = Any  # all of one kind in a fit, which no checker can know
    Real = Any
else:
    AnyArray = Array | np.ndarray
    Real = Float[AnyArray, ""] | float

Given = TypeVar("Given")
State = TypeVar("State")


def namespace(array: Any) -> Any:
    """`jax.numpy` of JAX's arrays, `numpy` of NumPy's."""
    return array.__array_namespace__()


def fixed(tree: State) -> State:
    """The same arrays, which are not differentiated."""
    leaves = jax.tree.leaves(tree)
    return jax.lax.stop_gradient(tree) if any(isinstance(x, jax.Array) for x in leaves) else tree


def of_each(values: AnyArray, axes: int = 1) -> AnyArray:
    """One number of each member with further axes, to go with arrays that have them."""
    return values.reshape(*values.shape, *(1,) * axes)


def loop(
    going: Callable[[State], Bool[AnyArray, " members"]],
    step: Callable[[Given, State], State],
    given: Given,
    state: State,
) -> State:
    """The state after steps of each member, which are taken as long as it goes on.

    On the host those that have arrived are put aside; a batch of JAX waits for its slowest.

    Args:
        going: which members go on.
        step: of what is given and of the state.
        given: trees of arrays that stay as they are.
        state: a tree of arrays with all members.
    """
    if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(state)):
        return jax.lax.while_loop(
            lambda at: going(at).any(),
            lambda at: where(going(at), step(given, at), at),
            state,
        )
    whole = jax.tree.map(np.array, state)
    places = np.arange(len(jax.tree.leaves(state)[0]))
    while places.size:
        on = going(state)
        if not on.all():
            for leaf, value in zip(jax.tree.leaves(whole), jax.tree.leaves(state), strict=True):
                leaf[places[~on]] = value[~on]
            places, given, state = places[on], members(given, on), members(state, on)
            continue
        state = step(given, state)
    return whole


def members(tree: State, which: np.ndarray) -> State:
    """Some of the members, by a mask or by their places; what all share stays as it is."""
    return jax.tree.map(lambda leaf: leaf if len(leaf) == 1 else leaf[which], tree)


def member(tree: Any, k: int) -> Any:
    """One of the members of results on the host, of lists with an array for each too."""
    if tree is None:
        return None
    names = _fields(type(tree))
    if names:
        return type(tree)(*(member(getattr(tree, name), k) for name in names))
    if isinstance(tree, tuple):
        return tuple(member(leaf, k) for leaf in tree)
    return np.array(tree[k])


@functools.cache
def _fields(kind: type) -> tuple[str, ...]:
    """Names of the fields of a dataclass or a named tuple; none of others."""
    if dataclasses.is_dataclass(kind):
        return tuple(field.name for field in dataclasses.fields(kind))
    return getattr(kind, "_fields", ())


def where(on: Bool[AnyArray, " members"], new: State, old: State) -> State:
    """The new state of the members that are on."""
    xp = namespace(on)
    return jax.tree.map(lambda a, b: xp.where(of_each(on, b.ndim - 1), a, b), new, old)
