"""Tone curves against the standard, and against the camera that took the bracket."""

import dataclasses

import numpy as np
import pytest

from imaging.camera import Tone
from imaging.synthetic import CameraSensor, expose, published_scene, render_linear

BRACKET_S = (1 / 8, 1 / 4, 1 / 2, 1.0, 2.0, 4.0)
DEBEVEC = 0.06  # relative, from value 30 up: six JPEG pictures with the noise of ISO 3200
ROUNDING = 1e-4  # of a table of 65536 entries


def test_srgb_has_the_values_of_the_standard():
    table = Tone.srgb().table
    assert table[0] == 0
    assert table[255] == 1
    assert table[10] == pytest.approx(10 / 255 / 12.92, rel=1e-12)  # the straight part
    assert table[188] == pytest.approx(0.5029, abs=5e-5)  # half the light
    assert np.all(np.diff(table) > 0)


def test_sensor_and_tone_undo_each_other():
    for sensor in (
        CameraSensor(),
        CameraSensor(s_curve=0.7),
        CameraSensor(gamma=0.8),
        CameraSensor(gamma=1.25),
    ):
        encoded = sensor.encoded(sensor.tone().table)
        np.testing.assert_allclose(encoded, np.arange(256) / 255, atol=ROUNDING)
    np.testing.assert_allclose(CameraSensor().tone().table, Tone.srgb().table, atol=ROUNDING)


@pytest.mark.parametrize(
    "sensor", [CameraSensor(), CameraSensor(s_curve=1.0), CameraSensor(gamma=1.25)]
)
def test_bracket_returns_the_camera_curve(sensor):
    light = render_linear(published_scene(size=(500, 220)))
    pictures = [
        expose(light, k, sensor=dataclasses.replace(sensor, exposure=time)).rgb
        for k, time in enumerate(BRACKET_S)
    ]
    found, true = Tone.from_exposures(pictures, BRACKET_S).table, sensor.tone().table
    ratio = found[30:251] / true[30:251]
    assert np.abs(ratio / np.median(ratio) - 1).max() < DEBEVEC
    assert np.all(np.diff(found) >= 0)


def test_linear_is_the_table():
    image = np.array([[0, 128], [255, 7]], np.uint8)
    np.testing.assert_array_equal(Tone.srgb().linear(image), Tone.srgb().table[image])
    with pytest.raises(ValueError, match="8-bit"):
        Tone.srgb().linear(image.astype(float))


def test_equal_tables_are_equal_curves():
    assert Tone.srgb() == Tone(Tone.srgb().table)
    assert hash(Tone.srgb()) == hash(Tone(Tone.srgb().table))
    assert Tone.srgb() != Tone(np.linspace(0, 1, 256))


def test_curves_that_are_none_are_refused():
    with pytest.raises(ValueError, match="256 finite"):
        Tone(np.linspace(0, 1, 255))
    with pytest.raises(ValueError, match="never falls"):
        Tone(np.linspace(1, 0, 256))
    with pytest.raises(ValueError, match="never falls"):
        Tone(np.ones(256))


def test_brackets_that_are_none_are_refused():
    picture = np.zeros((20, 20, 3), np.uint8)
    with pytest.raises(ValueError, match="at least 3"):
        Tone.from_exposures([picture] * 2, [1, 2])
    with pytest.raises(ValueError, match="differ in exposure"):
        Tone.from_exposures([picture] * 3, [1, 1, 1])
    with pytest.raises(ValueError, match="one shape"):
        Tone.from_exposures([picture, picture, picture[:10]], [1, 2, 3])
