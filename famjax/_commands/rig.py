"""`famjax rig`: with a device, simulated, and on what was recorded."""

import contextlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter
from rich.console import Console
from rich.progress import Progress

from .app import app, load_fitting, print_rows

rig_app = App(
    name="rig",
    help="Control a muscle's pressure, record a test, or simulate both; see rig/firmware.",
    help_format="markdown",
)
app.command(rig_app)


@contextlib.contextmanager
def _rig_problems() -> Iterator[None]:
    """Bad input of the rig as that of every command, and a rig that had to stop with exit code 1."""
    from fitting import InputError  # noqa: PLC0415
    from rig import RigError, RigFault  # noqa: PLC0415

    try:
        yield
    except RigError as error:
        raise InputError(str(error)) from None
    except RigFault as fault:
        notes = "".join(f"\n{note}" for note in getattr(fault, "__notes__", ()))
        print(f"famjax: the test was stopped: {fault}{notes}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print(
            "famjax: stopped; a rig that ran has been vented, and its journal holds all until then",
            file=sys.stderr,
        )
        sys.exit(130)


@rig_app.command(name="ports")
def rig_ports() -> int:
    """List the serial ports of this computer."""
    from rig import ports  # noqa: PLC0415

    found = ports()
    for row in found:
        print(f"{row['port']}  {row['description']}")
    if not found:
        print("no serial port; plug the device in, or give socket://host:port")
    return 0


