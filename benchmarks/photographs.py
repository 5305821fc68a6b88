"""How near a measured photograph comes to its truth, and what it does with photographs that deceive.

The renderer shades real threads and knows nothing of the measurement's model of the edge.

The pictures of `attacks`: each of 200 scenes drawn at random has a picture of a muscle, one of a ruler,
and what their user says of them; two thirds have one or two faults of random strength: motion in any
direction, another tone curve, a glossy rim, a phone's denoising and sharpening, a bowed or tilted axis, a
lens that distorts, a ruler out of the plane or of another pitch, a camera at a distance that is not said.
Every fifth scene is of full size. A picture is *sound* by its truth alone, decided before it is measured
(`is_sound`). An error is *silent* where the length or the mean diameter is off by more than 3 of its
standard errors, and the picture is neither refused nor measured with a warning.
"""

import dataclasses
import json
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from row import Case, command, tell
from scipy.optimize import minimize_scalar

# isort: split
from rendering import (
    INCH,
    Jpeg,
    Lens,
    Light,
    MuscleTruth,
    RulerScene,
    Scene,
    published_ruler,
    published_scene,
    random_scene,
    render,
    render_ruler,
)

from imaging import ImagingError, Measurement, Recipe, Scale, Tone, calibrate_ruler, measure

SIZE = (2650, 1100)
CONTRACTIONS = (0.0, 0.0875, 0.175, 0.2625, 0.35)
ATTACKS, DRAWN, BRAIDS = 200, 100, 60
FAULTS = ("motion", "tone", "gloss", "phone", "bow", "tilt", "lens", "plane", "pitch", "distance")
PLACED = 0.005  # in, standard deviation of a careful user's ruler


def woven(scene: Scene, seed: int, **changes: Any) -> Scene:
    """The scene with another braid, and other changes of the muscle."""
    assert scene.muscle is not None
    return dataclasses.replace(
        scene, muscle=dataclasses.replace(scene.muscle, weave_seed=seed, **changes)
    )


def photographed(scene: Scene, seed: int) -> tuple[Measurement, MuscleTruth]:
    """A scene's measurement and truth."""
    photo, camera = render(scene, seed), scene.camera
    assert isinstance(photo.truth, MuscleTruth)
    scale = Scale.manual(camera.px_per_m)
    recipe = Recipe(scale, camera.distance, centre=camera.centre, tone=Tone.srgb(), k1=0.0)
    return measure(photo.rgb, recipe), photo.truth


def diameter_error(found: Measurement, truth: MuscleTruth) -> np.ndarray:
    """D(z) less the true one [m]."""
    true = np.interp(found.z / found.length, truth.z / truth.length, truth.diameter)
    return found.diameter - true


def fourier_residual(x: np.ndarray, diameter: np.ndarray) -> np.ndarray:
    """Best series of three Fourier terms less the profile [m], by a search over the wave number."""

    def residual(w: float) -> np.ndarray:
        angle = np.arange(1, 4) * w * (x[:, None] - 0.5)
        columns = np.hstack([np.ones((x.size, 1)), np.cos(angle), np.sin(angle)])
        return columns @ np.linalg.lstsq(columns, diameter, rcond=1e-10)[0] - diameter

    waves = np.geomspace(0.5, 4 * np.pi, 160)
    best = waves[np.argmin([np.sum(residual(w) ** 2) for w in waves])]
    found = minimize_scalar(
        lambda w: np.sum(residual(w) ** 2), bounds=(best / 1.03, best * 1.03), method="bounded"
    )
    return residual(float(found.x))


def figures_of_photo(found: Measurement, truth: MuscleTruth) -> dict[str, float]:
    """Errors of one picture, lengths in inches."""
    off = diameter_error(found, truth) / INCH
    fourier = off + fourier_residual(found.z / found.length, found.diameter) / INCH
    return {
        "bias": float(off.mean()),
        "rms": float(np.sqrt(np.mean(off**2))),
        "length": (found.length - truth.length) / INCH,
        "volume": found.volume / truth.volume - 1,
        "fourier": float(np.sqrt(np.mean(fourier**2))),
    }


