"""A bound method that is a pytree, and that `jax.jit` can look up by identity."""

import types
from collections.abc import Callable
from typing import Any

import equinox as eqx


class Method(eqx.Module):
    """A function with the module that it is a method of.

    As with equinox's own bound methods the module's arrays are leaves, so that a method can be
    passed to a jitted function. Equinox compares its own by value: `jax.jit` of one, which looks it
    up among those that it knows, then fails on unhashable arrays, or on traced ones. These are the
    same where function and module are the same objects.

    Attributes:
        function: of the class.
        owner: the module.
    """

    function: Callable[..., Any] = eqx.field(static=True)
    owner: eqx.Module

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """What the method returns."""
        return self.function(self.owner, *args, **kwargs)

    def __hash__(self) -> int:
        """By identity."""
        return hash((self.function, id(self.owner)))

    def __eq__(self, other: object) -> bool:
        """Whether function and module are the same objects."""
        if not isinstance(other, Method):
            return NotImplemented
        return self.function is other.function and self.owner is other.owner

    @property
    def __func__(self) -> Callable[..., Any]:
        """As of Python's own bound methods."""
        return self.function

    @property
    def __self__(self) -> eqx.Module:
        """As of Python's own bound methods."""
        return self.owner

    @property
    def __wrapped__(self) -> Callable[..., Any]:
        """Python's own bound method, whose signature and documentation are read."""
        return types.MethodType(self.function, self.owner)

    @property
    def __name__(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Of the function."""
        return self.function.__name__
