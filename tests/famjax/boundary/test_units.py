"""Multipliers of units against an independent library of units."""

import re

import pint
import pytest

from famjax.boundary.units import (
    UNITS,
    Quantity,
    Sentence,
    factor,
    from_si,
    sentence_in_units,
    si_unit,
    text_in_units,
    to_si,
)


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


INNER = Sentence("the length ", Quantity(0.25, "length"))
WHOLE = Sentence("It seems that ", INNER, " pulls ", Quantity(44.4822, "force", 3), ".")


@pytest.mark.parametrize(
    ("system", "text"),
    [
        ("metric", "It seems that the length 250 mm pulls 44.5 N."),
        ("us", "It seems that the length 9.843 in pulls 10 lbf."),
        ("si", "It seems that the length 0.25 m pulls 44.5 N."),
    ],
)  # fmt: skip
def test_quantities_follow_the_units_also_in_a_sentence_within(system: str, text: str) -> None:
    assert sentence_in_units(WHOLE, system) == text
    assert sentence_in_units(text, "us") == text  # a text has no quantities to change


@pytest.mark.parametrize(
    ("text", "system", "shown"),
    [
        ("At 137895 Pa from 0.2359 m to 0.1588 m.", "metric", "At 137.9 kPa from 235.9 mm to 158.8 mm."),
        ("At 137895 Pa from 0.2359 m to 0.1588 m.", "us", "At 20 psi from 9.287 in to 6.252 in."),
        ("199 shapes, 158.8 to 235.7 mm, 15.3 um", "us", "199 shapes, 6.252 to 9.28 in, 0.0006024 in"),
        ("199 shapes, 158.8 to 235.7 mm, 15.3 um", "metric", "199 shapes, 158.8 to 235.7 mm, 15.3 um"),
        ("9.84e-05 m of 3 lengths in 1 gaps, 1.02 s", "metric", "0.0984 mm of 3 lengths in 1 gaps, 1.02 s"),
        ("2 N/mm and 3 Nm, DMSP-20 N", "us", "2 N/mm and 3 Nm, DMSP-20 N"),
    ],
)  # fmt: skip
def test_what_is_read_back_from_a_file_follows_the_units(
    text: str, system: str, shown: str
) -> None:
    assert text_in_units(text, system) == shown
    assert text_in_units(text_in_units(text, system), system) == shown