def _worst(scenes: Iterable[Scene]) -> dict[str, float]:
    """Largest absolute value of each figure over scenes."""
    found = [
        figures_of_photo(*photographed(scene, scene.muscle.weave_seed if scene.muscle else 0))
        for scene in scenes
    ]
    return {name: float(np.abs([one[name] for one in found]).max()) for name in found[0]}


def _rulers() -> dict[str, float]:
    """Steel, wood and tilted rulers in the muscle's plane."""
    changes: tuple[dict[str, Any], ...] = (
        {}, {"rotation_deg": 2.0}, {"tilt_deg": 1.0}, {"tilt_deg": -3.0}, {"edge": "both"},
        {"face": (0.62, 0.40, 0.17)}, {"edge": "right", "rotation_deg": -1.0},
    )  # fmt: skip
    off = []
    for k, change in enumerate(changes):
        photo = render_ruler(dataclasses.replace(published_ruler(size=SIZE), **change), k)
        assert photo.truth is not None
        off.append(calibrate_ruler(photo.rgb).px_per_m / photo.truth.px_per_m - 1)
    return {"scale from the ruler, relative": float(np.abs(off).max())}


def accuracy(_: Case) -> dict[str, float]:
    """Side-lit muscles, three weaves at each contraction, then harsh light, a stroke and rulers."""
    found = _worst(woven(published_scene(c, size=SIZE), k) for c in CONTRACTIONS for k in (1, 2, 3))
    figures = {
        "diameter, bias [in]": found["bias"],
        "diameter, RMS [in]": found["rms"],
        "length [in]": found["length"],
        "volume, relative": found["volume"],
        "three-term Fourier RMSE [in]": found["fourier"],
    }
    for name, light in (("harsh", Light.harsh()), ("frontal", Light.frontal())):
        scenes = [
            dataclasses.replace(woven(published_scene(c, size=SIZE), k), light=light)
            for c, k in ((0.2625, 1), (0.175, 2), (0.35, 3))
        ]
        figures[f"{name} light, diameter bias [in]"] = _worst(scenes)["bias"]
    strokes = [photographed(woven(published_scene(c, size=SIZE), 7), seed=k)
               for k, c in enumerate(np.linspace(0, 0.3, 7).round(2))]  # fmt: skip
    L, true = (np.array([one[k].length for one in strokes]) for k in (0, 1))
    off = np.abs((1 - L / L[0]) - (1 - true / true[0])).max() * true[0] / INCH
    return figures | {"contraction over a stroke, error [in]": float(off), **_rulers()}


def _any_weave(seed: int) -> Scene:
    """150 to 260 px/in, 20 to 48 strands, blur of 0.6 to 2 px, ISO 800 to 10 000, JPEG of 55 to 98."""
    random = np.random.default_rng(10_000 + seed)
    scene = random_scene(seed, px_per_in=(150.0, 260.0))
    assert scene.muscle is not None
    muscle = dataclasses.replace(
        scene.muscle, strands=int(random.choice([20, 24, 28, 32, 36, 40, 48])),
        turns=random.uniform(0.8, 1.4), relief=random.uniform(0, 0.003) * INCH,
    )  # fmt: skip
    sensor = dataclasses.replace(
        scene.sensor, full_well=float(random.choice([7600.0, 1900.0, 600.0])),
        sharpening=float(random.choice([0.0, 0.0, 0.5])),
    )  # fmt: skip
    jpeg = Jpeg(int(random.integers(55, 98)), random.choice(["444", "422", "420"]))
    lens = Lens(blur_px=random.uniform(0.6, 2.0))
    return dataclasses.replace(scene, muscle=muscle, sensor=sensor, jpeg=jpeg, lens=lens)


