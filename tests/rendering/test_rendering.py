"""The renderer against closed forms it does not use, and its truth against its pictures."""

import csv
import dataclasses
import datetime
import io
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from imaging import Camera
from imaging.camera import ring_position
from rendering import (
    INCH,
    PUBLISHED_CONTRACTIONS,
    CameraSensor,
    Jpeg,
    Lamp,
    Lens,
    Light,
    MuscleScene,
    RulerScene,
    Scene,
    Tape,
    apparent_diameter,
    damaged,
    expose,
    published_ruler,
    published_scene,
    published_shape,
    random_scene,
    render,
    render_linear,
    render_ruler,
    render_sequence,
    silhouette_from_profile,
    stroke_log,
    stroke_shape,
    triangle_stroke,
)
from rendering.exposure import through_lens
from rendering.renderer import draw, light_on_threads
from rendering.ruler import Ruler
from rendering.world import World

RAY_PX = 1e-4  # table of 4097 radii, three steps, positions tried every 5e-5 px
LATTICE_PX = 0.01  # 55 rays in a pixel, rows averaged
MARK_PART = 0.04  # of a pixel: 55 rays, the face's grain, the scale's change with the tilt
REFERENCE = Path(__file__).parents[2] / "benchmarks/reference/chambers2021.toml"
SIZE = (500, 220)
# Even light, no lens: what is left is geometry.
GEOMETRY = Light(lamps=(), ambient=1.0, cloth=0.0, stray=0.0)
SHARP = Lens(blur_px=0.0)


def small(**changes) -> Scene:
    """A small published scene with another muscle."""
    scene = published_scene(size=SIZE)
    assert scene.muscle is not None
    return dataclasses.replace(scene, muscle=dataclasses.replace(scene.muscle, **changes))


@pytest.fixture(scope="module")
def photo():
    return render(small(), 3)


@pytest.fixture(scope="module")
def linear():
    return render_linear(small())


def rim(world: World, column: float, row: float, sign: int) -> float:
    """Where rays stop meeting the braid, sought with a comb of rays about a column."""
    comb = np.arange(-0.05, 0.05, 5e-5)
    which, *_ = world.met(column + comb, np.full(comb.size, row))
    met = which == 0
    return column + (comb[met].max() if sign > 0 else comb[met].min())


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
    camera = changes.get("camera", published_scene().camera)
    shape = {name: value for name, value in changes.items() if name != "camera"}
    world = World(small(relief=0.0, **shape).muscle, camera)
    for (u, v), sign in zip(world.outline(), (-1, 1), strict=True):
        for k in (200, 1000, 2048, 3000, 3900):
            assert rim(world, u[k], v[k], sign) == pytest.approx(u[k], abs=RAY_PX)


def test_truth_of_a_straight_muscle_is_the_closed_form():
    scene = small(relief=0.0, x0=1 * INCH, y0=-0.3 * INCH, roll=0.04)
    truth = render_linear(scene).truth
    y = np.linspace(-0.5, 0.5, 4001) * truth.length
    R = scene.muscle.diameter(y / truth.length + 0.5) / 2
    rows, left, right = silhouette_from_profile(
        scene.camera, y - 0.3 * INCH, R, x0=1 * INCH, roll=0.04
    )
    np.testing.assert_array_equal(rows, truth.rows)
    np.testing.assert_allclose(truth.left, left, atol=RAY_PX)
    np.testing.assert_allclose(truth.right, right, atol=RAY_PX)


def test_relief_moves_the_outline_about_the_mean():
    plain, woven = (World(small(relief=h).muscle, small().camera) for h in (0.0, 5e-5))
    for (u, _), (u_plain, _) in zip(woven.outline(), plain.outline(), strict=True):
        offset = u - u_plain
        assert abs(offset.mean()) < 0.02 * offset.std()  # weighted by depth, not by height
        assert 0 < np.ptp(offset) < 5e-5 * small().camera.px_per_m * 1.05


def test_figures_of_a_cone_are_the_textbook_ones():
    D0, D1, L = 1.0 * INCH, 2.0 * INCH, 6 * INCH
    truth = render_linear(small(profile=lambda x: D0 + (D1 - D0) * x, length=L)).truth
    assert truth.volume == pytest.approx(np.pi * L / 12 * (D0**2 + D0 * D1 + D1**2), rel=1e-9)
    assert truth.mean_diameter == pytest.approx(1.5 * INCH, rel=1e-9)
    assert truth.maximum_diameter == pytest.approx(D1)
    assert truth.z[-1] == truth.length == L
    as_arrays = ([0, 0.5, 1], [D0, (D0 + D1) / 2, D1])
    np.testing.assert_allclose(small(profile=as_arrays).muscle.diameter(0.25), 1.25 * INCH)


