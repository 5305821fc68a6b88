"""Control the pressure in a muscle and record tests; see rig/firmware.

A plan file (PLAN.toml) states the units in its keys (psi, kPa, bar, in, mm, ...):

```toml
[plan]
pressures_psi = [20, 40, 60, 80, 90]
cycles = 3
stroke_in = 3.4
rate_in_per_s = 0.04
settle_s = 10

[rig]
circuit = "air"                       # or "water", with gains of 3 and 8
pressure_limit_psi = 110              # trips the device; required
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
calibration = "calibration.toml"      # sensor calibration; not needed by `simulate`
# jump_limit_psi = 15                 # trips at this change within 10 ms
# integral_limits_counts = [-128, 128]
# stall_s = 3                         # trips at full output without a pressure rise
# frozen_s = 0.75                     # trips if the reading ignores the output
```
"""

import contextlib
import functools
import json
import math
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic
from typing import Any, Literal

from famjax.boundary.units import from_si, parse_quantity, quantity_unit, si_unit, unit_system
from famjax.console import Units
from rig.errors import RigError, RigFault

COMMANDS: list[Callable[..., int]] = []  # subcommands of `famjax rig`

# Safety conditions that software cannot check.
PRECONDITIONS = {
    "air": (
        "The supply regulator is set no higher than the rating of the muscle and hoses.",
        "A normally open dump valve vents the muscle if the power fails.",
        "The proportional valve exhausts at 0 % output.",
        "Nobody is standing in line with the ends of the muscle.",
    ),
    "water": (
        "A mechanical relief valve is fitted: software cannot limit the peak if a needle valve blocks.",
        "A normally open dump valve returns the water to the tank.",
        "The pump stops at 0 % output, and its power switch is within reach.",
        "The circuit is bled: trapped air stores energy.",
    ),
}
STEPS = (
    *range(40, 201, 20),
    *range(180, 39, -20),
)  # pump outputs, up and down: hysteresis appears as scatter
PRESSURISE = "Type yes to pressurise the muscle: "
WORDS = "Type begin (or Enter alone), pause, skip, repeat or stop, and press Enter."


