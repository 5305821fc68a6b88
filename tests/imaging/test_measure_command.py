"""`famjax measure` from photographs, ruler and log to the files."""

import csv
import json
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from rendering import published_ruler, published_scene, render, render_ruler, sequence

from imaging import Recipe, Scale, Tone, write_recipe
from imaging.cli import RecipeOptions, command_recipe
from imaging.errors import MixedSizes
from imaging.pictures import check_sizes

IN, LBF, PSI = 0.0254, 4.4482216152605, 6894.757293168361
SIZE = (660, 280)
STROKE = sequence.triangle_stroke(0.3, 60.0)
TIMES = 3.0 + 6.0 * np.arange(9)


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A folder with nine pictures of a stroke and the ruler's, and the machine's log beside it."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "photos").mkdir()
    render_ruler(published_ruler(size=SIZE), 1).save(folder / "photos" / "ruler.jpg")
    scene = published_scene(0.0, size=SIZE)
    truth = []
    taken = sequence.render_sequence(scene, STROKE, TIMES, clock_offset=20.0, seed=5)
    for k, photo in enumerate(taken):
        photo.save(folder / "photos" / f"img{k + 1}.jpg")
        truth.append(photo.truth)
    record = sequence.stroke_log(STROKE, np.arange(0, 60, 0.05), scene.muscle.length)
    columns = record.time, record.displacement / IN, record.force / LBF, record.pressure / PSI
    names = "time_s,displacement_in,force_lbf,pressure_psi"
    file, data = folder / "log.csv", np.stack(columns, 1)
    np.savetxt(file, data, "%.7g", delimiter=",", header=names, comments="")
    return SimpleNamespace(folder=folder, photos=folder / "photos", truth=truth, record=record)


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_a_stroke_becomes_a_table_with_force_and_what_a_person_checks(lab, tmp_path, said):
    out, ruler = tmp_path / "out", lab.photos / "ruler.jpg"
    told = said("measure", lab.photos, "--ruler", ruler, "--log", lab.folder / "log.csv", "--jobs", 1,
                "--output", out, "--overlays", 3, "--units", "us", "--json")  # fmt: skip
    document = json.loads(told)
    assert document["ok"] == document["pictures"] == 9
    assert any("--tape-diameter" in note for note in document["notes"])
    rows = table(out / "measurements.csv")
    assert [row["path"].rsplit("img")[-1] for row in rows] == [f"{k}.jpg" for k in range(1, 10)]
    length = np.array([float(row["length_in"]) for row in rows])
    # 56 px/in here: two tape edges a tenth of a pixel off, and the scale of a coarse ruler.
    np.testing.assert_allclose(length, [t.length / IN for t in lab.truth], atol=0.012)
    force = np.array([float(row["force_lbf"]) for row in rows]) * LBF
    truth = np.interp(TIMES, lab.record.time, lab.record.force)
    assert np.abs(force - truth).max() < 0.01 * np.ptp(lab.record.force)
    recipe = tomllib.loads((out / "recipe.toml").read_text())
    assert recipe["scale"]["source"] == "ruler"
    assert recipe["scale"]["px_per_m"] == pytest.approx(lab.truth[0].px_per_m, rel=5e-4)
    assert len(list((out / "overlays").glob("*.jpg"))) == 3
    assert (out / "measurements.nc").stat().st_size > 1000


@pytest.mark.slow
def test_a_bad_picture_is_code_3_and_another_scale_measures_again(lab, tmp_path, run):
    picture = tmp_path / "cloth.jpg"
    render(published_scene(0.1, size=SIZE), 3).save(tmp_path / "good.jpg")
    picture.write_bytes(b"\xff\xd8 no picture")
    px_per_in = lab.truth[0].px_per_m * IN
    arguments = ["measure", tmp_path / "good.jpg", picture, "--output", tmp_path / "a", "--jobs", 1,
                 "--overlays", 0, "--units", "metric", "--scale"]  # fmt: skip
    code, told, _ = run(*arguments, f"{px_per_in}+-0.1 px/in")
    assert code == 3
    assert "1 of 2 pictures measured" in told
    assert "UnreadableImage" in told
    good, bad = table(tmp_path / "a" / "measurements.csv")
    assert float(good["length_mm"]) == pytest.approx(9.28125 * 0.9 * 25.4, abs=0.3)
    assert (bad["ok"], bad["length_mm"]) == ("false", "")
    assert run(*arguments, "60+-0.1 px/in")[0] == 3
    assert float(table(tmp_path / "a" / "measurements.csv")[0]["px_per_mm"]) < 2.4


