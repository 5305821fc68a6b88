"""Reading force maps: units, specimen, and every way in which a file can be wrong."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting import ForceData, InputError, Specimen, load_bundled, read_csv, write_csv
from fitting.cli.problem import parse_bounds
from fitting.faults import thick_wall
from fitting.specimen import parse_specimen


def test_bundled_maps_are_the_published_tables() -> None:
    """Sizes and largest forces of Martens & Boblan 2017, tables A1 and A2."""
    for name, readings, loaded, largest in (
        ("DMSP-20-300", 126, 60, 1653.5),
        ("DMSP-10-250", 85, 40, 542.5),
    ):
        data = load_bundled(name)
        assert data.force.size == readings
        assert (data.loaded.sum(), data.max_force) == (loaded, largest)
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
        ("force_N", "torque_Nm", "no column for force; the table has pressure_kPa, length_mm, torque_Nm"),
        ("length_mm,", "", "line 2 has 3 numbers under 2 names"),
        ("length_mm", "force_kN", "2 columns for force .force_kN, force_N.: say which, --column force="),
        ("100,300,", "100,300mm,", "row 2: length is '300mm', not a number"),
        ("100,300,", "100,,", "row 2: length is missing; take the row out, or write what was read"),
        ("100,300,", "100,nan,", "row 2: length is nan; every value must be finite"),
        ("100,300,", "inf,300,", "row 2: pressure is inf"),
        ("100,300,", "-5,300,", "pressure .gauge.* must be >= 0; reading 1 has -5000 "),
        ("100,300,", "100,0,", "length must be > 0; reading 1 has 0 "),
        ("100,290,", "100,290,1,", "line 3 has 4 numbers under 3 names"),
        ("100,300,", f"100,{'x' * 900},", "row 2: length is 'x{40}[.]{3}', not a number$"),
        ("length_mm", "x" * 900, "no column for length; the table has pressure_kPa, x{40}[.]{3}, force_N"),
        ("length_mm", "contraction_mm", "unit 'mm': a contraction is .L0 - L./L0"),
        ("length_mm", "contraction", "contractions need the rest length"),
        ("pressure", "# specimen: rest_lenght_mm = 3\npressure", "unknown entry.*'rest_lenght_mm'"),
        ("pressure", "# specimen: rest_length_mm = x\npressure", "not a number"),
        ("pressure", "# specimen: rest_length_mm = 3,5\npressure", "write a decimal point"),
        ("pressure", "# specimen: embedded = maybe\npressure", "true or false"),
        ("pressure", "# specimen: rest_length_mm = -3\npressure", "must be a positive length"),
        ("pressure", "# level: pressure_kPa = 5\npressure", "must read pressure_tolerance_kPa = 5"),
        ("pressure", "# level: pressure_tolerance_kPa = few\npressure", "is 'few', not a number"),
        ("pressure", "# level: pressure_tolerance_mm = 5\npressure", "'mm' is not a known unit of"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(map_file: Path, old: str, new: str, message: str) -> None:
    text = map_file.read_text()
    assert old in text
    map_file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_csv(map_file)


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


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"", "the file is empty"),
        (b"pressure_kPa,length_mm,force_N\n", "no readings"),
        (b"\0" * 500, "it is not a text file"),
        (b"\xff\xfe\x00pressure", "it is not a text file"),
    ],
)
def test_files_that_are_no_map(tmp_path: Path, content: bytes | None, message: str) -> None:
    if content is not None:
        (tmp_path / "map.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_csv(tmp_path / "map.csv")


ONE_TWO = np.array([1.0, 2.0])
OF = Specimen("s", 0.3, 0.0018)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ForceData(-ONE_TWO, ONE_TWO, ONE_TWO, OF), "all 2 readings are slack"),
        (lambda: ForceData(ONE_TWO, ONE_TWO, ONE_TWO[:1], OF), "length has shape"),
        (lambda: ForceData(ONE_TWO * [1, np.nan], ONE_TWO, ONE_TWO, OF), "force of reading 2 is nan"),
        (lambda: Specimen("s", 0.3, 0.01, bladder_diameter=0.02), "does not fit twice"),
        (lambda: parse_bounds(["E_1_MPa"]), "must read name_unit=min:max"),
        (lambda: parse_bounds(["E_1_MPa=a:b"]), "is not min:max"),
        (lambda: parse_bounds(["E_1_MPa=1:2:3"]), "is not min:max"),
        (lambda: parse_bounds(["E_1_mm=1:2"]), "'mm' is not a known unit of stress"),
        (lambda: parse_bounds(["wall_mm=1:2"]), "unknown parameter"),
        (lambda: parse_bounds(["E_1_MPa=1:2", "E_1_kPa=1:2"]), "given twice"),
    ],
)  # fmt: skip
def test_arrays_and_bounds_are_checked_like_files(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_a_file_may_say_which_readings_are_at_one_level(tmp_path: Path) -> None:
    path, again = tmp_path / "map.csv", tmp_path / "again.csv"
    readings = "pressure_kPa,length_mm,force_N\n99,250,10\n103,250,11\n150,250,20\n152,240,18\n"
    path.write_text("# level: pressure_tolerance_kPa = 5\n" + readings)
    data = read_csv(path)
    assert data.pressures.level.tolist() == [101e3, 101e3, 151e3, 151e3]
    assert read_csv(write_csv(data, again, "us")).pressures.level.tolist() == pytest.approx(
        data.pressures.level.tolist()
    )


def test_noise_about_zero_is_slack(dmsp10: ForceData) -> None:
    noise = np.random.default_rng(1).normal(0, 0.5, dmsp10.force.size)
    noisy = dataclasses.replace(dmsp10, force=dmsp10.force + noise, slack_below=None, count=None)
    np.testing.assert_array_equal(noisy.slack, dmsp10.slack)
    assert "count as slack: readings below zero show that much noise" in noisy.notes[-1]
    pushing = dataclasses.replace(
        dmsp10, force=np.where(dmsp10.slack, -30.0, dmsp10.force), slack_below=None, count=None
    )
    assert pushing.slack_below == 0.0
