"""Tables of others: the right numbers, or one sentence that names the remedy; none is taken wrongly."""

# ruff: noqa: E501 -- a file is shown as it is

import io
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from famjax.tables import read_table
from fitting import read_csv
from fitting.records import read_machine_log, read_ramp

MAP = [
    (100, 250, 300.5), (200, 250, 412.25), (100, 240, 201.75), (200, 240, 333.125),
    (300, 240, 1450.5),
]  # fmt: skip
"""Pressure [kPa], length [mm], force [N]."""
LOG = [(0.5 * k, 1.25 * k, 100 + 2.5 * k, 300 + k) for k in range(12)]
"""Time [s], displacement [mm], force [N], pressure [kPa]."""
HOUR = 36000.0


def rows(form: str, table: list = MAP, sign: str = ".", end: str = "\n") -> str:
    """The rows of a table by a form such as `{0};{1}`, with this decimal sign."""
    return end.join(form.format(*row).replace(".", sign) for row in table) + end


def clock(form: str, start: float = HOUR) -> str:
    """Rows of a log whose time is a stamp: H, M, S are its parts, f milliseconds, h the hour of twelve."""
    lines = []
    for t, x, F, _ in LOG:
        s, f = divmod(round((start + t) * 1e3) % 86_400_000, 1000)
        parts = {
            "H": s // 3600, "M": s // 60 % 60, "S": s % 60, "f": f, "h": (s // 3600 - 1) % 12 + 1,
        }  # fmt: skip
        parts |= {
            "half": "AP"[s >= 43200] + "M",
            "day": 4 + (start + t >= 86400),
            "m": int(start + t) // 60,
        }
        lines.append(form.format(**parts) + f";{x};{F}\n")
    return "Time;Position (mm);Load (N)\n" + "".join(lines)


def workbook(*sheets: list[list[object]], declared: str = "") -> bytes:
    """A workbook as spreadsheets write it."""
    book, held = pytest.importorskip("openpyxl").Workbook(), io.BytesIO()
    book.remove(book.active)
    for k, sheet in enumerate(sheets):
        page = book.create_sheet(f"Sheet {k + 1}")
        for row in sheet:
            page.append(row)
    book.save(held)
    if not declared:
        return held.getvalue()
    with zipfile.ZipFile(held, "a") as archive, archive.open("xl/media/extra.xml", "w") as part:
        part.write(declared.encode())
    return held.getvalue()


def zipped(name: str, *parts: bytes) -> bytes:
    held, how = io.BytesIO(), zipfile.ZIP_DEFLATED
    with zipfile.ZipFile(held, "w", how, compresslevel=1) as book, book.open(name, "w") as part:
        part.writelines(parts)
    return held.getvalue()


