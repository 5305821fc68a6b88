"""Which files are pictures, and what is drawn of a campaign for a check by eye."""

import cv2
import numpy as np
import pytest
from rendering import published_scene

from imaging import ImagingError, Recipe, Scale, Table
from imaging.campaign import POSITION, Row, measured_row
from imaging.errors import ScaleContradiction
from imaging.pictures import (
    by_contraction,
    check_known_sizes,
    draw_overlays,
    draw_profiles,
    expand,
    skipped,
)
from tests.imaging.photographs import photograph


def table(n_good, n_failed):
    numbers = {"length_stderr": 1e-5, "mean_diameter": 0.03, "mean_diameter_stderr": 1e-5}
    good = [
        Row(f"{k}.jpg", numbers={"length": 0.2 - 1e-3 * k, **numbers},
            diameter=np.full(POSITION.shape, 0.03), seconds=float(k))
        for k in range(n_good)
    ]  # fmt: skip
    failed = [Row(f"bad{k}.jpg", error="NoMuscle: none") for k in range(n_failed)]
    return Table.from_rows([*good, *failed])


def test_files_folders_and_patterns_name_pictures_in_natural_order(tmp_path):
    for name in ("img10.JPG", "img9.jpg", "notes.txt", "ruler.png", "._img9.jpg"):
        (tmp_path / name).touch()
    ruler = str(tmp_path / "ruler.png")
    expected = [str(tmp_path / name) for name in ("img9.jpg", "img10.JPG")]
    assert expand([str(tmp_path)], without=ruler) == expected
    assert skipped([str(tmp_path), ruler]) == ["._img9.jpg", "notes.txt"]
    assert expand([str(tmp_path / "img*")]) == expected
    assert expand([expected[1], expected[0]]) == expected[::-1]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ImagingError, match="no folder with pictures"):
        expand([str(tmp_path / "empty")])


@pytest.mark.parametrize(("good", "failed", "drawn"), [(100, 50, 12), (3, 5, 3), (0, 5, 0)])
def test_pictures_to_look_at_are_spread_over_the_stroke(good, failed, drawn):
    chosen = by_contraction(table(good, failed), 12)
    assert len(set(chosen)) == drawn
    if good == 100:
        assert {0, 99} <= set(chosen) <= set(range(good))


def test_overlays_are_of_the_pictures_that_were_measured_and_are_still_there(tmp_path):
    scene = published_scene(0.1, size=(400, 166))
    good = photograph(scene, 1).save(tmp_path / "good.jpg")
    recipe = Recipe(Scale.manual(scene.camera.px_per_m))
    rows = [measured_row(str(good), recipe), Row("bad.jpg", error="NoMuscle: none")]
    rows.append(Row(**{**vars(rows[0]), "path": str(tmp_path / "gone.jpg")}))
    folder = draw_overlays(Table.from_rows(rows), recipe, tmp_path / "overlays", 12)
    (drawn,) = folder.iterdir()
    assert drawn.name == "000001_good.jpg"
    blue, green, red = cv2.split(cv2.imread(str(drawn)).astype(np.int32))
    assert np.count_nonzero((red - green > 60) & (red - blue > 60)) > 100


@pytest.mark.parametrize("parts", [(30, 3), (0, 3), (1, 0)])
def test_profiles_are_drawn_of_any_campaign(tmp_path, parts):
    assert draw_profiles(table(*parts), tmp_path / "profiles.png", "metric").stat().st_size > 1000


@pytest.mark.parametrize(
    ("rest", "diameter", "refused"),
    [(0.2, 0.028, ""), (None, None, ""), (0.38, None, ""), (0.45, None, "rest length of 450 mm"),
     (0.185, None, "rest length of 185 mm"), (0.2, 0.012, "nominal diameter of 12 mm"),
     (0.2, 0.06, "nominal diameter of 60 mm")],
)  # fmt: skip
def test_a_scale_that_a_known_size_contradicts_is_refused_by_its_name(rest, diameter, refused):
    if not refused:
        check_known_sizes(table(3, 1), rest, diameter)
        return
    with pytest.raises(ScaleContradiction, match=refused):
        check_known_sizes(table(3, 1), rest, diameter)