def test_light_of_a_row_of_tape_is_the_width_of_the_cylinder():
    """Evenly lit, the light in a row counts the pixels that the tape covers, parts included."""
    tape = Tape(width=1.2 * INCH, diameter=1.3 * INCH)
    scene = dataclasses.replace(small(upper=tape, x0=0.5 * INCH), light=GEOMETRY, lens=SHARP)
    light = render_linear(scene).light[..., 2]
    upper = int(render_linear(scene).truth.tape_rows[0])
    rows = np.arange(upper - 40, upper - 10)
    full = np.median(light[rows][light[rows] > 0])
    width = light[rows].sum(axis=1) / full / scene.camera.px_per_m
    seen = apparent_diameter(1.3 * INCH, scene.camera.distance, 0.5 * INCH)
    assert width.mean() == pytest.approx(seen, abs=LATTICE_PX / scene.camera.px_per_m)


def test_edge_of_the_tape_is_a_circle_in_perspective(photo):
    scene = small()
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


def test_thicker_tape_hides_a_shoulder():
    edge = Tape(diameter=1.2 * INCH)
    scene = small(upper=edge, lower=edge)
    world = World(scene.muscle, scene.camera)
    truth = render_linear(scene).truth
    u, v = truth.upper_edge[len(truth.upper_edge) // 2]
    which, *_ = world.met(np.full(3, u), v + np.array([-0.05, 0.05, 1.5]))
    kinds = [world.bodies[number][0] for number in which]
    assert kinds == ["tape", "shade", "braid"]


def test_seed_draws_the_noise_and_weave_seed_the_braid(linear):
    first, again, other = (expose(linear, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.rgb, again.rgb)
    assert np.any(first.rgb != other.rgb)
    rewoven = render_linear(small(weave_seed=1))
    assert np.any(rewoven.light != linear.light)
    np.testing.assert_allclose(rewoven.truth.left, linear.truth.left, atol=1e-12)


def flat(light: float, sensor: CameraSensor) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Expected electrons of evenly lit cloth, and those read from two pictures of it."""
    plain = Light(lamps=(), cloth=light, cloth_gradient=0.0, stray=0.0)
    scene = dataclasses.replace(small(), muscle=None, light=plain, jpeg=None)
    linear = render_linear(scene)
    seen = (sensor.tone().table[expose(linear, k, sensor=sensor).rgb] for k in (1, 2))
    return linear.light * sensor.full_well, *(each * sensor.full_well for each in seen)


def test_noise_has_the_variance_of_its_electrons():
    sensor = CameraSensor(full_well=500.0, read_noise=4.0)
    expected, a, b = flat(0.3, sensor)
    variance = expected.mean() + 4.0**2
    assert np.var(a - b) / 2 == pytest.approx(variance, rel=0.03)  # 330 000 values, 8 bits
    assert a.mean() == pytest.approx(expected.mean(), rel=0.002)


def test_few_electrons_are_counted_one_by_one():
    expected, a, _ = flat(0.006, CameraSensor(full_well=400.0, read_noise=0.0))
    assert expected.max() < 4
    for count in range(4):
        chance = np.exp(-expected) * expected**count / [1, 1, 2, 6][count]
        # Eight bits do not hold the number of electrons exactly.
        part = np.mean(np.abs(a - count) < 0.3)
        assert part == pytest.approx(chance.mean(), abs=0.005)


def test_exposure_saturates():
    photo = render(dataclasses.replace(small(), sensor=CameraSensor(exposure=6.0)), 0)
    rows = photo.truth.rows[100:200].astype(int)
    middle = photo.rgb[rows, int(photo.truth.left.mean() + photo.truth.right.mean()) // 2]
    assert np.mean(middle[:, 0] >= 254) > 0.9


def test_bayer_keeps_the_colours(linear):
    plain, mosaic = (
        expose(linear, 1, sensor=CameraSensor(full_well=1e6, read_noise=0, bayer=bayer))
        for bayer in (False, True)
    )
    difference = mosaic.rgb.astype(float).mean(axis=(0, 1)) - plain.rgb.mean(axis=(0, 1))
    assert np.abs(difference).max() < 0.5


def test_sharpening_overshoots_at_the_outline(linear):
    quiet = CameraSensor(full_well=1e7, read_noise=0)
    soft, sharp = (
        expose(linear, 1, sensor=dataclasses.replace(quiet, sharpening=s)).rgb.astype(float)
        for s in (0.0, 2.0)
    )
    row = int(linear.truth.rows[150])
    u = int(linear.truth.left[150])
    assert np.ptp(sharp[row, u - 5 : u + 8, 1]) > np.ptp(soft[row, u - 5 : u + 8, 1]) + 5


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
        assert np.sqrt(second) == pytest.approx(
            np.hypot(sigma, 0.0), rel=0.03, abs=0.3 * (sigma == 0)
        )


def test_light_falls_off_at_the_limb_as_the_lamps_say():
    def limb_over_middle(light: Light) -> float:
        seen = render_linear(dataclasses.replace(small(sparkle=0.0), light=light))
        truth = seen.truth
        rows = truth.rows.astype(int)[40:-40]
        at = [
            np.mean([seen.light[r, round(u), 1] for r, u in zip(rows, columns, strict=True)])
            for columns in (truth.left[40:-40] + 4, (truth.left + truth.right)[40:-40] / 2)
        ]
        return at[0] / at[1]

    assert limb_over_middle(Light.side()) > 0.9
    assert 0.2 < limb_over_middle(Light.frontal()) < 0.7
    assert limb_over_middle(Light.harsh()) < limb_over_middle(Light.frontal())


@pytest.mark.parametrize("reflectance", ["lambert", "oren-nayar", "sqrt"])
def test_surface_that_faces_the_lamp_is_brightest(reflectance):
    angle = np.linspace(0, 1.2, 30)
    normal = np.stack([np.sin(angle), np.zeros(30), -np.cos(angle)], axis=1)
    sight = np.tile([0.0, 0.0, -1.0], (30, 1))
    light = Light((Lamp((0, 0, -1), 1.0, 0.05),), ambient=0.0, reflectance=reflectance)
    seen = light_on_threads(light, normal, sight)
    assert np.all(np.diff(seen) < 0)
    if reflectance == "lambert":
        np.testing.assert_allclose(seen, np.cos(angle), atol=1e-12)
    if reflectance == "sqrt":
        np.testing.assert_allclose(seen, np.sqrt(np.cos(angle)), atol=1e-12)


def test_scenes_of_what_can_go_wrong():
    cloth = dataclasses.replace(small(), muscle=None)
    assert render(cloth, 0).shown is None
    with pytest.raises(ValueError, match="cloth alone"):
        _ = render(cloth, 0).truth

    upright = render(small(), 0)
    lying = render(dataclasses.replace(small(), lying=True), 0)
    assert lying.rgb.shape == (220, 500, 3)
    turned_back = np.rot90(lying.rgb, -1).astype(int)
    assert np.abs(turned_back - upright.rgb).mean() < 3  # the noise's JPEG, block by block

    def blueness(photo, row):
        u = round(float((photo.truth.left + photo.truth.right)[0] / 2))
        return int(photo.rgb[row, u, 2]) - int(photo.rgb[row, u, 0])

    lower = int(upright.truth.tape_rows[1]) + 8
    assert blueness(upright, lower) > 60
    assert blueness(render(small(lower=None), 0), lower) < 30
    third = render(small(third=(Tape(width=0.4 * INCH), 0.45)), 0)
    middle = int(np.dot([0.55, 0.45], third.truth.tape_rows))
    assert blueness(third, middle) > 60
    assert blueness(upright, middle) < 0


@pytest.mark.parametrize("seed", range(4))
def test_random_scene_has_its_muscle_and_tapes_in_the_picture(seed):
    scene = random_scene(seed, px_per_in=(25, 40))
    photo = render(scene, seed)
    truth = photo.truth
    h, w = scene.size
    assert truth.left.min() > 5
    assert truth.right.max() < w - 6
    tape = scene.muscle.upper.width * truth.px_per_m
    assert truth.tape_rows[0] - tape > 5
    assert truth.tape_rows[1] + tape < h - 6
    border = np.concatenate([photo.rgb[:, :3], photo.rgb[:, -3:]]).max(axis=-1)
    assert np.percentile(border, 99) < 80  # cloth
    assert random_scene(seed, px_per_in=(25, 40)).camera == scene.camera
    assert random_scene(seed + 1, px_per_in=(25, 40)).camera != scene.camera


def test_muscles_that_are_none_are_refused():
    with pytest.raises(ValueError, match="multiple of 4"):
        small(strands=6)
    with pytest.raises(ValueError, match="length > 0"):
        small(length=0.0)
    with pytest.raises(ValueError, match="positive"):
        render(small(profile=lambda x: 0.02 - 0.05 * x), 0)
    with pytest.raises(ValueError, match="saturation"):
        Tape(saturation=1.2)
    with pytest.raises(ValueError, match="softness > 0"):
        Lamp((0, 0, -1), 1.0, 0.0)
    with pytest.raises(ValueError, match="never falls"):
        CameraSensor(s_curve=1.5)
    with pytest.raises(ValueError, match="widths >= 0"):
        Lens(motion_px=-1.0)
    with pytest.raises(ValueError, match="subsampling"):
        Jpeg(90, "411")
    with pytest.raises(ValueError, match="pitch > 0"):
        RulerScene(small().camera, SIZE, edge="top")


def test_published_shapes_are_those_of_the_table():
    rows = tomllib.loads(REFERENCE.read_text())["profile_100psi"]
    x = np.linspace(0, 1, 101)
    for c, row in zip(PUBLISHED_CONTRACTIONS, rows, strict=True):
        a0, *a = row["a"]
        n = np.arange(1, 4)[:, None] * row["w_corrected"] * x
        printed = a0 + np.array(a) @ np.cos(n) + np.array(row["b"]) @ np.sin(n)
        D = published_shape(c)(x) / INCH
        assert row["contraction"] == c
        np.testing.assert_allclose(D, (printed + printed[::-1]) / 2, atol=1e-12)
        np.testing.assert_allclose(stroke_shape(c)(x[20:81]) / INCH, D[20:81], atol=0.02)
        assert stroke_shape(c)(0.0) == pytest.approx(0.875 * INCH)
    with pytest.raises(ValueError, match="published at the contractions"):
        published_shape(0.1)
    with pytest.raises(ValueError, match="stroke is known"):
        stroke_shape(0.4)


def test_file_is_what_the_picture_was_read_from(photo, tmp_path):
    bgr = cv2.imdecode(np.frombuffer(photo.jpeg(), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(bgr[..., ::-1], photo.rgb)
    path = photo.save(tmp_path / "a.png")
    np.testing.assert_array_equal(cv2.imread(str(path))[..., ::-1], photo.rgb)
    raw = expose(render_linear(dataclasses.replace(small(), jpeg=None)), 3)
    assert raw.file is None
    close = cv2.imdecode(np.frombuffer(raw.jpeg(), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    assert np.abs(close.astype(int) - raw.rgb).max() <= 4  # quality 100, colour in full


@pytest.mark.parametrize("subsampling", ["444", "422", "420"])
def test_subsampling_is_that_of_the_file(linear, subsampling):
    scene = dataclasses.replace(linear.scene, jpeg=Jpeg(80, subsampling))
    data = expose(dataclasses.replace(linear, scene=scene), 0).jpeg()
    with Image.open(io.BytesIO(data)) as image:
        layers = image.layer
    assert layers[0][1:3] == {"444": (1, 1), "422": (2, 1), "420": (2, 2)}[subsampling]


def test_time_is_in_the_file(tmp_path):
    time = datetime.datetime(2021, 3, 1, 10, 2, 3, 250_000)
    path = render(dataclasses.replace(small(), time=time), 0).save(tmp_path / "a.jpg")
    with Image.open(path) as image:
        camera = image.getexif().get_ifd(0x8769)
    assert camera[0x9003] == "2021:03:01 10:02:03"
    assert camera[0x9291] == "250"
    assert cv2.imread(str(path)).shape == (*SIZE, 3)


def test_damage_is_damage(photo):
    data = photo.jpeg()
    assert not damaged(data, "truncated").endswith(b"\xff\xd9")
    for kind in ("scrambled", "blanked"):
        spoilt = damaged(data, kind, 4)
        assert len(spoilt) == len(data)
        decoded = cv2.imdecode(np.frombuffer(spoilt, np.uint8), cv2.IMREAD_COLOR)
        if decoded is not None:
            assert np.abs(decoded[..., ::-1].astype(int) - photo.rgb).max() > 50
    assert damaged(data, "scrambled", 4) == damaged(data, "scrambled", 4)


def covered_by_a_mark(light: np.ndarray, u: float, v: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows about a mark of black ink and the part of them that is dark."""
    rows = round(v) + np.arange(-4, 5)
    window = light[rows, round(u) - 1 : round(u) + 2, 1].mean(axis=1)
    face = np.interp(rows, rows[[0, -1]], window[[0, -1]])
    return rows, 1 - window / face


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
    ruler = dataclasses.replace(
        published_ruler(size=(1000, 300)), light=GEOMETRY, lens=SHARP, numbers=False,
        mark_width=wide, ink=(0.0, 0.0, 0.0), **changes,
    )  # fmt: skip
    face = Ruler(ruler)
    light, truth = draw(face, ruler), face.truth()
    for u, v in truth.marks:
        rows, dark = covered_by_a_mark(light, u, v)
        half = wide * truth.line / 2
        covered = np.minimum(rows + 0.5, v + half) - np.maximum(rows - 0.5, v - half)
        np.testing.assert_allclose(dark, np.clip(covered, 0, 1), atol=MARK_PART)


def test_scale_of_a_ruler_follows_tilt_and_place():
    camera = Camera(40 / INCH, 60 * INCH, (60.0, 200.0))
    ruler = RulerScene(camera, (400, 120), marks=65)
    inches = render_ruler(ruler, 0)
    assert inches.truth.line == pytest.approx(camera.px_per_m, rel=1e-12)
    worn = render_ruler(dataclasses.replace(ruler, worn=0.5), 0)
    assert worn.rgb.mean() > inches.rgb.mean()  # less ink
    behind = render_ruler(dataclasses.replace(ruler, offset=0.1 * INCH), 0).truth
    assert behind.line == pytest.approx(camera.px_per_m * 60 / 60.1, rel=1e-12)
    assert behind.px_per_m == camera.px_per_m
    tilted = render_ruler(dataclasses.replace(ruler, tilt_deg=3.0), 0).truth
    pitches = np.diff(tilted.marks[::8, 1])
    # Local scale ~ d^2 cos/(d + s sin)^2: the change from end to end is -2 * 7 in * sin / d.
    expected = -2 * 7 * np.sin(np.deg2rad(3.0)) / 60
    assert pitches[-1] / pitches[0] - 1 == pytest.approx(expected, rel=0.02)


def test_stroke_is_what_machine_and_camera_saw(tmp_path):
    contraction = triangle_stroke(0.3, 240.0)
    assert contraction(np.array([0.0, 60.0, 120.0, 240.0])) == pytest.approx([0, 0.15, 0.3, 0])
    rest = published_scene(0.01, size=(300, 140))
    times = np.array([10.0, 100.0, 200.0])
    photos = list(render_sequence(rest, contraction, times, clock_offset=2.5, seed=4))
    expected = rest.muscle.length * (1 - contraction(times))
    np.testing.assert_allclose([p.truth.length for p in photos], expected)
    seconds = [(p.time - datetime.datetime(2021, 3, 1, 10)).total_seconds() for p in photos]
    np.testing.assert_allclose(seconds, times + 2.5, atol=1e-6)
    tops = [p.truth.tape_rows[0] for p in photos]
    np.testing.assert_allclose(tops, tops[0], atol=1e-9)  # the upper end stays
    late = next(render_sequence(rest, contraction, times[:1], jitter=1.0, seed=4))
    assert late.time == photos[0].time.replace(second=10, microsecond=0)
    assert late.truth.length != photos[0].truth.length

    log = stroke_log(contraction, np.arange(0, 240, 0.02), rest.muscle.length)
    with log.save(tmp_path / "log.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time_s", "displacement_in", "force_lbf", "pressure_psi"]
    shortest = max(float(row["displacement_in"]) for row in rows)
    assert shortest == pytest.approx(0.3 * rest.muscle.length / INCH, abs=1e-4)
    assert float(rows[0]["force_lbf"]) == pytest.approx(1058, rel=1e-6)
    assert {float(row["pressure_psi"]) for row in rows} == {100.0}


def test_stroke_needs_a_muscle():
    cloth = dataclasses.replace(small(), muscle=None)
    with pytest.raises(ValueError, match="needs a scene with a muscle"):
        next(render_sequence(cloth, triangle_stroke(0.3, 10.0), [0.0]))


def test_frame_has_the_scale_of_the_crop():
    frame, crop, quarter = (
        published_scene(size=size) for size in ((3712, 5568), (2650, 1100), (662, 275))
    )
    assert frame.camera.px_per_m == crop.camera.px_per_m == pytest.approx(226.63 / INCH)
    assert quarter.camera.px_per_m == pytest.approx(crop.camera.px_per_m * 662 / 2650)
    assert isinstance(crop.muscle, MuscleScene)