SHEET = [["Pressure (kPa)", "Length (mm)", "Force (N)"], *map(list, MAP)]
MAPS: dict[str, tuple[object, dict[str, str]]] = {
    "plain": ("pressure_kPa,length_mm,force_N\n" + rows("{},{},{}"), {}),
    "sep=": ("sep=;\nPressure (kPa);Length (mm);Force (N)\n" + rows("{};{};{}"), {}),
    "German": ("Druck [kPa];Länge [mm];Kraft [N]\n".encode("cp1252") + rows("{};{};{}", sign=",").encode(), {}),
    "UTF-16 of Excel": (
        ("sep=\t\r\nPressure (kPa)\tLength (mm)\tForce (N)\r\n" + rows("{}\t{}\t{}", end="\r\n")).encode("utf-16"), {},
    ),
    "UTF-16, no mark": (("Force, N;Length, mm;Pressure, kPa\n" + rows("{2};{1};{0}")).encode("utf-16-le"), {}),
    "mark": (("pressure_kPa;length_mm;force_N\n" + rows("{};{};{}", sign=",")).encode("utf-8-sig"), {}),
    "unit row": ("Druck;Länge;Kraft\nmbar;mm;N\n" + rows("{0}0;{1};{2}", sign=","), {}),
    "unit row in brackets, above": ("[bar],[cm],[kN]\nPressure,Length,Force\n" + "\n".join(
        f"{P / 100},{L / 10},{F / 1000}" for P, L, F in MAP), {}),
    "preamble": ("Test report\nOperator;A. Miller\nDate;04.03.2021\nSpeed;1,5\n\nPressure (kPa);Length (mm);Force (N)\n"
                 + rows("{};{};{}", sign=","), {}),
    "thousands": ('Pressure (kPa),Length (mm),Force (N)\n' + "\n".join(f'{P},{L},"{F:,.3f}"' for P, L, F in MAP), {}),
    "Swiss thousands": ("Druck (kPa);Länge (mm);Kraft (N)\n" + "\n".join(
        f"{P};{L};{F:,.3f}".replace(",", "'") for P, L, F in MAP), {}),
    "French thousands": ("Pression (kPa);Longueur (mm);Force (N)\n" + "\n".join(
        f"{P};{L};{F:,.3f}".replace(",", "\u202f").replace(".", ",") for P, L, F in MAP), {}),
    "extra columns": ("No;Pressure (kPa);Length (mm);Force (N);Temp (°C);Remark\n"
                      + "\n".join(f"{k};{P};{L};{F};22.5;ok" for k, (P, L, F) in enumerate(MAP)), {}),
    "fill of a spreadsheet": ("Pressure (kPa),Length (mm),Force (N),,\n" + rows("{},{},{},,") + ",,,,\n", {}),
    "set point beside": ("Pressure setpoint (kPa),Pressure (kPa),Length (mm),Force (N)\n" + rows("50,{},{},{}"), {}),
    "groups above": ("Setpoints;;Measured;;\nPressure (kPa);Length (mm);Pressure (kPa);Length (mm);Force (N)\n"
                     + rows("7;8;{};{};{}"), {}),
    "words below": ("Pressure;Pressure;Length;Force\nsetpoint;measured;;\nkPa;kPa;mm;N\n" + rows("7;{};{};{}"), {}),
    "many that are none": (
        "Barometric pressure [hPa],Supply pressure [kPa],Pressure Cmd [kPa],Peak Load [N],Load limit [N],Load error [N],"
        "Pressure [kPa],Length [mm],Load [N],Load counter\n" + rows("1013,700,{0},9999,9000,1,{0},{1},{2},7"), {}),
    "German set point": ("Druck Soll [kPa];Druck Ist [kPa];Solllänge [mm];Länge [mm];Kraftgrenze [N];Kraft [N]\n"
                         + rows("1;{};2;{};3;{}"), {}),
    "camel case": ("PressureSetpoint_kPa,PressureActual_kPa,Length_mm,LoadCell_N\n" + rows("0,{},{},{}"), {}),
    "psia": ("Pressure (psia),Length (mm),Force (N)\n" + "\n".join(
        f"{(P * 1e3 + 101325) / 6894.757293168:.9f},{L},{F}" for P, L, F in MAP), {"atmosphere": "101.325kPa"}),
    "bar(a)": ("Pressure bar (a);Length mm;Force N\n" + "\n".join(
        f"{P / 100 + 1:.4f};{L};{F}" for P, L, F in MAP), {"atmosphere": "100kPa"}),
    "psig": ("Pressure [psi(g)],Length [in],Force [lbf]\n" + "\n".join(
        f"{P * 1e3 / 6894.757293168:.9f},{L / 25.4:.9f},{F / 4.4482216152605:.9f}" for P, L, F in MAP), {}),
    "kgf/cm2": ("Pressure, kgf/cm²;Length, cm;Force, kgf\n" + "\n".join(
        f"{P * 1e3 / 98066.5:.9f};{L / 10};{F / 9.80665:.9f}" for P, L, F in MAP), {}),
    "inHg, N": ("Pressure (inHg gauge)|Length (inch)|Force (newtons)\n" + "\n".join(
        f"{P * 1e3 / 3386.389:.8f}|{L / 25.4:.8f}|{F}" for P, L, F in MAP), {}),
    "--column": ("Kanal 1;Kanal 2;Kanal 3\n" + rows("{};{};{}", sign=","),
                 {"pressure": "Kanal 1 [kPa]", "length": "kanal 2 [mm]", "force": "3 [N]"}),
    "no header": (rows("{} {} {}"), {"pressure": "1 [kPa]", "length": "2 [mm]", "force": "3 [N]"}),
    "index of pandas": (",pressure_kPa,length_mm,force_N\n" + "".join(f"{k},{P},{L},{F}\n" for k, (P, L, F) in enumerate(MAP)), {}),
    "row names of R": ('"pressure_kPa"\t"length_mm"\t"force_N"\n' + "".join(
        f'"{k}"\t{P}\t{L}\t{F}\n' for k, (P, L, F) in enumerate(MAP, 1)), {}),
    "table of pandas as text": ("   pressure_kPa  length_mm  force_N\n" + "".join(
        f"{k:<4}  {P:8}  {L:8}  {F:8}\n" for k, (P, L, F) in enumerate(MAP)), {}),
    "names after a percent sign": ("% pressure_kPa length_mm force_N cycle\n" + rows("{} {} {} 1"), {}),
    "header of NumPy": ("# pressure_kPa length_mm force_N\n" + rows("{:.18e} {:.18e} {:.18e}"), {}),
    "footer": ("Pressure (kPa);Length (mm);Force (N)\n" + rows("{};{};{}") + "End of test\n", {}),
    "commented reading": ("pressure_kPa,length_mm,force_N\n# 900,900,900\n" + rows("{},{},{}"), {}),
    "workbook": (lambda: workbook(SHEET), {}),
    "workbook, notes and a second sheet": (
        lambda: workbook([["Notes"], ["Muscle 7", 3]], [["Test", 7], [], ["Druck", "Länge", "Kraft"], ["bar", "cm", "N"],
                         *[[P / 100, L / 10, F] for P, L, F in MAP]]), {}),
}  # fmt: skip
"""Content and what the user says of it: all are `MAP`."""


