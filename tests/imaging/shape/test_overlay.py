"""What was found in a picture, drawn on it."""

import numpy as np

from imaging import draw_overlay
from imaging.measurement import Trace
from tests.imaging.photographs import marked

RED, YELLOW, CYAN = (255, 40, 40), (255, 220, 0), (0, 230, 230)


def trace(turned=False):
    rows = np.arange(20.0, 181.0)
    bulge = 10 * np.sin(np.pi * (rows - 20) / 160)
    across = np.linspace(40, 80, 30)
    ends = [np.stack([across, np.full(30, v)]) for v in (20.0, 180.0)]
    return Trace(rows, 40 - bulge, 80 + bulge, *ends, turned)


def test_lines_lie_where_the_edges_were_found():
    drawn = draw_overlay(np.zeros((200, 120, 3), np.uint8), trace())
    v, u = marked(drawn, RED)
    side = np.where(u < 60, 40 - 10 * np.sin(np.pi * (v - 20) / 160),
                    80 + 10 * np.sin(np.pi * (v - 20) / 160))  # fmt: skip
    assert len(v) > 150
    assert np.abs(u - side).max() < 1.1
    v, u = marked(drawn, YELLOW)
    assert set(v) == {20, 180}
    v, u = marked(drawn, CYAN)
    assert set(u) == {60}
