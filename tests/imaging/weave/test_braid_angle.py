"""The braid angle of rendered weaves against the strands' own, its error, and where there is none."""

import functools
import math

import numpy as np
import pytest
from rendering import INCH, CameraSensor, Jpeg, Lens, random_scene
from slow_cases import slow_after

from imaging import Table, measure
from imaging.campaign import measured_row
from imaging.weave import Unrolled, Waves, count_yarns, shines
from tests.imaging.photographs import changed, photograph, recipe_of

WITHIN = math.radians(0.3)


@functools.cache
def scene(seed, strands=36, **changes):
    made = random_scene(seed, px_per_in=(150.0, 170.0), length=8.0 * INCH)
    return changed(made, {"strands": strands, "flecks": 0.0, "turns": 0.95}, **changes)


CASES = {
    "36 strands": (1, {}),
    "48 strands": (2, {"strands": 48}),
    "24 strands": (3, {"strands": 24}),
    "blurred, noisy, JPEG 60": (4, {
        "lens": Lens(blur_px=1.6), "sensor": CameraSensor(500.0), "jpeg": Jpeg(60, "420"),
    }),
    "lying": (5, {"lying": True}),
}  # fmt: skip


@pytest.mark.parametrize("case", slow_after(3, CASES))
def test_the_angle_is_that_of_the_strands(case):
    seed, changes = CASES[case]
    made = scene(seed, **changes)
    photo = photograph(made, 3)
    found = measure(photo.rgb, recipe_of(made, braid_angle=True, orientation="auto"))
    truth, braid = photo.truth, found.braid
    if not made.lying:
        assert braid.yarns == made.muscle.strands
    true = np.interp(braid.z / found.length, truth.z / truth.length, truth.braid_angle)
    error = (braid.angle - true)[braid.resolved]
    assert error.size > 8
    assert np.sqrt(np.mean(error**2)) < WITHIN
    assert np.all(np.abs(error) < 3.5 * braid.stderr[braid.resolved])  # of each window
    assert abs(error.mean()) < WITHIN / 2
    assert braid.turns == pytest.approx(truth.turns, rel=0.01)


def test_next_to_the_tapes_there_is_no_angle_and_a_table_holds_it(tmp_path):
    made = scene(1)
    photo = photograph(made, 3)
    found = measure(photo.rgb, recipe_of(made, braid_angle=True))
    braid = found.braid
    assert braid.z[0] == 0
    assert braid.z[-1] == pytest.approx(found.length)
    assert not braid.refusal
    assert 0.7 < braid.part < 1
    assert np.isnan([braid.angle[0], braid.angle[-1]]).all()
    middle = braid.z.size // 2
    assert 0 < braid.stderr[middle] < WITHIN < braid.angle[middle]
    path = photo.save(tmp_path / "one.jpg")
    rows = [measured_row(str(path), recipe_of(made, braid_angle=True))]
    table = Table.from_rows(rows)
    assert table["braid_angle_deg"][0] == pytest.approx(np.nanmean(table.braid_angle[0]), abs=0.5)
    assert 0 < table["braid_angle_deg_stderr"][0] < 0.3
    assert np.isnan(table.braid_angle[0, [0, -1]]).all()
    data = table.to_xarray()
    assert data["braid_angle_profile_deg"].attrs["units"] == "degree"
    assert not any("braid" in note for note in table.notes)
    told = f"1 of 1 pictures have no braid angle; the first is {path}: too dark."
    assert told in Table.from_rows([rows[0] | {"braid_refusal": "too dark"}]).notes


@pytest.mark.parametrize(
    ("first", "second", "counted"),
    [(24.3, 24.2, 24.0), (24.8, 24.4, 24.0), (23.6, 23.7, 24.0), (24.5, 24.6, None), (25.1, 25.0, None),
     (25.0, None, None)],
)  # fmt: skip
def test_yarns_are_counted_where_no_other_number_is_near(first, second, counted):
    class Seen(Waves):
        def __init__(self):
            pass

        def twist_rates(self, n):
            return np.zeros((2, 1)), np.zeros((2, 1))

        def phase_across(self, n, rates, harmonic):
            number = (first, second)[harmonic - 1]
            return (0.0, 0.0) if number is None else ((number - n) * harmonic * 1.9, 0.9)

    n, stderr = count_yarns(Seen(), 24.0)
    assert (n, stderr) == (counted, 0.0) if counted else abs(n - 24) < 2 * stderr


@pytest.mark.parametrize(("stripe", "glossy"), [(0.07, False), (0.16, True)])
def test_a_braid_that_shines_in_stripes_is_told(stripe, glossy):
    azimuth = np.linspace(-1.3, 1.3, 261)
    contrast = np.random.default_rng(0).normal(0, 0.08, (800, 261))
    contrast[:, 150:170] = np.random.default_rng(1).choice([-stripe, stripe], (800, 20))
    along = np.linspace(0, 0.1, 800)
    assert shines(Unrolled(azimuth, along, along, np.full(800, 0.01), contrast)) is glossy