def written(content: object, folder: Path) -> Path:
    made = content() if isinstance(content, Callable) else content
    path = folder / "table.dat"
    path.write_bytes(made if isinstance(made, bytes) else str(made).encode())
    return path


@pytest.mark.parametrize("name", MAPS)
def test_a_map_of_others_is_read(name, tmp_path):
    content, columns = MAPS[name]
    data = read_csv(written(content, tmp_path), {"nominal_diameter": 0.02}, columns)
    P, L, F = np.array(MAP).T
    np.testing.assert_allclose(data.pressure, P * 1e3, rtol=1e-7)
    np.testing.assert_allclose(data.length, L / 1e3, rtol=1e-7)
    np.testing.assert_allclose(data.force, F, rtol=1e-7)


STAMPS = {
    "hh:mm:ss.f": clock("{H:02d}:{M:02d}:{S:02d}.{f:03d}"),
    "comma": clock("{H:02d}:{M:02d}:{S:02d},{f:03d}"),
    "milliseconds after a colon": clock("{H:02d}:{M:02d}:{S:02d}:{f:03d}"),
    "midnight": clock("{H:02d}:{M:02d}:{S:02d}.{f:03d}", 86397.0),
    "AM/PM over noon": clock("{h}:{M:02d}:{S:02d}.{f:03d} {half}", 43197.0),
    "AM/PM over one o'clock": clock("{h}:{M:02d}:{S:02d}.{f:03d} {half}", 46797.0),
    "date and AM/PM": clock("3/{day}/2021 {h}:{M:02d}:{S:02d}.{f:03d} {half}", 86397.0),
    "ISO 8601": clock("2021-03-0{day}T{H:02d}:{M:02d}:{S:02d}.{f:03d}Z", 86397.0),
    "ISO 8601, zone": clock("2021-03-04 {H:02d}:{M:02d}:{S:02d}.{f:03d}+01:00"),
    "German date": clock("0{day}.03.2021 {H:02d}:{M:02d}:{S:02d},{f:03d}", 86397.0),
    "mm:ss.f": clock("{m:02d}:{S:02d}.{f:03d}", 57.0),
    "mm:ss.f over the hour": clock("{M:02d}:{S:02d}.{f:03d}", 3597.0),
}
LOGS: dict[str, tuple[object, dict[str, str]]] = {
    **{name: (text, {}) for name, text in STAMPS.items()},
    "Instron": ('"Time","Extension","Load"\n"(s)","(mm)","(kN)"\n' + "".join(
        f'"{t:.4f}","{x:.5f}","{F / 1e3:.6f}"\n' for t, x, F, _ in LOG), {}),
    "MTS": ("MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Acquisition: Timed\nAxial Displacement\tAxial Force\tRunning Time\t"
            "Axial Integer Count\tAxial Displacement Command\nmm\tkN\tSec\tsegments\tmm\n" + "".join(
        f"{x}\t{F / 1e3}\t{t}\t0\t9\n" for t, x, F, _ in LOG), {}),
    "Zwick": ('Prüfer;"Müller"\nVorkraft;5;N\n"Prüfzeit";"Standardweg";"Standardkraft"\n"s";"mm";"N"\n'.encode("cp1252")
              + rows("{};{};{};", LOG, ",").encode(), {}),
    "LabVIEW": ("LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n***End_of_Header***\t\n\t\n"
                "Channels\t2\t\nSamples\t12\t12\nDate\t2021/03/04\t2021/03/04\nTime\t10:00:00.5\t10:00:00.5\n"
                "Y_Unit_Label\tmm\tN\nX_Dimension\tTime\tTime\nX0\t0\t0\nDelta_X\t.5\t.5\n***End_of_Header***\t\t\n"
                "X_Value\tPosition\tLoad Cell\tComment\n" + rows("{}\t{}\t{}", LOG), {}),
    "logger with a stamp and no interest": ("Timestamp,Elapsed (ms),Stroke (µm),Tension Load [daN],Batt (V)\n" + "".join(
        f"2021-03-04 10:00:00,{t * 1e3:.0f},{x * 1e3:.1f},{F / 10:.3f},3.7\n" for t, x, F, _ in LOG), {}),
    "TestWorks": ("  Time    Crosshead Pos   Axial Load\n  sec   inch    lbs\n" + "".join(
        f"  {t:9.4f}  {x / 25.4:14.12f}   {F / 4.4482216152605:16.10f}\n" for t, x, F, _ in LOG), {}),
    "German thousands": ("Zeit / s;Weg / µm;Kraft / N\n".encode("cp1252") + "".join(
        f"{t};{x * 1e3:,.2f};{F}\n".translate(str.maketrans(",.", ".,")) for t, x, F, _ in LOG).encode(), {}),
    "decimal commas in quotes": ("Time (ms),Position (mm),Load (N)\n" + "".join(
        f'"{t * 1e3}","{x}","{F}"\n'.replace(".", ",") for t, x, F, _ in LOG), {}),
    "clock and text columns": ("Phase,Elapsed Time (hh:mm:ss),Stroke (mm),Stroke rate (mm/s),Load (daN),Strain 1 (%)\n"
                               + "".join(f"Ramp 1,00:00:{t:06.3f},{x},-1.016,{F / 10},\n" for t, x, F, _ in LOG), {}),
    "minutes": ("Time (min)\tPos [mm]\tF [N]\n" + "".join(f"{t / 60:.9f}\t{x}\t{F}\n" for t, x, F, _ in LOG), {}),
    "all capitals": ("TIME (SEC);POSITION (MM);FORCE (KN)\n" + "".join(
        f"{t};{x};{F / 1e3}\n" for t, x, F, _ in LOG), {}),
    "workbook of times": (lambda: workbook([["Zeit", "Weg / mm", "Kraft in N"], *[
        [f"00:00:{t:06.3f}", x, F] for t, x, F, _ in LOG]]), {}),
}  # fmt: skip
"""Content and what the user says of it: all are `LOG` from its first time on."""


