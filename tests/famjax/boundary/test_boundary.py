"""The boundary: units against another library, TOML files, the cache of programs, the bar of a command."""

import dataclasses
import io
import math
import os
import re
import sys
import time
import tomllib
from pathlib import Path
from typing import Literal

import jax
import pint
import pytest
from hypothesis import given, settings, strategies as st
from processes import python
from rich.console import Console

from famjax import compilation_cache, console
from famjax.boundary import toml_file, units as of_units
from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, from_entries, to_entries, toml_text
from famjax.boundary.units import UNITS, Quantity, Sentence, sentence_in_units
from famjax.compilation_cache import cache_root


@pytest.mark.parametrize(("kind", "unit"), [(k, u) for k, units in UNITS.items() for u in units])
def test_multipliers_are_those_of_pint(kind, unit):
    si = of_units.si_unit(kind)
    one, other = (re.sub(r"([a-z])3$", r"\1**3", u.replace("_per_", "/")) for u in (unit, si))
    expected = pint.get_application_registry().Quantity(1.0, one).to(other)
    assert of_units.factor(unit, kind) == pytest.approx(expected.magnitude, rel=1e-14)
    back = of_units.from_si(of_units.to_si(3.0, unit, kind), unit, kind)
    assert back == pytest.approx(3.0, rel=1e-15)


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
def test_quantities_follow_the_units_also_in_a_sentence_within(system, text):
    assert sentence_in_units(WHOLE, system) == text


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
def test_a_text_follows_units(text, system, shown):
    assert sentence_in_units(text, system) == shown
    assert sentence_in_units(sentence_in_units(text, system), system) == shown


TEXTS = st.text(st.characters(exclude_categories=["Cs"]))
VALUES = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(), TEXTS)


@dataclasses.dataclass(frozen=True)
class Inner:
    gap: toml_file.NotNegative = 0.0


@dataclasses.dataclass(frozen=True)
class Outer:
    length: toml_file.Positive
    lengths: tuple[float, ...] = ()
    ends: tuple[float, float] | None = None
    count: int = 1
    kind: Literal["air", "water"] = "air"
    name: toml_file.Text = "a"
    limit: float | None = 5.0
    inner: Inner = dataclasses.field(default_factory=Inner)


LENGTHS = ("length", "lengths", "ends", "gap", "limit")
FORM = Form(kinds=dict.fromkeys(LENGTHS, "length"), keys={"count": "count_of_all"})


@settings(deadline=None)  # the first example imports what it needs
@given(
    plain=st.dictionaries(st.sampled_from("abc"), st.one_of(VALUES, st.lists(VALUES, max_size=3))),
    table=st.dictionaries(st.sampled_from("abc"), VALUES),
)
def test_what_is_written_is_read_back_to_the_same_bits(plain, table):
    entries = {**plain, "table": table}
    assert repr(tomllib.loads(toml_text(entries))) == repr(entries)


EVERY = Outer(0.3, (0.1, 0.7), (1e-3, 2.0), 4, "water", "b", None, Inner(1 / 3))


@pytest.mark.parametrize("part", [Outer(0.1), EVERY])
def test_a_dataclass_comes_back_from_its_entries(part):
    entries = to_entries(part, FORM)
    assert from_entries(Outer, tomllib.loads(toml_text(entries)), FORM) == part
    assert "count_of_all" in entries
    assert "lengths_m" not in entries or part.lengths


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"length_ft": 1}, r"^F: unknown key 'length_ft'; valid keys: length_<m.cm.mm.um.in>, "),
        ({"length_in": 1}, "length is given twice, as length_m and length_in; keep one"),
        ({"width_m": 1, "lenght_m": 1}, "unknown key 'width_m'; unknown key 'lenght_m'; valid keys:"),
        ({"count": 1}, "unknown key 'count'; valid keys: .*count_of_all"),
        ({"count_of_all": 1.5}, "count_of_all must be a whole number, got 1.5"),
        ({"count_of_all": True}, "count_of_all must be a whole number, got True"),
        *(({"length_m": value}, f"length_m must be a number > 0 and finite, got {said}")
          for value, said in ((math.inf, "inf"), (math.nan, "nan"), (-0.5, "-0.5"), ("0.5", "'0.5'"),
                              (True, "True"), ([], r"\[\]"), ([0.5, 0.6], r"\[0.5, 0.6\]"))),
        ({"ends_m": [1, 2, 3]}, "ends_m must be two numbers in brackets"),
        ({"ends_m": 10}, "ends_m must be two numbers in brackets"),
        ({"lengths_m": ["a"]}, "lengths_m must be numbers in brackets"),
        ({"kind": "oil"}, "kind must be air or water, got 'oil'"),
        ({"name": " "}, "name must be text in quotes, got ' '"),
        ({"inner": 3}, "inner must be a table, got 3"),
        ({"inner": {"gap_m": -1}}, r"^F: \[inner\]: gap_m must be a number >= 0 and finite, got -1"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_with_its_place(change, message):
    with pytest.raises(InputError, match=message):
        from_entries(Outer, {"length_m": 1.0, **change}, FORM, where="F: ")


SWITCH_ON = "from famjax.compilation_cache import switch_on; print(repr(switch_on()))"


def in_fresh_process(code: str, **environment: str) -> str:
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "FAMJAX_"))}
    done = python("-W", "error", "-c", code, env=kept | environment)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.strip()


