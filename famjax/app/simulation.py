"""Simulate a complete test without hardware, from the plan to the recorded files and the dataset."""

import datetime
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp

import famjax
from famjax.plant import LinearMcKibben
from famjax.units import INCH, PSI
from fitting.records import read_machine_log, write_dataset
from rig.calibration import Calibration
from rig.errors import RigError
from rig.execution import JOURNAL, Attendant, Request, Situation, record_test
from rig.journal import read_journal
from rig.link import VirtualLink
from rig.plan import PlanFile
from rig.simulation import CIRCUITS, MachineClock, SimulatedRig, load_cell, machine_for

from .isobaric import Analysis, analyse

LOG, DATASET = "machine.csv", "dataset.csv"
"""File names of the machine log and the dataset from a test."""


class SimulatedTest(NamedTuple):
    """Result of a simulated test.

    Attributes:
        analysis: alignment, record and characterisation.
        paths: paths of the files, in the order in which they were written.
    """

    analysis: Analysis
    paths: tuple[Path, ...]


class Watcher(Attendant):
    """Reports progress about once per second of plan time.

    Args:
        progress: called with the elapsed time and the total planned time [s].
    """

    def __init__(self, progress: Callable[[float, float], None]) -> None:
        self._progress = progress

    def look(self, situation: Situation) -> Request:
        """Report progress during the first 1/20 s of each second of plan time."""
        if situation.done % 1.0 < 1 / 20:
            self._progress(situation.done, situation.done + situation.left)
        return ""


def reference_muscle() -> famjax.Muscle:
    """Return the 7/8 in muscle from the reference work, the default muscle for the simulated rig.

    References:
        Chambers 2021, chapter 6: latex bladder.
    """
    braid = famjax.Braid(9.89 * INCH, 1.09, 0.011 * INCH)
    bladder = famjax.Bladder(9.28125 * INCH, 0.875 * INCH, 0.0625 * INCH)
    latex = famjax.PolynomialMaterial(jnp.array([257.8, -57.9, 32.7]) * PSI)
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), latex)


def simulate_device(test: PlanFile, folder: str | Path, *, seed: int = 0) -> Path:
    """Run a test on a simulated rig with a stationary machine, and return the path of the journal.

    Raises:
        RigError: see `Rig` and `run`.
    """
    path, muscle = Path(folder) / JOURNAL, LinearMcKibben()
    path.parent.mkdir(parents=True, exist_ok=True)
    machine = machine_for(muscle, MachineClock(), seed=seed + 2)
    rig = SimulatedRig(CIRCUITS[test.circuit](), muscle, machine, seed=seed)
    record_test(test, VirtualLink(rig), rig.calibration(), path)
    return path


def simulate(
    test: PlanFile,
    folder: str | Path,
    *,
    muscle: famjax.AbstractMuscle | None = None,
    specimen: Mapping[str, object] | None = None,
    clock: MachineClock | None = None,
    clock_rate: float = -0.002,
    friction: float = 0.02,
    seed: int = 0,
    began: datetime.datetime | None = None,
    calibrated: Callable[[Calibration], Calibration] | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> SimulatedTest:
    """Run a test on a simulated rig in virtual time, and analyse the files that it writes.

    The files are written and read back like those from a real test. The machine reverses when the force
    falls to zero, or at the end of the planned stroke.

    Args:
        test: plan, circuit, pressure limit and gains; the calibration in it is not used.
        folder: folder for the files; it must not contain a journal.
        muscle: muscle to simulate; a `LinearMcKibben` by default.
        specimen: specimen entries for the dataset besides the rest length, with units in the keys.
        clock: clock used for the machine log; by default 12.345 s ahead and 50 ppm fast.
        clock_rate: relative error in the rate of the device's clock.
        friction: friction in the muscle, see `SimulatedRig`.
        seed: seed for all noise.
        began: date and time of the test; the current time by default.
        calibrated: function that maps the true calibration of the sensors to the assumed one; by default,
            the two are equal.
        progress: called with the elapsed time and the total planned time [s].

    Returns:
        The analysis, and the paths of the journal, log and dataset.

    Raises:
        RigError: see `Rig`, `run` and `analyse`.
    """
    folder = Path(folder)
    paths = [folder / name for name in (JOURNAL, LOG, DATASET)]
    folder.mkdir(parents=True, exist_ok=True)
    muscle = muscle or LinearMcKibben()
    machine = machine_for(muscle, clock or MachineClock(12.345, 50e-6), seed=seed + 2)
    longest = machine.rest_length - machine.shortest
    if test.plan.stroke > longest:
        raise RigError(
            f"the stroke in the plan must be <= {longest:.5g} m, got {test.plan.stroke:.5g} m"
        )
    # Blocked force at the limit plus a margin: a saturated load cell would bend the curves.
    most = 1.2 * float(muscle.blocked_force(test.pressure_limit))
    rig = SimulatedRig(
        CIRCUITS[test.circuit](), muscle, machine, force_sensor=load_cell(most), clock_rate=clock_rate,
        friction=friction, seed=seed,
    )  # fmt: skip
    believed = rig.calibration() if calibrated is None else calibrated(rig.calibration())
    record_test(
        test, VirtualLink(rig), believed, paths[0], machine=machine,
        attendant=None if progress is None else Watcher(progress), began=began,
    )  # fmt: skip
    machine.write_log(paths[1])
    found = analyse(
        read_journal(paths[0]), read_machine_log(paths[1]), rest_length=float(muscle.rest_length)
    )
    write_dataset(found.characterisation, paths[2], specimen=specimen)
    return SimulatedTest(found, tuple(paths))
