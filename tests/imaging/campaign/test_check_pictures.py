"""What is drawn of a campaign for people to check."""

import cv2
import numpy as np
import pytest
from rendering import damaged, published_scene

from imaging import Recipe, Scale, Table
from imaging.campaign import POSITION, Row, measured_row
from imaging.pictures import (
    Tile,
    choose,
    contact_sheet,
    plot_table,
    write_check_pictures,
)
from tests.imaging.photographs import marked, photograph


def test_a_contact_sheet_shows_every_picture_in_the_frame_of_its_fate():
    grey = np.full((300, 100, 3), 128, np.uint8)
    tiles = [Tile(grey, f"img{k}.jpg", "L 9.28 in", ok=k != 2) for k in range(5)]
    tiles.append(Tile(None, "gone.jpg", "UnreadableImage: no such file \u00e9", ok=False))
    sheet = contact_sheet(tiles, columns=3)
    assert sheet.dtype == np.uint8
    green, red = marked(sheet, (60, 160, 60)), marked(sheet, (210, 40, 40))
    assert len(green[0]) > len(red[0]) > 1000
    assert sheet.shape[1] > sheet.shape[0]
    assert contact_sheet(tiles[:1]).shape[0] < sheet.shape[0]


def test_the_reason_of_a_failure_is_told_below_its_picture():
    """One line of words for a good picture, as many as it takes, up to four, for a failed one."""
    short = contact_sheet([Tile(None, "a.jpg", "L 9.28 in", ok=True)])
    long = contact_sheet([Tile(None, "a.jpg", "NoMuscle: " + 30 * "words and ", ok=False)])
    lines = (long.shape[0] - short.shape[0]) / 15
    assert lines == 3
    assert (long[-20:] < 200).any()


def test_a_damaged_picture_is_shown_and_a_vanished_one_is_not(tmp_path):
    scene = published_scene(0.1, size=(400, 166))
    shot = photograph(scene, 1)
    (tmp_path / "bad.jpg").write_bytes(damaged(shot.jpeg(), "scrambled", 3))
    good = shot.save(tmp_path / "good.jpg")
    (row,) = [measured_row(str(good), Recipe(Scale.manual(scene.camera.px_per_m)))]
    assert not row.error
    bad = Row(str(tmp_path / "bad.jpg"), error="DamagedImage: the decoder must not complain")
    files = write_check_pictures(
        Table.from_rows([row, bad]), Recipe(Scale.manual(scene.camera.px_per_m)), tmp_path / "out"
    )
    sheet = cv2.imread(str(files[0]))
    halves = sheet[20:220, :248], sheet[20:220, 248:]
    assert all(half.std() > 30 for half in halves)  # neither is a grey tile
    assert len(list((tmp_path / "out" / "overlays").iterdir())) == 1
    good.unlink()
    write_check_pictures(Table.from_rows([row]), Recipe(Scale.manual(1.0)), tmp_path / "gone")
    assert not list((tmp_path / "gone" / "overlays").iterdir())


def table(n_good, n_failed):
    good = [
        Row(f"{k}.jpg", numbers={"length": 0.2 - 1e-3 * k, "length_stderr": 1e-5,
                                 "mean_diameter": 0.03, "mean_diameter_stderr": 1e-5},
            diameter=np.full(POSITION.shape, 0.03), seconds=float(k))
        for k in range(n_good)
    ]  # fmt: skip
    failed = [Row(f"bad{k}.jpg", error="NoMuscle: none") for k in range(n_failed)]
    return Table.from_rows([*good, *failed])


@pytest.mark.parametrize(
    ("n_good", "n_failed", "good", "failed"),
    [
        (100, 0, 12, 0),
        (100, 50, 8, 4),
        (100, 1, 11, 1),
        (3, 50, 3, 9),
        (0, 50, 0, 12),
        (2, 1, 2, 1),
    ],
)
def test_pictures_to_look_at_are_spread_over_the_stroke_and_over_those_that_failed(
    n_good, n_failed, good, failed
):
    chosen = choose(table(n_good, n_failed), 12)
    assert (chosen < n_good).sum() == good
    assert (chosen >= n_good).sum() == failed
    assert len(set(chosen)) == len(chosen)
    if n_good == 100:
        assert {0, 99} <= set(chosen)


def test_lengths_are_drawn_over_time_though_a_failed_picture_has_no_stamp():
    labels = [axes.get_xlabel() for axes in plot_table(table(5, 2)).axes]
    assert labels.count("time, s") == 2


@pytest.mark.parametrize("parts", [(30, 3), (0, 3), (3, 0)])
@pytest.mark.parametrize("system", ["us", "si"])
def test_plots_say_their_units_and_stand_a_campaign_that_failed(parts, system):
    figure = plot_table(table(*parts), system)
    unit = {"us": "in", "si": "m"}[system]
    labels = [axes.get_xlabel() for axes in figure.axes]
    assert f"z, {unit}" in labels
    profiles = figure.axes[0]
    assert len(profiles.lines) == parts[0]


def test_one_picture_has_no_plot_over_time():
    labels = [axes.get_xlabel() for axes in plot_table(table(1, 0)).axes]
    assert labels == ["z, in", "picture"]


def test_unreadable_pictures_get_a_tile_and_no_overlay(tmp_path):
    recipe = Recipe(Scale.manual(1000.0, 0.1))
    files = write_check_pictures(table(0, 2), recipe, tmp_path, number=4)
    assert [path.name for path in files] == ["contact_sheet.png", "profiles.png", "overlays"]
    assert list((tmp_path / "overlays").iterdir()) == []
