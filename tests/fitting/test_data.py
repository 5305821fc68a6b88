"""Force maps: files in any unit, every way in which one can be wrong, levels, pandas and xarray."""

import dataclasses

import numpy as np
import pytest

import fitting
from fitting import ForceData, InputError, Specimen, load_bundled, read_csv, write_csv
from fitting.cli.problem import parse_bounds
from fitting.data import MOST_APART, groups_of_levels, levels_of
from fitting.faults import thick_wall
from fitting.specimen import parse_specimen


def test_bundled_maps_are_the_published_tables():
    """Sizes and largest forces of Martens & Boblan 2017, tables A1 and A2."""
    for name, *known in (("DMSP-20-300", 126, 60, 1653.5), ("DMSP-10-250", 85, 40, 542.5)):
        data = load_bundled(name)
        assert [data.force.size, data.loaded.sum(), data.max_force] == known
        assert data.specimen.embedded
        assert not data.notes


def test_units_are_converted_and_order_does_not_matter(tmp_path):
    path = tmp_path / "us.csv"
    path.write_text("force_lbf;length_in;pressure_psi\n10;10;20\n5;9;20\n0;8;10\n")
    data = read_csv(path)
    np.testing.assert_allclose(data.force, [44.482216152605, 22.2411080763025, 0])
    np.testing.assert_allclose(data.length, [0.254, 0.2286, 0.2032])
    np.testing.assert_allclose(data.pressure, [137895.1458633, 137895.1458633, 68947.57293168])
    assert data.specimen.rest_length == pytest.approx(0.254)
    assert any("rest length was not given" in note for note in data.notes)
    assert any("wall thickness was not given" in note for note in data.notes)


@pytest.mark.parametrize(("bore", "wall"), [("20", 1.8e-3), ("10", 1.8e-3), ("5", 0.9e-3)])
def test_the_wall_that_is_assumed_fits_the_bore(tmp_path, bore, wall):
    """1.8 mm in a bore of 5 mm would be blamed on a user who never said it."""
    path = tmp_path / "small.csv"
    readings = "force_N,length_mm,pressure_kPa\n90,99,300\n50,95,300\n"
    path.write_text(f"# specimen: nominal_diameter_mm = {bore}\n" + readings)
    data = read_csv(path)
    assert data.specimen.wall_thickness == pytest.approx(wall)
    assert any(f"{wall * 1e3:.3g} mm is assumed" in note for note in data.notes)
    assert not thick_wall(data)


