"""Pictures are read as their EXIF orientation says that they are to be shown."""

import numpy as np
import pytest
from PIL import Image, ImageOps
from rendering import published_scene, render

from imaging import Recipe, Scale, measure, read_image

SCENE = published_scene(0.175, size=(1060, 440))
ORIENTATION = 0x0112


@pytest.fixture(scope="module")
def photo():
    return render(SCENE, 1)


def saved(rgb, orientation, path):
    """A file whose pixels lie as a camera held so would have them."""
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    undone = {1: None, 2: 0, 3: 3, 4: 1, 5: 5, 6: 2, 7: 6, 8: 4}[orientation]
    picture = Image.fromarray(rgb)
    stored = picture if undone is None else picture.transpose(Image.Transpose(undone))
    stored.save(path, exif=exif, quality=97, subsampling=0)
    return path


@pytest.mark.parametrize("kind", ["jpg", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_is_undone(orientation, kind, photo, tmp_path):
    path = saved(photo.rgb, orientation, tmp_path / f"one.{kind}")
    with Image.open(path) as picture:
        by_pillow = np.asarray(ImageOps.exif_transpose(picture))
    read = read_image(path)
    assert read.shape == photo.rgb.shape
    assert np.abs(read.astype(int) - by_pillow).mean() < 0.5
    assert np.abs(read.astype(int) - photo.rgb).mean() < 3


@pytest.mark.parametrize("orientation", [6, 7])
def test_a_portrait_from_a_phone_is_measured(orientation, photo, tmp_path):
    path = saved(photo.rgb, orientation, tmp_path / "phone.jpg")
    camera = SCENE.camera
    found = measure(path, Recipe(Scale.manual(camera.px_per_m), camera.distance))
    assert abs(found.length - photo.truth.length) < 4 * found.length_stderr
    assert abs(found.mean_diameter - photo.truth.mean_diameter) < 4 * found.mean_diameter_stderr
