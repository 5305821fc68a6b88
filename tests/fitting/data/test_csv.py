"""Reading force maps: units, specimen, and every way in which a file can be wrong."""

import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fitting import ForceData, InputError, Specimen, load_bundled, read_csv, write_csv
from fitting.cli.problem import parse_bounds
from fitting.faults import thick_wall
from fitting.specimen import parse_specimen


def _spoil(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


def test_bundled_maps_are_the_published_tables() -> None:
    """Sizes and largest forces of Martens & Boblan 2017, tables A1 and A2."""
    for name, readings, loaded, largest in (
        ("DMSP-20-300", 126, 60, 1653.5),
        ("DMSP-10-250", 85, 40, 542.5),
    ):
        data = load_bundled(name)
        assert (data.force.size, int(data.loaded.sum()), data.max_force) == (
            readings,
            loaded,
            largest,
        )
        assert data.specimen.embedded
        assert not data.notes


def test_units_are_converted_and_order_does_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "us.csv"
    path.write_text("force_lbf;length_in;pressure_psi\n10;10;20\n5;9;20\n0;8;10\n")
    data = read_csv(path)
    np.testing.assert_allclose(data.force, [44.482216152605, 22.2411080763025, 0])
    np.testing.assert_allclose(data.length, [0.254, 0.2286, 0.2032])
    np.testing.assert_allclose(data.pressure, [137895.1458633, 137895.1458633, 68947.57293168])
    assert data.specimen.rest_length == pytest.approx(0.254)
    assert any("rest length was not given" in note for note in data.notes)
    assert any("wall was not given" in note for note in data.notes)


@pytest.mark.parametrize(("bore", "wall"), [("20", 1.8e-3), ("10", 1.8e-3), ("5", 0.9e-3)])
def test_the_wall_that_is_assumed_fits_the_bore(tmp_path: Path, bore: str, wall: float) -> None:
    """1.8 mm in a bore of 5 mm would be blamed on a user who never said it."""
    path = tmp_path / "small.csv"
    path.write_text(
        f"# specimen: nominal_diameter_mm = {bore}\nforce_N,length_mm,pressure_kPa\n90,99,300\n50,95,300\n"
    )
    data = read_csv(path)
    assert data.specimen.wall_thickness == pytest.approx(wall)
    assert any(f"{wall * 1e3:.3g} mm is assumed" in note for note in data.notes)
    assert not thick_wall(data)


def test_specimen_lines_and_overrides(map_file: Path) -> None:
    map_file.write_text("# a remark\n# specimen: rest_length_in = 12\n" + map_file.read_text())
    assert read_csv(map_file).specimen.rest_length == pytest.approx(0.3048)
    given = parse_specimen(["rest_length_mm=310", "name=mine"])
    specimen = read_csv(map_file, given).specimen
    assert (specimen.rest_length, specimen.name) == (0.31, "mine")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("force_N", "force", "column 'force' has no unit.*--column force=.force .N."),
        ("force_N", "force_dyn", "unknown unit 'dyn'; known units of force are: N, kN, lbf, kgf"),
        ("pressure_kPa", "pressure_psia", "is an absolute pressure.*--column atmosphere="),
        (
            "force_N",
            "torque_Nm",
            "no column for force; the table has pressure_kPa, length_mm, torque_Nm",
        ),
        ("length_mm,", "", "line 2 has 3 numbers under 2 names"),
        (
            "length_mm",
            "force_kN",
            "2 columns for force .force_kN, force_N.: say which, --column force=",
        ),
        ("100,300,", "100,300mm,", "row 2: length is '300mm', not a number"),
        ("100,300,", "100,,", "row 2: length is missing; take the row out, or write what was read"),
        ("100,300,", "100,nan,", "row 2: length is nan; every value must be finite"),
        ("100,300,", "inf,300,", "row 2: pressure is inf"),
        (
            "100,300,",
            "-5,300,",
            "pressure .gauge pressure, not absolute. must be >= 0; reading 1 has -5000 ",
        ),
        ("100,300,", "100,0,", "length must be > 0; reading 1 has 0 "),
        ("100,290,", "100,290,1,", "line 3 has 4 numbers under 3 names"),
        ("100,300,", f"100,{'x' * 900},", "row 2: length is 'x{40}[.]{3}', not a number$"),
        (
            "length_mm",
            "x" * 900,
            "no column for length; the table has pressure_kPa, x{40}[.]{3}, force_N",
        ),
        ("length_mm", "contraction_mm", "unit 'mm': a contraction is .L0 - L./L0"),
        (
            "length_mm",
            "contraction",
            "contractions need the rest length",
        ),
        ("pressure", "# specimen: rest_lenght_mm = 3\npressure", "unknown entry.*'rest_lenght_mm'"),
        ("pressure", "# specimen: rest_length_mm = x\npressure", "not a number"),
        ("pressure", "# specimen: rest_length_mm = 3,5\npressure", "write a decimal point"),
        ("pressure", "# specimen: embedded = maybe\npressure", "true or false"),
        ("pressure", "# specimen: rest_length_mm = -3\npressure", "must be a positive length"),
    ],
)
def test_what_is_wrong_is_said(map_file: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_csv(_spoil(map_file, old, new))


def test_what_spreadsheets_make_of_a_map_is_read(map_file: Path, tmp_path: Path) -> None:
    """Filled up to the width of the widest line, with empty rows, and with decimal commas."""
    text = "# specimen: wall_thickness_mm = 1.5\n" + map_file.read_text()
    map_file.write_text(text)
    expected, path = read_csv(map_file), tmp_path / "saved.csv"
    filled = "".join(f"{line},,\n" for line in text.splitlines())
    path.write_text(f"\ufeff,,,,\n{filled},,,,\n\n", encoding="utf-8")
    assert read_csv(path).specimen.wall_thickness == 1.5e-3
    for name in ("force", "pressure", "length"):
        np.testing.assert_array_equal(getattr(read_csv(path), name), getattr(expected, name))
    halves = [(0.5 * k, 300 - 10.25 * k, 10 * k) for k in range(1, 5)]
    for separator in ";\t":
        head = separator.join(("force_N", "length_mm", "pressure_kPa"))
        rows = [separator.join(map(str, row)).replace(".", ",") for row in halves]
        path.write_text("\n".join([head, *rows]) + "\n")
        np.testing.assert_allclose(read_csv(path).length, [row[1] / 1e3 for row in halves])
        np.testing.assert_allclose(read_csv(path).force, [row[0] for row in halves])


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("100.000;300,5;20", "'100.000' has a point and '300,5' a comma"),
        ("100,000;300;20", "'100,000' may be 100.000 or 100000: say which sign"),
    ],
)
def test_a_doubtful_decimal_sign_is_refused(tmp_path: Path, row: str, message: str) -> None:
    path = tmp_path / "map.csv"
    path.write_text(f"pressure_Pa;length_mm;force_N\n{row}\n")
    with pytest.raises(InputError, match=message):
        read_csv(path)


