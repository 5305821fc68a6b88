"""JPEG files that are cut off or scrambled are refused; sound ones of any quality are read."""

import functools
import io
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image
from rendering import damaged, published_scene

from imaging import read_image
from imaging.errors import DamagedImage, UnreadableImage
from imaging.photograph import sizes_of
from tests.imaging.photographs import photograph

SIZE = (530, 220)


@functools.cache
def photo():
    return photograph(published_scene(0.1, size=SIZE), 7)


def test_a_decoder_s_complaint_is_an_error(tmp_path):
    path, refused = tmp_path / "scrambled.jpg", 0
    for seed in range(8):
        path.write_bytes(damaged(photo().jpeg(), "scrambled", seed))
        try:
            read_image(path)
        except DamagedImage as error:
            refused += "the decoder must not complain" in str(error)
    assert refused >= 6


@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("subsampling", ["444", "422", "420"])
def test_sound_files_of_any_quality_are_read(tmp_path, subsampling, progressive):
    factor = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{subsampling}")
    for quality in (30, 60, 90, 98):
        options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factor,
                   cv2.IMWRITE_JPEG_PROGRESSIVE, int(progressive)]  # fmt: skip
        cv2.imwrite(str(tmp_path / "sound.jpg"), photo().rgb[..., ::-1], options)
        assert read_image(tmp_path / "sound.jpg").shape == (*SIZE, 3)


def test_a_preview_s_end_is_not_the_file_s(tmp_path):
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
    with pytest.raises((UnreadableImage, DamagedImage)):
        read_image(path)


def test_a_heic_file_is_read(tmp_path):
    heif = pytest.importorskip("pillow_heif")
    heif.from_pillow(Image.fromarray(photo().rgb)).save(tmp_path / "a.heic", quality=95)
    seen = read_image(tmp_path / "a.heic").astype(float)
    assert np.abs(seen - photo().rgb).mean() < 4


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
