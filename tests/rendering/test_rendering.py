"""The renderer against closed forms it does not use, and its truth against its pictures."""

import dataclasses

import numpy as np
import pytest

from imaging import Camera
from imaging.camera import ring_position
from rendering import INCH, CameraSensor, Lens, Light, published_scene, published_shape, render
from rendering.exposure import expose, through_lens
from rendering.folder import write_twin
from rendering.folder_truth import TRUTH
from rendering.renderer import draw, render_linear
from rendering.ruler import Ruler, published_ruler
from rendering.truth import silhouette_from_profile
from rendering.world import World

RAY_PX = 1e-4  # table of 4097 radii, three steps, positions tried every 5e-5 px
MARK_PART = 0.04  # of a pixel: 55 rays, the face's grain, the scale's change with the tilt


def small(**changes):
    """A small published scene with another muscle."""
    scene = published_scene(size=(500, 220))
    return dataclasses.replace(scene, muscle=dataclasses.replace(scene.muscle, **changes))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"x0": 3 * INCH, "roll": 0.05},
        {"bow": 0.1 * INCH, "bow_depth": 0.2 * INCH, "x0": -1 * INCH},
        {"profile": published_shape(0.35), "roll": -0.03},
        {"camera": Camera(300 / INCH, 30 * INCH, (400.0, 1300.0), k1=-0.1), "x0": 1 * INCH},
    ],
)
def test_rays_end_at_the_outline_that_is_called_true(changes):
    """Where rays stop meeting the braid, sought with a comb of rays."""
    camera = changes.get("camera", published_scene().camera)
    shape = {name: value for name, value in changes.items() if name != "camera"}
    world = World(small(relief=0.0, **shape).muscle, camera)
    for (u, v), outermost in zip(world.outline(), (np.min, np.max), strict=True):
        for k in (200, 1000, 2048, 3000, 3900):
            comb = u[k] + np.arange(-0.05, 0.05, 5e-5)
            which, *_ = world.met(comb, np.full(comb.size, v[k]))
            assert outermost(comb[which == 0]) == pytest.approx(u[k], abs=RAY_PX)


def test_truth_of_a_straight_muscle_is_the_closed_form():
    scene = small(relief=0.0, x0=1 * INCH, y0=-0.3 * INCH, roll=0.04)
    truth = render_linear(scene).truth
    y = np.linspace(-0.5, 0.5, 4001) * truth.length
    R = scene.muscle.diameter(y / truth.length + 0.5) / 2
    rows, left, right = silhouette_from_profile(scene.camera, y - 0.3 * INCH, R, x0=INCH, roll=0.04)
    np.testing.assert_array_equal(rows, truth.rows)
    np.testing.assert_allclose(truth.left, left, atol=RAY_PX)
    np.testing.assert_allclose(truth.right, right, atol=RAY_PX)


def test_edge_of_the_tape_is_a_circle_in_perspective():
    scene = small()
    photo = render(scene, 3)
    truth = photo.truth
    radius = truth.diameter[0] / 2
    for edge, y in ((truth.upper_edge, -truth.length / 2), (truth.lower_edge, truth.length / 2)):
        inner = edge[5:-5]
        found = ring_position(scene.camera, inner[:, 0], inner[:, 1], radius)
        np.testing.assert_allclose(found, y, atol=1e-12)
    columns = truth.upper_edge[100:260:40]
    blue = photo.rgb[..., 2].astype(int) - photo.rgb[..., 0]
    for u, v in columns:
        column = blue[int(v) - 4 : int(v) + 5, round(u)]
        assert column[0] > 60  # tape
        assert column[-1] < 0  # braid


def test_noise_has_the_variance_of_its_electrons():
    """Evenly lit cloth, in two pictures."""
    sensor = CameraSensor(full_well=500.0, read_noise=4.0)
    plain = Light(lamps=(), cloth=0.3, cloth_gradient=0.0, stray=0.0)
    scene = dataclasses.replace(small(), muscle=None, light=plain, jpeg=None, sensor=sensor)
    linear = render_linear(scene)
    expected = linear.light * sensor.full_well
    a, b = (sensor.tone().table[expose(linear, k).rgb] * sensor.full_well for k in (1, 2))
    variance = expected.mean() + 4.0**2
    assert np.var(a - b) / 2 == pytest.approx(variance, rel=0.03)  # 330 000 values, 8 bits
    assert a.mean() == pytest.approx(expected.mean(), rel=0.002)


