"""Characterisation folders end to end: twins of known muscles, clocks, kills, and damaged folders.

A twin is a folder made by the simulated rig and camera; it is evaluated by `famjax characterise`, as a
person would, and its results are held against its truth. `kills` ends the evaluation with SIGKILL, with
its workers, after random times, each run going on from the one before; its results must be the same
bytes as those of an undisturbed run. `damages` makes each mistake of `DAMAGES` in a sound folder, whose
pictures are measured: the evaluation must stop or warn at the right step with the right message.
"""

import csv
import dataclasses
import datetime
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from row import Case, command, tell

# isort: split
from rendering import published_ruler, render_ruler
from rendering.folder import TRUE_LENGTHS, write_twin
from rendering.folder_truth import TRUTH, drawn_truth, read_truth

import famjax
import fitting
from famjax.app import simulate
from famjax.app.folder import read_sheet
from famjax.plant import LinearMcKibben
from famjax.units import INCH, PSI
from fitting.records import MachineLog, synchronise
from fitting.shapes import Pictures
from rig.control import Control
from rig.plan import Isobaric, PlanFile
from rig.simulation import MachineClock

TWINS, CLOCKS, KILLS, SEED = 20, 100, 10, 3
HELD_OUT = np.array([55.0, 85.0]) * PSI
"""Set pressures between those of a small twin's test."""


def twins(_: Case) -> dict[str, float]:
    """The largest errors of small twins, and how many of their intervals hold the truth."""
    every = []
    for seed in range(TWINS):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "twin"
            write_twin(folder, seed=seed)
            begin = time.monotonic()
            _run(_characterise(folder))
            every.append(_against_truth(folder) | {"seconds": time.monotonic() - begin})
        tell(f"twin {seed}: {json.dumps(every[-1])}")
    within = sum(one["within"] for one in every) / sum(one["intervals"] for one in every)
    largest = {name: max(one[name] for one in every) for name in every[0] if "error" in name}
    return largest | {
        "95 % intervals of parameters and forces, part with the truth": within,
        "evaluation from cold, mean wall time [s]": float(
            np.mean([one["seconds"] for one in every])
        ),
    }


def _characterise(folder: Path, jobs: int = os.cpu_count() or 1) -> list[str]:
    return [sys.executable, "-m", "famjax", "characterise", str(folder), "--jobs", str(jobs)]


def _run(words: list[str]) -> None:
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _against_truth(folder: Path) -> dict[str, Any]:
    """A twin's results against its truth."""
    truth = read_truth(folder / TRUTH, drawn_truth(0, "small", flawed=True)).muscle
    results, true = folder / "results", truth.muscle()
    known: Any = true.geometry
    found = json.loads((results / "measured" / "figures.json").read_text())
    saved = fitting.load_fit(results / "measured" / "fit.json")
    table = results / "pictures" / "measurements.nc"
    surface, pictures = fitting.shape_surface(table), Pictures.of(table)
    # A picture at rest may be measured a hair longer than the muscle.
    where = np.minimum(surface.lengths, truth.rest_length)
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    shape = np.asarray(known.family.diameter(x, where[:, None], 0.0))
    with (folder / TRUE_LENGTHS).open(encoding="utf-8", newline="") as file:
        true_lengths = {row["picture"]: float(row["length_m"]) for row in csv.DictReader(file)}
    off_lengths = pictures.length - [true_lengths[Path(name).name] for name in pictures.names]
    largest = float(np.max(np.asarray(known.dimensions(where, 0.0).hoop_strain)))
    laws: tuple[Any, Any] = (saved.muscle, true)
    stress, truly = (
        np.asarray(one.material.stress(np.linspace(0.0, largest, 200))) for one in laws
    )
    data = fitting.read_csv(results / "records" / "dataset.csv")
    at = np.linspace(max(data.length.min(), surface.lengths[-1]), data.length.max(), 12)
    pressures = np.concatenate([HELD_OUT, np.unique(data.pressures.level[data.loaded])])

    def pull(muscle: famjax.Muscle) -> np.ndarray:
        """A reading is never below zero: what is slack pulls nothing."""
        return np.maximum(np.asarray(muscle.force(at, pressures[:, None])), 0.0)

    force, rows = pull(true), fitting.predict(saved, at, pressures)
    states = {(row["length_m"], row["pressure_Pa"]): row for row in rows}
    got, low, high = (np.array([[states[L, P][key] for L in at] for P in pressures])
                      for key in ("force_N", "low_95_N", "high_95_N"))  # fmt: skip
    inside = (low <= force) & (force <= high)
    # The same muscle but for the shape that the photographs show.
    sizes = ("rest_length", "wall_thickness", "bladder_diameter", "braid_thickness")
    specimen = dataclasses.replace(
        read_sheet(folder).specimen, **{name: getattr(truth, name) for name in sizes}
    )
    shown = surface.geometry(specimen, braid=known.family.braid)
    as_shown = pull(famjax.Muscle(shown, laws[1].material, true.deadband_pressure))
    values = zip(["E_1", "E_2", "E_3", "deadband_pressure", "turns"],
                 [*truth.coefficients, truth.deadband, truth.turns], strict=True)  # fmt: skip
    off = [abs(found["values"][name] - value) / found["std"][name] for name, value in values]

    def rms(error: np.ndarray) -> float:
        return float(np.sqrt(np.mean(error**2)))

    return {
        "diameter, RMS error [in]": rms(surface.diameters[0] - shape) / INCH,
        "contraction, largest error": float(np.abs(off_lengths).max() / truth.rest_length),
        "stress over the visited strains, largest error / largest":
            float(np.abs(stress - truly).max() / np.abs(truly).max()),
        "force at pressures held out, RMS error / largest": rms((got - force)[:2]) / force.max(),
        "force from photographs and true profiles, RMS error / largest":
            rms(as_shown - force) / force.max(),
        "intervals": inside.size + len(off),
        "within": int(inside.sum()) + sum(one <= 1.96 for one in off),
    }  # fmt: skip


