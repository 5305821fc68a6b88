"""Time stamps of pictures, from files that are written here."""

import pytest

from imaging import read_timestamp
from imaging.photograph import Timestamp, date_text


def stamped(path, taken, fraction=None):
    from PIL import Image

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
    assert date_text(fine.seconds) == "2021-03-04T05:06:07.250"


def test_a_picture_without_a_clock_has_no_stamp(tmp_path):
    from PIL import Image

    assert read_timestamp(stamped(tmp_path / "a.jpg", "0000:00:00 00:00:00")) is None
    Image.new("RGB", (8, 8)).save(tmp_path / "b.jpg")
    assert read_timestamp(tmp_path / "b.jpg") is None
    (tmp_path / "c.jpg").write_bytes(b"no picture")
    assert read_timestamp(tmp_path / "c.jpg") is None
    assert read_timestamp(tmp_path / "missing.jpg") is None
