"""Columns and branches of records that are known, with noise, holds and faults."""

from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from fitting.records import read_history, read_machine_log, read_ramp
from fitting.records.record import checked_columns, split_branches

PLAIN = {"force": "1 [N]", "pressure": "2 [kPa]", "time": "3 [s]"}


def _triangle(cycles: int, rows: int, hold: int = 0) -> np.ndarray:
    """Position of a test between 0 and 1: ramps of `rows` steps, holds of `hold` more readings."""
    ramp = np.linspace(0, 1, rows + 1)
    up = np.concatenate([ramp, np.ones(hold)])
    cycle = np.concatenate([up, ramp[-2::-1], np.zeros(hold)])
    return np.concatenate([cycle, np.tile(cycle[1:], cycles - 1)])


@pytest.mark.parametrize("hold", [0, 30])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-3])
def test_branches_of_a_known_record(noise, hold):
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
        assert all(np.ptp(x[branch.start : branch.stop]) == 1 for branch in branches)


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        ({"a": [1, 2, 3], "b": [1, 2]}, r"b of shape \(2,\)"),
        ({"a": [[1, 2, 3]]}, "one-dimensional"),
        ({"a": [1, np.nan, 3]}, "a of reading 2 is nan"),
        ({"a": [1, 2]}, "at least 3 readings"),
        ({"a": [1, 2, 3], "time": [0, 2, 1]}, "run backwards, but it does at reading 3"),
    ],
)
def test_bad_columns_are_named(columns, match):
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


def test_units_are_in_the_header(tmp_path):
    path = _file(tmp_path, "time_ms;pressure_psi;force_lbf\n# pause\n0;10;1\n1;20;2\n\n3;30;3\n")
    record = read_ramp(path, length=0.3)
    np.testing.assert_allclose(record.time, [0, 1e-3, 3e-3])
    np.testing.assert_allclose(record.pressure, 6894.757293 * np.array([10, 20, 30]), rtol=1e-9)
    np.testing.assert_allclose(record.force, 4.4482216 * np.array([1, 2, 3]), rtol=1e-7)
    assert (record.length, record.source) == (0.3, "record.csv")
    history = read_history(_file(tmp_path, "# a test\nlength_in;pressure_psi\n10;0\n\n9.5;50\n"))
    np.testing.assert_allclose(history.length, [0.254, 0.2413])
    np.testing.assert_allclose(history.pressure, [0, 344737.8647], rtol=1e-9)
    assert (history.time, history.units) == (None, {"length": "in", "pressure": "psi"})
    timed = read_history(_file(tmp_path, "pressure_bar,time_us,length_mm\n1,0,250\n2,5,250\n"))
    np.testing.assert_allclose(timed.time, [0.0, 5e-6])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("1,2,3\n1,2\n", "row 2: time is missing"),
        ("1,2,3\n1,2,2\n1,4,1\n", "time goes back from 3 s to 2 s at line 2"),
        ("1,2,3\n", "at least 3 readings"),
    ],
)
def test_ramps_that_cannot_be_read(tmp_path, text, match):
    with pytest.raises(InputError, match=match):
        read_ramp(_file(tmp_path, text), length=0.3, columns=PLAIN)


def test_missing_rows_of_a_log_are_reported_and_what_is_no_log_is_refused(tmp_path):
    kept = [k for k in range(150) if k not in {10, 50, 51, 52}]
    rows = "".join(f"{0.02 * k:.3f},{k},{100 - k}\n" for k in kept)
    log = read_machine_log(_file(tmp_path, "time_s,displacement_mm,force_N\n" + rows))
    assert (log.missing_rows, log.time.size) == (4, 146)
    assert log.unread == ()
    path = _file(tmp_path, "Dear all,\nno numbers today.\n")
    with pytest.raises(InputError, match="no block of numbers") as caught:
        read_machine_log(path)
    assert str(path) in str(caught.value)
    with pytest.raises(InputError, match="no such file"):
        read_machine_log(tmp_path / "none.txt")
    with pytest.raises(InputError, match="load must be one of time, displacement, force, decimal"):
        read_machine_log(path, columns={"load": "Load"})
