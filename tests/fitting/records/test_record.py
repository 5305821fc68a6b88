"""Columns and branches of records that are known, with noise, holds and faults."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from fitting.records import read_history, read_ramp
from fitting.records.record import checked_columns, noise_of, split_branches

RAMP = {"force": "1 [N]", "pressure": "2 [kPa]", "time": "3 [s]", "valve_state": "4"}
PLAIN = {key: RAMP[key] for key in ("force", "pressure", "time")}


def _triangle(cycles: int, rows: int, hold: int = 0) -> np.ndarray:
    """Position of a test between 0 and 1: ramps of `rows` steps, holds of `hold` more readings."""
    ramp = np.linspace(0, 1, rows + 1)
    up = np.concatenate([ramp, np.ones(hold)])
    cycle = np.concatenate([up, ramp[-2::-1], np.zeros(hold)])
    return np.concatenate([cycle, np.tile(cycle[1:], cycles - 1)])


@pytest.mark.parametrize("hold", [0, 30])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-3])
def test_branches_of_a_known_record(noise: float, hold: int) -> None:
    rows, cycles = 200, 5
    clean = _triangle(cycles, rows, hold)
    x = clean + noise * np.random.default_rng(1).standard_normal(clean.size)
    branches = split_branches(x)
    assert [branch.rising for branch in branches] == [True, False] * cycles
    # Turning points lie in the holds; where noise hides the turn, within its width (2 %) of it.
    slack = int(np.ceil(min(6 * noise, 0.02) * rows)) + (0 if noise == 0 else 8)
    for number, branch in enumerate(branches):
        start = number * (rows + hold)
        assert abs(branch.start - start) <= slack
        assert abs(branch.stop - (start + rows + 1)) <= slack
    if noise == 0:
        assert all(np.ptp(x[branch.rows]) == 1 for branch in branches)


def test_scale_offset_and_direction_do_not_matter() -> None:
    x = _triangle(3, 50, 5)
    rows = [(b.start, b.stop) for b in split_branches(x)]
    assert [(b.start, b.stop) for b in split_branches(2.5 - 40 * x)] == rows
    assert [b.rising for b in split_branches(-x)] == [False, True] * 3


def test_small_wiggles_and_parts_count_from_min_travel_on() -> None:
    t = np.linspace(0, 3, 1501)
    x = 1 - np.cos(2 * np.pi * t) + 0.3 * np.sin(40 * np.pi * t)  # wiggles of 0.6 in a range of 2.4
    assert len(split_branches(x)) == 6
    assert len(split_branches(x, min_travel=0.02)) > 60
    part = np.concatenate([np.linspace(0, 1, 51), np.linspace(0.98, 0.4, 30)])
    assert [len(split_branches(part, min_travel=least)) for least in (0.5, 0.7)] == [2, 1]
    assert split_branches(np.ones(10)) == ()


def test_branches_meet_at_the_turns() -> None:
    branches = split_branches(_triangle(3, 20)[10:])  # starts half-way up
    assert len(branches) == 6
    assert all(b.start == a.stop - 1 for a, b in itertools.pairwise(branches))


def test_noise_is_found_on_a_ramp() -> None:
    values = np.linspace(0, 500, 20001) + 0.9 * np.random.default_rng(0).standard_normal(20001)
    assert noise_of(values) == pytest.approx(0.9, rel=0.03)  # three standard errors of the median


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        ({"a": [1, 2, 3], "b": [1, 2]}, r"b of shape \(2,\)"),
        ({"a": [[1, 2, 3]]}, "one-dimensional"),
        ({"a": [1, np.nan, 3]}, "a of reading 2 is nan"),
        ({"a": [1, 2]}, "at least 3 readings"),
        ({"a": [1, 2, 3], "time": [0, 2, 1]}, "run backwards, and does at reading 3"),
    ],
)
def test_bad_columns_are_named(columns: dict, match: str) -> None:
    with pytest.raises(InputError, match=match):
        checked_columns(columns)
    good = checked_columns({"a": [1, 2, 3], "time": [0, 0, 1], "b": None})  # stamps may repeat
    assert good["b"] is None
    with pytest.raises(InputError, match="fraction of the range"):
        split_branches([0, 1, 0], min_travel=1.0)


def _file(folder: Path, text: str) -> Path:
    path = folder / "record.csv"
    path.write_text(text)
    return path


def test_units_are_in_the_header(tmp_path: Path) -> None:
    path = _file(tmp_path, "time_ms;pressure_psi;force_lbf\n# pause\n0;10;1\n1;20;2\n\n3;30;3\n")
    record = read_ramp(path, length=0.3)
    np.testing.assert_allclose(record.time, [0, 1e-3, 3e-3])
    np.testing.assert_allclose(record.pressure, 6894.757293 * np.array([10, 20, 30]), rtol=1e-9)
    np.testing.assert_allclose(record.force, 4.4482216 * np.array([1, 2, 3]), rtol=1e-7)
    assert (record.valve_state, record.length, record.source) == (None, 0.3, "record.csv")
    history = read_history(_file(tmp_path, "# a test\nlength_in;pressure_psi\n10;0\n\n9.5;50\n"))
    np.testing.assert_allclose(history.length, [0.254, 0.2413])
    np.testing.assert_allclose(history.pressure, [0, 344737.8647], rtol=1e-9)
    assert (history.time, history.units) == (None, {"length": "in", "pressure": "psi"})
    timed = read_history(_file(tmp_path, "pressure_bar,time_us,length_mm\n1,0,250\n2,5,250\n"))
    np.testing.assert_allclose(timed.time, [0.0, 5e-6])


def test_columns_may_be_given_and_left_out(tmp_path: Path) -> None:
    rows = "1,8.94,0,1,x\n2,9.5,0.001,7444,x\n3,20,0.001,2,x\n"
    record = read_ramp(_file(tmp_path, rows), length=0.1, columns=RAMP)
    assert record.valve_state is not None
    assert record.valve_state.tolist() == [1, 7444, 2]
    named = _file(tmp_path, "F,P,t,s,?\n" + rows)
    names = {"force": "F [N]", "pressure": "P [kPa]", "time": "t [s]", "valve_state": "s"}
    renamed = read_ramp(named, length=0.1, columns=names)
    np.testing.assert_array_equal(renamed.pressure, record.pressure)


@pytest.mark.parametrize(
    ("text", "columns", "match"),
    [
        ("", None, "empty"),
        ("1,2,3\n", None, "no column for force; the table has column 1, .*--column force=.1 .N."),
        ("force,pressure_kPa,time_s\n1,2,3\n", None, "column 'force' has no unit"),
        ("force_N,pressure_kPa\n1,2\n", None, "no column for time"),
        ("force_N,pressure_foo,time_s\n1,2,3\n", None, "unknown unit 'foo'"),
        ("force_N,force_lbf,pressure_Pa,time_s\n1,2,3,4\n", None, "2 columns for force"),
        ("force_N,pressure_kPa,time_s\n1,2,3\n1,2\n", None, "row 3: time is missing"),
        ("1,2,3\n4,x,6\n", PLAIN, "row 2: pressure is 'x', not a number"),
        ("1;2,5;3.5\n", PLAIN, "--column decimal=,"),
        ("1,2,nan\n", PLAIN, "row 1: time is nan; every value must be finite"),
        ("1,2,3\n1,2,2\n1,4,1\n", PLAIN, "time goes back from 3 s to 2 s at line 2"),
        ("1,2,3\n", PLAIN, "at least 3 readings"),
        ("\0" * 500, None, "not a text file"),
    ],
)
def test_ramps_that_cannot_be_read(
    tmp_path: Path, text: str, columns: dict[str, str] | None, match: str
) -> None:
    with pytest.raises(InputError, match=match):
        read_ramp(_file(tmp_path, text), length=0.3, columns=columns)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("length_mm,pressure_kPa\n", "a header but no readings"),
        ("length_mm,force_N\n250,1\n", "no column for pressure"),
        ("length_mm,pressure_kPa\n250,-1\n", "gauge pressures >= 0"),
        ("length_mm,pressure_kPa\n0,1\n", "lengths must be > 0"),
        ("time_s,length_mm,pressure_kPa\n1,250,1\n0,250,1\n", "backwards, and does at reading 2"),
    ],
)
def test_histories_that_cannot_be_read(tmp_path: Path, text: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        read_history(_file(tmp_path, text))
    with pytest.raises(InputError, match="no such file"):
        read_history(tmp_path / "none.csv")