@contextlib.contextmanager
def ended_in_words() -> Iterator[None]:
    """Exit with code 1 after a fault and 130 after a signal; by then the rig has vented."""
    names = ("SIGTERM", "SIGHUP") if threading.current_thread() is threading.main_thread() else ()
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    except RigFault as fault:
        notes = "".join(f"\n{note}" for note in getattr(fault, "__notes__", ()))
        print(f"famjax: the test was stopped: {fault}{notes}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("famjax: stopped; the rig has been vented", file=sys.stderr)
        sys.exit(130)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _command(function: Callable[..., int]) -> Callable[..., int]:
    """Register a function as a rig command with error handling."""

    @functools.wraps(function)
    def run(*given: Any, **options: Any) -> int:
        with ended_in_words():
            return function(*given, **options)

    COMMANDS.append(run)
    return run


@_command
def monitor(
    port: str,
    *,
    calibration: Path | None = None,
    baud: int = 115200,
    seconds: float | None = None,
    units: Units = "metric",
) -> int:
    """Print live values every second without changing the state of the device.

    Opening the port resets most boards, which then vent.

    Parameters
    ----------
    port
        Serial port or socket://host:port.
    calibration
        Sensor calibration file (TOML). If omitted, values are shown in counts.
    baud
        Baud rate for which the firmware was built: 115200 (2.1 % fast on an Uno) or 500000 (exact).
    seconds
        Duration in seconds. If omitted, the command runs until you press Ctrl-C.
    units
        Units of the printed values: si, metric or us.
    """
    from rig.calibration import read_calibration

    known = read_calibration(calibration) if calibration else None
    end = monotonic() + (seconds or math.inf)
    with opened(port, baud) as link:
        while monotonic() < end:
            link.sleep(1.0)
            print(values(link.newest, known, units), flush=True)
    return 0


@_command
def acknowledge(
    port: str, *, calibration: Path | None = None, baud: int = 115200, yes: bool = False
) -> int:
    """Acknowledge a trip after its cause has been found; nothing else clears a trip.

    Shows the cause of the trip, the reading and the output, and asks for confirmation. The device refuses
    to clear the trip while the pressure is at the limit or the reading is out of range.

    Parameters
    ----------
    port
        Serial port or socket://host:port.
    calibration
        Sensor calibration file (TOML). If omitted, the reading is shown in counts.
    baud
        Baud rate for which the firmware was built.
    yes
        Skip the confirmation, for use in scripts.
    """
    from rig import control
    from rig.calibration import read_calibration
    from rig.protocol import TRIP

    known = read_calibration(calibration) if calibration else None
    with opened(port, baud) as link:
        status = control.device_status(link)
        if status.state != TRIP:
            print("the device is not tripped")
            return 0
        print(f"tripped: {control.trip_text(status, known)}")
        confirm("Has the cause been found? Type yes to acknowledge: ", "acknowledged", yes=yes)
        control.acknowledge(link, known)
    print("acknowledged: the device is in SAFE, with its dump valve open")
    return 0


@_command
def calibrate_sensor(
    sensor: Literal["pressure", "force"],
    *,
    reference: tuple[str, ...],
    reading: tuple[float, ...] = (),
    port: str | None = None,
    baud: int = 115200,
    seconds: float = 2.0,
    calibration: Path = Path("calibration.toml"),
) -> int:
    """Calibrate the pressure transducer or the load cell against known references.

    Asks you to apply each reference and averages the counts, or uses counts recorded earlier. The device
    stays in SAFE with its dump valve open: apply the reference pressure directly to the transducer, from a
    calibrator or a gauge line. The other tables in the calibration file are kept. The file also stores the
    number of the board and can be used only with that board.

    Parameters
    ----------
    sensor
        pressure or force.
    reference
        Applied reference with its unit, such as `40psi`. Repeat the option for at least three references,
        in order.
    reading
        Counts at each reference, as sums of five converter readings. Repeatable; if omitted, the counts are
        read from the port.
    port
        Serial port or socket://host:port.
    baud
        Baud rate for which the firmware was built.
    seconds
        Averaging time for each reference, in seconds.
    calibration
        Calibration file (TOML), created if missing.
    """
    from rig.calibration import fit_sensor, update_calibration
    from rig.channels import numbered
    from rig.link import mean_counts

    applied = [parse_quantity(text, sensor) for text in reference]
    counts, board = list(reading), 0
    if not counts:
        with opened(port, baud) as link:
            board = numbered(link)
            for text in reference:
                _typed(f"Apply {text} and press Enter: ")
                counts.append(mean_counts(link, seconds)[sensor == "force"])
                print(f"{text}: {counts[-1]:.2f} counts", flush=True)
    found = fit_sensor(counts, applied)
    update_calibration(calibration, sensor, found, board)
    unit = quantity_unit(reference[0])
    print(f"{sensor} at the references [{unit}]:")
    shown = zip(reference, applied, found.value(counts), found.error(counts), strict=True)
    for text, true, measured, std in shown:
        figures = [f"{from_si(x, unit, sensor):.4g}" for x in (measured, measured - true, std)]
        print("{}: measured {}, error {}, standard error {}".format(text, *figures))
    print(
        f"{found.gain:.6g} +- {found.gain_std:.2g} {si_unit(sensor)} per count, "
        f"zero at {found.zero:.2f} +- {found.zero_std:.2g} counts"
    )
    print("written:", calibration)
    return 0


@_command
def calibrate_pump(
    plan: Path, *, port: str | None = None, baud: int = 115200, yes: bool = False
) -> int:
    """Measure the feed-forward of a water circuit by stepping the pump with the controller off.

    The limits in the plan apply. The result is written to the calibration file named in the plan. The
    muscle is pressurised, so the same safety conditions apply as for `run`.

    Parameters
    ----------
    plan
        Plan file (TOML) with the tables [plan] and [rig]; a pressure limit is required.
    port
        Serial port or socket://host:port.
    baud
        Baud rate for which the firmware was built.
    yes
        Skip the confirmation, for use in scripts.
    """
    from rig.calibration import pressure_text, read_calibration, update_calibration
    from rig.control import Rig
    from rig.execution import calibrate_feed_forward
    from rig.plan import read_plan

    test, port = read_plan(plan), _known_port(port)
    if test.circuit != "water":
        raise RigError(
            f"calibrate-pump requires a water circuit; the plan's circuit is {test.circuit!r}"
        )
    if test.calibration is None:
        raise RigError("[rig] must specify a calibration file: calibration = 'calibration.toml'")
    calibration = read_calibration(test.calibration)
    tell_preconditions(test)
    confirm(f"{len(STEPS)} pump steps. {PRESSURISE}", "started", yes=yes)

    def tell(output: int, pressure: float) -> None:
        print(f"output {output}: {pressure_text(pressure, test.unit)}", flush=True)

    with opened(port, baud) as link, Rig(link, calibration, **vars(test.settings)) as rig:
        found = calibrate_feed_forward(rig, STEPS, tell)
    update_calibration(test.calibration, "feed_forward", found)
    low, high = (pressure_text(P, test.unit) for P in found.pressure_range)
    print(f"feed-forward valid from {low} to {high}, scatter {found.scatter:.2g} counts")
    print("written:", test.calibration)
    return 0


@_command
def run(
    plan: Path,
    *,
    port: str | None = None,
    baud: int = 115200,
    output: Path = Path("famjax-rig"),
    resume: bool = False,
    dry_run: bool = False,
    yes: bool = False,
    start: Literal["asked", "load", "at-once"] | None = None,
    units: Units = "metric",
) -> int:
    """Run and record a test at constant pressures; the rig always vents at the end.

    First prints the safety conditions and the steps of the plan, and asks for confirmation. Writes
    `test.fam` to the output folder. At each pressure, the command prompts you to start the strokes of the
    test machine and waits for them to begin. At a terminal, type a word and press Enter: begin (or Enter
    alone) once the strokes have begun, or to continue after a pause; pause to hold the pressure; skip to go
    on to the next pressure; repeat to start this pressure again; stop to end the test. At the end, the
    command prints a summary table and writes it to `test.csv` in the same folder.

    Parameters
    ----------
    plan
        Plan file (TOML) with the tables [plan] and [rig]; a pressure limit is required.
    port
        Serial port or socket://host:port.
    baud
        Baud rate for which the firmware was built: 115200 (2.1 % fast on an Uno) or 500000 (exact).
    output
        Folder for the journal, created if missing.
    resume
        Resume the existing journal at the first incomplete pressure. The plan, limits, gains and
        calibration must be unchanged.
    dry_run
        Print the steps of the plan and their duration, then exit.
    yes
        Skip the confirmation, for use in scripts.
    start
        Event that marks the start of the strokes: `asked`, you type begin; `load`, the load changes, which
        must happen within 60 s; `at-once`, the prompt itself (the default without a terminal).
    units
        Units of the printed values: si, metric or us.
    """
    from rig.execution import JOURNAL, prepare, record_test
    from rig.plan import read_plan

    test = read_plan(plan)
    tell_preconditions(test)
    calibration, first = prepare(test, output, resume=resume)
    print(*describe(test, first), sep="\n")
    print(f"duration {test.plan.duration(first):.0f} s, plus the device's response times")
    if dry_run:
        return 0
    port = _known_port(port)
    if start == "asked" and not _at_terminal():
        raise RigError("--start asked requires a terminal: use --start at-once or load")
    confirm(PRESSURISE, "started", yes=yes)
    operator = operator_of(calibration, units)
    output.mkdir(parents=True, exist_ok=True)
    journal = output / JOURNAL
    with opened(port, baud) as link:
        record_test(
            test, link, calibration, journal, first_block=first, append=resume,
            attendant=operator, start=start or ("asked" if _at_terminal() else "at-once"),
        )  # fmt: skip
    print("written:", journal, journal.with_suffix(".csv"))
    return 0


@_command
def check(journal: Path, *, json_: bool = False) -> int:
    """Check that a journal is complete and that the device followed its control law.

    The exit code is 0 if the journal is sound and 1 otherwise. Records lost on the serial line are listed
    but do not make the journal unsound.

    Parameters
    ----------
    journal
        Journal file.
    json_
        Print a single JSON object to standard output.
    """
    from dataclasses import asdict

    from rig.journal import audit, read_journal

    found = audit(read_journal(journal))
    print(json.dumps(asdict(found) | {"sound": found.sound}) if json_ else found)
    return 0 if found.sound else 1


def values(sample: Any, calibration: Any, system: str, *, wanted: float | None = None) -> str:
    """Format the values of a record on one line.

    Args:
        sample: record, or None.
        calibration: sensor calibration; if None, counts are shown.
        system: "si", "metric" or "us".
        wanted: set pressure [Pa], or None.
    """
    from rig.protocol import FAULTS, STATES

    if sample is None:
        return "no record yet"
    shown = []
    for kind, total in (("pressure", sample.pressure_sum), ("force", sample.force_sum)):
        mean, of, unit = total / 5, "", "counts"
        if calibration is not None:
            unit = unit_system(system)[kind]
            mean = from_si(float(getattr(calibration, kind).value(total)), unit, kind)
            if kind == "pressure" and wanted is not None:
                of = f" of {from_si(wanted, unit, kind):.5g}"
        shown.append(f"{kind} {mean:.5g}{of} {unit}")
    fault = f"  fault: {FAULTS[sample.fault]}" if sample.fault else ""
    state = f"output {sample.output}  {STATES[sample.state]}{fault}"
    return "  ".join([f"record {sample.seq}", *shown, state])


def operator_of(calibration: Any, system: str):
    """Return an attendant that prints instructions and progress, and reads words from the terminal."""
    from rig.execution import Attendant, Situation

    typed: queue.SimpleQueue[str] = queue.SimpleQueue()
    every = 5.0 if _at_terminal() else 15.0  # s between two lines

    class Operator(Attendant):
        due = monotonic() + every

        def tell(self, text: str) -> None:
            print(text, flush=True)

        def look(self, situation: Situation) -> Any:
            if monotonic() >= self.due:
                self.due = monotonic() + every
                now = situation
                cycle = f" {now.cycle} of {now.cycles}" if now.cycle else ""
                phase = "waiting for the first stroke" if now.phase == "ready" else now.phase
                self.tell(
                    f"block {now.block} (the last is {now.last_block}): {phase}{cycle}, "
                    f"{now.left:.0f} s left  "
                    + values(now.newest, calibration, system, wanted=now.set_point)
                )
            word = "" if typed.empty() else typed.get() or "begin"
            if word == "stop":
                raise KeyboardInterrupt
            if word not in ("", "begin", "pause", "skip", "repeat"):
                self.tell(WORDS)
                return ""
            return word

    def read() -> None:
        with contextlib.suppress(OSError):  # the terminal was closed
            # Reading sys.stdin here would hold its buffer lock and block the program's exit.
            while data := os.read(sys.stdin.fileno(), 4096):
                for line in data.decode(errors="ignore").splitlines():
                    typed.put(line.strip().lower())

    if _at_terminal():
        print(WORDS)
        threading.Thread(target=read, name="words", daemon=True).start()
    return Operator()


def describe(test: Any, first_block: int = 0) -> list[str]:
    """Return one line for each pressure with its start time; nothing is run."""
    from rig.calibration import pressure_text

    plan, lines = test.plan, []
    for block, pressure in list(enumerate(plan.pressures))[first_block:]:
        at = plan.duration(first_block) - plan.duration(block)
        lines.append(
            f"{at:8.1f} s  block {block}: {pressure_text(pressure, test.unit)}, settle {plan.settle:g} s, "
            f"{plan.cycles} strokes of {plan.stroke * 1e3:.4g} mm at {plan.rate * 1e3:.4g} mm/s, "
            f"{plan.stroke_seconds:.4g} s"
        )
    return lines


def _known_port(port: str | None) -> str:
    """Return the port, or raise an error that lists the available ports."""
    if port is not None:
        return port
    from serial.tools import list_ports

    known = ", ".join(f"{one.device} ({one.description})" for one in sorted(list_ports.comports()))
    raise RigError(
        f"a port is required (--port PORT); available: {known or 'none; plug in the device'}"
    )


def opened(port: str | None, baud: int) -> Any:
    """Open the link to a device."""
    from rig import link

    return link.Link(link.serial_opener(_known_port(port), baud))


def _at_terminal() -> bool:
    return sys.stdin.isatty() and sys.stdout.isatty()


def tell_preconditions(test: Any) -> None:
    """Print the safety conditions that software cannot check."""
    from rig.calibration import pressure_text

    limit = pressure_text(test.pressure_limit, test.unit)
    print(f"{test.circuit.capitalize()} circuit, limit {limit}. Make sure that:")
    print(*(f"- {sentence}" for sentence in PRECONDITIONS[test.circuit]), sep="\n")


def _typed(question: str) -> str:
    try:
        return input(question)
    except EOFError:
        raise RigError("standard input closed before the question was answered") from None


def confirm(question: str, done: str, *, yes: bool) -> None:
    """Ask for confirmation; raise unless the answer is yes."""
    if yes:
        return
    if not sys.stdin.isatty():
        raise RigError("confirmation requires a terminal: add --yes to confirm in a script")
    if _typed(question).strip().lower() != "yes":
        raise RigError(f"not {done}: the answer was not yes")
