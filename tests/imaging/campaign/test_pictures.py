"""Which files are pictures, and what is drawn of a campaign for a check by eye."""

import numpy as np
import pytest

from imaging import ImagingError, Table, draw_overlay
from imaging.errors import ScaleContradiction
from imaging.measurement import Trace
from imaging.pictures import check_known_sizes, expand


def table(n_good, n_failed):
    numbers = {"length_stderr": 1e-5, "mean_diameter": 0.03, "mean_diameter_stderr": 1e-5}
    good = [
        {"path": f"{k}.jpg", "numbers": {"length": 0.2 - 1e-3 * k, **numbers}}
        for k in range(n_good)
    ]
    failed = [{"path": f"bad{k}.jpg", "error": "NoMuscle: none"} for k in range(n_failed)]
    return Table.from_rows([*good, *failed])


def test_files_folders_and_patterns_name_pictures_in_natural_order(tmp_path):
    for name in ("img10.JPG", "img9.jpg", "notes.txt", "ruler.png", "._img9.jpg"):
        (tmp_path / name).touch()
    ruler = str(tmp_path / "ruler.png")
    expected = [str(tmp_path / name) for name in ("img9.jpg", "img10.JPG")]
    assert expand([str(tmp_path)], without=ruler) == expected
    assert expand([str(tmp_path / "img*")]) == expected
    assert expand([expected[1], expected[0]]) == expected[::-1]
    (tmp_path / "empty").mkdir()
    with pytest.raises(ImagingError, match="a folder with pictures"):
        expand([str(tmp_path / "empty")])


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


def marked(image, colour):
    """v and u of the pixels of a colour, a third as bright or more: lines fade at their sides."""
    pixels, wanted = image.astype(float), np.array(colour, float)
    bright = np.linalg.norm(pixels, axis=2)
    like = pixels @ wanted / np.maximum(bright, 1) / np.linalg.norm(wanted)
    return np.nonzero((like > 0.998) & (bright > np.linalg.norm(wanted) / 3))


def test_lines_lie_where_the_edges_were_found():
    def bulge(rows):
        return 10 * np.sin(np.pi * (rows - 20) / 160)

    rows, across = np.arange(20.0, 181.0), np.linspace(40, 80, 30)
    ends = [np.stack([across, np.full(30, v)]) for v in (20.0, 180.0)]
    trace = Trace(rows, 40 - bulge(rows), 80 + bulge(rows), *ends, turned=False)
    drawn = draw_overlay(np.zeros((200, 120, 3), np.uint8), trace)
    v, u = marked(drawn, (255, 40, 40))
    assert len(v) > 150
    assert np.abs(u - np.where(u < 60, 40 - bulge(v), 80 + bulge(v))).max() < 1.1
    v, u = marked(drawn, (255, 220, 0))
    assert set(v) == {20, 180}
    v, u = marked(drawn, (0, 230, 230))
    assert set(u) == {60}
