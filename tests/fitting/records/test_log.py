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


def test_other_columns_are_kept_as_printed(tmp_path: Path) -> None:
    log = read_machine_log(write(tmp_path, *FORMS["Instron"]))
    assert set(log.others) == {"Tensile stress (MPa)"}
    assert np.abs(log.others["Tensile stress (MPa)"] - FORCE / 50).max() < 6e-4


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


def test_lines_that_are_no_numbers_are_reported(tmp_path: Path) -> None:
    lines = simple().splitlines()
    lines[30] = "*** machine paused by operator ***"
    lines[31] = lines[31].replace(lines[31].split(",")[2], "----")
    lines.append("End of test")
    log = read_machine_log(write(tmp_path, "\n".join(lines)))
    assert log.unread == (31, 32)
    assert log.missing_rows == 2


def test_a_header_repeated_in_the_middle_is_no_row(tmp_path: Path) -> None:
    lines = simple().splitlines()
    lines[75:75] = ["", lines[0]]
    log = read_machine_log(write(tmp_path, "\n".join(lines)))
    assert log.time.size == TIME.size
    assert log.unread == (77,)


def test_a_time_that_stands_still_is_reported(tmp_path: Path) -> None:
    lines = simple().splitlines()
    lines.insert(20, lines[19])
    log = read_machine_log(write(tmp_path, "\n".join(lines)))
    assert log.repeated == (21,)
    assert log.time.size == TIME.size


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


def test_no_header_at_all_needs_columns_and_units(tmp_path: Path) -> None:
    path = write(tmp_path, "\n".join(simple().splitlines()[1:]))
    with pytest.raises(InputError, match="no column for time"):
        read_machine_log(path)
    log = read_machine_log(
        path,
        columns={"time": "1 [s]", "displacement": "2 [mm]", "force": "3 [N]"},
    )
    assert np.abs(log.force - FORCE).max() < 1e-3


def test_two_loads_must_be_told_apart(tmp_path: Path) -> None:
    text = simple(header="Time (s),Extension (mm),Load cell (N)").splitlines()
    text = [f"{line},{'Load cell 2 (N)' if k == 0 else '7'}" for k, line in enumerate(text)]
    path = write(tmp_path, "\n".join(text))
    with pytest.raises(InputError, match="2 columns for force"):
        read_machine_log(path)
    assert read_machine_log(path, columns={"force": "Load cell 2"}).force[0] == 7.0
    assert read_machine_log(path, columns={"force": "Load cell (N)"}).force[0] == 4000.0


def test_a_plain_name_does_not_decide_between_two_loads(tmp_path: Path) -> None:
    text = simple(header="Time (s),Extension (mm),Load (N)").splitlines()
    text = [f"{line},{'Load 2 (N)' if k == 0 else '7'}" for k, line in enumerate(text)]
    path = write(tmp_path, "\n".join(text))
    with pytest.raises(InputError, match=r"2 columns for force \(Load \(N\), Load 2 \(N\)\)"):
        read_machine_log(path)
    assert read_machine_log(path, columns={"force": "Load 2"}).force[0] == 7.0


def test_a_rate_beside_a_load_and_a_second_time_need_no_choice(tmp_path: Path) -> None:
    text = simple(header="Time (s),Extension (mm),Load (N)").splitlines()
    more = [",Load rate (N/s),Cycle time (s)", *[",1.5,0.5"] * (len(text) - 1)]
    path = write(tmp_path, "\n".join(a + b for a, b in zip(text, more, strict=True)))
    assert read_machine_log(path).force[0] == pytest.approx(4000.0)


def test_decimal_commas_between_commas_are_refused(tmp_path: Path) -> None:
    text = "time_s,displacement_mm,force_N\n" + rows(
        lambda t, x, F: f"{comma(t)},{comma(x * 1e3)},{comma(F)}"
    )
    with pytest.raises(
        InputError, match=r"line 2 has 6 numbers under 3 names: are they decimal commas"
    ):
        read_machine_log(write(tmp_path, text))


def test_mega_and_milli_are_not_confused(tmp_path: Path) -> None:
    for unit, scale in (("mN", 1e-3), ("MN", 1e6), ("KN", 1e3), ("kn", 1e3)):
        log = read_machine_log(
            write(tmp_path, simple(header=f"time_s,displacement_mm,force ({unit})"))
        )
        assert log.force[0] == pytest.approx(4000 * scale)
    with pytest.raises(InputError, match="unknown unit 'mn'"):
        read_machine_log(write(tmp_path, simple(header="time_s,displacement_mm,force (mn)")))


def test_a_comma_that_may_be_either_is_refused(tmp_path: Path) -> None:
    text = "time_s;displacement_mm;force_N\n" + "\n".join(f"{k};1,234;2,345" for k in range(20))
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=r"'1,234' may be 1.234 or 1234: say which sign"):
        read_machine_log(path)
    assert read_machine_log(path, columns={"decimal": ","}).force[0] == pytest.approx(2.345)
    assert read_machine_log(path, columns={"decimal": "."}).force[0] == pytest.approx(2345)


def test_two_tests_in_one_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"time goes back from 2.98 s to 0 s at line 152"):
        read_machine_log(write(tmp_path, simple() + "\n".join(simple().splitlines()[1:])))


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
