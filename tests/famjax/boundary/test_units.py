"""Multipliers of units against an independent library of units."""

import re

import pint
import pytest

from famjax.boundary.units import UNITS, factor, from_si, si_unit, to_si
from fitting import InputError


@pytest.mark.parametrize(("kind", "unit"), [(k, u) for k, units in UNITS.items() for u in units])
def test_multipliers_are_those_of_pint(kind: str, unit: str) -> None:
    si = si_unit(kind)
    registry = pint.get_application_registry()
    unit_there, si_there = (
        re.sub(r"([a-z])3$", r"\1**3", u.replace("_per_", "/")) for u in (unit, si)
    )
    expected = registry.Quantity(1.0, unit_there).to(si_there).magnitude
    assert factor(unit, kind) == pytest.approx(expected, rel=1e-14)
    assert from_si(to_si(3.0, unit, kind), unit, kind) == pytest.approx(3.0, rel=1e-15)


def test_an_unknown_unit_is_refused_with_those_known() -> None:
    with pytest.raises(InputError, match=r"'mmHg' is not a known unit of pressure.*kPa"):
        factor("mmHg", "pressure")
