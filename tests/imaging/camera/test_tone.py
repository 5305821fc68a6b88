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


def test_the_tone_of_a_rendered_sensor_is_that_of_the_standard():
    np.testing.assert_allclose(CameraSensor().tone().table, Tone.srgb().table, atol=ROUNDING)