def clocks(_: Case) -> dict[str, float]:
    """Errors of offset and rate of two clocks over their stated standard errors, RMS over 100 seeds."""
    found: dict[str, list[float]] = {}
    for seed in range(CLOCKS):
        for way, errors in (("load", _by_load(seed)), ("motion", _by_motion(seed))):
            for name, error in zip(("offset", "rate"), errors, strict=True):
                found.setdefault(f"by the {way}, {name}, RMS error / standard error", []).append(
                    error
                )
    return {name: float(np.sqrt(np.mean(np.square(errors)))) for name, errors in found.items()}


def _by_load(seed: int) -> tuple[float, float]:
    """A test on the simulated rig, whose machine's clock is laid onto the journal by the load."""
    rng = np.random.default_rng((seed, 0))
    friction, turns = rng.uniform(0.005, 0.03), 1.09 * rng.uniform(0.97, 1.03)
    low = float(rng.uniform(30, 45))
    plan = Isobaric((low * PSI, (low + 20) * PSI, (low + 40) * PSI), 1, 2.0 * INCH, 0.3 * INCH,
                    settle=3.0)  # fmt: skip
    clock = MachineClock(float(rng.uniform(-50, 50)), float(rng.uniform(-1e-4, 1e-4)))
    with tempfile.TemporaryDirectory() as folder:
        found = simulate(
            PlanFile(plan, "air", 115 * PSI, Control.per_psi(4, 2)), folder,
            muscle=LinearMcKibben(turns=turns), clock=clock,
            clock_rate=float(rng.uniform(-3e-3, 3e-3)), friction=friction, seed=seed,
        ).analysis.alignment  # fmt: skip
    apart = float(found.journal_time(found.reference)) - clock.true_time(found.reference)
    gain = 1 / (1 + clock.rate) - 1
    return apart / found.offset_error, (found.rate - gain) / found.rate_error


def _by_motion(seed: int) -> tuple[float, float]:
    """Lengths in photographs of a stroke there and back, laid onto a machine's displacement."""
    rng = np.random.default_rng((seed, 1))
    offset, rate = rng.uniform(-30, 30), 1 + rng.uniform(-3e-4, 3e-4)

    def displacement(at: np.ndarray) -> np.ndarray:
        return 2.8 * INCH * (1 - np.abs(2 * np.clip((at - 10) / 240, 0, 1) - 1))

    taken, logged = 0.4 + 1.09 * np.arange(220), np.arange(0, 270.0, 0.1)
    middle = taken.mean()
    at = taken + offset + (rate - 1) * (taken - middle) + rng.normal(0, 0.01, taken.size)
    lengths = 9.28 * INCH - displacement(at) + rng.normal(0, 0.001 * INCH, taken.size)
    found = synchronise(taken, lengths, MachineLog(logged, displacement(logged), source="log"))
    apart = found.offset - offset - (rate - 1) * (found.reference - middle)
    return apart / found.offset_stderr, (found.rate - rate) / found.rate_stderr


