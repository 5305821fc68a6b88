"""Whether the sibling packages `fitting`, `imaging` and `rig` are famjax's own.

Two of these names are also taken by foreign distributions, and any script's folder can hold a
`fitting.py`. Each sibling carries `__famjax__`; what does not is refused by name.
"""

import importlib.util

SIBLINGS = ("fitting", "imaging", "rig")


def clashes() -> list[str]:
    """One sentence for each sibling package that another distribution replaces; none is imported."""
    places = {name: _foreign(name) for name in SIBLINGS}
    return [_sentence(name, where) for name, where in places.items() if where]


def _sentence(name: str, where: str) -> str:
    return (
        f"{name!r} resolved to {where}, which is not famjax's own {name!r} package. A file or "
        "folder of that name shadows it, or another distribution has overwritten it: rename "
        "the file, or uninstall the other distribution and install famjax again."
    )


def _foreign(name: str) -> str:
    """Where the name leads, if not to famjax's own package; what is foreign is not executed."""
    spec = importlib.util.find_spec(name)
    if spec is None:
        return ""
    if spec.origin is None:  # a folder without __init__.py
        return str(list(spec.submodule_search_locations or ["?"]))
    read = getattr(spec.loader, "get_source", None)
    source = read(name) if read is not None else None
    return "" if source is not None and "__famjax__" in source else spec.origin