def test_specimen_lines_and_overrides(map_file):
    map_file.write_text("# a remark\n# specimen: rest_length_in = 12\n" + map_file.read_text())
    assert read_csv(map_file).specimen.rest_length == pytest.approx(0.3048)
    given = parse_specimen(["rest_length_mm=310", "name=mine"])
    specimen = read_csv(map_file, given).specimen
    assert (specimen.rest_length, specimen.name) == (0.31, "mine")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("force_N", "torque_Nm", "no column for force; the table has pressure_kPa, length_mm, torque_Nm"),
        ("length_mm,", "", "line 2 has 3 numbers, but the header has 2 names"),
        ("length_mm", "force_kN", "2 columns match force .force_kN, force_N.: choose one with --column"),
        ("100,300,", "100,300mm,", "row 2: length is '300mm', not a number"),
        ("100,300,", "100,,", "row 2: length is missing; remove the row, or fill in the cell"),
        ("100,300,", "100,nan,", "row 2: length is 'nan', not a number"),
        ("100,300,", "inf,300,", "row 2: pressure is 'inf'"),
        ("100,300,", "-5,300,", "pressure of reading 1 is -5000 .*finite and >= 0 .gauge pressure"),
        ("100,300,", "100,0,", "length of reading 1 is 0 .*finite and > 0"),
        ("100,290,", "100,290,1,", "line 3 has 4 numbers, but the header has 3 names"),
        ("100,300,", f"100,{'x' * 900},", "row 2: length is 'x{40}[.]{3}', not a number;"),
        ("length_mm", "x" * 900, "no column for length; the table has pressure_kPa, x{40}[.]{3}, force_N"),
        ("length_mm", "contraction_mm", "unit of a length: a contraction is .L0 - L./L0"),
        ("length_mm", "contraction", "contractions require the rest length"),
        ("pressure", "# specimen: rest_lenght_mm = 3\npressure", "unknown specimen.*'rest_lenght_mm'"),
        ("pressure", "# specimen: rest_length_mm = x\npressure", "not a number"),
        ("pressure", "# specimen: rest_length_mm = 3,5\npressure", "use a decimal point"),
        ("pressure", "# specimen: embedded = maybe\npressure", "true or false"),
        ("pressure", "# specimen: rest_length_mm = -3\npressure", "must be a positive length"),
        ("pressure", "# level: pressure_kPa = 5\npressure", "must have the form pressure_tolerance"),
        ("pressure", "# level: pressure_tolerance_kPa = few\npressure", "its unit .*got 'fewkPa'"),
        ("pressure", "# level: pressure_tolerance_mm = 5\npressure", "'mm' is not a known unit of"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(map_file, old, new, message):
    text = map_file.read_text()
    assert old in text
    map_file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_csv(map_file)


def test_contractions_are_lengths_of_the_rest_length(map_file, tmp_path):
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
    with pytest.raises(InputError, match="contractions require the rest length"):
        read_csv(path)
    assert read_csv(path, {"rest_length": 0.3}).length_std == pytest.approx(0.003)
    path.write_text("force_N,pressure_kPa,contraction\n10,100,100\n")
    with pytest.raises(InputError, match=r"length of reading 1 .*contraction_% .percent"):
        read_csv(path, {"rest_length": 0.3})
    path.write_text("force_N,pressure_kPa,contraction,length_mm\n10,100,0.1,1\n")
    with pytest.raises(InputError, match="'length' and 'contraction' are redundant"):
        read_csv(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"", "the file is empty"),
        (b"pressure_kPa,length_mm,force_N\n", "no readings"),
        (b"\0" * 500, "this is not a text file"),
        (b"\xff\xfe\x00pressure", "this is not a text file"),
    ],
)
def test_files_that_are_no_map(tmp_path, content, message):
    if content is not None:
        (tmp_path / "map.csv").write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_csv(tmp_path / "map.csv")