def kills(_: Case) -> dict[str, float]:
    """Files of the results that differ after kills."""
    rng, differing, done = np.random.default_rng(SEED), set(), 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "muscle"
        results, words = folder / "results", _characterise(folder, 2)

        def digests() -> dict[str, str]:
            return {str(path.relative_to(results)): hashlib.sha256(path.read_bytes()).hexdigest()
                    for path in results.rglob("*") if path.is_file()}  # fmt: skip

        def compare_and_empty() -> None:
            """All but the date of the first run, which is a part of the results, is removed."""
            again, date = digests(), (results / "first-run.json").read_bytes()
            differing.update(n for n in sound.keys() | again.keys() if sound.get(n) != again.get(n))
            shutil.rmtree(results)
            results.mkdir()
            (results / "first-run.json").write_bytes(date)

        write_twin(folder, seed=SEED)
        begin = time.monotonic()
        _run(words)
        whole, sound = time.monotonic() - begin, digests()
        compare_and_empty()
        while done < KILLS:
            process = subprocess.Popen(
                words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
            )
            time.sleep(float(rng.uniform(0.02, 0.7)) * whole)
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                done += 1
            else:
                compare_and_empty()
            process.wait()
        _run(words)
        compare_and_empty()
    return {"files that differ": float(len(differing))}


STEPS = ("records", "pictures", "shape")
SHEET, LOG, JOURNAL, PICTURES = "characterisation.toml", "machine.csv", "test.fam", "photographs"
# A laboratory whose sheet is right, so that what is changed in it is what is wrong.
_EXACT = "[errors]\n" + "".join(
    f"{name}_m = 0.0\n"
    for name in ("rest_length", "wall_thickness", "bladder_diameter", "braid_thickness")
)
_OTHERS = {
    "test": "[rig]\npressures_psi = [30, 60, 90]\nstroke_in = 1.9\nrate_in_per_s = 0.08\n"
    "[camera]\npictures = 2\n",
    "muscle": "[muscle]\nrest_length_in = 8.5\nbladder_diameter_in = 1.0\n[camera]\npictures = 12\n",
}
"""Folders that files are taken from: another test of the muscle, and another muscle."""

Change = Callable[[Path], object]
"""Does a mistake to a folder, beside which lie those of `_OTHERS`."""


def _edit(name: str, old: str, new: str) -> Change:
    def change(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text, old
        (folder / name).write_text(text.replace(old, new))

    return change


def _cut(name: str, part: float) -> Change:
    def change(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: round(part * len(content))])

    return change


def _from_test(*names: str) -> Change:
    return lambda folder: [shutil.copy(folder.parent / "test" / n, folder / n) for n in names]


def _columns(t: float = 1.0, x: float = 1.0, F: float = 1.0) -> Change:
    """Time, displacement and force of the log multiplied."""

    def change(folder: Path) -> None:
        names, units, *rows = (folder / LOG).read_text().splitlines()
        table = np.array([row.split(",") for row in rows], float) * [t, x, F, 1.0]
        lines = [f"{a:.5f},{b:.7f},{c:.5f},{d:.0f}" for a, b, c, d in table.tolist()]
        (folder / LOG).write_text("\n".join([names, units, *lines]) + "\n")

    return change


def _pictures(folder: Path) -> list[Path]:
    return sorted((folder / PICTURES).iterdir())


def _pictures_of_another_muscle(folder: Path) -> None:
    shutil.rmtree(folder / PICTURES)
    shutil.copytree(folder.parent / "muscle" / PICTURES, folder / PICTURES)


def _ruler_off(inches: float) -> Change:
    """The ruler as it is seen where it lies behind the plane of the axis."""

    def change(folder: Path) -> None:
        scene = published_ruler(size=(900, round(900 * 1100 / 2650)))
        off = dataclasses.replace(scene, offset=inches * INCH)
        render_ruler(off, 4).save(folder / "ruler.jpg")

    return change


