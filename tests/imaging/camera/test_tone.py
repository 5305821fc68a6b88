"""Tone curves against the standard, and against the camera that took the bracket."""

import numpy as np
import pytest
from rendering import CameraSensor

from imaging import Tone

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
