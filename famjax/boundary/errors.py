"""The error class for bad input, and the import of user-defined classes."""

import difflib
import importlib
import inspect
import numbers
import operator
from collections.abc import Iterable, Sequence
from types import ModuleType
from typing import Any


class InputError(ValueError):
    """Bad input; exit code 2. The message states what is required, what was found and what to do next."""


def check_seed(seed: int) -> int:
    """Check a random seed.

    Raises:
        InputError: the seed is negative or not a whole number.
    """
    if not isinstance(seed, numbers.Integral) or seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed!r}")
    return seed


def meant(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean ...?" with the closest known name, or "" if none is close.

    >>> meant("rest_lenght_mm", ["rest_length_mm", "name"])
    '; did you mean rest_length_mm?'
    >>> meant("colour", ["rest_length_mm", "name"])
    ''
    """
    by_lower = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return f"; did you mean {by_lower[near[0]]}?" if near else ""


def import_extra(name: str, extra: str, error: type[Exception] = InputError) -> ModuleType:
    """Import an optional package.

    Args:
        name: name of the package.
        extra: extra of famjax that installs the package.
        error: exception to raise if the package is missing.

    Raises:
        InputError: the package is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise error(
            f'{name} requires the extra {extra!r}: python -m pip install "famjax[{extra}]"'
        ) from None


# --- user-defined classes, named by their location `module:Class`

_FAILURES = (
    ArithmeticError, AttributeError, ImportError, LookupError, NameError, OSError, RuntimeError,
    SyntaxError, TypeError, ValueError,
)  # fmt: skip
"""Exceptions that may be raised while a user's module is imported."""


Own = Sequence[str | type]
"""Modules (by name) and classes that the user trusts, so files may refer to them."""


def class_path(cls: Any) -> str:
    """Return the name `module:Class` of a user-defined class."""
    return f"{cls.__module__}:{cls.__qualname__}"


class NotTrustedError(InputError):
    """A file refers to a class that the user has not declared as trusted."""


def check_trusted(path: str, own: Own, what: str) -> None:
    """Raise an error unless the user trusts a class named in a file, because importing it runs its code.

    Args:
        path: `module:Class`, as written in the file.
        own: modules and classes that the user trusts.
        what: name of the part in messages, such as "law".

    Raises:
        NotTrustedError: neither the module nor the class is trusted.
    """
    module = path.partition(":")[0]
    if not {path, module} & {one if isinstance(one, str) else class_path(one) for one in own}:
        raise NotTrustedError(
            f"the {what} is {path!r}, which is not part of famjax. A module named in a file is imported "
            f"only if you trust it: add --own {module}, or own=({module!r},) in Python"
        )


def class_named(path: str, base: type, what: str) -> type:
    """Import a class that is named as `module:Class`.

    Args:
        path: module and class.
        base: required base class.
        what: name of the part in messages, such as "law".

    Raises:
        InputError: the module or class does not exist, or does not derive from the base class.
    """
    module, _, name = path.partition(":")
    where = "the module must be installed or in the current folder"
    if not module or not name or module.startswith("."):
        raise InputError(f"the {what} must be module:Class, got {path!r}: {where}")
    try:
        found: Any = operator.attrgetter(name)(importlib.import_module(module))
    except _FAILURES as error:
        raise InputError(
            f"the {what} {path!r} cannot be imported ({type(error).__name__}: {error}): {where}"
        ) from None
    if not (isinstance(found, type) and issubclass(found, base)):
        of = f"{base.__module__}.{base.__name__}"
        raise InputError(f"the {what} {path!r} must be a class derived from {of}")
    if inspect.isabstract(found):
        lacks = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
        raise InputError(f"the {what} {path!r} is an abstract class: it must define {lacks}")
    return found
