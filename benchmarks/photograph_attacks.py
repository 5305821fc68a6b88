"""Photographs that deceive: how many errors nobody would have been told of.

Run `python benchmarks/photograph_attacks.py` in a clone. Each of 200 scenes drawn at random has a
picture of a muscle, one of a ruler, and what their user says of them; two thirds have one or two
faults of random strength: motion in any direction, another tone curve, a glossy rim, a phone's
denoising and sharpening, a bowed or tilted axis, a lens that distorts, a ruler out of the plane or
of another pitch, a camera at a distance that is not said. Every fifth scene is of full size.

A picture is *sound* by its truth alone, decided before it is measured (`is_sound`): all that its
user says is true, and each fault is so small that a careful laboratory would not know of it. An
error is *silent* where the length or the mean diameter is off by more than 3 of its standard
errors, and the picture is neither refused nor measured with a warning.

`--write FOLDER` keeps pictures and `truth.csv`; `--folder FOLDER` measures those of a folder, which
another renderer may have made. Its table has the columns `picture`, `ruler` (file names),
`length_in`, `mean_diameter_in`, `sound` (0 or 1), `fault` (words), and one for each option of
`famjax measure` that the user gives, such as `distance` or `pitch`, empty where he does not.
`--csv PATH` writes what was found.
"""

import argparse
import csv
import dataclasses
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from imaging import ImagingError, measure
from imaging.camera import turned
from imaging.cli import RecipeOptions, command_recipe

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from rendering import INCH, Lens, MuscleTruth, RulerScene, Scene, random_scene, render, render_ruler

FAULTS = ("motion", "tone", "gloss", "phone", "bow", "tilt", "lens", "plane", "pitch", "distance")
SOUND_SHARE = 0.34  # scenes without a fault
TWO_FAULTS = 0.25
EVERY_FULL = 5
REDUCED, FULL = (160.0, 200.0), (220.0, 240.0)  # px/in
PLACED = 0.005  # in, standard deviation of a careful user's ruler
SIGMAS = 3.0
SILENT_ERRORS = 2
OPTIONS = tuple(field.name for field in dataclasses.fields(RecipeOptions))


@dataclasses.dataclass(frozen=True)
class Attack:
    """A scene with its faults and what its user says.

    Attributes:
        scene, ruler: what is photographed.
        faults: strength of each fault, in the unit that `drawn` gives it.
        said: options of `famjax measure` and their values.
        sound: see `is_sound`.
    """

    scene: Scene
    ruler: RulerScene
    faults: dict[str, float]
    said: dict[str, str]
    sound: bool


def is_sound(faults: dict[str, float]) -> bool:
    """Whether a picture with these faults is sound: by its truth, before it is measured.

    Sound are a way of at most 1 px during the exposure, a bow of 0.02 in, a tilt of 0.5 deg and a
    k1 of 0.002. Another tone curve, a rim of gloss, a phone's processing, a ruler out of the plane,
    a pitch that is not the published one and a distance that is not said are not, however small:
    their users have not said what the measurement needs, or cannot.
    """
    limits = {"motion": 1.0, "bow": 0.02, "tilt": 0.5, "lens": 0.002}
    return all(abs(size) <= limits.get(name, 0.0) for name, size in faults.items())


def drawn(seed: int, i: int) -> Attack:
    """The i-th scene of a seed."""
    random = np.random.default_rng([seed, i])
    scale = FULL if i % EVERY_FULL == EVERY_FULL - 1 else REDUCED
    scene = random_scene(int(random.integers(1 << 30)), px_per_in=scale)
    chosen: list[str] = []
    if random.random() > SOUND_SHARE:
        chosen = list(random.permutation(FAULTS)[: 1 + int(random.random() < TWO_FAULTS)])
    faults: dict[str, float] = {}
    ruler: dict[str, Any] = {"offset": random.normal(0, PLACED) * INCH}
    distance = scene.camera.distance
    said = {
        "distance": f"{distance / INCH:.2f}in", "tone": "srgb", "ruler_placement": f"{PLACED}in",
        "orientation": "vertical",
    }  # fmt: skip
    for name in chosen:
        scene, ruler, said, faults[name] = _faulty(name, random, scene, ruler, said)
    u, v = scene.camera.centre
    h, w = scene.size
    said["frame_size"] = f"{w + 4000},{h + 4000}"
    said["crop_offset"] = f"{(w + 3999) / 2 - u:.6f},{(h + 3999) / 2 - v:.6f}"
    muscle = scene.muscle
    assert muscle is not None
    # The ruler lies where the muscle was, in the same crop.
    x0, y0 = turned(muscle.x0, muscle.y0, muscle.roll)
    reach = min(11.0, scene.size[0] / scene.camera.px_per_m / INCH - 0.9) * INCH
    pitch = ruler.get("pitch", 0.125 * INCH)
    lying: dict[str, Any] = {
        "marks": int(reach / pitch) + 1,
        "rotation_deg": float(np.degrees(muscle.roll)),
        "x0": float(x0),
        "y0": float(y0),
    }
    ruler.update(lying)
    photographed = RulerScene(
        scene.camera,
        scene.size,
        **ruler,
        lens=Lens(blur_px=scene.lens.blur_px),
        sensor=dataclasses.replace(scene.sensor, full_well=7600.0),
    )
    return Attack(scene, photographed, faults, said, is_sound(faults))


