"""One instance is one muscle: a batch of muscles is refused, with the way to ask many at once."""

import dataclasses
import functools
import typing
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from ..parameters.declared import declaration


def check_one_muscle(*parts: eqx.Module) -> None:
    """Refuse declared numbers with more axes than their declaration has.

    Args:
        parts: a muscle, or parts of one.

    Raises:
        ValueError: a number of a part, or of a part of it, is an array where one is meant.
    """
    for part in parts:
        _check(part, type(part).__name__)


def _check(part: eqx.Module, where: str) -> None:
    axes = _axes(type(part))
    for field in dataclasses.fields(part):
        value = getattr(part, field.name, None)
        at = f"{where}.{field.name}"
        if field.name in axes and value is not None:
            if jnp.ndim(value) != axes[field.name]:
                wanted = "one number" if not axes[field.name] else f"{axes[field.name]} axes"
                raise ValueError(
                    f"one muscle is meant: {at} must have {wanted}, got the shape "
                    f"{jnp.shape(value)}. Make and ask many muscles under jax.vmap or "
                    "equinox.filter_vmap, over a function that makes one"
                )
        elif isinstance(value, eqx.Module):
            _check(value, at)
        elif isinstance(value, tuple | list):
            for i, one in enumerate(value):
                if isinstance(one, eqx.Module):
                    _check(one, f"{at}[{i}]")


@functools.cache
def _axes(cls: type[eqx.Module]) -> dict[str, int]:
    """Number of axes of every declared number of a class: its annotation's, by default none.

    What is annotated with names that cannot be resolved is not known, and not checked.
    """
    declared = [field for field in dataclasses.fields(cls) if declaration(field) is not None]
    if any(isinstance(field.type, str) for field in declared):
        try:
            hints: dict[str, Any] = typing.get_type_hints(cls)
        except NameError:
            return {}
    else:
        hints = {field.name: field.type for field in declared}
    return {field.name: _axes_of(hints[field.name]) for field in declared}


def _axes_of(annotation: Any) -> int:
    for one in (annotation, *typing.get_args(annotation)):
        if hasattr(one, "dims"):
            return 0 if one.index_variadic is not None else len(one.dims)
    return 0