@pytest.mark.parametrize("name", LOGS)
def test_a_log_of_others_is_read(name, tmp_path):
    content, columns = LOGS[name]
    log = read_machine_log(written(content, tmp_path), columns=columns)
    t, x, F, _ = np.array(LOG).T
    np.testing.assert_allclose(log.time - log.time[0], t, atol=1e-6)
    np.testing.assert_allclose(log.displacement, x / 1e3, rtol=1e-9)
    np.testing.assert_allclose(log.force, F, rtol=1e-9)


HEAD = "Time (s),Position (mm),Load (N)\n"
REFUSED: dict[str, tuple[Callable[..., object], object, str]] = {
    **{
        f"map: {what}": (read_csv, f"{name},Length (mm),Force (N)\n" + rows("{},{},{}"), says)
        for what, name, says in (
            ("set point", "Pressure setpoint (kPa)", "is a set point or command.*--column pressure="),
            ("set", "P_set [kPa]", "is a set point or command.*--column pressure="),
            ("commanded", "Commanded Pressure (psi)", "is a set point or command"),
            ("Soll", "Solldruck [kPa]", "is a set point or command"),
            ("atmosphere", "Atmospheric pressure (hPa)", "is an ambient value"),
            ("Luftdruck", "Luftdruck [mbar]", "is an ambient value"),
            ("supply", "Supply pressure (bar)", "is a supply value"),
            ("regulator", "Regulator P (kPa)", "is a supply value"),
            ("maximum", "Max. pressure (kPa)", "is a limit"),
            ("error", "Pressure error (kPa)", "is an error or difference"),
            ("absolute", "Absolute pressure (kPa)", "is an absolute pressure.*--column atmosphere="),
            ("psia", "pressure_psia", "is an absolute pressure.*--column atmosphere="),
            ("unknown unit", "Pressure (flob)", "unknown unit 'flob'; known units of pressure are"),
            ("no unit", "Pressure", r"has no unit.*--column pressure=\"Pressure \[Pa\]\""),
            ("formula", "2 Pressure (kPa)", "may be a different quantity.*--column pressure="),
            ("multiple", "Pressure*10 (kPa)", "may be a different quantity.*--column pressure="),
            ("word that is not known", "Header2 tap pressure (kPa)", "is a supply value|may be a different quantity"),
            ("milli or mega", "pressure_mPa", "unknown unit 'mPa'"),
        )
    },
    "map: row that no name is left for": (
        read_csv, "Pressure (kPa);Length (mm);Force (N)\n" + rows("7;{};{};{}"), "4 numbers, but the header has 3 names"),
    "map: a mean below": (read_csv, "Test,Pressure (kPa),Length (mm),Force (N)\n" + rows("1,{},{},{}") + "Mean,180,244,540\n",
                          "row 7 is labelled 'Mean', so it is not a reading"),
    "map: units of 100 N": (read_csv, "Pressure (kPa),Length (mm),Force (100 N)\n" + rows("{},{},{}"), "convert a multiple"),
    "map: units of 0.1 N": (read_csv, "Pressure (kPa);Length (mm);Force, 0.1 N\n" + rows("{};{};{}"), "different quantity"),
    "map: divided": (read_csv, "Pressure (kPa);Length (mm);Force (N), 1:10\n" + rows("{};{};{}"), "different quantity"),
    "map: 1.100 between whole numbers": (
        read_csv, "Druck [mbar]\tLänge [mm]\tKraft [N]\n350\t296\t0\n1.100\t296\t179\n", "--column decimal=,"),
    "map: contraction in mm": (read_csv, "Pressure (kPa),Contraction (mm),Force (N)\n" + rows("{},{},{}"), "write the length L"),
    "map: displacement": (read_csv, "Pressure (kPa),Displacement (mm),Force (N)\n" + rows("{},{},{}"), "a displacement is not a length"),
    "log: serial monitor": (read_machine_log, "".join(f"10:22:11.{k}00 -> {k},{k}.5,{k}\n" for k in range(9)), "serial monitor"),
    "map: peak": (read_csv, "Pressure (kPa),Length (mm),Peak Load (N)\n" + rows("{},{},{}"), "is a peak"),
    "map: counter": (read_csv, "Pressure (kPa),Length (mm),Load count\n" + rows("{},{},{}"), "is a counter"),
    "map: fractions called percent": (
        lambda path: read_csv(path, {"rest_length": 0.25}),
        "Pressure (kPa),Contraction (%),Force (N)\n100,0.001,30\n200,0.002,20\n", r'contraction="NAME \[-\]"'),
    "map: force counts": (read_csv, "Pressure (kPa),Length (mm),Load (N)\n" + "".join(
        f"{100 + 10 * k},250,{k}\n" for k in range(12)), "counts the rows"),
    "map: command above": (read_csv, "Command,Feedback,Feedback\nPressure (kPa),Length (mm),Force (N)\n" + rows("{},{},{}"),
                           "is a set point or command"),
    "map: two loads": (read_csv, "Pressure (kPa),Length (mm),Load 1 (N),Load 2 (N)\n" + rows("{0},{1},{2},{2}"),
                       r"2 columns match force .*--column force="),
    "map: begins at the atmosphere": (read_csv, "Pressure (psi),Length (mm),Force (N)\n14.69,250,1\n30.1,250,90\n45,250,150\n",
                                      "begins at atmospheric pressure"),
    "map: mixed signs": (read_csv, "Pressure (kPa);Length (mm);Force (N)\n100.5;250;1,5\n200;250;3\n", "--column decimal=,"),
    "map: 1,234": (read_csv, "Pressure (kPa);Length (mm);Force (N)\n100;250;1,234\n200;250;2,345\n", "--column decimal=,"),
    "map: commas between commas": (read_csv, "Pressure (kPa),Length (mm),Force (N)\n100,5,250,0,30,5\n200,5,250,0,41,5\n",
                                   "export the table with semicolons"),
    "map: thousands between commas": (read_csv, "Pressure (kPa),Length (mm),Force (N)\n100.5,250.5,1,030.5\n200.5,250.5,1,041.5\n",
                                      "decimal or thousands separators"),
    "map: HTML": (read_csv, "<html><table><tr><td>1</td></tr></table></html>", "save it as .xlsx or CSV"),
    "map: XML with entities": (read_csv, '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>',
                               "save it as .xlsx or CSV"),
    "map: old workbook": (read_csv, b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600), "save it as .xlsx or CSV"),
    "map: two sheets": (read_csv, lambda: workbook(SHEET, SHEET), "keep one, or save one as CSV"),
    "map: a bomb": (read_csv, lambda: zipped("xl/a.xml", *[b" " * 100_000_000] * 6), "unpacks to 600 MB"),
    "map: a sheet that reaches far": (
        read_csv, lambda: zipped("xl/worksheets/sheet1.xml", b'<c r="A1"/><c r="XFD1048576"/>'), "is too large"),
    "map: entities": (read_csv, lambda: workbook(SHEET, declared="<!DOCTYPE x>"), "defines XML entities"),
    "map: no workbook": (read_csv, b"PK\x03\x04" + bytes(200), "is not a readable workbook"),
    "log: time stands": (read_machine_log, HEAD + "".join(f"{k // 4},{k},{k}.5\n" for k in range(24)), "does not advance"),
    "log: hh:mm": (read_machine_log, "Time,Position (mm),Load (N)\n" + "".join(
        f"10:{k // 30:02d},{k},{k}.5\n" for k in range(60)), "does not advance.*with seconds"),
    "log: mm:ss or hh:mm": (read_machine_log, "Time,Position (mm),Load (N)\n" + "".join(
        f"10:{k:02d},{k},{k}.5\n" for k in range(30)), r"--column time=\"Time \[mm:ss\]\""),
    "log: back": (read_machine_log, HEAD + rows("{},{},{}", LOG) + rows("{},{},{}", LOG), "single test; split the file"),
    "log: dates": (read_machine_log, "Time;Position (mm);Load (N)\n" + "".join(
        f"{3 * k + 1}/{3 * k + 2}/2021 10:00:00;{k};{k}.5\n" for k in range(4)), "write them as 2021-03-04"),
    "ramp: time in no unit": (lambda path: read_ramp(path, length=0.1), "time,pressure_kPa,force_N\n" + rows("{},{},{}", LOG),
                              r"--column time=\"time \[s\]\""),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_told_is_refused_with_its_remedy(name, tmp_path):
    read, content, says = REFUSED[name]
    with pytest.raises(InputError, match=says) as caught:
        read(written(content, tmp_path))
    assert "table.dat" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_the_user_says_holds(tmp_path):
    path = written("Pressure setpoint (kPa),Length (mm),Force (N)\n" + rows("{},{},{}"), tmp_path)
    data = read_csv(path, columns={"pressure": "Pressure setpoint (kPa)"})
    assert data.pressure.tolist() == [P * 1e3 for P, *_ in MAP]
    stamps = written(REFUSED["log: mm:ss or hh:mm"][1], tmp_path)
    for unit, step in (("mm:ss", 1.0), ("hh:mm", 60.0)):
        log = read_machine_log(stamps, columns={"time": f"Time [{unit}]"})
        assert np.allclose(np.diff(log.time), step)


def test_what_was_taken_is_one_line_or_a_table(tmp_path):
    plain = read_table(written(MAPS["German"][0], tmp_path), ("force", "pressure", "length")).said()
    assert plain == (
        "columns: force from 'Kraft [N]', first 300.5 N; pressure from 'Druck [kPa]', first 100 kPa; "
        "length from 'Länge [mm]', first 250 mm"
    )
    extra = written(MAPS["extra columns"][0], tmp_path)
    table = read_table(extra, ("force", "pressure", "length")).said()
    assert "ignored      'No', 'Temp (°C)'" in table
    assert len(table.splitlines()) == 5
