"""Logs as several makers and countries write them, made from numbers that are known."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting import InputError
from fitting.records import read_machine_log

TIME = 0.02 * np.arange(150)
DISPLACEMENT = -1.016e-3 * TIME
FORCE = 4000 * np.cos(TIME / 3)
WRITTEN = {"time": 6e-4, "displacement": 6e-7, "force": 0.6}  # rounding of the coarsest form below


def comma(value: float, digits: int = 4) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


def german(t: float, x: float, F: float) -> str:
    thousands = f"{F:,.2f}".translate(str.maketrans(",.", ".,"))
    return f"{comma(t)};{comma(x * 1e6, 2)};{thousands}"


def phased(t: float, x: float, F: float) -> str:
    clock = f"00:{int(t // 60):02d}:{t % 60:06.3f}"
    return f"Ramp 1,{clock},{x * 1e3:.5f},-1.016,{F / 10:.4f},"


def rows(form: Callable[[float, float, float], str]) -> str:
    return "\n".join(map(form, TIME.tolist(), DISPLACEMENT.tolist(), FORCE.tolist()))


def instron(t: float, x: float, F: float) -> str:
    return f'"{t:.3f}","{x * 1e3:.5f}","{F:,.3f}","{F / 50:.3f}"'


FORMS: dict[str, tuple[str, str]] = {
    "Instron": (
        "\ufeff" + 'Results Table 1\n\n"Time","Extension","Load","Tensile stress"\n'
        '"(s)","(mm)","(N)","(MPa)"\n' + rows(instron) + "\n\n",
        "utf-8",
    ),
    "Instron, Windows line ends": (
        '"Time (s)","Extension (mm)","Load (kN)"\r\n'
        + rows(lambda t, x, F: f"{t:.4f},{x * 1e3:.5f},{F / 1e3:.6f}").replace("\n", "\r\n"),
        "utf-8",
    ),
    "MTS": (
        "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Header:\tTime:\t12.30469\tSec\t3/4/2021 10:00:00 AM\n"
        "Data Acquisition: Timed Data\nStation Name: FAM\nTest File Name: isobaric.000\n"
        "Axial Displacement\tAxial Force\tRunning Time\tAxial Integer Count\nin\tlbf\tSec\tsegments\n"
        + rows(lambda t, x, F: f"{x / 0.0254:.7f}\t{F / 4.4482216:.5f}\t{t:.5f}\t{int(t)}"),
        "utf-8",
    ),
    "TestWorks": (
        "  Time    Crosshead Pos   Axial Load\n  sec   inch    lbs\n"
        + rows(lambda t, x, F: f"  {t:9.4f}  {x / 0.0254:10.6f}   {F / 4.4482216:10.3f}"),
        "cp1252",
    ),
    "Zwick": (
        'Prüfer;"Müller"\nDatum;04.03.2021\n"Prüfzeit";"Standardweg";"Standardkraft";\n"s";"mm";"N";\n'
        + rows(lambda t, x, F: f"{comma(t)};{comma(x * 1e3)};{comma(F)};"),
        "cp1252",
    ),
    "German, UTF-16": (
        "Prüfling 3\nZeit [s]\tTraversenweg [mm]\tKraft [kN]\n"
        + rows(lambda t, x, F: f"{comma(t)}\t{comma(x * 1e3, 5)}\t{comma(F / 1e3, 6)}"),
        "utf-16",
    ),
    "German, thousands": (
        "Zeit / s;Weg / µm;Kraft / N\n" + rows(german),
        "cp1252",
    ),
    "UTF-16 without a mark": (
        "time_s,displacement_in,force_lbf\n"
        + rows(lambda t, x, F: f"{t:.4f},{x / 0.0254:.6f},{F / 4.4482216:.4f}"),
        "utf-16-be",
    ),
    "decimal comma in quotes": (
        'Time (ms),Position (mm),Force (N)\n'
        + rows(lambda t, x, F: f'"{comma(t * 1e3, 1)}","{comma(x * 1e3)}","{comma(F, 2)}"'),
        "utf-8",
    ),
    "clock and text columns": (
        "Phase,Elapsed Time (hh:mm:ss),Stroke (mm),Stroke rate (mm/s),Load (daN),Strain 1 (%)\n"
        + rows(phased),
        "utf-8",
    ),
}  # fmt: skip


def write(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "log.txt"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("name", FORMS)
def test_every_form_gives_the_same_numbers(name: str, tmp_path: Path) -> None:
    text, encoding = FORMS[name]
    columns = None
    log = read_machine_log(write(tmp_path, text, encoding), columns=columns)
    assert log.time.size == TIME.size
    for quantity, truth in (("time", TIME), ("displacement", DISPLACEMENT), ("force", FORCE)):
        assert np.abs(getattr(log, quantity) - truth).max() <= WRITTEN[quantity], quantity
    assert log.missing_rows == 0
    assert log.unread == log.repeated == ()
    assert log.interval == pytest.approx(0.02)


def simple(
    keep: Callable[[int], bool] = lambda k: True, header: str = "time_s,displacement_mm,force_N"
):
    lines = rows(lambda t, x, F: f"{t:.3f},{x * 1e3:.4f},{F:.3f}").splitlines()
    return "\n".join([header, *(line for k, line in enumerate(lines) if keep(k))]) + "\n"


def test_missing_rows_are_reported_and_not_filled(tmp_path: Path) -> None:
    log = read_machine_log(write(tmp_path, simple(lambda k: k not in {10, 50, 51, 52})))
    assert [(round(after, 3), rows) for after, rows in log.gaps] == [(0.18, 1), (0.98, 3)]
    assert log.missing_rows == 4
    assert log.time.size == TIME.size - 4


@pytest.mark.parametrize(
    ("header", "match"),
    [
        (
            "time_s,displacement_furlong,force_N",
            "unknown unit 'furlong'; known units of length are: m,",
        ),
        ("Time (s),Extension (mm),Load (psi)", "unknown unit 'psi'"),
        ("Time,Extension (mm),Load (N)", "'Time' has no unit"),
        ("Time (s),Extension (mm),Temperature (N)", "no column for force"),
        ("Time (s),Load A (N),Load B (N)", "no column for displacement"),
        ("a,b,c", "no column for time"),
    ],
)
def test_what_would_have_to_be_guessed_is_refused(header: str, match: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=match.replace("(", r"\(")):
        read_machine_log(write(tmp_path, simple(header=header)))


@pytest.mark.parametrize(
    ("data", "match"),
    [
        (b"Dear all,\nno numbers today.\n", "no block of numbers"),
        (bytes(range(256)) * 20, "is not a text file"),
        (b"time_s,displacement_mm,force_N\n0,1,1\n0,1,1\n0,1,1\n", "does not advance"),
        (b"time_s,position_mm,position_in,force_N\n0,1,1,1\n1,2,2,2\n2,3,3,3\n", "2 columns"),
    ],
)
def test_what_is_no_log_is_refused_with_its_path(data: bytes, match: str, tmp_path: Path) -> None:
    path = tmp_path / "log.xls"
    path.write_bytes(data)
    with pytest.raises(InputError, match=match) as caught:
        read_machine_log(path)
    assert str(path) in str(caught.value)
    with pytest.raises(InputError, match="no such file"):
        read_machine_log(tmp_path / "none.txt")
    with pytest.raises(InputError, match="load is none of time, displacement, force, decimal"):
        read_machine_log(path, columns={"load": "Load"})
