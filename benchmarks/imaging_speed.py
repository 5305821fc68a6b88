"""Speed of the photogrammetry with its accuracy beside it, and scikit-image's in the same run.

    python benchmarks/imaging_speed.py [--repeats 12] [--pictures 60] [--json]

A crop of 2650 x 1100 px against rgb2hsv + threshold_otsu + label + regionprops + find_contours on
the same crop (the reference work's outline, on V of HSV, as scikit-image's users write it) and
against the last four alone with V given; a 5568 x 3712 px JPEG against its decoding; a campaign in
two processes against one. One thread, runs interleaved, the shortest of each taken. Where other
programs run beside it take the processor times: they count what this process has used, and nothing
else.
"""

import argparse
import dataclasses
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.color import rgb2hsv
from skimage.filters import threshold_otsu
from skimage.measure import find_contours, label, regionprops

from imaging import Measurement, Recipe, Scale, Tone, measure, process, read_image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from rendering import PUBLISHED_FRAME, MuscleTruth, Photo, published_scene, render

INCH = 0.0254
CONTRACTIONS = (0.0, 0.175, 0.2625)
COLOUR, GREY = "scikit-image, rgb2hsv and its four calls", "scikit-image, its four calls, V given"
WANTED = {"crop": 15.0, "file": 1.6, "workers": 1.7}
"""The issue's figures: times faster than scikit-image, times of decoding, throughput of two workers."""


@dataclasses.dataclass(frozen=True)
class Line:
    """One way of doing one task.

    Attributes:
        task: what was done.
        way: how.
        wall_ms: shortest of the repeats.
        cpu_ms: the same of the processor time of this process.
        bias_in, rms_in: of the diameter along the muscle [in]; nan where there is none.
        length_error_in: of the length [in]; nan where there is none.
    """

    task: str
    way: str
    wall_ms: float
    cpu_ms: float
    bias_in: float = float("nan")
    rms_in: float = float("nan")
    length_error_in: float = float("nan")


