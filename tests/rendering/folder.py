"""A twin: a characterisation folder of a muscle that is known, made by the simulated rig and camera."""

import csv
import dataclasses
import datetime
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from famjax.app.folder import SHEET
from famjax.app.simulation import LOG, simulate
from famjax.units import INCH, PSI
from rig.calibration import Calibration
from rig.control import Control
from rig.plan import Isobaric, PlanFile
from rig.simulation import MachineClock

from . import CameraSensor, Tape, published_ruler, published_scene, render, render_ruler
from .folder_truth import MOST, STATED, TRUTH, Truth, drawn_truth, read_truth, truth_text
from .sequence import START, at_length

TRUE_LENGTHS = "truth-lengths.csv"  # of every picture; no step of an evaluation reads it

_LOG_INTERVAL = 0.02  # s, of the simulated machine


def write_twin(
    folder: Path, *, seed: int = 0, size: Literal["small", "large"] = "small",
    flawed: bool = True, truth: Path | None = None,
) -> None:  # fmt: skip
    """Make a characterisation folder of a known muscle: the same arguments make the same bytes.

    If it is to be flawed, a picture is damaged and the log lacks a second.
    """
    assert not (folder / SHEET).exists(), folder
    made_of = drawn_truth(seed, size, flawed=flawed)
    if truth is not None:
        made_of = read_truth(truth, made_of)
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng((seed, 1))
    record = _test(folder, made_of, seed)
    lengths = _photographs(folder, record, made_of, rng, seed)
    _flaw(folder, made_of, rng)
    (folder / SHEET).write_text(_sheet(made_of, seed), encoding="utf-8")
    head = (
        f"# What this twin was made from, with the noise of seed {seed}. No evaluation reads it.\n"
        f"# Edit it, and make another: `write_twin` of tests/rendering/folder.py, seed {seed}, "
        f"size {size}, truth {TRUTH}\n\n"
    )
    (folder / TRUTH).write_text(head + truth_text(made_of), encoding="utf-8")
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows([("picture", "length_m"), *lengths.items()])
    (folder / TRUE_LENGTHS).write_text(table.getvalue(), encoding="utf-8")


def _test(folder: Path, truth: Truth, seed: int) -> Any:
    """Journal and log of the test; its record, which the evaluation makes anew."""
    muscle, rig = truth.muscle, truth.rig
    plan = Isobaric(rig.pressures, rig.cycles, rig.stroke, rig.rate, settle=rig.settle)
    limit = max(115 * PSI, 1.15 * max(rig.pressures))
    made = simulate(
        PlanFile(plan, "air", limit, Control.per_psi(4, 2)), folder,
        muscle=muscle.muscle(), friction=muscle.friction,
        clock=MachineClock(rig.clock_ahead, rig.clock_drift), seed=seed,
        began=START.replace(tzinfo=datetime.UTC),
        calibrated=lambda perfect: _calibrated(perfect, truth.errors),
    )  # fmt: skip
    (folder / "dataset.csv").unlink()
    log = folder / LOG
    rows = list(csv.reader(log.read_text(encoding="utf-8").splitlines()))
    place = rows[0].index("Load")
    for row in rows[2:]:  # two lines are its header
        row[place] = f"{float(row[place]) * (1 + truth.errors.force_reading):.4f}"
    log.write_text("\n".join(",".join(row) for row in rows) + "\n", encoding="utf-8")
    return made.analysis.record


def _calibrated(perfect: Calibration, errors: Any) -> Calibration:
    """What the laboratory believes of its transducer, with the standard errors of that."""
    gain = perfect.pressure.gain * (1 + errors.pressure_reading)
    believed = dataclasses.replace(
        perfect.pressure, gain=gain, zero=perfect.pressure.zero - errors.pressure_zero / gain,
        gain_std=STATED.pressure_reading * gain, zero_std=STATED.pressure_zero / gain,
    )  # fmt: skip
    return dataclasses.replace(perfect, pressure=believed)


