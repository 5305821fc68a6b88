"""Settings of a work on the disk against those of now, and long lists in short words."""

from collections.abc import Sequence
from typing import Any


def differing(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """What differs between settings of JSON, each as "name was a, now b"."""
    before, now = _flat(old), _flat(new)
    return [
        f"{name} was {before.get(name, 'not given')}, now {now.get(name, 'not given')}"
        for name in [*now, *(name for name in before if name not in now)]
        if before.get(name) != now.get(name)
    ]


def _flat(settings: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(settings, dict):
        return {name: settings}
    flat: dict[str, Any] = {}
    for key, value in settings.items():
        flat |= _flat(value, f"{name}.{key}" if name else key)
    return flat


def some_of(texts: Sequence[str], between: str = ", ") -> str:
    """The first five of some texts, and how many more there are."""
    shown = [text if len(text) < 200 else text[:200] + " ..." for text in texts[:5]]
    more = f"{between}and {len(texts) - 5} more" if len(texts) > 5 else ""
    return between.join(shown) + more
