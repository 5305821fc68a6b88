"""JPEG files that decode without a word: the spoilt ones are refused, the sound ones never."""

import dataclasses
import functools
import io
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image
from rendering import (
    CameraSensor,
    Jpeg,
    damaged,
    published_ruler,
    published_scene,
    render_ruler,
)
from slow_cases import slow_after

from imaging import ImagingError, read_image
from imaging.errors import UnreadableImage
from imaging.photograph import Header, find_seam, read_header, sizes_of
from tests.imaging.photographs import photograph

SIZE = (1060, 440)
LAST = slice(-200, None)  # rows behind the spoilt bit; the muscle's end and a tape are in them
FELT = 8.0  # levels of brightness that the muscle moves by in them, twice what is looked for
UNFELT = 1.0  # levels: one step of the coding


@functools.cache
def photo(subsampling="422"):
    scene = dataclasses.replace(published_scene(0.1, size=SIZE), jpeg=Jpeg(92, subsampling))
    return photograph(scene, 7)


@pytest.mark.parametrize("subsampling", ["444", "422", "420"])
def test_a_flipped_bit_that_moves_the_rest_of_the_picture_is_refused(tmp_path, subsampling):
    data, path = photo(subsampling).jpeg(), tmp_path / "flipped.jpg"
    sound = luma(photo(subsampling).rgb)[LAST]
    muscle = sound > 60
    moved, refused = [], []
    for seed in range(60):
        path.write_bytes(damaged(data, "flipped", seed))
        read = read_or_refused(path)
        if isinstance(read, ImagingError):
            refused.append(read)
        else:
            moved.append(float(np.median((luma(read)[LAST] - sound)[muscle])))
    assert np.abs(moved).max() < FELT
    assert np.sum(np.abs(moved) <= UNFELT) >= 25  # one block of 8 x 8 px, which is left
    seams = [error for error in refused if "jump_levels" in error.figures]
    assert len(seams) >= 2
    assert all(error.path == str(path) and "copy it again" in str(error) for error in seams)
    assert all(abs(float(error.figures["jump_levels"])) >= 4 for error in seams)


def read_or_refused(path):
    try:
        return read_image(path)
    except ImagingError as error:
        return error


def luma(rgb):
    return cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(float)


def test_the_error_says_where_and_how_far(tmp_path):
    """A seam made by hand: the level of all units from one in the middle of a row on."""
    rgb = photo().rgb.astype(int)
    rgb[480:488, 200:] += 9
    rgb[488:] += 9
    header = Header(rows=8, step=0.7)
    seam = find_seam(np.clip(rgb, 0, 255).astype(np.uint8), header)
    assert seam is not None
    row, height = seam
    assert row == 480
    assert height == pytest.approx(9, abs=1.5)


SOUND = {
    "muscle": lambda: photo().rgb,
    "lying": lambda: np.ascontiguousarray(np.rot90(photo().rgb)),
    "noisy": lambda: (
        photograph(
            dataclasses.replace(
                published_scene(0.2, size=SIZE), sensor=CameraSensor(full_well=240)
            ),
            1,
        ).rgb
    ),
    "ruler": lambda: render_ruler(published_ruler(size=SIZE), 1).rgb,
    "slope without noise": lambda: np.repeat(
        np.add.outer(np.linspace(5, 60, 800), np.linspace(0, 20, 500))[..., None], 3, axis=2
    ).astype(np.uint8),
    "horizon": lambda: horizon(0.7),
    "sharpened horizon": lambda: np.clip(2.0 * horizon(0.8) - horizon(1.3), 0, 255).astype(
        np.uint8
    ),
    "noise": lambda: np.random.default_rng(0).integers(0, 255, (480, 400, 3), dtype=np.uint8),
}


def horizon(blur):
    """An edge across the whole picture along a row of blocks, as blurred as the best lens does it."""
    rgb = np.full((800, 400, 3), 25.0) + np.random.default_rng(0).normal(0, 2, (800, 400, 1))
    rgb[400:] += 120
    return np.clip(cv2.GaussianBlur(rgb, (0, 0), blur), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("progressive", slow_after(1, [False, True]))
@pytest.mark.parametrize("name", SOUND)
def test_sound_files_of_any_quality_are_read(tmp_path, name, progressive):
    rgb, path = SOUND[name](), tmp_path / "sound.jpg"
    for quality in (30, 60, 90, 98):
        for subsampling in ("444", "422", "420"):
            factor = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{subsampling}")
            options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factor,
                       cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)]  # fmt: skip
            cv2.imwrite(str(path), rgb[..., ::-1], options)
            assert read_image(path).shape == rgb.shape


def test_the_header_of_a_file():
    for subsampling, rows in (("444", 8), ("422", 8), ("420", 16)):
        header = read_header(photo(subsampling).jpeg())
        assert header.rows == rows
        assert header.ended
        # The standard's table begins with 16 and 17, and quality 92 leaves 16 % of it.
        assert header.step == pytest.approx(3 / 8 * 1.772)
    assert not read_header(damaged(photo().jpeg(), "truncated")).ended


def test_a_previews_end_is_not_the_files(tmp_path):
    """A file that is cut off, though a whole preview stands in its header."""
    preview = io.BytesIO()
    Image.fromarray(photo().rgb[:160, :120]).save(preview, "jpeg")
    body = photo().jpeg()
    block = b"Exif\0\0" + preview.getvalue()
    whole = body[:2] + b"\xff\xe1" + (len(block) + 2).to_bytes(2, "big") + block + body[2:]
    path = tmp_path / "cut.jpg"
    path.write_bytes(whole)
    assert read_image(path).shape == (*SIZE, 3)
    path.write_bytes(whole[: len(block) + len(body) // 2])
    with pytest.raises(UnreadableImage, match="FF D9"):
        read_image(path)


def test_what_a_camera_adds_after_the_end_is_no_damage(tmp_path):
    path = tmp_path / "trailer.jpg"
    path.write_bytes(photo().jpeg() + bytes(9000))
    np.testing.assert_array_equal(read_image(path), photo().rgb)


def test_a_header_of_more_pixels_than_a_picture_has_is_refused_before_decoding(tmp_path):
    size = (60_000).to_bytes(4, "big")
    path = tmp_path / "bomb.png"
    chunks = b"IHDR" + size + size + b"\x08\x02\0\0\0", b"IDAT" + zlib.compress(bytes(99)), b"IEND"
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + b"".join(
            (len(chunk) - 4).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
            for chunk in chunks
        )
    )
    with pytest.raises(UnreadableImage, match="178 Mpx at most"):
        read_image(path)
    assert sizes_of(path) == []
