"""A twin: a characterisation folder of a muscle that is known, made by the simulated rig and camera."""

import dataclasses
import datetime
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import jax.numpy as jnp
import numpy as np

import famjax
from famjax.boundary.errors import InputError
from famjax.units import INCH, PSI
from rig.control import Control, Isobaric, PlanFile
from rig.simulation import MachineClock

from ..simulation import LOG, simulate, simulated_muscle
from .sheet import SHEET

TRUTH = "truth.json"
"""What a twin is made from; no step of an evaluation reads it."""

_STATIONS, _CONTRACTIONS = 201, 29
_REST, _MOST = 9.28125 * INCH, 0.345  # the profiles are known up to 0.35
_FITTING = 0.875 * INCH  # diameter of fittings and tapes
_STRANDS = 36  # of the reference work's braid
_START = datetime.datetime(2021, 3, 1, 10, 0, 0)


class Size(NamedTuple):
    """How large a twin is: set pressures [psi], cycles, stroke [in], rate [in/s], pictures, their rows."""

    pressures: tuple[float, ...]
    cycles: int
    stroke: float
    rate: float
    pictures: int
    rows: int


SIZES: dict[str, Size] = {
    "small": Size((40.0, 70.0, 100.0), 1, 2.4, 0.1, 36, 900),
    "large": Size(tuple(range(10, 101, 10)), 3, 3.1, 0.1, 200, 1200),
}


@dataclasses.dataclass(frozen=True)
class TwinMuscle:
    """A muscle drawn about the reference work's 7/8 in one.

    Attributes:
        coefficients: E_1 to E_3 of the law [Pa].
        deadband: P_d [Pa].
        turns: of one thread.
        friction: part of the force by which the branches differ from their mean.
    """

    coefficients: tuple[float, float, float]
    deadband: float
    turns: float
    friction: float = 0.01

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "TwinMuscle":
        """Within a tenth of the reference work's, stable."""
        scale = 1 + rng.uniform(-0.1, 0.1, 3)
        law = np.array([257.8, -57.9, 32.7]) * PSI * scale
        return cls(
            (float(law[0]), float(law[1]), float(law[2])),
            float(rng.uniform(2e3, 12e3)),
            float(1.09 * (1 + rng.uniform(-0.02, 0.02))),
        )

    def muscle(self) -> famjax.Muscle:
        """As a model: the shape that the camera sees, and the law."""
        from imaging.synthetic import stroke_shape  # noqa: PLC0415 -- where a twin is made

        x, c = np.linspace(0, 1, _STATIONS), np.linspace(0.0, 0.35, _CONTRACTIONS)
        shapes = np.stack([np.asarray(stroke_shape(float(one), _FITTING)(x)) for one in c])
        braid = famjax.Braid(9.89 * INCH, self.turns, 0.011 * INCH)
        surface = famjax.profiles.SampledSurface(
            lengths=_REST * (1 - c),
            pressures=[0.0],
            diameters=shapes[None],
            braid=braid,
            margin=0.0,
        )
        geometry = famjax.MeasuredGeometry(
            surface, famjax.Bladder(_REST, 0.875 * INCH, 0.0625 * INCH)
        )
        return famjax.Muscle(
            geometry, famjax.PolynomialMaterial(jnp.array(self.coefficients)), self.deadband
        )


def write_twin(
    folder: Path,
    *,
    seed: int = 0,
    size: Literal["small", "large"] = "small",
    flawed: bool = True,
    progress: Callable[[str, float, float], None] | None = None,
) -> TwinMuscle:
    """Make a characterisation folder of a known muscle.

    A test on the simulated rig in air, photographs of it by a camera with a clock of its own, a
    ruler, the sheet, and `truth.json`. With noise everywhere, a shutter that jitters, clocks that
    drift and, if it is to be flawed, a damaged picture and a second that the log lacks.

    Args:
        folder: must not hold a sheet.
        seed: of the muscle and of all noise.
        size: small, for a try in minutes, or large, of ten pressures and two hundred pictures.
        flawed: whether a picture and the log are damaged.
        progress: called with what is made, what is done and what there is to do.

    Returns:
        The true muscle.

    Raises:
        InputError: the folder has a sheet.
    """
    if (folder / SHEET).exists():
        raise InputError(f"{folder} has a {SHEET}: give a new folder for the twin")
    show = progress or (lambda *_: None)
    rng = np.random.default_rng(seed)
    true, scope = TwinMuscle.drawn(rng), SIZES[size]
    folder.mkdir(parents=True, exist_ok=True)
    plan = Isobaric(
        tuple(P * PSI for P in scope.pressures), scope.cycles, scope.stroke * INCH,
        scope.rate * INCH, settle=6.0,
    )  # fmt: skip
    test = PlanFile(plan, "air", 115 * PSI, Control.per_psi(4, 2))
    clock = MachineClock(float(rng.uniform(-20, 20)), float(rng.uniform(-60e-6, 60e-6)))
    muscle = simulated_muscle([true.muscle()], shortest=_REST * (1 - _MOST), friction=true.friction)
    made = simulate(
        test, folder, muscle=muscle, clock=clock, seed=seed,
        progress=lambda done, total: show("simulating the test", done, total),
    )  # fmt: skip
    (folder / "dataset.csv").unlink()  # the evaluation makes its own
    record = made.analysis.record
    shown = _photographs(folder, record, scope, rng, seed, show)
    if flawed:
        _flaw(folder, rng)
    (folder / SHEET).write_text(_sheet(seed), encoding="utf-8")
    truth = {
        **dataclasses.asdict(true), "seed": seed, "size": size, "lengths_m": shown,
        "clock": dataclasses.asdict(clock),
    }  # fmt: skip
    (folder / TRUTH).write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return true