@pytest.mark.skipif(sys.platform in {"win32", "darwin"}, reason="the convention of Linux")
def test_the_folder_is_below_the_users_cache_unless_named(monkeypatch, tmp_path):
    monkeypatch.delenv("FAMJAX_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_root() == tmp_path / "famjax" / "programs"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_root() == tmp_path / ".cache" / "famjax" / "programs"
    monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")
    assert cache_root() is None
    monkeypatch.setenv("FAMJAX_CACHE_DIR", "~/mine")
    assert cache_root() == tmp_path / "mine"


def test_the_folder_is_of_this_machine_and_private(tmp_path, monkeypatch):
    """One of somebody else is not trusted."""
    folder = Path(in_fresh_process(SWITCH_ON, FAMJAX_CACHE_DIR=str(tmp_path)).strip("'"))
    assert folder.parent == tmp_path
    assert folder.name.endswith(f"-jaxlib-{jax.lib.__version__}")
    if sys.platform != "win32":
        folder.chmod(0o755)
        in_fresh_process(SWITCH_ON, FAMJAX_CACHE_DIR=str(tmp_path))
        assert folder.stat().st_mode & 0o777 == 0o700
    assert compilation_cache._private_folder(tmp_path / "mine")
    monkeypatch.setattr(os, "getuid", lambda: -1, raising=False)
    assert not compilation_cache._private_folder(tmp_path / "mine")


def test_a_platform_without_a_device_is_refused_in_one_sentence():
    code = """
from famjax.compilation_cache import start_jax
from famjax.boundary.errors import InputError
try:
    start_jax()
except InputError as error:
    print(error)
"""
    assert "JAX_PLATFORMS is 'nothing'" in in_fresh_process(code, JAX_PLATFORMS="nothing")


def shown(monkeypatch: pytest.MonkeyPatch, *, terminal: bool, patience: float) -> str:
    """What a work of two parts shows on standard error."""
    monkeypatch.setattr(console, "_PATIENCE", patience)
    file = io.StringIO()
    made = Console(file=file, force_terminal=terminal, width=100)
    monkeypatch.setattr(console, "Console", lambda **_: made)
    with console.progress("fitting") as show:
        show(1, 4)
        time.sleep(0.1)
        show(2, 4)
        show(1, 9, "leaving out")
    return file.getvalue()


def test_a_terminal_has_a_bar_of_each_part_and_short_work_and_logs_have_none(monkeypatch):
    text = shown(monkeypatch, terminal=True, patience=0.0)
    assert "leaving out" in text
    assert "1/9" in text
    assert "-:--:--" in text  # the time left
    assert shown(monkeypatch, terminal=True, patience=60.0) == ""
    assert shown(monkeypatch, terminal=False, patience=0.0).strip() == ""


ROOT = Path(__file__).parents[3]


def test_wheel_holds_exactly_the_four_packages():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["packages"] == ["famjax", "fitting", "imaging", "rig"]
    for name in wheel["packages"]:
        assert (ROOT / name / "py.typed").exists()
        assert (ROOT / name / "__init__.py").exists()
