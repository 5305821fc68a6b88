from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from famjax.boundary.units import parse_quantity
from fitting.ramps import RampRecord, read_ramp
from fitting.ramps.holds import find_staircase, noise_of

COLUMNS = "force_N,pressure_kPa,time_s,valve_state"


def _record(**changed: object) -> RampRecord:
    fields: dict = {
        "force": np.array([1.0, 2.0, 3.0]),
        "pressure": np.array([0.0, 1e5, 2e5]),
        "time": np.array([0.0, 1.0, 2.0]),
        "length": 0.3,
    }
    return RampRecord(**(fields | changed))


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "ramp.csv"
    path.write_text(text)
    return path


def test_units_are_in_the_header(tmp_path: Path) -> None:
    path = _file(tmp_path, "time_ms;pressure_psi;force_lbf\n# pause\n0;10;1\n1;20;2\n\n3;30;3\n")
    record = read_ramp(path, length=0.3)
    np.testing.assert_allclose(record.time, [0, 1e-3, 3e-3])
    np.testing.assert_allclose(record.pressure, 6894.757293 * np.array([10, 20, 30]), rtol=1e-9)
    np.testing.assert_allclose(record.force, 4.4482216 * np.array([1, 2, 3]), rtol=1e-7)
    assert record.valve_state is None
    assert record.length == 0.3
    assert record.source == "ramp.csv"


def test_columns_may_be_given_and_left_out(tmp_path: Path) -> None:
    rows = "1,8.94,0,1,x\n2,9.5,0.001,7444,x\n3,20,0.001,2,x\n"
    record = read_ramp(_file(tmp_path, rows), length=0.1, columns=COLUMNS + ",-")
    assert record.valve_state is not None
    assert record.valve_state.tolist() == [1, 7444, 2]
    assert (record.n_glitches, record.n_repeated_stamps) == (1, 1)
    renamed = read_ramp(
        _file(tmp_path, "F,P,t,s,?\n" + rows), length=0.1, columns=[*COLUMNS.split(","), "-"]
    )
    np.testing.assert_array_equal(renamed.pressure, record.pressure)


@pytest.mark.parametrize(
    ("text", "columns", "match"),
    [
        ("", None, "empty"),
        ("1,2,3\n", None, "no header names the columns"),
        ("force,pressure_kPa,time_s\n1,2,3\n", None, "'force' is not force, pressure or time"),
        ("force_N,pressure_kPa\n1,2\n", None, "no column for time"),
        ("force_N,pressure_foo,time_s\n1,2,3\n", None, "'foo' is not a known unit of pressure"),
        ("force_N,pressure_kPa,time_h\n1,2,3\n", None, "known units of time are s, ms"),
        ("force_N,force_lbf,time_s\n1,2,3\n", None, "'force' has two columns"),
        ("force_N,pressure_kPa,time_s\n1,2,3\n1,2\n", None, "row 3 has 2 cells for 3 columns"),
        ("1,2,3\n4,x,6\n", "force_N,pressure_kPa,time_s", "row 2: pressure_kPa is 'x'"),
        ("1;2,5;3\n", "force_N,pressure_kPa,time_s", "write a decimal point"),
        ("1,2,3\n1,2,2\n1,4,1\n", "force_N,pressure_kPa,time_s", "time must not run backwards"),
        ("1,2,3\n", "force_N,pressure_kPa,time_s", "at least 3 readings"),
    ],
)
def test_files_that_cannot_be_used(
    tmp_path: Path, text: str, columns: str | None, match: str
) -> None:
    with pytest.raises(InputError, match=match):
        read_ramp(_file(tmp_path, text), length=0.3, columns=columns)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_ramp(tmp_path / "none.csv", length=0.3)
    path = tmp_path / "binary.csv"
    path.write_bytes(b"\0" * 500)
    with pytest.raises(InputError, match="500 of its bytes are zero"):
        read_ramp(path, length=0.3)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a UTF-8"):
        read_ramp(path, length=0.3)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"length": 0.0}, "length must be > 0"),
        ({"pressure": np.full(3, 1e5)}, "pressure of a record must change"),
        ({"time": np.ones(3)}, "time of a record must change"),
        ({"force": np.array([1.0, np.nan, 2.0])}, "force of reading 2 is nan"),
    ],
)
def test_records_that_cannot_be(changed: dict, match: str) -> None:
    with pytest.raises(InputError, match=match):
        _record(**changed)


@pytest.mark.parametrize("text", ["73.25", "mm", "73.25 km", "7 3mm"])
def test_lengths_need_a_number_and_a_unit(text: str) -> None:
    with pytest.raises(InputError, match="unit"):
        parse_quantity(text, "length")


def _stairs(period: float, rate: float, noise: float, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Pressure [Pa], time [s] and the times of all pulses; some pulses are too small to be seen."""
    t = np.arange(0, 40 * period, 1 / rate)
    pulses = 0.3 * period + period * np.arange(39)
    steps = np.concatenate([6e4 * 0.85 ** np.arange(25), -9e4 * 0.75 ** np.arange(14)])
    since = t[:, None] - pulses
    ringing = 1 - np.exp(-since.clip(0) / (0.02 * period)) * np.cos(250 * since / period)
    P = (steps * np.where(since > 0, ringing, 0)).sum(axis=1) + 9e3
    return P + noise * np.random.default_rng(seed).standard_normal(t.size), t + 100, pulses + 100


@pytest.mark.parametrize(("period", "rate"), [(0.5, 500.0), (0.8, 1000.0), (5.0, 20.0)])
@pytest.mark.parametrize("noise", [0.0, 400.0])
def test_holds_lie_between_the_pulses(period: float, rate: float, noise: float) -> None:
    P, t, pulses = _stairs(period, rate, noise)
    found = find_staircase(P, t)
    assert found is not None
    assert found.period == pytest.approx(period, rel=0.01)  # two readings in a hundred
    assert found.start.size == 39  # one after each pulse; what is left after the last is too short
    # A pulse is seen at its first jump, at most two readings late; unseen ones are spaced evenly.
    late = found.start - pulses
    assert np.abs(late).max() < max(3 / rate, 0.03 * period)
    rows = found.rows(t, (0.56, 0.96))
    assert all(
        t[part[0]] >= pulse + 0.55 * period and t[part[-1]] < pulse + period
        for part, pulse in zip(rows, pulses, strict=True)
    )


def test_a_known_period_is_taken_and_a_wrong_one_refused() -> None:
    P, t, _ = _stairs(0.5, 500.0, 300.0)
    found = find_staircase(P, t, period=0.5)
    assert found is not None
    assert found.period == 0.5
    assert find_staircase(P, t, period=0.37) is None
    for wrong in (0.0, 30.0):
        with pytest.raises(InputError, match="period must lie between"):
            find_staircase(P, t, period=wrong)


@pytest.mark.parametrize("duration", [0.2, 2.0, 20.0])
def test_a_continuous_ramp_is_no_staircase(duration: float) -> None:
    t = np.arange(0, 3 * duration, 1e-3)
    P = 6e5 * np.clip(np.minimum(t, 2 * duration - t) / duration, 0, None)
    P = P + 400 * np.random.default_rng(0).standard_normal(t.size)
    assert find_staircase(P, t) is None


def test_noise_is_found_on_a_ramp() -> None:
    values = np.linspace(0, 500, 20001) + 0.9 * np.random.default_rng(0).standard_normal(20001)
    assert noise_of(values) == pytest.approx(0.9, rel=0.03)  # three standard errors of the median
