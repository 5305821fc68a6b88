"""Recipes as files: every choice in them, back to the same bits, units in the keys."""

import dataclasses

import numpy as np
import pytest

from imaging import ImagingError, Recipe, Scale, Tone, read_recipe, write_recipe

RULER = Scale(8922.4409, 0.0892, 0.31, 0.021, 97, "ruler", -0.02, 0.002, 0.0016, 0.0003)
PLAIN = Recipe(Scale.manual(8922.0, 0.1))
FULL = Recipe(
    RULER, distance=61 * 0.0254, centre=(501.25, 1330.0), crop_offset=(1459, 531),
    frame_size=(5568, 3712), k1=-0.01, tone=Tone(np.linspace(0, 1, 256) ** 2.1),
    orientation="auto", braid_angle=True,
)  # fmt: skip


@pytest.mark.parametrize("recipe", [PLAIN, FULL], ids=["plain", "full"])
def test_a_recipe_comes_back_to_the_same_bits(tmp_path, recipe):
    path = write_recipe(recipe, tmp_path / "recipe.toml")
    assert read_recipe(path) == recipe
    assert write_recipe(read_recipe(path), tmp_path / "again.toml").read_text() == path.read_text()


def written(tmp_path, text, scale="[scale]\npx_per_m = 8922.0\nstderr_px_per_m = 0.1\n"):
    path = tmp_path / "recipe.toml"
    path.write_text(text + scale)
    return path


def test_a_person_may_write_any_unit_and_leave_out_what_has_a_default(tmp_path):
    path = written(tmp_path, "distance_in = 60\n")
    expected = dataclasses.replace(PLAIN, distance=1.524)
    found = read_recipe(path)
    assert found == dataclasses.replace(expected, distance=found.distance)
    assert found.distance == pytest.approx(1.524, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (
            "distance_ft = 5\n",
            "unknown key .*; valid keys: .*distance_<m.cm.mm.um.in>",
        ),
        ("distance = 5\n", "unknown key 'distance'; valid keys: .*distance_<m.cm"),
        ("distance_m = 1.5\ndistance_in = 60\n", "distance is given twice"),
        ("colour = 5\n", "unknown key 'colour'; valid keys: .*distance_<m.cm.mm.um.in>"),
        ("orientation = 'guess'\n", "orientation must be vertical or horizontal or auto"),
        ("distance_m = 'far'\n", "distance_m must be a number, got 'far'"),
        ("format = 'famjax recipe 9'\n", "must have the format 'famjax recipe 1'"),
        ("distance_m = \n", "not a TOML file"),
        ("tone = [0.0, 1.0]\n", "256 finite values"),
    ],
)
def test_what_cannot_be_a_recipe_is_refused_with_the_path(tmp_path, text, match):
    path = written(tmp_path, text)
    with pytest.raises(ImagingError, match=match) as caught:
        read_recipe(path)
    assert caught.value.path == str(path)


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