def _photographs(
    folder: Path, record: Any, truth: Truth, rng: np.random.Generator, seed: int
) -> Mapping[str, float]:
    """Pictures over the strokes of the test, and the ruler; the true length [m] by picture."""
    camera, rest = truth.camera, truth.muscle.rest_length
    size = (camera.rows, round(camera.rows * 1100 / 2650))
    sensor, offset = CameraSensor(camera.electrons, camera.read_noise), camera.ruler_offset
    ruler = dataclasses.replace(published_ruler(size=size), sensor=sensor, offset=offset)
    render_ruler(ruler, seed + 1).save(folder / "ruler.jpg")
    held = np.flatnonzero(np.isfinite(record.set_pressure))
    times = np.linspace(record.time[held[0]] + 2, record.time[held[-1]] - 2, camera.pictures)
    taken = times + camera.jitter * rng.standard_normal(times.size)
    lengths = np.minimum(np.interp(taken, record.time, record.length), rest)
    (folder / "photographs").mkdir(exist_ok=True)
    # Yarns as fine as the real ones, at every scale: thick ones shift the outline where they cross.
    scene = published_scene(0.0, size=size, rest_length=rest)
    tape = Tape(diameter=truth.muscle.bladder_diameter)
    assert scene.muscle is not None
    body = dataclasses.replace(scene.muscle, strands=36, upper=tape, lower=tape)
    scene = dataclasses.replace(scene, muscle=body, sensor=sensor)
    found = {}
    for k, (time, length) in enumerate(zip(times, lengths.tolist(), strict=True)):
        contraction = float(np.clip(1 - length / rest, 0.0, MOST))
        shown = camera.clock_ahead + (1 + camera.clock_drift) * float(time)
        stamp = START + datetime.timedelta(seconds=shown)
        picture = at_length(scene, length, truth.muscle.shape(contraction), stamp)
        name = f"DSC_{k:04d}.JPG"
        render(picture, seed + 100 + k).save(folder / "photographs" / name)
        found[name] = length
    return found


def _flaw(folder: Path, truth: Truth, rng: np.random.Generator) -> None:
    """Cut pictures short, and a piece out of the machine's log, in the middle half of each."""
    pictures = sorted((folder / "photographs").iterdir())
    middle = np.arange(len(pictures) // 4, max(3 * len(pictures) // 4, 1))
    for k in rng.choice(middle, min(truth.camera.damaged, middle.size), replace=False).tolist():
        content = pictures[k].read_bytes()
        pictures[k].write_bytes(content[: len(content) // 3])
    log = folder / LOG
    lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
    first = int(rng.integers(len(lines) // 4, 3 * len(lines) // 4))
    rows = round(truth.rig.lost / _LOG_INTERVAL)
    log.write_text("".join(lines[:first] + lines[first + rows :]), encoding="utf-8")


def _sheet(truth: Truth, seed: int) -> str:
    muscle, errors = truth.muscle, truth.errors
    names = ("rest_length", "wall_thickness", "bladder_diameter", "braid_thickness")
    shown = {name: (getattr(muscle, name) + getattr(errors, name)) / INCH for name in names}
    sizes = "\n".join(f"{name}_in = {value:.6g}" for name, value in shown.items())
    stated = "\n".join(f"{name}_in = {getattr(STATED, name) / INCH:.3g}" for name in names)
    return f"""\
# A twin: made by the simulated rig and camera, seed {seed}. {TRUTH} holds what it was made from.

[specimen]
name = "twin {seed}"
{sizes}

[records]
journal = "test.fam"
machine_log = "machine.csv"

[photographs]
pictures = "photographs"
ruler = "ruler.jpg"
distance_in = 60
pitch_in = 0.125
ruler_placement_in = 0.01

[errors]
{stated}
force_reading = {STATED.force_reading:g}

[fit]
law = "polynomial"
order = {min(len(muscle.coefficients), 4)}
starts = 4
"""
