"""TOML files as dataclasses: units in keys, values checked, the same bits back."""

import dataclasses
import math
import tomllib
from typing import Any, Literal

import pytest
from hypothesis import given, settings, strategies as st

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import (
    Form,
    NotNegative,
    Positive,
    Text,
    from_entries,
    to_entries,
    toml_text,
)

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


@settings(deadline=None)  # the first example imports what it needs
@given(
    plain=st.dictionaries(st.sampled_from("abc"), st.one_of(VALUES, st.lists(VALUES, max_size=3))),
    table=st.dictionaries(st.sampled_from("abc"), VALUES),
)
def test_what_is_written_is_read_back_to_the_same_bits(plain: dict, table: dict) -> None:
    entries = {**plain, "table": table}
    assert repr(tomllib.loads(toml_text(entries))) == repr(entries)


@pytest.mark.parametrize(
    "part",
    [
        Outer(0.1),
        Outer(0.3, (0.1, 0.7), (1e-3, 2.0), 4, "water", "b", None, Inner(1 / 3)),
    ],
)  # fmt: skip
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
        *(({"length_m": value}, f"length_m must be a number > 0 and finite, got {said}")
          for value, said in ((math.inf, "inf"), (math.nan, "nan"), (-0.5, "-0.5"), ("0.5", "'0.5'"),
                              (True, "True"), ([], r"\[\]"), ([0.5, 0.6], r"\[0.5, 0.6\]"))),
        ({"ends_m": [1, 2, 3]}, "ends_m must be two numbers in brackets"),
        ({"ends_m": 10}, "ends_m must be two numbers in brackets"),
        ({"length_psi": 1}, "unknown unit 'psi'"),
        ({"lengths_m": ["a"]}, "lengths_m must be numbers in brackets"),
        ({"kind": "oil"}, "kind must be air or water, got 'oil'"),
        ({"name": " "}, "name must be a text in quotes, got ' '"),
        ({"inner": 3}, "inner must be a table, got 3"),
        ({"inner": {"gap_m": -1}}, r"^F: \[inner\]: gap_m must be a number >= 0 and finite, got -1"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_its_place(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        from_entries(Outer, {"length_m": 1.0, **change}, FORM, where="F: ")