@rig_app.command(name="monitor")
def rig_monitor(
    port: str,
    *,
    calibration: Path | None = None,
    baud: int = 115200,
    seconds: float | None = None,
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Show live values and a plot of the pressure; sends nothing that changes the device.

    Opening the port resets most boards, which then vent. In a terminal the picture is redrawn;
    elsewhere a line is printed every second.

    Parameters
    ----------
    port
        A serial port or socket://host:port.
    calibration
        TOML file of the rig's sensors; counts are shown without one.
    baud
        Of the firmware.
    seconds
        To go on for; until Ctrl-C unless given.
    units
        Of the values: si, metric or us.
    """
    from time import monotonic  # noqa: PLC0415

    from rich.live import Live  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    from rig import Link, Monitor, read_calibration, serial_opener  # noqa: PLC0415

    with _rig_problems():
        view = Monitor(read_calibration(calibration) if calibration else None, units)
        link = Link(serial_opener(port, baud))
        link.watch = view.add
        end = None if seconds is None else monotonic() + seconds
        console = Console()
        try:
            with Live(console=console, auto_refresh=False, transient=True) as live:
                while end is None or monotonic() < end:
                    link.sleep(0.2 if console.is_terminal else 1.0)
                    settings = link.session.settings
                    view.ticks_per_record = settings.ticks_per_record if settings else 5
                    if console.is_terminal:
                        live.update(Text(f"{view.line()}\n{view.plot()}"), refresh=True)
                    else:
                        print(view.line(), flush=True)
        finally:
            link.close()
    return 0


@rig_app.command(name="run")
def rig_run(
    plan: Path,
    *,
    port: str | None = None,
    baud: int = 115200,
    output: Path = Path("famjax-rig"),
    resume: Annotated[bool, Parameter(negative=())] = False,
) -> int:
    """Carry out a test at constant pressures and record it; the rig vents however this ends.

    Prints first what must hold that no software can see: relief valve, dump valve. Writes
    `test.fam` into the output folder. Start the test machine's strokes when the pressure is held.

    Parameters
    ----------
    plan
        TOML file with the tables [plan] and [rig]; a pressure limit is needed.
    port
        A serial port or socket://host:port.
    baud
        Of the firmware.
    output
        Folder for the journal, made if need be.
    resume
        Go on in the journal that is there, with the pressure that was not completed.
    """
    from rig import PRECONDITIONS, need_port, read_plan, run_test  # noqa: PLC0415

    with _rig_problems():
        test = read_plan(plan)
        print(
            f"Circuit of {test.circuit}, limit {test.pressure_limit / 1e3:.4g} kPa. Make sure that:"
        )
        for sentence in PRECONDITIONS[test.circuit]:
            print(f"- {sentence}")
        with Progress(console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task("running the plan", total=None)
            path = run_test(
                test,
                need_port(port),
                output,
                baud=baud,
                resume=resume,
                progress=lambda done, total: progress.update(task, completed=done, total=total),
            )
    print("written:", path)
    return 0


def _simulated_muscle(fit_json: Path | None):
    """A famjax muscle, tabulated for the rig, and its entries in a dataset."""
    import jax  # noqa: PLC0415
    import jax.numpy as jnp  # noqa: PLC0415
    import numpy as np  # noqa: PLC0415

    from rig.simulation import SimulatedMuscle  # noqa: PLC0415

    from .. import Bladder, Braid, EstimatedGeometry, Muscle, PolynomialMaterial, units  # noqa: PLC0415

    if fit_json is None:  # the reference work's 7/8 in muscle with the latex of its chapter 6
        braid = Braid(9.89 * units.INCH, 1.09, 0.011 * units.INCH)
        bladder = Bladder(9.28125 * units.INCH, 0.875 * units.INCH, 0.0625 * units.INCH)
        latex = PolynomialMaterial(jnp.array([257.8, -57.9, 32.7]) * units.PSI)
        muscle = Muscle(EstimatedGeometry(braid, bladder), latex)
        known = {"name": "7/8 in, simulated", "wall_thickness_in": 0.0625, "bladder_diameter_in": 0.875,
                 "braid_thickness_in": 0.011, "nominal_diameter_in": 0.875}  # fmt: skip
    else:
        saved = load_fitting().load_fit(fit_json)
        muscle = saved.muscle
        specimen = saved.document["specimen"]
        known = {key: value for key, value in specimen.items() if not key.startswith("rest_length")}
        known = {key: value for key, value in known.items() if value is not None}
    rest = float(muscle.geometry.rest_length)
    low = float(muscle.geometry.length_range()[0])
    lengths, pressures = np.linspace(low, rest, 201), np.linspace(0.0, 125.0 * units.PSI, 26)

    def state(length, pressure):
        at = muscle.geometry.dimensions(length, pressure)
        return muscle.force(length, pressure), at.volume - at.bladder_volume

    over = jax.vmap(jax.vmap(state, (None, 0)), (0, None))
    force, volume = jax.jit(over)(lengths, pressures)
    tables = np.asarray(force), np.asarray(volume)
    return SimulatedMuscle(lengths, pressures, *tables, rest_length=rest), known


@rig_app.command(name="simulate")
def rig_simulate(
    plan: Path,
    *,
    fit: Path | None = None,
    seed: int = 0,
    output: Path = Path("famjax-rig"),
    units: Literal["si", "metric", "us"] = "us",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
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
    from rig import read_plan  # noqa: PLC0415
    from rig.simulation import simulate  # noqa: PLC0415

    with _rig_problems():
        test = read_plan(plan)
        muscle, specimen = _simulated_muscle(fit)
        with Progress(console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task("simulating", total=None)
            done = simulate(
                test,
                output,
                muscle=muscle,
                specimen=specimen,
                seed=seed,
                progress=lambda now, total: progress.update(task, completed=now, total=total),
            )
        return _report_test(done.analysis, [*done.paths], output, units, json_)


@rig_app.command(name="characterise")
def rig_characterise(
    journal: Path,
    log: Path,
    *,
    rest_length: str,
    sync_column: str | None = None,
    near: str | None = None,
    near_within: str = "5s",
    skip_cycles: int = 0,
    shortening_positive: Annotated[bool, Parameter(negative=())] = False,
    pushing_positive: Annotated[bool, Parameter(negative=())] = False,
    zero_displacement: str = "0mm",
    specimen: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    output: Path = Path("famjax-rig"),
    units: Literal["si", "metric", "us"] = "us",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Turn a test's journal and the test machine's log into curves, figures and a dataset to fit.

    Writes `dataset.csv`, `characterisation.json` and `characterisation.png`.

    Parameters
    ----------
    journal
        The rig's journal.
    log
        The machine's log: any delimited text with time, displacement and force with their units.
    rest_length
        Active length at zero contraction with its unit, `9.28125in`.
    sync_column
        Column of the log with the rig's sync pulses; without it the load aligns the clocks.
    near
        What is to be added to the machine's time to give the journal's, roughly, with its unit;
        needed where equal strokes leave it open.
    near_within
        How far that may be off.
    skip_cycles
        First strokes at each pressure that are left out.
    shortening_positive
        The machine's displacement grows as the muscle shortens.
    pushing_positive
        The machine's force is positive in compression.
    zero_displacement
        What the machine shows at the rest length.
    specimen
        Describe the muscle for the fit, key_unit=value, repeatable.
    output
        Folder for the files, made if need be.
    units
        Of the picture and the table: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    from rig import (  # noqa: PLC0415
        analyse,
        quantity,
        read_journal,
        read_machine_log,
        specimen_entries,
        write_dataset,
    )

    with _rig_problems():
        entries = specimen_entries(specimen)
        rest, zero = quantity(rest_length, "length"), quantity(zero_displacement, "length")
        roughly = near and (quantity(near, "time"), quantity(near_within, "time"))
        found = analyse(
            read_journal(journal),
            read_machine_log(log),
            rest_length=rest,
            sync_column=sync_column,
            near=roughly or None,
            skip_cycles=skip_cycles,
            shortening_positive=shortening_positive,
            pushing_positive=pushing_positive,
            zero_displacement=zero,
        )
        output.mkdir(parents=True, exist_ok=True)
        path = write_dataset(found.characterisation, output / "dataset.csv", specimen=entries)
        return _report_test(found, [path], output, units, json_)


def _report_test(found, paths: list[Path], output: Path, units: str, json_: bool) -> int:
    """Write figures and picture of a test, and print its table."""
    from rig import figures, plot_characterisation, table_rows  # noqa: PLC0415

    document = figures(found)
    picture, numbers = output / "characterisation.png", output / "characterisation.json"
    plot_characterisation(found, units).savefig(picture, dpi=150)
    numbers.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    paths = [*(path for path in paths if path != numbers), numbers, picture]
    if json_:
        print(json.dumps(document | {"files": [str(p) for p in paths]}, allow_nan=False))
        return 0
    print_rows("Isobars", table_rows(found.characterisation, units))
    for note in found.characterisation.notes:
        print("note:", note)
    print("written:", ", ".join(map(str, paths)))
    return 0


@rig_app.command(name="replay")
def rig_replay(
    journal: Path,
    *,
    speed: float = 10.0,
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Show a recorded test as `monitor` would have, faster.

    Parameters
    ----------
    journal
        The journal.
    speed
        Seconds of the test per second; 0 prints a line for every second of the test at once.
    units
        Of the values: si, metric or us.
    """
    from time import sleep  # noqa: PLC0415

    from rich.live import Live  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    from rig import Monitor, Sample, read_journal, stored_calibration  # noqa: PLC0415

    with _rig_problems():
        record = read_journal(journal)
        view = Monitor(stored_calibration(record), units)
        console = Console()
        drawn = console.is_terminal and speed > 0
        with Live(console=console, auto_refresh=False, transient=True) as live:
            for k, row in enumerate(record.rows.tolist()):
                view.add(Sample(*row))
                if drawn and k % 20 == 0:
                    live.update(Text(f"{view.line()}\n{view.plot()}"), refresh=True)
                    sleep(0.2 / speed)
                elif not drawn and k % 100 == 0:
                    print(view.line())
                    if speed > 0:
                        sleep(1.0 / speed)
    print(view.line())
    return 0


@rig_app.command(name="check")
def rig_check(
    journal: Path,
    *,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Check a journal: is it whole, what was lost, did the device do what its law says?

    Exit code 0 when it is sound, 1 when it is not; records that the line lost are told and do not
    make it unsound.

    Parameters
    ----------
    journal
        The journal.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    from dataclasses import asdict  # noqa: PLC0415

    from rig import audit, read_journal  # noqa: PLC0415

    with _rig_problems():
        found = audit(read_journal(journal))
    print(json.dumps(asdict(found) | {"sound": found.sound}) if json_ else found)
    return 0 if found.sound else 1


@rig_app.command(name="convert")
def rig_convert(journal: Path, target: Path) -> int:
    """Write a journal's records as a table with units; the journal stays the record.

    Parameters
    ----------
    journal
        The journal.
    target
        File to write: .parquet, .nc (NetCDF) or .csv.
    """
    from rig import convert  # noqa: PLC0415

    with _rig_problems():
        print("written:", convert(journal, target))
    return 0


@rig_app.command(name="serve")
def rig_serve(
    *,
    circuit: Literal["air", "water"] = "air",
    transport: Literal["pty", "tcp"] = "tcp",
    port: int = 0,
    link: Path | None = None,
    calibration: Path = Path("simulated-calibration.toml"),
    seconds: float | None = None,
    seed: int = 0,
) -> int:
    """Run a simulated rig in real time on a TCP port or a pseudo-terminal, to try `monitor` and `run`.

    Prints what to open, and goes on until Ctrl-C.

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
    seconds
        To go on for; until Ctrl-C unless given.
    seed
        Of the sensors' noise.
    """
    import time  # noqa: PLC0415

    from rig import write_calibration  # noqa: PLC0415
    from rig.simulation import HydraulicCircuit, PneumaticCircuit, RigServer, SimulatedRig  # noqa: PLC0415

    with _rig_problems():
        plant = PneumaticCircuit() if circuit == "air" else HydraulicCircuit()
        simulated = SimulatedRig(plant, seed=seed)
        write_calibration(calibration, simulated.calibration())
        with RigServer(simulated, transport, port=port, link=link) as server:
            print(server.address, flush=True)
            print(f"calibration: {calibration}", flush=True)
            end = None if seconds is None else time.monotonic() + seconds
            while end is None or time.monotonic() < end:
                time.sleep(0.1)
    return 0