def braid_angles(_: Case) -> dict[str, float]:
    """The braid angle read from photographs against that of the rendered strands."""
    errors, sigmas, means, counted = [], [], [], 0
    for seed in range(BRAIDS):
        scene = _any_weave(seed)
        photo, camera = render(scene, seed), scene.camera
        truth: Any = photo.truth
        scale = Scale.manual(camera.px_per_m)
        try:
            found = measure(
                photo.rgb, Recipe(scale, camera.distance, centre=camera.centre, braid_angle=True)
            )
        except ImagingError as error:
            tell(f"scene {seed}: {type(error).__name__}: {error}")
            continue
        braid = found.braid
        assert braid is not None
        assert scene.muscle is not None
        true = np.interp(braid.z / found.length, truth.z / truth.length, truth.braid_angle)
        off = (braid.angle - true)[braid.resolved]
        errors.append(np.degrees(off))
        sigmas.append(off / braid.stderr[braid.resolved])
        means.append(abs(float(np.degrees(off.mean()))) if off.size else np.nan)
        counted += braid.yarns == scene.muscle.strands
    return {
        "angle at z within 0.3 deg, part": float(np.mean(np.abs(np.concatenate(errors)) <= 0.3)),
        "mean angle of a picture, largest error [deg]": float(np.max(means)),
        "angle at z within its 95 % interval, part": float(
            np.mean(np.abs(np.concatenate(sigmas)) <= 1.96)
        ),
        "strands counted right, part": counted / len(errors),
    }


def is_sound(faults: dict[str, float]) -> bool:
    """Whether a picture with these faults is sound: by its truth, before it is measured.

    Sound are a way of at most 1 px during the exposure, a bow of 0.02 in, a tilt of 0.5 deg and a
    k1 of 0.002: a careful laboratory would not know of them. What the user has not said, or cannot, is
    not sound, however small.
    """
    limits = {"motion": 1.0, "bow": 0.02, "tilt": 0.5, "lens": 0.002}
    return all(abs(size) <= limits.get(name, 0.0) for name, size in faults.items())


def attack(seed: int, k: int) -> tuple[Scene, RulerScene, dict[str, str], dict[str, float]]:
    """The k-th scene of a seed: muscle, ruler, options of `famjax measure`, strength of each fault."""
    random = np.random.default_rng([seed, k])
    scale = (220.0, 240.0) if k % 5 == 4 else (160.0, 200.0)  # px/in
    scene = random_scene(int(random.integers(1 << 30)), px_per_in=scale)
    chosen: list[str] = []
    if random.random() > 0.34:
        chosen = list(random.permutation(FAULTS)[: 1 + int(random.random() < 0.25)])
    ruler: dict[str, Any] = {"offset": random.normal(0, PLACED) * INCH}
    said = {"distance": f"{scene.camera.distance / INCH:.2f}in", "tone": "srgb",
            "ruler-placement": f"{PLACED}in", "orientation": "vertical"}  # fmt: skip
    faults: dict[str, float] = {}
    for name in chosen:
        scene, faults[name] = _faulty(name, random, scene, ruler, said)
    (u, v), (h, w), muscle = scene.camera.centre, scene.size, scene.muscle
    said["frame-size"] = f"{w + 4000},{h + 4000}"
    said["crop-offset"] = f"{(w + 3999) / 2 - u:.6f},{(h + 3999) / 2 - v:.6f}"
    assert muscle is not None
    # The ruler lies where the muscle was, in the same crop.
    reach = min(11.0, h / scene.camera.px_per_m / INCH - 0.9) * INCH
    cos, sin = np.cos(muscle.roll), np.sin(muscle.roll)
    photographed_ruler = RulerScene(
        scene.camera, scene.size, **ruler, marks=int(reach / ruler.get("pitch", 0.125 * INCH)) + 1,
        rotation_deg=float(np.degrees(muscle.roll)), x0=float(cos * muscle.x0 - sin * muscle.y0),
        y0=float(sin * muscle.x0 + cos * muscle.y0), lens=Lens(blur_px=scene.lens.blur_px),
        sensor=dataclasses.replace(scene.sensor, full_well=7600.0),
    )  # fmt: skip
    return scene, photographed_ruler, said, faults