def _stamp(path: Path) -> bytes:
    found = re.search(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d", path.read_bytes())
    assert found is not None
    return found.group()


def _times(of: Callable[[list[bytes]], list[bytes]]) -> Change:
    """Other times, of the same length, in the EXIF data of the pictures."""

    def change(folder: Path) -> None:
        paths = _pictures(folder)
        stamps = [_stamp(path) for path in paths]
        for path, old, new in zip(paths, stamps, of(stamps), strict=True):
            path.write_bytes(path.read_bytes().replace(old, new, 1))

    return change


def _clock(hours: float) -> Change:
    form, late = "%Y:%m:%d %H:%M:%S", datetime.timedelta(hours=hours)
    return _times(lambda stamps: [
        (datetime.datetime.strptime(one.decode(), form) + late).strftime(form).encode()
        for one in stamps
    ])  # fmt: skip


def _shuffled(count: int) -> list[int]:
    return np.random.default_rng(0).permutation(count).tolist()


def _renamed(folder: Path) -> None:
    paths = _pictures(folder)
    for path in paths:
        path.rename(path.with_suffix(".tmp"))
    for path, k in zip(paths, _shuffled(len(paths)), strict=True):
        path.with_suffix(".tmp").rename(path.with_name(f"P{k:04d}.JPG"))


def _unlink(count: int, folder: Path) -> None:
    for path in _pictures(folder)[count:]:
        path.unlink()


_WALL, _BORE, _REST, _PITCH = (
    "wall_thickness_in = 0.0625", "bladder_diameter_in = 0.875", "rest_length_in = 9.28125",
    "pitch_in = 0.125",
)  # fmt: skip
_NAMES = ("Extension,Load", "Load,Extension")
DAMAGES: tuple[tuple[str, Change, str, str, bool], ...] = (
    ("missing ruler", lambda f: (f / "ruler.jpg").unlink(), "", r"ruler\.jpg, which is not in", True),
    ("missing log", lambda f: (f / LOG).unlink(), "", r"machine\.csv, which is not in", True),
    ("a photograph of the muscle in place of the ruler",
     lambda f: shutil.copy(_pictures(f)[3], f / "ruler.jpg"), "", "ruler", True),
    ("empty journal", _cut(JOURNAL, 0), "records", "is not a journal", True),
    ("empty log", _cut(LOG, 0), "records", r"machine\.csv", True),
    ("wall of 1.5875 mm given as inches", _edit(SHEET, _WALL, "wall_thickness_in = 1.5875"), "",
     r"wall of 40\.32 mm does not fit.*check the units", True),
    ("columns of the log swapped", _edit(LOG, *_NAMES), "records", "unit|swapped|agree", True),
    ("columns of the log swapped with their units",
     lambda f: (_edit(LOG, *_NAMES)(f), _edit(LOG, "(mm),(N)", "(N),(mm)")(f)), "records",
     "columns swapped or wrongly named", True),
    ("mm in the log labelled inches", _edit(LOG, "(mm)", "(in)"), "records",
     "check the unit of the displacement", True),
    ("inches in the log labelled mm", _columns(x=1 / 25.4), "records", "ratio of inches and mm", True),
    ("lbf in the log labelled N", _columns(F=1 / 4.4482216), "records", "ratio of lbf and N", True),
    ("minutes in the log labelled seconds", _columns(t=1 / 60), "records",
     "check the unit of its time", True),
    ("sign of the force turned round", _columns(F=-1.0), "records", "pushing_positive must be true",
     True),
    ("sign of the displacement turned round", _columns(x=-1.0), "records",
     "shortening_positive must be true", True),
    ("decimal commas in a file with commas", _edit(LOG, ".", ","), "records", "decimal|column", True),
    ("log of another test", _from_test(LOG), "records", "of (one|the same) test", True),
    ("journal of another test", _from_test(JOURNAL), "records", "of (one|the same|two) tests?", True),
    ("sync column that is none",
     _edit(SHEET, 'machine_log = "machine.csv"', 'machine_log = "machine.csv"\nsync_column = "Sync"'),
     "records", "no column 'Sync'", True),
    ("half of the log", _cut(LOG, 0.55), "records", "complete strokes.*expected 6", False),
    ("half of the journal", _cut(JOURNAL, 0.55), "records", "complete stroke", False),
    ("rest length in mm that is in inches", _edit(SHEET, _REST, "rest_length_mm = 9.28125"), "records",
     "rest_length", True),
    ("wall of 0.0625 in given as mm", _edit(SHEET, _WALL, "wall_thickness_mm = 0.0625"), "records",
     "wall_thickness over bladder_diameter.*units", False),
    ("no pictures", lambda f: _unlink(0, f), "", "no pictures|there are no|photographs", True),
    ("five pictures", lambda f: _unlink(5, f), "shape", "5 pictures were measured.*6", True),
    ("journal and log of another test", _from_test(JOURNAL, LOG), "pictures", "length|displacement",
     True),
    ("pictures out of order: their times exchanged",
     _times(lambda stamps: [stamps[k] for k in _shuffled(len(stamps))]), "pictures",
     "of another test, or their times are not", True),
    ("pictures out of order: renamed", _renamed, "pictures", "differ in order", False),
    ("pictures without times", _times(lambda stamps: [b"0000:00:00 00:00:00"] * len(stamps)),
     "pictures", "have a time in their EXIF", False),
    ("camera's time zone off by 8 h", _clock(8), "pictures",
     r"8 h \d min ahead: a time zone|7 h 5\d min ahead: a time zone", False),
    ("camera's clock off by 3 h 22 min", _clock(-3.37), "pictures",
     r"3 h 2\d min behind: a clock that was not set", False),
    ("photographs of another muscle", _pictures_of_another_muscle, "pictures",
     "rest length.*another muscle|are of another test", True),
    ("ruler 1 in nearer than the axis", _ruler_off(-1.0), "pictures",
     r"as if the ruler had been 2[3-7](\.\d)? mm nearer", True),
    ("ruler 1 in behind the axis", _ruler_off(1.0), "pictures",
     r"as if the ruler had been 2[3-7](\.\d)? mm farther", True),
    ("ruler of inches read as cm", _edit(SHEET, _PITCH, "pitch_cm = 0.125"), "pictures",
     "ratio of inches and cm", True),
    ("rest length wrong by 1 in", _edit(SHEET, _REST, "rest_length_in = 8.28125"), "pictures",
     r"machine's zero, and the rest length: expected .* found 235\.\d mm", True),
    ("bladder of 1.5 in in place of 0.875", _edit(SHEET, _BORE, "bladder_diameter_in = 1.5"),
     "pictures", "narrower than its bladder", True),
    ("bladder of 0.6 in in place of 0.875", _edit(SHEET, _BORE, "bladder_diameter_in = 0.6"),
     "pictures", "check bladder_diameter", False),
)  # fmt: skip
"""Mistakes: name, what does it, step at which it must be told ("": before any), regular expression of what
must be told, and whether the work must stop there; else it goes on with a warning."""


def damages(_: Case) -> dict[str, float]:
    """Damages that stop or warn elsewhere than they must, or with another message."""
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        folder, sound = place / "muscle-under-test", place / "sound"
        for other, text in {**_OTHERS, "sound": _EXACT}.items():
            (place / "truth.toml").write_text(text)
            write_twin(place / other, seed=SEED + (other != "sound"), flawed=False,
                       truth=place / "truth.toml")  # fmt: skip
        code, said = _evaluated(sound.rename(folder))
        assert not code, said
        assert "warning" not in said, said
        folder.rename(sound)
        for title, change, step, says, stops in DAMAGES:
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(sound, folder)
            change(folder)
            code, said = _evaluated(folder)
            text = " ".join(said.splitlines())
            told = re.search(says, text)
            before = text[: told.start()] if told else text
            begun = re.findall(rf"\b({'|'.join(STEPS)})(?:: as before| \.\.\.)", before)
            right = told and (begun or [""])[-1] == step and code == (2 if stops else 0)
            if not right:
                wrong += 1
                tell(f"{title}: exit {code} at {begun[-1:]}: {said}")
    return {"not told at the right step": float(wrong)}


def _evaluated(folder: Path) -> tuple[int, str]:
    """The steps of a folder before its fits."""
    steps = [word for step in STEPS for word in ("--only", step)]
    code, _, said = command("characterise", folder, *steps, "--jobs", 2)
    return code, said
