from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from fitting.hysteresis import read_history


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "history.csv"
    path.write_text(text)
    return path


def test_units_are_in_the_header(tmp_path: Path) -> None:
    history = read_history(_file(tmp_path, "# a test\nlength_in;pressure_psi\n10;0\n\n9.5;50\n"))
    np.testing.assert_allclose(history.length, [0.254, 0.2413])
    np.testing.assert_allclose(history.pressure, [0, 344737.8647], rtol=1e-9)
    assert history.time is None
    timed = read_history(_file(tmp_path, "pressure_bar,time_ms,length_mm\n1,0,250\n2,0,250\n"))
    assert timed.time is not None
    np.testing.assert_allclose(timed.time, 0.0)
    np.testing.assert_allclose(timed.pressure, [1e5, 2e5])


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "needs a header"),
        ("length_mm,pressure_kPa\n", "needs a header"),
        ("length_mm\n250\n", "no column for pressure"),
        ("length,pressure_kPa\n250,1\n", "unknown column 'length'; known are length_ with m, "),
        ("length_mm,pressure_kPa,force_N\n250,1,2\n", "unknown column 'force_N'"),
        ("length_mm,pressure_kPa,pressure_bar\n250,1,2\n", "'pressure' has two columns"),
        ("length_mm,pressure_kPa\n250\n", "row 2 has 1 cells"),
        ("length_mm;pressure_kPa\n250;1,5\n", r"'1,5', not a number \(write a decimal point\)"),
        ("length_mm,pressure_kPa\n250,nan\n", "'nan', not a number"),
        ("length_mm,pressure_kPa\n250,-1\n", "gauge pressures >= 0"),
        ("length_mm,pressure_kPa\n0,1\n", "lengths must be > 0"),
        ("time_s,length_mm,pressure_kPa\n1,250,1\n0,250,1\n", "backwards at reading 2"),
    ],
)
def test_what_cannot_be_used_is_refused(tmp_path: Path, text: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        read_history(_file(tmp_path, text))


def test_files_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        read_history(tmp_path / "none.csv")
    path = tmp_path / "binary.csv"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a UTF-8"):
        read_history(path)
