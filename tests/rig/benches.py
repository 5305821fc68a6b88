"""Rigs in virtual time, entered and recorded as the tests need them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig.control import Control, Rig
from rig.device import Device
from rig.journal import Journal
from rig.link import VirtualLink
from rig.protocol import SAFE
from rig.simulation import SimulatedRig

PSI = 6894.757293168361
LIMIT = 110 * PSI
GAINS = Control.per_psi(4, 2)


class Exchanged(Device):
    """A board with the plugs of transducer and load cell exchanged."""

    def tick(self, pressure_counts: int, force_counts: int) -> None:
        super().tick(force_counts, pressure_counts)


def opened(sim: SimulatedRig, journal: Journal | None = None, **changes: Any) -> Rig:
    """A rig under 110 psi, still to be entered."""
    calibration = changes.pop("calibration", None) or sim.calibration()
    settings = {"pressure_limit": LIMIT, "control": GAINS, "journal": journal, **changes}
    return Rig(VirtualLink(sim), calibration, **settings)


def journal_of(path: Path, sim: SimulatedRig, **options: bool) -> Journal:
    return Journal(path, lambda: sim.now, reserve_bytes=0, **options)


def vented(sim: SimulatedRig) -> bool:
    return sim.device.state == SAFE and sim.device.output == 0 and sim.device.dump_open


def highest(sim: SimulatedRig) -> Callable[[], float]:
    """What tells the highest true pressure [Pa] from now on."""
    peak, step = [0.0], sim.plant.step

    def watched(*args: Any) -> None:
        step(*args)
        peak[0] = max(peak[0], sim.pressure)

    sim.plant.step = watched
    return lambda: peak[0]