def _faulty(
    name: str,
    random: np.random.Generator,
    scene: Scene,
    ruler: dict[str, Any],
    said: dict[str, str],
) -> tuple[Scene, dict[str, Any], dict[str, str], float]:
    """Scene, ruler and what is said with one fault more, and its strength."""
    muscle, size = scene.muscle, 0.0
    assert muscle is not None
    if name == "motion":  # px
        size = random.uniform(0, 25)
        lens = dataclasses.replace(scene.lens, motion_px=size, motion_deg=random.uniform(0, 180))
        scene = dataclasses.replace(scene, lens=lens)
    elif name == "tone":  # of the S-curve, or gamma less 1
        if random.random() < 0.5:
            size = random.uniform(-0.4, 0.8)
            scene = dataclasses.replace(
                scene, sensor=dataclasses.replace(scene.sensor, s_curve=size)
            )
        else:
            size = random.uniform(-0.25, 0.25)
            scene = dataclasses.replace(
                scene, sensor=dataclasses.replace(scene.sensor, gamma=1 + size)
            )
        said = said | {"tone": ""}
    elif name == "gloss":  # light of the rim
        size = random.uniform(0.2, 1.5)
        muscle = dataclasses.replace(muscle, sheen=size, sheen_power=random.uniform(2, 8))
    elif name == "phone":  # range of the bilateral filter
        size = random.uniform(0.02, 0.15)
        sensor = dataclasses.replace(
            scene.sensor, denoising=size, sharpening=random.uniform(0, 1.2)
        )
        scene = dataclasses.replace(scene, sensor=sensor)
        said = said | {"tone": ""}
    elif name == "bow":  # in
        size, turn = random.uniform(0, 0.3), np.pi / 4 * random.uniform(-1, 1)
        muscle = dataclasses.replace(
            muscle,
            bow=size * np.cos(turn) * random.choice((-1, 1)) * INCH,
            bow_depth=size * np.sin(turn) * INCH,
        )
    elif name == "tilt":  # deg
        size = random.uniform(-5, 5)
        muscle = dataclasses.replace(muscle, tilt=np.radians(size))
    elif name == "lens":  # k1
        size = random.uniform(-0.08, 0.04)
        distance = random.uniform(20, 60) * INCH
        camera = dataclasses.replace(scene.camera, k1=size, distance=distance)
        scene = dataclasses.replace(scene, camera=camera)
        said = said | ({"distance": f"{distance / INCH:.2f}in"} if said["distance"] else {})
    elif name == "plane":  # in
        size = random.uniform(-0.6, 0.6)
        ruler = ruler | {"offset": size * INCH}
        said = said | {"ruler_placement": ""}
    elif name == "pitch":  # in
        size, per = ((1 / 16, 16), (1 / 25.4, 10), (0.1, 10), (1 / 8, 8))[random.integers(4)]
        ruler = ruler | {"pitch": size * INCH, "per_number": per}
    elif name == "distance":  # in
        size = random.uniform(20, 100)
        scene = dataclasses.replace(
            scene, camera=dataclasses.replace(scene.camera, distance=size * INCH)
        )
        said = said | {"distance": ""}
    return dataclasses.replace(scene, muscle=muscle), ruler, said, size


