"""TOML files as dataclasses: units in keys, values checked, the same bits back."""

import dataclasses
import math
import tomllib
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import (
    Form,
    NotNegative,
    Positive,
    Text,
    check_fields,
    from_entries,
    read_toml,
    to_entries,
    toml_text,
)
from famjax.boundary.units import UNITS

VALUES = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    st.floats(),
    st.text(st.characters(exclude_categories=["Cs"])),
)


@dataclasses.dataclass(frozen=True)
class Inner:
    gap: NotNegative = 0.0


@dataclasses.dataclass(frozen=True)
class Outer:
    length: Positive
    lengths: tuple[float, ...] = ()
    ends: tuple[float, float] | None = None
    count: int = 1
    kind: Literal["air", "water"] = "air"
    name: Text = "a"
    limit: float | None = 5.0
    inner: Inner = dataclasses.field(default_factory=Inner)


FORM = Form(
    kinds=dict.fromkeys(("length", "lengths", "ends", "gap", "limit"), "length"),
    keys={"count": "count_of_all"},
)


@dataclasses.dataclass(frozen=True)
class Checked:
    width: Positive
    widths: tuple[NotNegative, ...] = ()
    count: int | None = None

    def __post_init__(self) -> None:
        check_fields(self)


def test_a_dataclass_made_in_a_program_is_checked_by_its_annotations() -> None:
    Checked(np.float64(0.1), tuple(np.linspace(0, 1, 3)), 3)
    for fields, message in (
        ((0.0,), "width must be a number > 0 and finite, got 0.0"),
        ((1.0, (1.0, math.nan)), "widths must be numbers in brackets"),
        ((1.0, (), 2.5), "count must be a whole number, got 2.5"),
    ):
        with pytest.raises(InputError, match=message):
            Checked(*fields)


@settings(deadline=None)  # the first example imports what it needs
@given(
    plain=st.dictionaries(st.sampled_from("abc"), st.one_of(VALUES, st.lists(VALUES, max_size=3))),
    table=st.dictionaries(st.sampled_from("abc"), VALUES),
)
def test_what_is_written_is_read_back_to_the_same_bits(plain: dict, table: dict) -> None:
    entries = {**plain, "table": table}
    assert repr(tomllib.loads(toml_text(entries))) == repr(entries)


@pytest.mark.parametrize("unit", UNITS["length"])
def test_every_unit_of_the_kind_is_read(unit: str) -> None:
    entries = {f"length_{unit}": 2, f"lengths_{unit}": 3, f"ends_{unit}": [1, 2]}
    factor = UNITS["length"][unit]
    found = from_entries(Outer, entries, FORM)
    assert found == Outer(2 * factor, (3 * factor,), (factor, 2 * factor))


@pytest.mark.parametrize(
    "part",
    [
        Outer(0.1),
        Outer(0.3, (0.1, 0.7), (1e-3, 2.0), 4, "water", "b", None, Inner(1 / 3)),
    ],
)
def test_a_dataclass_comes_back_from_its_entries(part: Outer) -> None:
    entries = to_entries(part, FORM)
    assert from_entries(Outer, tomllib.loads(toml_text(entries)), FORM) == part
    assert "count_of_all" in entries
    assert "lengths_m" not in entries or part.lengths


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length_ft": 1}, r"^F: length_ft has the unknown unit 'ft': .* write one of length_m, "),
        ({"length": 1}, "length has no unit"),
        ({"length_in": 1}, "length is given twice, as length_m and length_in; keep one"),
        ({"width_m": 1, "lenght_m": 1}, "unknown key 'width_m'; unknown key 'lenght_m'; known are"),
        ({"count": 1}, "unknown key 'count'; known are .*count_of_all"),
        ({"count_of_all": 1.5}, "count_of_all must be a whole number, got 1.5"),
        ({"count_of_all": True}, "count_of_all must be a whole number, got True"),
        ({"length_m": math.inf}, "length_m must be a number > 0 and finite, got inf"),
        ({"length_m": math.nan}, "length_m must be a number > 0 and finite, got nan"),
        ({"ends_m": [1, 2, 3]}, "ends_m must be two numbers in brackets"),
        ({"lengths_m": ["a"]}, "lengths_m must be numbers in brackets"),
        ({"kind": "oil"}, "kind must be air or water, got 'oil'"),
        ({"name": " "}, "name must be a text in quotes, got ' '"),
        ({"inner": 3}, "inner must be a table, got 3"),
        (
            {"inner": {"gap_m": -1}},
            r"^F: \[inner\]: gap_m must be a number >= 0 and finite, got -1",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        from_entries(Outer, {"length_m": 1.0, **change}, FORM, where="F: ")


def test_what_is_missing_is_named_with_its_units() -> None:
    with pytest.raises(InputError, match=r"length_<unit> is missing: a number > 0 .* length_mm"):
        from_entries(Outer, {}, FORM)


def test_a_file_that_cannot_be_read_is_named(tmp_path) -> None:
    with pytest.raises(InputError, match=r"none\.toml: cannot read the plan: No such file"):
        read_toml(tmp_path / "none.toml", "plan")
    path = tmp_path / "a.toml"
    path.write_text("\ufeffa = 1\n", encoding="utf-8")
    assert read_toml(path, "plan") == {"a": 1}
    path.write_text("a = \n", encoding="utf-8")
    with pytest.raises(InputError, match="cannot read the plan: it is not a TOML file: "):
        read_toml(path, "plan")
