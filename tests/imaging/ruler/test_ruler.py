"""Rulers of every kind against the scale they were rendered with."""

import dataclasses

import pytest
from rendering import INCH, published_ruler, render_ruler
from slow_cases import slow_after

from imaging import calibrate_ruler
from imaging.errors import AmbiguousRuler

SCALE = 5e-5  # relative; the aim is 1e-5 at full resolution, and these pictures have half of it


@pytest.fixture(scope="module")
def base():
    return published_ruler(size=(1325, 300))


CASES = {
    "as published": {},
    "turned right": {"rotation_deg": 2.0},
    "tilted away": {"tilt_deg": -5.0},
    "marks on both edges": {"edge": "both"},
    "marks on both edges, worn": {"edge": "both", "worn": 0.1},
    "marks of one length": {"mark_lengths": (0.2 * INCH,) * 4},
    "wood, marks on the right": {"edge": "right", "face": (0.62, 0.40, 0.17)},
    "light marks": {"face": (0.04, 0.04, 0.04), "ink": (0.7, 0.7, 0.7)},
    "wide marks, no numbers": {"mark_width": 0.03 * INCH, "numbers": False},
    "short and aside": {"marks": 41, "x0": 0.4 * INCH, "y0": 0.3 * INCH},
}


@pytest.mark.parametrize("case", CASES)
def test_the_scale_of_any_ruler(base, case):
    photo = render_ruler(dataclasses.replace(base, **CASES[case]), 3)
    scale = calibrate_ruler(photo.rgb)
    marks = CASES[case].get("marks", base.marks)
    spread = SCALE * (base.marks / marks) ** 1.5
    assert scale.px_per_m == pytest.approx(photo.truth.px_per_m, rel=spread)
    assert scale.tilt_deg == pytest.approx(photo.truth.tilt_deg, abs=0.1)
    assert marks * (1 - 1.5 * CASES[case].get("worn", 0)) <= scale.marks <= marks
    assert scale.source == "ruler"
    assert abs(scale.px_per_m / photo.truth.px_per_m - 1) < 5 * scale.relative_stderr


def test_printing_errors_show_in_the_residual_and_the_standard_error(base):
    photo = render_ruler(dataclasses.replace(base, print_error=0.002 * INCH, print_seed=5), 1)
    scale = calibrate_ruler(photo.rgb)
    assert scale.residual_px == pytest.approx(0.002 * INCH * scale.px_per_m, rel=0.3)
    assert abs(scale.px_per_m / photo.truth.px_per_m - 1) < 3 * scale.relative_stderr
    assert scale.relative_stderr > 1e-5


def test_a_misplaced_ruler_cannot_be_seen_but_can_be_declared(base):
    photo = render_ruler(dataclasses.replace(base, offset=0.1 * INCH), 1)
    blind = calibrate_ruler(photo.rgb)
    assert blind.px_per_m / photo.truth.px_per_m - 1 == pytest.approx(-0.1 / 60, rel=0.05)
    told = calibrate_ruler(photo.rgb, placement_stderr=0.1 * INCH)
    assert told.relative_stderr == pytest.approx(0.1 / 60, rel=0.01)


TWO_EDGES = {
    "sixteenths": {"other_pitch": INCH / 16},
    "sixteenths of one length": {"other_pitch": INCH / 16, "mark_lengths": (0.16 * INCH,) * 4},
    "sixteenths, worn": {"other_pitch": INCH / 16, "worn": 0.08},
    "sixteenths, turned": {"other_pitch": INCH / 16, "rotation_deg": -1.5},
    "sixteenths, tilted": {"other_pitch": INCH / 16, "tilt_deg": 4.0},
    "quarters": {"other_pitch": INCH / 4},
    "two millimetres": {"other_pitch": 2e-3},
    "half centimetres": {"other_pitch": 5e-3},
}


@pytest.mark.parametrize("case", slow_after(3, TWO_EDGES))
def test_two_edges_that_differ_are_ambiguous(base, case):
    scene = dataclasses.replace(base, edge="both", **TWO_EDGES[case])
    with pytest.raises(AmbiguousRuler, match="cover one edge") as caught:
        calibrate_ruler(render_ruler(scene, 12).rgb)
    pitches = sorted(caught.value.figures.values())
    fine, coarse = sorted([scene.other_pitch, scene.pitch])
    assert pitches[0] / pitches[1] == pytest.approx(fine / coarse, rel=0.02)


@pytest.mark.parametrize(("width", "longest"), [(0.8, 0.42), (0.9, 0.42), (0.9, 0.25), (1.0, 0.25)])
@pytest.mark.parametrize("rotation", slow_after(1, [0.235, 0.25, 0.265]))
def test_an_edge_that_steps_as_often_as_numbers_come_is_no_number(base, rotation, width, longest):
    """A ruler in eighths that leans by one pixel in sixteen of them."""
    lengths = (0.19, 0.3, 0.3, 0.42) if longest > 0.3 else (0.12, 0.12, 0.16, 0.25)
    marks = tuple(length * INCH for length in lengths)
    leaning = {"rotation_deg": rotation, "width": width * INCH, "mark_lengths": marks}
    photo = render_ruler(dataclasses.replace(base, **leaning, numbers=False), 1)
    try:
        scale = calibrate_ruler(photo.rgb)
    except AmbiguousRuler:
        return
    assert scale.px_per_m == pytest.approx(photo.truth.px_per_m, rel=0.001)