def interleaved(ways: dict[str, Callable[[], Any]], repeats: int) -> dict[str, tuple[float, float]]:
    """Shortest wall and processor time of each way [ms], the ways taking turns.

    What else the machine does makes a run longer and never shorter.
    """
    spent: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for turn in range(repeats + 1):
        for name, way in ways.items():
            wall, cpu = time.perf_counter(), time.process_time()
            way()
            if turn:  # the first loads libraries and fills caches
                spent[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {
        name: (1e3 * min(wall for wall, _ in each), 1e3 * min(cpu for _, cpu in each))
        for name, each in spent.items()
    }


def by_scikit_image(value: NDArray[Any]) -> NDArray[np.float64]:
    """The outline as its users find it: rows and columns of the longest contour at Otsu's level."""
    level = threshold_otsu(value)
    largest = max(regionprops(label(value > level)), key=lambda region: region.area)
    top, _, bottom, _ = largest.bbox
    longest = max(find_contours(value, level), key=len)
    return longest[(longest[:, 0] >= top) & (longest[:, 0] <= bottom)]


def diameter_errors(contour: NDArray[np.float64], truth: MuscleTruth) -> NDArray[np.float64]:
    """Width of a contour at the true rows of the braid, less the true one [in].

    Read in the picture, where perspective and roll play no part.
    """
    middle = np.median((truth.left + truth.right) / 2)
    sides = []
    for side in (contour[contour[:, 1] < middle], contour[contour[:, 1] >= middle]):
        ordered = side[np.argsort(side[:, 0])]
        sides.append(np.interp(truth.rows, ordered[:, 0], ordered[:, 1]))
    return (sides[1] - sides[0] - (truth.right - truth.left)) / truth.px_per_m / INCH


def our_errors(found: Measurement, truth: MuscleTruth) -> tuple[float, float, float]:
    """Bias and RMS of D(z), and the error of the length [in]."""
    at = found.z / found.length
    off = (found.diameter - np.interp(at, truth.z / truth.length, truth.diameter)) / INCH
    return float(off.mean()), float(np.sqrt(np.mean(off**2))), (found.length - truth.length) / INCH


def recipe_of(truth: MuscleTruth) -> Recipe:
    """That of the scene, its scale known to a ruler's 1e-5."""
    scale = Scale.manual(truth.px_per_m, 1e-5 * truth.px_per_m)
    return Recipe(scale, distance=60 * INCH, tone=Tone.srgb(), k1=0.0)


def truth_of(photo: Photo) -> MuscleTruth:
    """The truth of a photograph of a muscle."""
    assert isinstance(photo.truth, MuscleTruth)
    return photo.truth


def crops(repeats: int) -> list[Line]:
    """Ours and scikit-image on crops, at three contractions."""
    lines = []
    for seed, contraction in enumerate(CONTRACTIONS):
        photo = render(published_scene(contraction), seed)
        truth, rgb = truth_of(photo), photo.rgb
        value = rgb.max(axis=2)
        recipe = recipe_of(truth)
        ways = {
            "this project": lambda rgb=rgb, recipe=recipe: measure(rgb, recipe),
            COLOUR: lambda rgb=rgb: by_scikit_image(rgb2hsv(rgb)[..., 2]),
            GREY: lambda value=value: by_scikit_image(value),
        }
        times = interleaved(ways, repeats)
        task = f"crop 2650 x 1100, contraction {contraction:g}"
        off = diameter_errors(by_scikit_image(value), truth)
        theirs = float(off.mean()), float(np.sqrt(np.mean(off**2)))
        lines += [
            Line(task, "this project", *times["this project"],
                 *our_errors(measure(rgb, recipe), truth)),
            *(Line(task, way, *times[way], *theirs) for way in (COLOUR, GREY)),
        ]  # fmt: skip
    return lines


def whole_file(folder: Path, repeats: int) -> list[Line]:
    """From a full JPEG file to the measurement, and its decoding alone."""
    photo = render(published_scene(0.175, size=PUBLISHED_FRAME), 5)
    path = str(photo.save(folder / "frame.jpg"))
    truth = truth_of(photo)
    recipe = recipe_of(truth)
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    ways = {
        "cv2.imread alone": lambda: cv2.imread(path, flags),
        "reading with checks": lambda: read_image(path),
        "this project, file to measurement": lambda: measure(path, recipe),
    }
    times = interleaved(ways, repeats)
    task = f"file 5568 x 3712, {os.path.getsize(path) / 1e6:.1f} MB"
    errors = our_errors(measure(path, recipe), truth)
    return [
        Line(task, way, *spent, *(errors if "project" in way else ()))
        for way, spent in times.items()
    ]


def campaign(folder: Path, pictures: int) -> dict[str, float]:
    """Pictures per second of one and of two processes, from their first result to their last."""
    paths = []
    photo = render(published_scene(0.175), 7)
    data = photo.jpeg()
    for k in range(pictures):
        paths.append(folder / f"{k:04d}.jpg")
        paths[-1].write_bytes(data)
    recipe = recipe_of(truth_of(photo))
    # The first round of the two only warms the caches.
    return {f"{workers} workers": _rate(paths, recipe, workers) for workers in (1, 2, 1, 2)}


def _rate(paths: Sequence[Path], recipe: Recipe, workers: int) -> float:
    reports: list[tuple[float, int]] = []
    process(
        paths,
        recipe,
        executor=workers,
        progress=lambda done, _: reports.append((time.perf_counter(), done)),
    )
    # Starting the processes is no part of a long campaign's rate, nor is its uneven end.
    steady = [(at, done) for at, done in reports if 2 * workers <= done <= len(paths) - 2 * workers]
    return (steady[-1][1] - steady[0][1]) / (steady[-1][0] - steady[0][0])


def main(arguments: list[str] | None = None) -> int:
    """Run everything and print it; exit code 1 if a ratio of processor times misses the issue's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--repeats", type=int, default=12)
    parser.add_argument("--pictures", type=int, default=60, help="of the campaign; 0 leaves it out")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        lines = [*crops(given.repeats), *whole_file(Path(name), given.repeats)]
        rates = campaign(Path(name), given.pictures) if given.pictures else {}
    ours, theirs, grey = (
        [line for line in lines if line.task.startswith("crop") and line.way == way]
        for way in ("this project", COLOUR, GREY)
    )
    decoding, _, whole = lines[-3:]
    ratios = {
        "crop": min(b.cpu_ms / a.cpu_ms for a, b in zip(ours, theirs, strict=True)),
        "crop, wall": min(b.wall_ms / a.wall_ms for a, b in zip(ours, theirs, strict=True)),
        "crop, V given": min(b.cpu_ms / a.cpu_ms for a, b in zip(ours, grey, strict=True)),
        "file": whole.cpu_ms / decoding.cpu_ms,
        "file, wall": whole.wall_ms / decoding.wall_ms,
    }
    if rates:
        ratios["workers"] = rates["2 workers"] / rates["1 workers"]
    loads = {"load_before": load, "load_after": os.getloadavg()[0], "cores": os.cpu_count()}
    if given.json:
        rows = [dataclasses.asdict(line) for line in lines]
        print(json.dumps({"lines": rows, "pictures_per_s": rates, "ratios": ratios, **loads}))
    else:
        _show(lines, rates, ratios, loads)
    kept = ratios["crop"] >= WANTED["crop"] and ratios["file"] <= WANTED["file"]
    return 0 if kept else 1


def _show(
    lines: list[Line], rates: dict[str, float], ratios: dict[str, float], loads: dict[str, Any]
) -> None:
    print(f"{'task':36} {'way':41} {'wall ms':>8} {'cpu ms':>8}  D bias / RMS, in    L, in")
    for line in lines:
        accuracy = "" if np.isnan(line.bias_in) else f"{line.bias_in:+.5f} / {line.rms_in:.5f}"
        length = "" if np.isnan(line.length_error_in) else f"{line.length_error_in:+.5f}"
        print(f"{line.task:36} {line.way:41} {line.wall_ms:8.1f} {line.cpu_ms:8.1f}  "
              f"{accuracy:20} {length}")  # fmt: skip
    for name, rate in rates.items():
        print(f"campaign of crops, {name}: {rate:.2f} pictures/s")
    print(f"times faster than scikit-image per crop: {ratios['crop']:.1f} of processor time, "
          f"{ratios['crop, wall']:.1f} of wall time (wanted {WANTED['crop']:g}); "
          f"{ratios['crop, V given']:.2f} of its four calls alone with V given")  # fmt: skip
    print(f"file to measurement over decoding: {ratios['file']:.2f} of processor time, "
          f"{ratios['file, wall']:.2f} of wall time (wanted {WANTED['file']:g})")  # fmt: skip
    if rates:
        print(f"two workers over one: {ratios['workers']:.2f} (wanted {WANTED['workers']:g} on a "
              "quiet machine)")  # fmt: skip
    print(f"load of the machine {loads['load_before']:.1f} before, {loads['load_after']:.1f} "
          f"after, on {loads['cores']} cores")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
