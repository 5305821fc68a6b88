"""Comparison of stored settings with current ones, and short texts for long lists."""

import re
from collections.abc import Sequence
from typing import Any

_CHECKSUM = re.compile(r"\b([0-9a-f]{8})[0-9a-f]{56}\b")
"""Of SHA-256."""


def differing(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Differences between two JSON settings, each as "name was a, now b".

    Of a checksum, which nobody compares by eye, the beginning is shown.

    >>> differing({"seed": 0, "data": ["4f" * 32]}, {"seed": 1, "data": ["a0" * 32]})
    ['seed was 0, now 1', "data was ['checksum 4f4f4f4f'], now ['checksum a0a0a0a0']"]
    """
    before, now = _flat(old), _flat(new)
    return [
        f"{name} was {_shown(before, name)}, now {_shown(now, name)}"
        for name in [*now, *(name for name in before if name not in now)]
        if before.get(name) != now.get(name)
    ]


def _shown(settings: dict[str, Any], name: str) -> str:
    return _CHECKSUM.sub(r"checksum \1", str(settings.get(name, "not given")))


def _flat(settings: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(settings, dict):
        return {name: settings}
    flat: dict[str, Any] = {}
    for key, value in settings.items():
        flat |= _flat(value, f"{name}.{key}" if name else key)
    return flat


def some_of(texts: Sequence[str], between: str = ", ") -> str:
    """The first five of several texts, and the number of the others."""
    shown = [text if len(text) < 200 else text[:200] + " ..." for text in texts[:5]]
    more = f"{between}and {len(texts) - 5} more" if len(texts) > 5 else ""
    return between.join(shown) + more
