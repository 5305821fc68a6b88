"""Options that are repeated with a name and a value each: `force="Load 2"`."""

from collections.abc import Iterable

from famjax.boundary.errors import InputError


def parse_entries(given: Iterable[str], option: str, example: str) -> dict[str, str]:
    """Name and value of entries such as `operator=NAME`.

    Args:
        given: the entries.
        option: its name, for messages.
        example: of an entry, for messages.

    Raises:
        InputError: an entry that is not of this form, or a name twice.

    >>> parse_entries(["force=Load 2"], "log-columns", "force=3")
    {'force': 'Load 2'}
    """
    found: dict[str, str] = {}
    for entry in given:
        name, equals, value = (part.strip() for part in entry.partition("="))
        if not (name and equals and value) or name in found:
            raise InputError(
                f"{option} {entry!r} must read name=value, once for each name, as in {example}"
            )
        found[name] = value
    return found
