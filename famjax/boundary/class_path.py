"""Classes of a user's own, named by where they are: `module:Class`."""

import importlib

from .errors import InputError


def class_path(cls: type) -> str:
    """`module:Class`, by which a class of a user's own is found again."""
    return f"{cls.__module__}:{cls.__qualname__}"


def class_named(path: str, base: type, what: str) -> type:
    """The class of `module:Class`, imported.

    Args:
        path: module and class.
        base: what it must be derived from.
        what: for the message, such as "law".

    Raises:
        InputError: no such module or class, or a class of something else.
    """
    module, _, name = path.partition(":")
    try:
        found = importlib.import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise InputError(
            f"the {what} {path!r} was not found ({error}): give module:Class, with the module in "
            "the folder that you start from or installed"
        ) from None
    if not (isinstance(found, type) and issubclass(found, base)):
        raise InputError(f"the {what} {path!r} must be a class derived from famjax.{base.__name__}")
    return found