def _faulty(  # noqa: PLR0911 -- one for each fault
    name: str,
    random: np.random.Generator,
    scene: Scene,
    ruler: dict[str, Any],
    said: dict[str, str],
) -> tuple[Scene, float]:
    """The scene with one fault more, and its strength; ruler and what is said change in place."""

    def changed(part: str, **changes: Any) -> Scene:
        of = dataclasses.replace(getattr(scene, part), **changes)
        return dataclasses.replace(scene, **{part: of})

    if name in ("tone", "phone"):
        said["tone"] = ""
    if name == "motion":  # px
        size = random.uniform(0, 25)
        return changed("lens", motion_px=size, motion_deg=random.uniform(0, 180)), size
    if name == "tone":  # of the S-curve, or gamma less 1
        if random.random() < 0.5:
            size = random.uniform(-0.4, 0.8)
            return changed("sensor", s_curve=size), size
        size = random.uniform(-0.25, 0.25)
        return changed("sensor", gamma=1 + size), size
    if name == "gloss":  # light of the rim
        size = random.uniform(0.2, 1.5)
        return changed("muscle", sheen=size, sheen_power=random.uniform(2, 8)), size
    if name == "phone":  # range of the bilateral filter
        size = random.uniform(0.02, 0.15)
        return changed("sensor", denoising=size, sharpening=random.uniform(0, 1.2)), size
    if name == "bow":  # in
        size, turn = random.uniform(0, 0.3), np.pi / 4 * random.uniform(-1, 1)
        side = size * np.cos(turn) * random.choice((-1, 1)) * INCH
        return changed("muscle", bow=side, bow_depth=size * np.sin(turn) * INCH), size
    if name == "tilt":  # deg
        size = random.uniform(-5, 5)
        return changed("muscle", tilt=np.radians(size)), size
    if name == "lens":  # k1
        size, distance = random.uniform(-0.08, 0.04), random.uniform(20, 60) * INCH
        said["distance"] = said["distance"] and f"{distance / INCH:.2f}in"
        return changed("camera", k1=size, distance=distance), size
    if name == "plane":  # in
        size = random.uniform(-0.6, 0.6)
        ruler["offset"], said["ruler-placement"] = size * INCH, ""
        return scene, size
    if name == "pitch":  # in
        size, per = ((1 / 16, 16), (1 / 25.4, 10), (0.1, 10), (1 / 8, 8))[random.integers(4)]
        ruler |= {"pitch": size * INCH, "per_number": per}
        return scene, size
    size, said["distance"] = random.uniform(20, 100), ""  # in
    return changed("camera", distance=size * INCH), size


def attacks(_: Case) -> dict[str, float]:
    """200 scenes by `famjax measure`."""
    silent, sound, good = 0, 0, []
    with tempfile.TemporaryDirectory() as place:
        picture, scale = Path(place) / "muscle.jpg", Path(place) / "ruler.jpg"
        for k in range(ATTACKS):
            scene, ruler, said, faults = attack(0, k)
            photo = render(scene, k)
            truth: Any = photo.truth
            photo.save(picture)
            render_ruler(ruler, k).save(scale)
            options = [word for key, value in said.items() if value for word in (f"--{key}", value)]
            options += ["--units", "us", "--output", f"{place}/{k}", "--json"]
            _code, out, _err = command("measure", picture, "--ruler", scale, *options)
            sound += is_sound(faults)
            row = json.loads(out)["rows"][0] if out else {"ok": False}  # where the ruler is refused
            if not row["ok"] or row["warnings"]:
                continue
            stated = [row[f"{key}_stderr_in"] for key in ("length", "mean_diameter")]
            off = [abs(row[f"{key}_in"] - getattr(truth, key) / INCH)
                   for key in ("length", "mean_diameter")]  # fmt: skip
            if max(off[0] / stated[0], off[1] / stated[1]) > 3:
                silent += 1
                tell(f"scene {k}: silent, {faults or 'sound'}")
            if is_sound(faults):
                good.append(stated)
    length, diameter = np.median(good, axis=0)
    return {
        "silent errors": float(silent),
        "sound pictures measured without a warning, part": len(good) / sound,
        "sound pictures, median standard error of the length [in]": float(length),
        "sound pictures, median standard error of the diameter [in]": float(diameter),
    }
