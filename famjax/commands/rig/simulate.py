"""Commands without hardware: a whole test in virtual time, a rig served in real time."""

from pathlib import Path
from typing import Literal

from ..loading import load_fitting
from ..options.whole_numbers import Seed
from ..terminal import progress
from .characterise import report_test
from .problems import rig_problems


def rig_simulate(
    plan: Path,
    *,
    fit: Path | None = None,
    baud: Literal[115200, 500000] = 115200,
    seed: Seed = 0,
    output: Path = Path("famjax-rig"),
    units: Literal["si", "metric", "us"] = "us",
    json_: bool = False,
) -> int:
    """Carry out the same test against a simulated rig, far faster than real time.

    Device, serial line, recorder and test machine are simulated with their noise and clocks; what
    they write is read back and analysed as a real test's is. Writes `test.fam` (journal),
    `machine.csv` (the machine's log), `dataset.csv` (for `famjax fit`), `characterisation.json` and
    `characterisation.png`.

    Parameters
    ----------
    plan
        TOML file with the tables [plan] and [rig]; a pressure limit is needed.
    fit
        A `fit.json` of the muscle; the reference work's 7/8 in muscle unless given.
    baud
        Of the firmware.
    seed
        Of all noise; the same seed gives the same files.
    output
        Folder for the files, made if need be; must not hold a journal.
    units
        Of the picture and the table: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    load_fitting()
    from famjax.chain import simulate
    from rig import read_plan

    with rig_problems():
        test = read_plan(plan)
        muscle, specimen = _simulated_muscle(fit)
        with progress("simulating") as show:
            done = simulate(
                test, output, muscle=muscle, specimen=specimen, baud=baud, seed=seed, progress=show
            )
        return report_test(done.analysis, [*done.paths], output, units, json_)


def _simulated_muscle(fit_json: Path | None):
    """A famjax muscle, tabulated for the rig, and its entries in a dataset."""
    from famjax.chain import reference_muscle, simulated_muscle

    if fit_json is None:
        muscle, others = reference_muscle(), ()
        known = {"name": "7/8 in, simulated", "wall_thickness_in": 0.0625, "bladder_diameter_in": 0.875,
                 "braid_thickness_in": 0.011, "nominal_diameter_in": 0.875}  # fmt: skip
    else:
        saved = load_fitting().load_fit(fit_json)
        muscle, others = saved.muscle, tuple(one.muscle for one in saved.others)
        specimen = saved.document["data"]["specimen"]
        known = {key: value for key, value in specimen.items() if not key.startswith("rest_length")}
        known = {key: value for key, value in known.items() if value is not None}
    members = (muscle, *others)  # a chosen model may be the mean of several
    low = max(float(one.geometry.length_range()[0]) for one in members)
    return simulated_muscle(members, shortest=low), known


def rig_serve(
    *,
    circuit: Literal["air", "water"] = "air",
    transport: Literal["pty", "tcp"] = "tcp",
    port: int = 0,
    link: Path | None = None,
    calibration: Path = Path("simulated-calibration.toml"),
    baud: Literal[115200, 500000] = 115200,
    seconds: float | None = None,
    seed: Seed = 0,
) -> int:
    """Run a simulated rig in real time on a TCP port or a pseudo-terminal, to try `monitor` and `run`.

    Prints the address to open and runs until Ctrl-C.

    Parameters
    ----------
    circuit
        air or water.
    transport
        tcp, or pty (not on Windows).
    port
        TCP port; a free one unless given.
    link
        Path of a symbolic link to the pseudo-terminal.
    calibration
        File for the calibration of the simulated sensors, which `run` and `monitor` need.
    baud
        Of the firmware; a served line is as fast as its device.
    seconds
        Duration; until Ctrl-C unless given.
    seed
        Of the sensors' noise.
    """
    import time

    from rig.calibration import write_calibration
    from rig.simulation import CIRCUITS, SimulatedRig

    from .server import RigServer

    with rig_problems():
        simulated = SimulatedRig(CIRCUITS[circuit](), baud=baud, seed=seed)
        write_calibration(calibration, simulated.calibration())
        with RigServer(simulated, transport, port=port, link=link) as server:
            print(server.address, flush=True)
            print(f"calibration: {calibration}", flush=True)
            end = None if seconds is None else time.monotonic() + seconds
            while end is None or time.monotonic() < end:
                time.sleep(0.1)
    return 0
