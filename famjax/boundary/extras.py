"""Packages of an extra, imported on demand."""

import importlib
from types import ModuleType

from .errors import InputError


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
            f'{name} comes with the extra {extra!r}: python -m pip install "famjax[{extra}]"'
        ) from None