@pytest.mark.parametrize(
    ("lens", "spread"),
    [
        (Lens(blur_px=1.7), (1.7, 1.7)),
        (Lens(blur_px=0, defocus_px=4.0), (2.0, 2.0)),  # a disk: radius / 2
        (Lens(blur_px=0, motion_px=6.0), (6 / np.sqrt(12), 0.0)),
        (Lens(blur_px=0, halo=0.25, halo_px=4.0), (2.0, 2.0)),
    ],
)
def test_point_spread_has_its_second_moment(lens, spread):
    point = np.zeros((81, 81, 3), np.float32)
    point[40, 40] = 1
    seen = through_lens(point, lens)[..., 0].astype(float)
    away = np.arange(81) - 40.0
    assert seen.sum() == pytest.approx(1, rel=1e-5)
    for axis, sigma in enumerate(spread):
        second = seen.sum(axis=1 - axis) @ away**2
        # A sampled box or disk has its pixels' own 1/12 on top, a cut Gaussian a little less.
        assert np.sqrt(second) == pytest.approx(sigma, rel=0.03, abs=0.3 * (sigma == 0))


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"tilt_deg": 3.0, "rotation_deg": 1.0},
        {"offset": 0.1 * INCH, "edge": "right", "print_error": 0.002 * INCH},
        {"edge": "both", "other_pitch": 0.002},
    ],
)
def test_marks_of_a_ruler_cover_the_pixels_that_the_truth_says(changes):
    wide = 0.02 * INCH
    # Even light, no lens: what is left is geometry.
    light, lens = Light(lamps=(), ambient=1.0, cloth=0.0, stray=0.0), Lens(blur_px=0.0)
    ruler = dataclasses.replace(
        published_ruler(size=(1000, 300)), light=light, lens=lens, numbers=False,
        mark_width=wide, ink=(0.0, 0.0, 0.0), **changes,
    )  # fmt: skip
    face = Ruler(ruler)
    light, truth = draw(face, ruler), face.truth()
    for u, v in truth.marks:
        rows = round(v) + np.arange(-4, 5)
        window = light[rows, round(u) - 1 : round(u) + 2, 1].mean(axis=1)
        dark = 1 - window / np.interp(rows, rows[[0, -1]], window[[0, -1]])
        half = wide * truth.line / 2
        covered = np.minimum(rows + 0.5, v + half) - np.maximum(rows - 0.5, v - half)
        np.testing.assert_allclose(dark, np.clip(covered, 0, 1), atol=MARK_PART)


SMALL = """
[muscle]
rest_length_in = 8
friction = 0.02
[rig]
pressures_psi = [60]
stroke_mm = 20
rate_mm_per_s = 4
settle_s = 2
[camera]
pictures = 4
rows = 600
damaged = 1
"""


@pytest.mark.slow
@pytest.mark.long
def test_a_twin_of_a_truth_is_the_same_bytes_again_from_its_own(tmp_path):
    """The file that the first wrote makes the second, on another day."""
    first, second = tmp_path / "a", tmp_path / "b"
    (tmp_path / TRUTH).write_text(SMALL)
    write_twin(first, seed=4, truth=tmp_path / TRUTH)
    write_twin(second, seed=4, truth=first / TRUTH)
    names = sorted(path.relative_to(first) for path in first.rglob("*.*"))
    pictures = [name.name for name in names if "DSC" in str(name)]
    assert pictures == [f"DSC_{k:04d}.JPG" for k in range(4)]
    assert [n for n in names if (first / n).read_bytes() != (second / n).read_bytes()] == []
    lines = (first / "machine.csv").read_text().splitlines()[2:]
    times = [float(line.split(",")[0]) for line in lines]
    assert np.diff(times).max() == pytest.approx(1.02)