def test_contractions_are_lengths_of_the_rest_length(map_file: Path, tmp_path: Path) -> None:
    text = "# specimen: rest_length_mm = 300\n# specimen: name = map\n" + map_file.read_text()
    map_file.write_text(text)
    expected = read_csv(map_file)
    for unit, size in (("", 1.0), ("_%", 100.0), ("_percent", 100.0)):
        rows = text.replace(",length_mm,", f",contraction{unit},")
        for length in (300, 290, 280, 270):
            rows = rows.replace(f",{length},", f",{size * (300 - length) / 300!r},")
        path = tmp_path / "contraction.csv"
        path.write_text(rows)
        found = read_csv(path)
        np.testing.assert_allclose(found.length, expected.length, rtol=1e-14)
        assert np.unique(found.lengths.level).size == 4
        assert read_csv(path, {"rest_length": 0.6}).length[0] == pytest.approx(0.6)
    path.write_text("force_N,pressure_kPa,contraction,contraction_std_%\n10,100,0.1,1\n")
    with pytest.raises(InputError, match="contractions need the rest length"):
        read_csv(path)
    one = read_csv(path, {"rest_length": 0.3})
    assert one.length_std == pytest.approx(0.003)
    path.write_text("force_N,pressure_kPa,contraction\n10,100,100\n")
    with pytest.raises(InputError, match=r"contraction is 100; .* lies below 1: write percent"):
        read_csv(path, {"rest_length": 0.3})
    path.write_text("force_N,pressure_kPa,contraction,length_mm\n10,100,0.1,1\n")
    with pytest.raises(InputError, match="'length' and 'contraction' say the same"):
        read_csv(path)


