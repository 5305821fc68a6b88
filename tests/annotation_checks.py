"""Annotations, shapes included, checked while tests run: in the first calls of a function, or in all."""

import dataclasses
import functools
import os
from collections.abc import Callable, Sequence
from typing import Any

import jaxtyping

FIRST = 20
EVERY_CALL = os.environ.get("FAMJAX_CHECK_EVERY_CALL", "") not in {"", "0"}


def check_annotations(packages: Sequence[str]) -> None:
    """Have beartype check what is imported of the packages from now on.

    A check of every call, and of every function made anew inside another one, is a fifth to a half of the
    time of the tests. A wrong annotation shows in the first calls; `FAMJAX_CHECK_EVERY_CALL=1` checks all.
    """
    if not EVERY_CALL:
        jaxtyping.jaxtyped = functools.partial(_sparing, check=jaxtyping.jaxtyped)
    jaxtyping.install_import_hook(packages, "beartype.beartype")


def _sparing(*, typechecker: Any, check: Callable[..., Any]) -> Callable[[Any], Any]:
    """In the place of `jaxtyping.jaxtyped`, with which the import hook decorates functions and classes."""

    def decorate(it: Any) -> Any:
        if not isinstance(it, type):
            return _checked_at_first(it, functools.partial(check, typechecker=typechecker))
        # An `__init__` that is written in a class has been decorated as a function.
        if dataclasses.is_dataclass(it) and not hasattr(it.__init__, "__wrapped__"):
            it.__init__ = decorate(it.__init__)
        return it

    return decorate


_calls: dict[int, int] = {}
"""By code, which a function that is made anew in each call of another shares; its owner keeps it alive."""


def _checked_at_first(function: Any, check: Callable[[Any], Any]) -> Any:
    code = id(function.__code__)
    if _calls.setdefault(code, 0) >= FIRST:
        return function
    checked = None

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if _calls[code] >= FIRST:
            return function(*args, **kwargs)
        _calls[code] += 1
        checked = checked or check(function)
        return checked(*args, **kwargs)

    return call
