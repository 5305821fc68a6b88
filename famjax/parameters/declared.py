"""The declaration of a number in the class that holds it: unit, kind, range, scale."""

import dataclasses
import math
from typing import Any

import equinox as eqx

from .._types import as_number

QUANTITY = "quantity"
"""Key of the declaration in a field's metadata."""

_KINDS = {
    "": "number",
    "Pa": "pressure",
    "m": "length",
    "rad": "angle",
    "N": "force",
    "m/N": "compliance",
    "1/N": "strain compliance",
}


@dataclasses.dataclass(frozen=True)
class WithUnit:
    """What every declared number says of itself.

    Attributes:
        unit: SI unit, "" for a pure number; of an array with unlike entries, one for each.
    """

    unit: str | tuple[str, ...] = ""


@dataclasses.dataclass(frozen=True)
class Declared(WithUnit):
    """A number that can be identified.

    Attributes:
        unit: SI unit, "" for a pure number.
        name: by which it is free, bounded and reported.
        kind: of quantity: which units a user may give it in.
        low, high: sensible range in `unit`; infinite where there is no end to it.
        scale: magnitude in `unit`, for solvers; None where range or value give one.
        linear: the force is affine in it, together with all others declared so.
    """

    name: str | tuple[str, ...] = ""
    kind: str = "number"
    low: float = -math.inf
    high: float = math.inf
    scale: float | None = None
    linear: bool = False

    def __post_init__(self) -> None:
        """Refuse a range that is none."""
        if not self.low <= self.high:
            raise ValueError(
                f"the range of a parameter goes from low to high, got {self.low} and {self.high}"
            )
        if self.scale is not None and not 0 < self.scale < math.inf:
            raise ValueError(f"the scale of a parameter is finite and > 0, got {self.scale}")

    def entry(self, name: str, index: tuple[int, ...]) -> "Declared":
        """The declaration of one entry, under its name."""
        if isinstance(self.unit, str):
            return dataclasses.replace(self, name=name)
        unit = self.unit[index[0]]
        return dataclasses.replace(self, name=name, unit=unit, kind=_KINDS.get(unit, unit))


def parameter(
    unit: str | tuple[str, ...] = "",
    *,
    kind: str | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    scale: float | None = None,
    linear: bool = False,
    name: str | tuple[str, ...] | None = None,
    default: Any = dataclasses.MISSING,
) -> Any:
    """A field that holds a number which can be identified, or an array of them.

    A scalar by default. Where the field is annotated with axes, as `Float[Array, " order"]`, each
    entry is a parameter; its name is `name` formatted with the entry's place, counted from 1.

    Args:
        unit: SI unit, such as "Pa", "m", "rad", "N/m"; "" for a pure number. Of an array whose
            entries have unlike units, one for each.
        kind: of quantity. By default "pressure" for Pa, "length" for m, "angle" for rad, "force" for
            N, "compliance" for m/N, "strain compliance" for 1/N, and the unit itself for any other.
            Say `kind="stress"` for a stress or a modulus.
        low: lower end of the sensible range, in `unit`.
        high: its upper end.
        scale: magnitude, in `unit`; by default taken from the range, or from the value at hand.
        linear: the force is affine in this number and in all others declared so.
        name: if not the field's own; for arrays with places, as in "E_{}", or one for each entry.
        default: of the field; None for one that may be absent.

    Returns:
        The field, for the body of a class derived from `Parametrised`.

    >>> from famjax.terms import AbstractForceTerm
    >>> from jaxtyping import Array, Float
    >>> class Tape(AbstractForceTerm):
    ...     stiffness: Float[Array, ""] = parameter("N/m", low=0.0, linear=True)
    ...
    ...     def force(self, at, pressure):
    ...         return self.stiffness * (at.length - 0.3)
    >>> Tape(40.0).declared()["stiffness"].unit
    'N/m'
    """
    if kind is None:
        kind = _KINDS.get(unit, unit) if isinstance(unit, str) else "number"
    declared = Declared(
        unit=unit,
        name=name or "",
        kind=kind,
        low=low,
        high=high,
        scale=scale,
        linear=linear,
    )
    return _field(declared, default)


def number(unit: str = "", *, default: Any = dataclasses.MISSING) -> Any:
    """A field that holds a number, or an array of them, which is known and never identified.

    Args:
        unit: SI unit, "" for a pure number.
        default: of the field.

    Returns:
        The field, for the body of an `equinox.Module`.
    """
    return _field(WithUnit(unit), default)


def declaration(field: dataclasses.Field[Any]) -> WithUnit | None:
    """What a field says of its number; None for a field that holds something else."""
    return field.metadata.get(QUANTITY)


def _field(quantity: WithUnit, default: Any) -> Any:
    given = {} if default is dataclasses.MISSING else {"default": default}
    return eqx.field(converter=_real_or_none, metadata={QUANTITY: quantity}, **given)


def _real_or_none(value: Any) -> Any:
    return None if value is None else as_number(value)