def test_files_that_are_no_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_csv(tmp_path / "none.csv")
    with pytest.raises(InputError, match="cannot read"):
        read_csv(tmp_path)
    empty = tmp_path / "empty.csv"
    empty.write_text("")
    with pytest.raises(InputError, match="the file is empty"):
        read_csv(empty)
    empty.write_text("pressure_kPa,length_mm,force_N\n")
    with pytest.raises(InputError, match="no readings"):
        read_csv(empty)
    empty.write_bytes(b"\0" * 500)
    with pytest.raises(InputError, match="it is not a text file"):
        read_csv(empty)
    empty.write_bytes(b"\xff\xfe\x00pressure")
    with pytest.raises(InputError, match="it is not a text file"):
        read_csv(empty)


def test_arrays_are_checked_like_files() -> None:
    specimen = Specimen("s", 0.3, 0.0018)
    good = np.array([1.0, 2.0])
    with pytest.raises(InputError, match="all 2 readings are slack"):
        ForceData(-good, good, good, specimen)
    with pytest.raises(InputError, match="length has shape"):
        ForceData(good, good, good[:1], specimen)
    with pytest.raises(InputError, match=r"pressure \(gauge pressure, not absolute\) must be >= 0"):
        ForceData(good, -good, good, specimen)
    with pytest.raises(InputError, match="force of reading 2 is nan"):
        ForceData(np.array([1.0, np.nan]), good, good, specimen)
    with pytest.raises(InputError, match="does not fit twice"):
        Specimen("s", 0.3, 0.01, bladder_diameter=0.02)


