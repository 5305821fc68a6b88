"""User-defined classes, named by their location: `module:Class`."""

import importlib
import inspect
from collections.abc import Sequence
from typing import Any

from .errors import InputError

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
        found: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name is not None and f"{module}.".startswith(f"{error.name}."):
            raise InputError(f"the {what} {path!r} was not found ({error}): {where}") from None
        raise InputError(f"the module {module} of the {what} {path!r} imports what is not there: "
                         f"{error}") from None  # fmt: skip
    except _FAILURES as error:
        raise InputError(
            f"the module {module} of the {what} {path!r} could not be imported: "
            f"{type(error).__name__}: {error}. Mend it so that `python -c 'import {module}'` works"
        ) from None
    try:
        for part in name.split("."):
            found = getattr(found, part)
    except AttributeError as error:
        if module == "__main__":
            where = (
                "it is of the script or notebook that wrote this: put the class into a module of its "
                "own, and import it there"
            )
        raise InputError(f"the {what} {path!r} was not found ({error}): {where}") from None
    if not (isinstance(found, type) and issubclass(found, base)):
        room = ".".join(base.__module__.split(".")[:2])
        raise InputError(f"the {what} {path!r} must be a class derived from {room}.{base.__name__}")
    if inspect.isabstract(found):
        lacks = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
        raise InputError(f"the {what} {path!r} is abstract: it must have {lacks}")
    return found
