"""Files of pictures: damage, quality, orientation, time stamps; tone curves; errors on their way."""

import functools
import io
import pickle
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps
from rendering import CameraSensor, damaged, published_scene

from imaging import ImagingError, Tone, errors, read_image, read_timestamp
from imaging.errors import DamagedImage, UnreadableImage
from imaging.photograph import Timestamp, sizes_of
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
            refused += "the decoder reports" in str(error)
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
    data = b"\x89PNG\r\n\x1a\n"
    for chunk in chunks:
        data += (len(chunk) - 4).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    path.write_bytes(data)
    with pytest.raises(UnreadableImage, match="at most 178 Mpx"):
        read_image(path)
    assert sizes_of(path) == []


@pytest.mark.parametrize("kind", ["jpg", "tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_every_orientation_is_undone(orientation, kind, tmp_path):
    """Of a file whose pixels lie as a camera held so would have them."""
    exif, path = Image.Exif(), tmp_path / f"one.{kind}"
    exif[0x0112] = orientation
    undone = {1: None, 2: 0, 3: 3, 4: 1, 5: 5, 6: 2, 7: 6, 8: 4}[orientation]
    picture = Image.fromarray(photo().rgb)
    stored = picture if undone is None else picture.transpose(Image.Transpose(undone))
    stored.save(path, exif=exif, quality=97, subsampling=0)
    with Image.open(path) as picture:
        by_pillow = np.asarray(ImageOps.exif_transpose(picture))
    read = read_image(path)
    assert read.shape == photo().rgb.shape
    assert np.abs(read.astype(int) - by_pillow).mean() < 0.5
    assert np.abs(read.astype(int) - photo().rgb).mean() < 3


def stamped(path, taken, fraction=None):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x9003] = taken
    if fraction is not None:
        exif.get_ifd(0x8769)[0x9291] = fraction
    Image.new("RGB", (8, 8)).save(path, exif=exif)
    return path


def test_a_stamp_has_the_digits_that_the_camera_writes(tmp_path):
    whole = read_timestamp(stamped(tmp_path / "a.jpg", "2021:03:04 05:06:07"))
    assert whole == Timestamp(1614834367.0, 1.0)
    fine = read_timestamp(stamped(tmp_path / "b.jpg", "2021:03:04 05:06:07", "250"))
    assert fine == Timestamp(1614834367.25, pytest.approx(1e-3))
    # A picture without a clock has no stamp.
    assert read_timestamp(stamped(tmp_path / "a.jpg", "0000:00:00 00:00:00")) is None
    Image.new("RGB", (8, 8)).save(tmp_path / "b.jpg")
    assert read_timestamp(tmp_path / "b.jpg") is None
    (tmp_path / "c.jpg").write_bytes(b"no picture")
    assert read_timestamp(tmp_path / "c.jpg") is None
    assert read_timestamp(tmp_path / "missing.jpg") is None


def test_the_tone_of_a_rendered_sensor_is_that_of_the_standard():
    np.testing.assert_allclose(CameraSensor().tone().table, Tone.srgb().table, atol=1e-4)


KINDS = [k for k in vars(errors).values() if isinstance(k, type) and issubclass(k, ImagingError)]


@pytest.mark.parametrize("kind", KINDS)
def test_error_survives_the_way_between_processes(kind):
    figures = {"blur_px": 6.25, "tapes": 1}
    again = pickle.loads(pickle.dumps(kind("too little", path="a/b.jpg", **figures)))
    assert type(again) is kind
    assert (again.message, again.path, again.figures) == ("too little", "a/b.jpg", figures)
    assert str(again) == "a/b.jpg: too little [blur_px = 6.25, tapes = 1]"
