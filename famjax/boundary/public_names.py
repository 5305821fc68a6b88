"""Public names that are imported when they are first used, and where a name has moved to."""

import importlib.util
import warnings
from collections.abc import Callable, Collection, Mapping
from typing import Any

import lazy_loader


def attach_rooms(
    package: str, file: str, moved: Mapping[str, Collection[str]] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package whose names its stub lists.

    A name that the stub does not list is looked for in the package's rooms, so that a script from
    before there were rooms still runs, with a warning that says where the name lives.

    Args:
        package: `__name__` of the package.
        file: its `__file__`, beside which the stub `__init__.pyi` lies.
        moved: names that now live in a room of another package, by that room.
    """
    listed, directory, names = lazy_loader.attach_stub(package, file)
    elsewhere = {name: room for room, of_room in (moved or {}).items() for name in of_room}

    def find(name: str) -> Any:
        if name in names or name.startswith("_"):
            return listed(name)
        here = (f"{package}.{room}" for room in names if _is_room(package, room))
        for room in [elsewhere[name]] if name in elsewhere else here:
            found = importlib.import_module(room)
            if name in getattr(found, "__all__", vars(found)):
                text = f"{package}.{name} is now {room}.{name}"
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                return getattr(found, name)
        return listed(name)

    return find, directory, names


def _is_room(package: str, name: str) -> bool:
    """Whether a public name is a module, and not a class or a function."""
    return importlib.util.find_spec(f"{package}.{name}") is not None