ONE_TWO = np.array([1.0, 2.0])
SPECIMEN = Specimen("measured", 0.3, 0.002, nominal_diameter=0.02)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: ForceData(-ONE_TWO, ONE_TWO, ONE_TWO, SPECIMEN), "all 2 readings are slack"),
        (lambda: ForceData(ONE_TWO, ONE_TWO, ONE_TWO[:1], SPECIMEN), "length has shape"),
        (lambda: ForceData(ONE_TWO * [1, np.nan], ONE_TWO, ONE_TWO, SPECIMEN), "force of reading 2 is nan"),
        (lambda: Specimen("s", 0.3, 0.01, bladder_diameter=0.02), "must be thinner than half"),
        (lambda: parse_bounds(["E_1_MPa"]), "must have the form name_unit=min:max"),
        (lambda: parse_bounds(["E_1_MPa=a:b"]), "must have the form name_unit=min:max"),
        (lambda: parse_bounds(["E_1_MPa=1:2:3"]), "must have the form name_unit=min:max"),
        (lambda: parse_bounds(["E_1_mm=1:2"]), "'mm' is not a known unit of stress"),
        (lambda: parse_bounds(["wall_mm=1:2"]), "unknown parameter"),
        (lambda: parse_bounds(["E_1_MPa=1:2", "E_1_kPa=1:2"]), "given twice"),
    ],
)  # fmt: skip
def test_arrays_and_bounds_are_checked_like_files(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_a_file_may_say_which_readings_are_at_one_level(tmp_path):
    path, again = tmp_path / "map.csv", tmp_path / "again.csv"
    readings = "pressure_kPa,length_mm,force_N\n99,250,10\n103,250,11\n150,250,20\n152,240,18\n"
    path.write_text("# level: pressure_tolerance_kPa = 5\n" + readings)
    data = read_csv(path)
    assert data.pressures.level.tolist() == [101e3, 101e3, 151e3, 151e3]
    level = read_csv(write_csv(data, again, "us")).pressures.level
    assert level == pytest.approx(data.pressures.level)


def test_noise_about_zero_is_slack(dmsp10):
    noise = np.random.default_rng(1).normal(0, 0.5, dmsp10.force.size)
    unsaid = {"slack_below": None, "count": None}
    noisy = dataclasses.replace(dmsp10, force=dmsp10.force + noise, **unsaid)
    np.testing.assert_array_equal(noisy.slack, dmsp10.slack)
    assert "count as slack: readings below zero show noise of this size" in noisy.notes[-1]
    force = np.where(dmsp10.slack, -30.0, dmsp10.force)
    assert dataclasses.replace(dmsp10, force=force, **unsaid).slack_below == 0.0


def measured(values: np.ndarray, times: int, std: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, std, (times, values.size))
    return (values + noise).ravel()


@pytest.mark.parametrize("seed", range(100, 120))
@pytest.mark.parametrize(("times", "std"), [(2, 20.0), (3, 150.0), (8, 300.0)])
def test_readings_about_nominal_pressures_find_their_level(seed, times, std):
    rng = np.random.default_rng(seed)
    nominal = rng.choice(np.arange(40e3, 640e3, 20e3), rng.integers(4, 20), replace=False)
    found = levels_of(measured(nominal, times, std, seed), "pressure")
    expected = np.tile(np.arange(nominal.size)[np.argsort(np.argsort(nominal))], times)
    np.testing.assert_array_equal(np.unique(found.level, return_inverse=True)[1], expected)
    assert "derived from the gaps" in found.note


@pytest.mark.parametrize("seed", range(20))
def test_no_levels_are_seen_where_there_are_none(seed):
    values = np.random.default_rng(seed).uniform(0, 6e5, 40)
    found = levels_of(values, "pressure")
    np.testing.assert_array_equal(found.level, values)
    assert found.tolerance == 0
    assert "do not separate them into levels" in found.note


@pytest.mark.parametrize("seed", range(20))
def test_values_that_a_gauge_rounds_are_on_the_level_that_was_set(seed):
    """Readings at seven set pressures and eight lengths, rounded so that most values repeat."""
    grid = np.meshgrid(np.arange(1, 8) * 70e3, np.arange(8) * 5e-3 + 0.2)
    pressure, length = (one.ravel() for one in grid)
    read = pressure + np.random.default_rng(seed).normal(0, 400, pressure.size)
    pressure = np.round(read / 1e3) * 1e3
    assert pressure.size >= 2 * np.unique(pressure).size
    found = ForceData(np.arange(1.0, 57.0), pressure, length, SPECIMEN).pressures
    expected = np.round(pressure / 70e3)
    np.testing.assert_array_equal(np.unique(found.level, return_inverse=True)[1], expected - 1)
    assert "derived from the gaps" in found.note


def test_neighbours_that_were_set_at_one_length_are_two_levels():
    """A fine grid beside a coarse one: 5 and 6 kPa were both measured at every length."""
    P, L = (g.ravel() for g in np.meshgrid([5e3, 6e3, 7e3, 300e3, 600e3], [0.3, 0.29, 0.28, 0.27]))
    found = ForceData(np.arange(1.0, 21.0), P, L, SPECIMEN).pressures
    np.testing.assert_array_equal(found.level, P)


def test_a_measured_pressure_is_left_out_with_its_neighbours():
    nominal = np.array([100e3, 200e3, 300e3])
    pressure = measured(nominal, 4, 60.0, seed=1)
    length = np.repeat([0.30, 0.29, 0.28, 0.27], 3)
    data = ForceData(pressure / 1e3, pressure, length, SPECIMEN)
    levels, counts = np.unique(data.left_out_as("pressure"), return_counts=True)
    assert counts.tolist() == [4, 4, 4]
    np.testing.assert_allclose(levels, nominal, atol=150)


def test_a_part_keeps_its_levels_and_every_column():
    pressure = np.array([1e5, 1.001e5, 2e5, 2.002e5, 3e5, 3.001e5])
    n = pressure.size
    data = ForceData(
        np.linspace(10.0, 60.0, n), pressure, np.linspace(0.2, 0.25, n), SPECIMEN,
        force_std=np.full(n, 0.5), pressure_tolerance=500.0, length_tolerance=1e-4,
    )  # fmt: skip
    part = data.part(data.pressure > 1.5e5)
    np.testing.assert_array_equal(part.force, data.force[2:])
    np.testing.assert_array_equal(part.force_std, data.force_std[2:])
    np.testing.assert_array_equal(part.pressures.level, data.pressures.level[2:])
    with pytest.raises(InputError, match="nothing to fit"):
        data.part(data.pressure > 1e6)


def test_levels_are_left_out_one_by_one_and_many_of_them_with_their_neighbours():
    few = np.array([3.0, 1.0, 2.0, 2.0, 9.0])
    assert groups_of_levels(few, np.array([1.0, 2.0, 3.0])).tolist() == [2, 0, 1, 1, -1]
    many = np.random.default_rng(0).permutation(1000.0 + np.arange(400))
    group = groups_of_levels(many, np.unique(many))
    assert np.bincount(group).tolist() == [10] * MOST_APART
    assert (np.diff(group[np.argsort(many)]) >= 0).all()


def test_a_fit_shows_itself_in_a_notebook_and_on_the_axes_it_is_given(dmsp10):
    found = fitting.identify(dmsp10, starts=1)
    shown = found._repr_html_()
    assert all(one in shown for one in ("Identified", "E_1 3.2", "RMSE", "data:image/png"))
    figure_module = pytest.importorskip("matplotlib.figure")
    for plot in (fitting.plot_isobars, type(found).plot):
        axes = figure_module.Figure().subplots()
        assert plot(found, axes, "us") is axes
        assert axes.get_xlabel()
        assert axes.lines
    force = fitting.plot_isobars(found, figure_module.Figure().subplots(), "si")
    drawn = np.nanmax(np.concatenate([line.get_ydata() for line in force.lines]))
    assert drawn == pytest.approx(float(found.muscle.force(dmsp10.length.max(), 6.5e5)), rel=1e-6)


def test_a_table_of_pandas_is_a_map_and_back(dmsp20):
    data, frame = dmsp20, dmsp20.to_pandas()
    assert list(frame) == ["force_N", "pressure_Pa", "length_m", "loaded"]
    again = ForceData.from_pandas(frame, data.specimen)
    np.testing.assert_array_equal(again.force, data.force)
    np.testing.assert_array_equal(again.length, data.length)
    other = frame.rename(columns={"length_m": "length_mm"}).assign(length_mm=1e3 * data.length)
    known = {k: v for k, v in dataclasses.asdict(data.specimen).items() if v is not None}
    np.testing.assert_allclose(ForceData.from_pandas(other, known).length, data.length)
    foreign = frame.rename(columns={"force_N": "Kanal 3"}).assign(counter=range(len(frame)))
    named = fitting.read_csv(foreign, known, {"force": "Kanal 3 [N]"})
    np.testing.assert_array_equal(named.force, data.force)
    assert "Ignored columns: counter." in named.notes


def test_a_data_set_of_xarray_is_a_map_and_back(dmsp10):
    assert ForceData.from_xarray(dmsp10.to_xarray()).sha256 == dmsp10.sha256
    xarray = pytest.importorskip("xarray")
    grid = xarray.Dataset(
        {"force_N": (("pressure_kPa", "length_mm"), [[30.0, np.nan], [60.0, 20.0]])},
        {"pressure_kPa": [100.0, 200.0], "length_mm": [250.0, 240.0]},
    )
    made = ForceData.from_xarray(grid, dmsp10.specimen)
    assert made.force.tolist() == [30.0, 60.0, 20.0]
    assert made.pressure.tolist() == [1e5, 2e5, 2e5]