def test_hash_follows_the_numbers_not_the_format(tmp_path: Path) -> None:
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    a.write_text("# specimen: name = x\npressure_kPa,length_mm,force_N\n100,250,10\n")
    b.write_text("# specimen: name = x\nforce_N;pressure_Pa;length_m\n10;100000;0.25\n")
    assert read_csv(a).sha256 == read_csv(b).sha256
    b.write_text("# specimen: name = x\nforce_N;pressure_Pa;length_m\n10;100001;0.25\n")
    assert read_csv(a).sha256 != read_csv(b).sha256


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("E_1_MPa", "must read name_unit=min:max"),
        ("E_1_MPa=a:b", "is not min:max"),
        ("E_1_MPa=1:2:3", "is not min:max"),
        ("E_1_mm=1:2", "'mm' is not a known unit of stress"),
        ("wall_mm=1:2", "unknown parameter"),
    ],
)
def test_bounds_that_cannot_be_read(entry: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_bounds([entry])
    with pytest.raises(InputError, match="given twice"):
        parse_bounds(["E_1_MPa=1:2", "E_1_kPa=1:2"])


def test_a_file_may_say_which_readings_are_at_one_level(tmp_path: Path) -> None:
    path, again = tmp_path / "map.csv", tmp_path / "again.csv"
    readings = "pressure_kPa,length_mm,force_N\n99,250,10\n103,250,11\n150,250,20\n152,240,18\n"
    path.write_text("# level: pressure_tolerance_kPa = 5\n" + readings)
    data = read_csv(path)
    assert data.pressures.level.tolist() == [101e3, 101e3, 151e3, 151e3]
    assert read_csv(write_csv(data, again, "us")).pressures.level.tolist() == pytest.approx(
        data.pressures.level.tolist()
    )
    for line, message in (
        ("pressure_kPa = 5", "must read pressure_tolerance_kPa = 5"),
        ("pressure_tolerance_kPa = few", "is 'few', not a number"),
        ("pressure_tolerance_mm = 5", "'mm' is not a known unit of pressure"),
    ):
        path.write_text(f"# level: {line}\n" + readings)
        with pytest.raises(InputError, match=message):
            read_csv(path)


def test_a_map_is_read_from_a_stream() -> None:
    text = "\ufeff" + "# specimen: rest_length_mm = 100\n# specimen: nominal_diameter_mm = 10\n"
    text += "pressure_kPa,length_mm,force_N\n100,100,50\n200,100,90\n200,90,40\n"
    assert read_csv(io.StringIO(text)).force.tolist() == [50.0, 90.0, 40.0]
    with pytest.raises(InputError, match="a stream: the file is empty"):
        read_csv(io.StringIO(""))


SPREADSHEET = [
    "Pressure (kPa),Length (mm),Force [N]",
    "PRESSURE [kpa],length mm,Force (n)",
    "pressure_kPa,Length_mm,force_N",
]


@pytest.mark.parametrize("header", SPREADSHEET)
def test_headers_as_a_spreadsheet_has_them(tmp_path: Path, header: str) -> None:
    path = tmp_path / "map.csv"
    path.write_text(f"{header}\n100,250,300\n200,250,400\n100,240,200\n")
    data = read_csv(path)
    assert data.pressure.tolist() == [1e5, 2e5, 1e5]
    assert data.length.tolist() == [0.25, 0.25, 0.24]
    assert data.units == {"pressure": "kPa", "length": "mm", "force": "N"}


@pytest.mark.parametrize(
    ("header", "says"),
    [
        ("Presure (psi),length_mm,force_N", "did you mean pressure_psi?"),
        ("pressure_kPa,lenght_mm,force_N", "did you mean length_mm?"),
        ("pressure_mpa,length_mm,force_N", "unknown unit 'mpa'"),  # milli or mega: not guessed
        ("pressure_kPa,Pressure (psi),length_mm,force_N", "2 columns for pressure"),
        ("Pressure,length_mm,force_N", "has no unit"),
    ],
)
def test_what_is_near_a_known_name_is_named_and_what_is_ambiguous_refused(
    tmp_path: Path, header: str, says: str
) -> None:
    path = tmp_path / "map.csv"
    path.write_text(f"{header}\n" + "1," * header.count(",") + "1\n")
    with pytest.raises(InputError, match=re.escape(says)):
        read_csv(path)


@pytest.mark.parametrize(
    ("key", "near"),
    [("rest_lenght_mm", "rest_length_mm"), ("rest_length", "rest_length_m"),
     ("nominal_diamter_in", "nominal_diameter_in"), ("embeded", "embedded")],
)  # fmt: skip
def test_a_misspelt_key_of_the_specimen_has_a_hint(key: str, near: str) -> None:
    with pytest.raises(InputError, match=re.escape(f"did you mean {near}")):
        parse_specimen([f"{key}=1"])


def test_a_bore_that_holds_no_bladder_names_bore_and_wall() -> None:
    with pytest.raises(InputError, match="check wall_thickness and nominal_diameter"):
        Specimen("a", 0.25, 1.8e-3, bladder_diameter=3e-3)


@pytest.mark.slow
def test_a_file_that_has_not_been_read_is_no_map() -> None:
    """In a process whose annotations are not checked, as a user's."""
    script = """if True:
        import jax, fitting
        jax.config.update("jax_enable_x64", True)
        together = lambda one: fitting.identify_together([one])
        swept = lambda one: fitting.sweep(one, None)
        for use in fitting.identify, fitting.choose, swept, fitting.compare, together:
            try:
                use("map.csv")
            except fitting.InputError as error:
                print(error)
    """
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    said = "a force map must be a fitting.ForceData, got 'map.csv': fitting.read_csv(path) reads a file"
    assert [line.startswith(said) for line in done.stdout.splitlines()] == [True] * 5
