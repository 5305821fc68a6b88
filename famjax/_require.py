"""The handshake between famjax and its sibling packages `fitting`, `imaging` and `rig`.

Two of these names are also taken by foreign distributions, and any script's folder can hold a
`fitting.py`. Each sibling carries `__famjax__`; what does not is refused by name.
"""

import importlib
from types import ModuleType

SIBLINGS = ("fitting", "imaging", "rig")


def require(name: str) -> ModuleType:
    """Famjax's own sibling package of that name, imported.

    Args:
        name: "fitting", "imaging" or "rig".

    Returns:
        The module.

    Raises:
        ValueError: no such sibling.
        ImportError: the name resolves to a foreign module, or to nothing.
    """
    if name not in SIBLINGS:
        raise ValueError(f"famjax has the sibling packages {', '.join(SIBLINGS)}; got {name!r}")
    module = importlib.import_module(name)
    if not hasattr(module, "__famjax__"):
        where = getattr(module, "__file__", None) or list(getattr(module, "__path__", ["?"]))
        raise ImportError(
            f"{name!r} resolved to {where}, which is not famjax's own {name!r} package. A file or "
            "folder of that name shadows it, or another distribution has overwritten it: rename "
            "the file, or uninstall the other distribution and install famjax again."
        )
    return module
