"""Recipes as files: every choice in them, with units in the keys."""

import tomllib

import numpy as np
import pytest

from imaging import Recipe, Scale, Tone, write_recipe

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
