"""Public names that are imported when they are first used, and where a name has moved to."""

import importlib
import warnings
from collections.abc import Callable
from typing import Any

import lazy_loader


def attach_rooms(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package whose names its stub lists.

    A name that the stub does not list is looked for in the package's rooms, so that a script from
    before there were rooms still runs, with a warning that says where the name lives.

    Args:
        package: `__name__` of the package.
        file: its `__file__`, beside which the stub `__init__.pyi` lies.
    """
    listed, directory, names = lazy_loader.attach_stub(package, file)

    def find(name: str) -> Any:
        if name in names or name.startswith("_"):
            return listed(name)
        for room in names:
            if room.islower() and name in getattr(_room(package, room), "__all__", ()):
                warnings.warn(
                    f"{package}.{name} is now {package}.{room}.{name}",
                    DeprecationWarning,
                    stacklevel=2,
                )
                return getattr(_room(package, room), name)
        return listed(name)

    return find, directory, names


def _room(package: str, name: str) -> Any:
    """A room of the package, or None where the name is that of a function."""
    try:
        return importlib.import_module(f"{package}.{name}")
    except ModuleNotFoundError:
        return None
