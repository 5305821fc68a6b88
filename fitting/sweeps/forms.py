"""The forms of the law that a sweep goes through, and those of them that were chosen."""

import dataclasses
from collections.abc import Iterable, Sequence

from famjax.boundary.errors import InputError

from ..arguments import check_names, check_whole, shown
from ..response import CONSTRAINTS as CONSTRAINTS, DEPENDENCES as DEPENDENCES

OBJECTIVES = ("sum_of_squares", "mean_rmse", "huber")

_HIGHEST_ORDER = 4  # up to it the tangent modulus is a cubic, and its constraint exact


@dataclasses.dataclass(frozen=True)
class Forms:
    """Orders, dependences and constraints: every combination of them is one fit.

    Attributes:
        orders: of the law, ascending.
        dependences: some of `DEPENDENCES`, in their order.
        constraints: some of `CONSTRAINTS`, in their order.
    """

    orders: tuple[int, ...]
    dependences: tuple[str, ...] = DEPENDENCES
    constraints: tuple[str, ...] = CONSTRAINTS

    @classmethod
    def of(
        cls, orders: Sequence[int], dependences: Sequence[str], constraints: Sequence[str]
    ) -> "Forms":
        """Those that were named, each once.

        Raises:
            InputError: a name or an order is not known, or there is none.
        """
        if isinstance(orders, str) or not isinstance(orders, Iterable) or not tuple(orders):
            raise InputError(
                f"orders must be whole numbers from 1 to {_HIGHEST_ORDER} in a list, as [1, 2], got "
                f"{shown(orders)}"
            )
        each = {check_whole("each of the orders", order, 1, _HIGHEST_ORDER) for order in orders}
        degrees = tuple(sorted(each))
        return cls(
            degrees,
            named("dependences", check_names("dependences", dependences), DEPENDENCES),
            named("constraints", check_names("constraints", constraints), CONSTRAINTS),
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """(dependences, orders, constraints)."""
        return len(self.dependences), len(self.orders), len(self.constraints)


def named(what: str, given: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """What was named, in the order in which it is known.

    Raises:
        InputError: something else was named, or nothing.
    """
    strange = [value for value in given if value not in known]
    if strange or not given:
        raise InputError(f"{what}: known are {', '.join(known)}; got {strange or 'none'}")
    return tuple(value for value in known if value in given)


def n_coefficients(dependence: str, order: int, n_pressures: int) -> int:
    """Number of coefficients of a form of the law."""
    return {"fixed": 1, "linear": min(2, n_pressures), "free": n_pressures}[dependence] * order