def write(folder: Path, seed: int, scenes: int) -> None:
    """Pictures and their table."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for i in range(scenes):
        attack = drawn(seed, i)
        photo = render(attack.scene, i)
        assert isinstance(photo.truth, MuscleTruth)
        row = {
            "picture": f"{i:03d}.jpg", "ruler": f"{i:03d}-ruler.jpg",
            "length_in": photo.truth.length / INCH,
            "mean_diameter_in": photo.truth.mean_diameter / INCH,
            "sound": int(attack.sound),
            "fault": " ".join(f"{name}={size:.3g}" for name, size in attack.faults.items()),
        }  # fmt: skip
        photo.save(folder / str(row["picture"]))
        render_ruler(attack.ruler, i).save(folder / str(row["ruler"]))
        rows.append(row | dict.fromkeys(_TOLD, "") | attack.said)
    with (folder / "truth.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)


_TOLD = ("distance", "tone", "pitch", "ruler_placement", "k1", "frame_size", "crop_offset")


@dataclasses.dataclass(frozen=True)
class Found:
    """What came of one picture; lengths in inches.

    Attributes:
        picture, fault, sound: of the table.
        verdict: "measured", "warned" or "refused".
        why: the refusal or the warnings.
        length_error, diameter_error: found less true.
        length_stderr, diameter_stderr: as stated.
        silent: a wrong figure without a word.
    """

    picture: str
    fault: str
    sound: bool
    verdict: str
    why: str = ""
    length_error: float = np.nan
    length_stderr: float = np.nan
    diameter_error: float = np.nan
    diameter_stderr: float = np.nan

    @property
    def sigmas(self) -> float:
        """The larger of both errors over its standard error."""
        return max(
            abs(self.length_error) / self.length_stderr,
            abs(self.diameter_error) / self.diameter_stderr,
        )

    @property
    def silent(self) -> bool:
        """Off by more than three standard errors without refusal or warning."""
        return self.verdict == "measured" and self.sigmas > SIGMAS


def measured(folder: Path) -> Iterator[Found]:
    """Each picture of a folder by its row of `truth.csv`."""
    with (folder / "truth.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            what = row["picture"], row.get("fault", ""), bool(int(row["sound"]))
            said = {name: row[name] for name in OPTIONS if row.get(name)}
            options: dict[str, Any] = {**said, "ruler": folder / row["ruler"]}
            try:
                recipe, _ = command_recipe(RecipeOptions(**options))
                found = measure(folder / row["picture"], recipe)
            except ImagingError as error:
                yield Found(*what, "refused", f"{type(error).__name__}: {error}")
                continue
            warnings = getattr(found, "warnings", ())
            yield Found(
                *what,
                "warned" if warnings else "measured",
                " | ".join(warnings),
                found.length / INCH - float(row["length_in"]),
                found.length_stderr / INCH,
                found.mean_diameter / INCH - float(row["mean_diameter_in"]),
                found.mean_diameter_stderr / INCH,
            )


def figures(found: list[Found]) -> dict[str, float]:
    """What is promised of all pictures together."""
    sound = [one for one in found if one.sound]
    good = [one for one in sound if one.verdict == "measured"]
    return {
        "scenes": len(found),
        "silent errors": sum(bool(one.silent) for one in found),
        "sound": len(sound),
        "sound, measured without a warning": len(good) / max(len(sound), 1),
        "sound, median standard error of the length [in]": _median(good, "length_stderr"),
        "sound, median standard error of the diameter [in]": _median(good, "diameter_stderr"),
        "sound, median error of the length [in]": _median(good, "length_error"),
        "sound, median error of the diameter [in]": _median(good, "diameter_error"),
    }


def _median(found: list[Found], name: str) -> float:
    return float(np.median([abs(getattr(one, name)) for one in found])) if found else float("nan")


def attacked(seed: int, scenes: int, folder: Path | None = None) -> list[Found]:
    """What comes of a folder's pictures, or of scenes drawn here."""
    if folder is not None:
        return list(measured(folder))
    with tempfile.TemporaryDirectory() as made:
        write(Path(made), seed, scenes)
        return list(measured(Path(made)))


def main() -> None:
    """Print each silent error and each sound picture refused, then the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    if options.write:
        write(options.write, options.seed, options.scenes)
        return
    found = attacked(options.seed, options.scenes, options.folder)
    for one in found:
        if one.silent or (one.sound and one.verdict != "measured"):
            what = f"{one.sigmas:.1f} sigma" if one.silent else one.why
            print(f"{one.picture} [{one.fault or 'sound'}] {what}")
    for why, n in Counter(one.why.partition(":")[0] for one in found if one.why).most_common():
        print(f"{n:4d} {why}")
    for name, value in figures(found).items():
        print(f"{name:52s} {value:.4g}")
    if options.csv:
        with options.csv.open("w", newline="") as file:
            table = csv.DictWriter(file, [field.name for field in dataclasses.fields(Found)])
            table.writeheader()
            table.writerows(dataclasses.asdict(one) for one in found)
    if options.json:
        options.json.write_text(json.dumps(figures(found), indent=1))


if __name__ == "__main__":
    main()
