"""The one family of errors that say what is wrong with what was given, and what a user names."""

import difflib
import importlib.util
import inspect
import numbers
import operator
import sys
from collections.abc import Iterable, Sequence
from types import ModuleType
from typing import Any


class InputError(ValueError):
    """Bad input: what must hold, what was given, what to do; commands print it and exit with 2."""


def check_seed(seed: int) -> int:
    """Check a seed of random numbers.

    Raises:
        InputError: it is negative, or no whole number.
    """
    if not isinstance(seed, numbers.Integral) or seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed!r}")
    return seed


def meant(name: str, known: Iterable[str]) -> str:
    """A "did you mean" with the nearest known name, or "" if none is near.

    >>> meant("rest_lenght_mm", ["rest_length_mm", "name"])
    '; did you mean rest_length_mm?'
    >>> meant("colour", ["rest_length_mm", "name"])
    ''
    """
    by_lower = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return f"; did you mean {by_lower[near[0]]}?" if near else ""


def import_extra(name: str, extra: str, error: type[Exception] = InputError) -> ModuleType:
    """Import a package of an extra.

    Args:
        name: of the package.
        extra: with which it comes.
        error: what is raised where it is not there.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise error(
            f'{name} requires the extra {extra!r}: python -m pip install "famjax[{extra}]"'
        ) from None


# --- classes of a user's own, named by where they are: `module:Class`

_FAILURES = (
    ArithmeticError, AttributeError, ImportError, LookupError, NameError, OSError, RuntimeError,
    SyntaxError, TypeError, ValueError,
)  # fmt: skip
"""What a module of somebody else may raise while it is imported."""


Own = Sequence[str | type]
"""What a user trusts in a file: names of modules, and classes."""


def class_path(cls: Any) -> str:
    """The name `module:Class` of a user-defined class."""
    return f"{cls.__module__}:{cls.__qualname__}"


class NotTrustedError(InputError):
    """A file names a class that its reader has not been told to trust."""


def check_trusted(path: str, own: Own, what: str) -> None:
    """Raise unless the user trusts a class that a file names, because importing a module runs its code.

    Args:
        path: `module:Class`, as the file has it.
        own: modules and classes that the user has named.
        what: for the message, such as "law".

    Raises:
        InputError: neither the module nor the class is among them.
    """
    module = path.partition(":")[0]
    if not {path, module} & {one if isinstance(one, str) else class_path(one) for one in own}:
        raise NotTrustedError(
            f"the {what} is {path!r}, which is not famjax's, and a file imports nothing by itself: if you "
            f"trust that module, name it, --own {module} or own=({module!r},) in Python"
        )


def class_named(path: str, base: type, what: str) -> type:
    """Import the class of `module:Class`.

    Args:
        path: module and class.
        base: what it must be derived from.
        what: for the message, such as "law".

    Raises:
        InputError: no such module or class, or a class of something else.
    """
    module, _, name = path.partition(":")
    where = "give module:Class, with the module in the folder that you start from or installed"
    if not module or not name or module.startswith("."):
        raise InputError(f"the {what} is module:Class, got {path!r}: {where}")
    try:
        found: Any = operator.attrgetter(name)(importlib.import_module(module))
    except _FAILURES as error:
        if importlib.util.find_spec(module.partition(".")[0]) is None or module in sys.modules:
            raise InputError(f"the {what} {path!r} was not found ({error}): {where}") from None
        raise InputError(
            f"the module {module} of the {what} {path!r} could not be imported: "
            f"{type(error).__name__}: {error}. Mend it so that `python -c 'import {module}'` works"
        ) from None
    if not (isinstance(found, type) and issubclass(found, base)):
        room = ".".join(base.__module__.split(".")[:2])
        raise InputError(f"the {what} {path!r} must be a class derived from {room}.{base.__name__}")
    if inspect.isabstract(found):
        lacks = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
        raise InputError(f"the {what} {path!r} is abstract: it must have {lacks}")
    return found