def _photographs(
    folder: Path,
    record: Any,
    scope: Size,
    rng: np.random.Generator,
    seed: int,
    show: Callable[[str, float, float], None],
) -> dict[str, float]:
    """Pictures over the strokes of the test, and the ruler; the true length [m] by picture."""
    from imaging.synthetic import (  # noqa: PLC0415 -- OpenCV, where a twin is made
        Tape,
        published_ruler,
        published_scene,
        render,
        render_ruler,
        stroke_shape,
    )

    size = (scope.rows, round(scope.rows * 1100 / 2650))
    scene = published_scene(0.0, size=size)
    assert scene.muscle is not None
    render_ruler(published_ruler(size=size), seed + 1).save(folder / "ruler.jpg")
    held = np.flatnonzero(np.isfinite(record.set_pressure))
    times = np.linspace(record.time[held[0]] + 2, record.time[held[-1]] - 2, scope.pictures)
    taken = times + 0.01 * rng.standard_normal(times.size)
    lengths = np.minimum(np.interp(taken, record.time, record.length), _REST)
    ahead, rate = float(rng.uniform(-300, 300)), 1 + float(rng.uniform(-30e-6, 30e-6))
    (folder / "photographs").mkdir(exist_ok=True)
    # Yarns as fine as the real ones, at every scale: thick ones shift the outline where they cross.
    tape = Tape(diameter=_FITTING)
    body = dataclasses.replace(scene.muscle, strands=_STRANDS, upper=tape, lower=tape)
    for k, (time, length) in enumerate(zip(times, lengths, strict=True)):
        show("taking photographs", k, times.size)
        contraction = float(np.clip(1 - length / _REST, 0.0, 0.35))
        now = dataclasses.replace(
            body, profile=stroke_shape(contraction, _FITTING), length=float(length),
            y0=body.y0 - (_REST - float(length)) / 2,
        )  # fmt: skip
        stamp = _START + datetime.timedelta(seconds=ahead + rate * float(time))
        picture = dataclasses.replace(scene, muscle=now, time=stamp)
        render(picture, seed + 100 + k).save(folder / "photographs" / f"DSC_{k:04d}.JPG")
    return {f"DSC_{k:04d}.JPG": float(length) for k, length in enumerate(lengths)}


def _flaw(folder: Path, rng: np.random.Generator) -> None:
    """Cut a picture short, and a second out of the machine's log."""
    pictures = sorted((folder / "photographs").iterdir())
    victim = pictures[int(rng.integers(len(pictures) // 4, 3 * len(pictures) // 4))]
    content = victim.read_bytes()
    victim.write_bytes(content[: len(content) // 3])
    log = folder / LOG
    lines = log.read_text(encoding="utf-8").splitlines(keepends=True)
    first = int(rng.integers(len(lines) // 4, 3 * len(lines) // 4))
    log.write_text("".join(lines[:first] + lines[first + 50 :]), encoding="utf-8")


def _sheet(seed: int) -> str:
    return f"""\
# A twin: made by the simulated rig and camera, seed {seed}. truth.json holds what it was made from.

[specimen]
name = "twin {seed}"
rest_length_in = 9.28125
wall_thickness_in = 0.0625
bladder_diameter_in = 0.875
braid_thickness_in = 0.011

[records]
journal = "test.fam"
machine_log = "machine.csv"

[photographs]
pictures = "photographs"
ruler = "ruler.jpg"
distance_in = 60
pitch_in = 0.125
ruler_placement_in = 0.01

[fit]
law = "polynomial"
order = 3
starts = 4
"""