SCALED, RULED = ["PHOTOS", "--scale", "56 px/in"], ["PHOTOS", "--ruler", "RULER"]
LOGGED = [*SCALED, "--log", "LOG", "--column"]


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["PHOTOS"], "the scale must be stated exactly once"),
        (["PHOTOS", "--scale", "56", "--distance", "60in"], "a number with an error and a unit"),
        ([*SCALED, "--ruler", "RULER"], "the scale must be stated exactly once"),
        ([*SCALED, "--distance", "60"], "has no unit"),
        ([*SCALED, "--crop-offset", "1459"], "two numbers"),
        ([*SCALED, "--crop-offset", "14,5", "--frame-size", "20,20"], "frame"),
        ([*SCALED, "--log", "NO"], "no such file"),
        ([*LOGGED, "displacement=no"], "this must match one column"),
        ([*LOGGED, "displacement=1 [psi]"], "unknown unit 'psi'"),
        ([*LOGGED, "force"], "must have the form name=value"),
        (["missing*.jpg", "--scale", "56 px/in"], "or a pattern that matches"),
        (["PHOTOS", "--ruler", "missing.jpg"], "UnreadableImage"),
        ([*SCALED, "--ruler-placement", "0.01in"], "require a ruler"),
        ([*RULED, "--ruler-placement=-1mm"], "placement_stderr"),
    ],
)
def test_input_that_cannot_be_used_is_code_2_at_once(lab, tmp_path, refused, arguments, match):
    names = {"PHOTOS": lab.photos, "RULER": lab.photos / "ruler.jpg", "NO": tmp_path / "no.csv",
             "LOG": lab.folder / "log.csv"}  # fmt: skip
    words = [names.get(one, one) for one in arguments]
    refused(match, "measure", *words, "--output", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_how_well_a_ruler_was_placed_is_an_option(lab):
    ruler = lab.photos / "ruler.jpg"
    found, provenance = command_recipe(RecipeOptions(ruler=ruler, ruler_placement="0.06in"))
    assert found.scale.px_per_m == pytest.approx(lab.truth[0].px_per_m, rel=5e-4)
    assert found.scale.relative_stderr == pytest.approx(1e-3, rel=0.02)  # 0.06 in of 60
    assert provenance["ruler"] == str(ruler)


def test_a_ruler_of_another_size_is_refused(tmp_path):
    """Other pixels; or the same ones, of a frame that the camera took with others."""

    def saved(name, size, taken):
        exif = Image.Exif()
        exif.get_ifd(0x8769).update({0xA002: taken[0], 0xA003: taken[1]})
        Image.new("RGB", size).save(tmp_path / name, exif=exif)
        return str(tmp_path / name)

    plain = Recipe(Scale.manual(9000.0))
    muscle = saved("muscle.jpg", (300, 200), (600, 400))
    check_sizes(saved("alike.jpg", (300, 200), (600, 400)), [muscle], plain)
    for size, taken in (((450, 300), (600, 400)), ((300, 200), (300, 200))):
        with pytest.raises(MixedSizes, match="cropped and scaled alike"):
            check_sizes(saved("ruler.jpg", size, taken), [muscle], plain)
    whole = saved("whole.jpg", (600, 400), (600, 400))
    cropped = Recipe(Scale.manual(9000.0), crop_offset=(10, 10), frame_size=(600, 400))
    check_sizes(whole, [muscle], cropped)


RULER = Scale(8922.4409, 0.0892, 0.31, 0.021, 97, "ruler", -0.02, 0.002, 0.0016, 0.0003)
FULL = Recipe(
    RULER, distance=61 * 0.0254, centre=(501.25, 1330.0), crop_offset=(1459, 531),
    frame_size=(5568, 3712), k1=-0.01, tone=Tone(np.linspace(0, 1, 256) ** 2.1),
    orientation="auto", braid_angle=True,
)  # fmt: skip


def test_a_recipe_is_written_with_units_in_its_keys(tmp_path):
    told = tomllib.loads(write_recipe(FULL, tmp_path / "recipe.toml").read_text())
    assert told["distance_m"] == FULL.distance
    assert told["crop_offset"] == [1459, 531]
    assert told["scale"]["stderr_px_per_m"] == RULER.stderr
    np.testing.assert_array_equal(told["tone"], FULL.tone.table)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"orientation": "diagonal"}, "orientation"),
        ({"distance": 0.0}, "distance"),
        ({"crop_offset": (10.0, 10.0)}, "frame_size"),
    ],
)
def test_a_recipe_that_cannot_be_followed_is_refused(options, match):
    with pytest.raises(ValueError, match=match):
        Recipe(Scale.manual(9000.0), **options)
