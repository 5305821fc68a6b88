"""Options that are whole numbers of a range, refused before anything is read or computed."""

from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter, Token, validators


def whole(type_: Any, tokens: Sequence[Token]) -> Any:
    """The number of a token, or the numbers of several where a tuple is wanted; never rounded.

    Raises:
        ValueError: one is no whole number.
    """
    found = [_whole(token) for token in tokens]
    return tuple(found) if getattr(type_, "__origin__", None) is tuple else found[0]


def _whole(token: Token) -> int:
    try:
        return int(token.value)
    except ValueError:
        name = token.keyword or "the value"
        raise ValueError(f"{name} must be a whole number, got {token.value!r}") from None


def _check_replicates(_: Any, value: int) -> None:
    if value < 0 or value == 1:
        raise ValueError(f"It must be 0, for no replicates, or 2 and more; got {value}")


def _between(low: int, high: int | None = None) -> Parameter:
    return Parameter(converter=whole, validator=validators.Number(gte=low, lte=high))


Seed = Annotated[int, _between(0)]
"""Of random numbers."""

Starts = Annotated[int, _between(1)]
"""Number of starts of a search."""

Jobs = Annotated[int | None, _between(1)]
"""Number of processes."""

Replicates = Annotated[int, Parameter(converter=whole, validator=_check_replicates)]
"""Number of replicates of a bootstrap, 0 for none."""

Order = Annotated[int | None, Parameter(converter=whole)]
"""Of a polynomial law, which knows how high it may be."""

SweptOrders = Annotated[
    tuple[int, ...],
    Parameter(converter=whole, validator=validators.Number(gte=1, lte=4)),
]
"""Orders of the polynomial law that a sweep has."""
