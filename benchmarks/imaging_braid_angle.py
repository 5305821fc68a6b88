"""The braid angle read from photographs against that of the rendered strands.

    python benchmarks/imaging_braid_angle.py [--scenes 60] [--json PATH]

Muscles, lamps, lenses, weaves and files drawn at random: 150 to 260 px/in, 20 to 48 strands in each
direction, 0.8 to 1.4 turns, blur of 0.6 to 2 px, ISO 800 to 10 000, JPEG of quality 55 to 98, in
camera sharpening in a third. Half of the braids have black flecks.
"""

import argparse
import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from imaging import ImagingError, Recipe, Scale, measure
from imaging.synthetic import INCH, Jpeg, Lens, Scene, random_scene, render

PX_PER_IN = (150.0, 260.0)
WITHIN = 0.3  # deg
NORMAL = 1.96


@dataclasses.dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        what: the quantity, with its unit.
        found: its value.
        scenes: number of pictures.
    """

    what: str
    found: float
    scenes: int


def drawn(seed: int) -> Scene:
    """A scene of any weave, at 150 px/in or more."""
    random = np.random.default_rng(10_000 + seed)
    scene = random_scene(seed, px_per_in=PX_PER_IN)
    assert scene.muscle is not None
    muscle = dataclasses.replace(
        scene.muscle,
        strands=int(random.choice([20, 24, 28, 32, 36, 40, 48])),
        turns=random.uniform(0.8, 1.4),
        relief=random.uniform(0, 0.003) * INCH,
    )
    sensor = dataclasses.replace(
        scene.sensor,
        full_well=float(random.choice([7600.0, 1900.0, 600.0])),
        sharpening=float(random.choice([0.0, 0.0, 0.5])),
    )
    jpeg = Jpeg(int(random.integers(55, 98)), random.choice(["444", "422", "420"]))
    lens = Lens(blur_px=random.uniform(0.6, 2.0))
    return dataclasses.replace(scene, muscle=muscle, sensor=sensor, jpeg=jpeg, lens=lens)


def rows(scenes: int) -> Iterator[Row]:
    """All figures."""
    errors, scaled, means, parts, counted = [], [], [], [], 0
    for seed in range(scenes):
        scene = drawn(seed)
        assert scene.muscle is not None
        photo = render(scene, seed)
        camera, truth = scene.camera, photo.truth
        recipe = Recipe(
            Scale.manual(camera.px_per_m), camera.distance, centre=camera.centre, braid_angle=True
        )
        try:
            found = measure(photo.rgb, recipe)
        except ImagingError as error:
            print(f"scene {seed}: {type(error).__name__}: {error}")
            continue
        braid = found.braid
        assert braid is not None
        true = np.interp(braid.z / found.length, truth.z / truth.length, truth.braid_angle)
        off = (braid.angle - true)[braid.resolved]
        errors.append(np.degrees(off))
        scaled.append(off / braid.stderr[braid.resolved])
        means.append(abs(float(np.degrees(off.mean()))) if off.size else np.nan)
        parts.append(braid.part)
        counted += braid.yarns == scene.muscle.strands
    n = len(errors)
    every, sigmas = np.concatenate(errors), np.concatenate(scaled)
    yield Row("angle at z within 0.3 deg, part", float(np.mean(np.abs(every) <= WITHIN)), n)
    yield Row("angle at z, RMS error [deg]", float(np.sqrt(np.mean(every**2))), n)
    yield Row("angle at z, largest error [deg]", float(np.abs(every).max()), n)
    yield Row("mean angle of a picture, largest error [deg]", float(np.max(means)), n)
    yield Row(
        "angle at z within its 95 % interval, part", float(np.mean(np.abs(sigmas) <= NORMAL)), n
    )
    yield Row("length over which it is resolved, least part", float(min(parts)), n)
    yield Row("strands counted right, part", counted / n, n)


def main() -> None:
    """Print the rows, and write them as JSON if asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--scenes", type=int, default=60)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    done = []
    for row in rows(options.scenes):
        print(f"{row.what:52s} {row.found:9.4f}  {row.scenes:4d} scenes", flush=True)
        done.append(dataclasses.asdict(row))
    if options.json:
        options.json.write_text(json.dumps(done, indent=1))


if __name__ == "__main__":
    main()
