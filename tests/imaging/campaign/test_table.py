"""The table of a campaign and its files, read back by other programs."""

import csv
import io

import numpy as np
import pytest
from rendering import stroke_log, triangle_stroke

from famjax.app.photographs import with_log
from fitting.records import synchronise
from imaging import Table
from imaging.campaign import POSITION

IN = 0.0254
REST = 9.28125 * IN
SCALE = 1e-4  # relative standard error common to all lengths
START = 1614834367.0


def row(k, length, seconds=START):
    numbers = {
        "length": length, "length_stderr": float(np.hypot(2e-5, SCALE * length)),
        "mean_diameter": 1.4 * IN, "mean_diameter_stderr": 1e-5, "max_diameter": 1.9 * IN,
        "volume": 14.0 * IN**3, "volume_stderr": 1e-8, "px_per_m": 226.63 / IN,
        "roll_deg": 0.5, "x0": 1e-3, "blur_px": 1.2, "tape_blur_px": np.nan,
    }  # fmt: skip
    diameter = 1.4 * IN + 0.5 * IN * np.sin(np.pi * POSITION) * (1 - length / REST)
    return {"path": f"img{k}.jpg", "numbers": numbers, "diameter": diameter,
            "diameter_stderr": np.full(POSITION.shape, 1e-5), "seconds": seconds,
            "resolution": 1e-3}  # fmt: skip


STROKE = triangle_stroke(0.3, 240.0)
TIMES = 2.0 + 5.0 * np.arange(40)


def table(**options):
    rng = np.random.default_rng(0)
    lengths = REST * (1 - STROKE(TIMES)) + 2e-5 * rng.standard_normal(40)
    rows = [row(k, float(L), START + 5.0 * k) for k, L in enumerate(lengths)]
    bad = {"path": 'bad, "odd".jpg', "error": "NoMuscle: nothing, at\nall"}
    rows[7] = bad | {"seconds": START + 35.0}
    return Table.from_rows(rows, scale_relative_stderr=SCALE, **options)


def test_a_picture_from_another_camera_distance_is_rejected():
    rows = [row(k, REST) for k in range(4)]
    for k, distance in enumerate((1.52, 1.50, 0.345, 1.53)):
        rows[k]["numbers"] |= {"distance": distance, "distance_stderr": 0.18 * distance**2}
    found = Table.from_rows(rows)
    assert found.ok.tolist() == [True, True, False, True]
    assert "camera distance of 345 mm" in found.error[2]


def cells(text):
    return list(csv.DictReader(io.StringIO(text)))


@pytest.mark.parametrize(
    ("system", "length", "volume", "scale"),
    [("us", ("length_in", IN), ("volume_in3", IN**3), ("px_per_in", 1 / IN)),
     ("metric", ("length_mm", 1e-3), ("volume_mm3", 1e-9), ("px_per_mm", 1e3)),
     ("si", ("length_m", 1.0), ("volume_m3", 1.0), ("px_per_m", 1.0))],
)  # fmt: skip
def test_the_csv_has_one_row_per_picture_in_the_units_of_its_columns(system, length, volume, scale):
    found = table()
    rows = cells(found.csv_text(system))
    assert len(rows) == 40
    name, unit = length
    for wanted in ("path", "ok", "error", name, name.replace("_", "_stderr_"), f"mean_diameter_{name[7:]}",
                   "contraction", "contraction_stderr", "roll_deg", "time_s", "blur_px"):  # fmt: skip
        assert wanted in rows[0]
    assert float(rows[3][name]) * unit == pytest.approx(found["length"][3], rel=1e-9)
    assert float(rows[3][volume[0]]) * volume[1] == pytest.approx(14 * IN**3, rel=1e-9)
    assert float(rows[3][scale[0]]) * scale[1] == pytest.approx(226.63 / IN, rel=1e-9)
    good, bad = rows[3], rows[7]
    assert (good["ok"], good["tape_blur_px"]) == ("true", "")
    assert (bad["ok"], bad["path"], bad[name]) == ("false", 'bad, "odd".jpg', "")
    assert bad["error"].startswith("NoMuscle: nothing")


def test_contraction_against_a_picture_loses_the_error_of_the_scale():
    found = table()
    longest = int(np.nanargmax(found["length"]))
    L, L0 = found["length"], found["length"][longest]
    np.testing.assert_allclose(found["contraction"], 1 - L / L0, rtol=1e-12)
    expected = L / L0 * np.hypot(2e-5 / L, 2e-5 / L0)
    expected[longest] = 0
    np.testing.assert_allclose(found["contraction_stderr"], expected, rtol=1e-6)
    assert f"img{longest}.jpg" in found.notes[0]


def test_the_log_gives_each_picture_its_force_with_the_error_of_interpolation():
    found = table()
    t = np.arange(0, 240, 0.1)
    log = stroke_log(STROKE, t, REST)
    clock = synchronise(found["time"], found["length"], log)
    merged = with_log(found, log, clock)
    truth = np.interp(TIMES, t, log.force)
    assert clock.offset == pytest.approx(2.0, abs=0.02)
    away = np.abs(merged["force"] - truth)
    assert np.all(away <= 4 * merged["force_stderr"])
    assert merged["force_stderr"].max() < 0.001 * np.ptp(log.force)
    assert merged["pressure"][3] == pytest.approx(log.pressure[0])
    assert "force_lbf" in cells(merged.csv_text("us"))[0]
    assert "pressure_kPa" in cells(merged.csv_text("metric"))[0]
    assert any("clock" in note for note in merged.notes)


def test_xarray_reads_the_netcdf_with_units_profiles_and_provenance(tmp_path):
    xarray = pytest.importorskip("xarray")
    found = table(provenance={"ruler_sha256": "ab" * 32})
    path = found.write_netcdf(tmp_path / "table.nc")
    with xarray.open_dataset(path, engine="scipy") as data:
        np.testing.assert_array_equal(data["length_m"], found["length"])
        assert data["length_m"].attrs["units"] == "m"
        assert data["volume_m3"].attrs["units"] == "m3"
        np.testing.assert_array_equal(data["diameter_m"], found.diameter)
        assert data["diameter_m"].dims == ("picture", "position")
        assert [str(p) for p in data["path"].values] == list(found.path)
        assert str(data["error"].values[7]).startswith("NoMuscle")
        assert data["ok"].values.tolist() == found.ok.astype(int).tolist()
        assert data.attrs["ruler_sha256"] == "ab" * 32
        assert data.attrs["rest_length_m"] == found.rest_length
        middle = data["diameter_m"].sel(picture=10).interp(position=0.5)
        assert float(middle) == pytest.approx(found.diameter[10, 100])
