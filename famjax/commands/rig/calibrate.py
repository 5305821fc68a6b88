"""Commands that calibrate a rig: its sensors at references, its pump at steps."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from ...boundary.units import from_si, parse_quantity, si_unit, unit_system
from ..terminal import print_table
from .asking import confirm, known_port, tell_preconditions, typed
from .problems import rig_problems

STEPS = (*range(40, 201, 20), *range(180, 39, -20))
"""Outputs of the pump, up and down again so that its hysteresis shows as scatter."""


def rig_calibrate_sensor(
    sensor: Literal["pressure", "force"],
    *,
    reference: tuple[str, ...],
    reading: tuple[float, ...] = (),
    port: str | None = None,
    baud: int = 115200,
    seconds: float = 2.0,
    calibration: Path = Path("calibration.toml"),
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Calibrate the pressure transducer or the load cell at known references, into a rig's file.

    Asks at each reference for its application and takes the mean of the counts, or takes counts that
    were read before. The device stays in SAFE with its dump valve open: apply a reference pressure to
    the transducer itself, from a calibrator or a gauge's line. The file keeps its other tables.

    Parameters
    ----------
    sensor
        pressure, or force.
    reference
        What is applied, with its unit, `40psi`, three or more, repeatable, in their order.
    reading
        Counts that belong to the references, sums of five readings of the converter, repeatable;
        without them they are read at the port.
    port
        A serial port or socket://host:port.
    baud
        Of the firmware.
    seconds
        Time of each mean.
    calibration
        TOML file of the rig's calibration, made if need be.
    units
        Of the table: si, metric or us.
    """
    from rig.calibration import fit_sensor, update_calibration

    with rig_problems():
        values = [parse_quantity(text, sensor) for text in reference]
        counts = reading or _read(sensor, reference, known_port(port), baud, seconds)
        found = fit_sensor(counts, values)
        update_calibration(calibration, sensor, found)
        unit = unit_system(units)[sensor]
        shown = found.value(counts), found.error(counts)
        print_table(
            f"{sensor} at the references",
            ["applied", "counts", f"measured [{unit}]", "error", "standard error"],
            [
                [text, f"{c:.2f}", *(f"{from_si(x, unit, sensor):.4g}" for x in (v, v - true, std))]
                for text, c, true, v, std in zip(reference, counts, values, *shown, strict=True)
            ],
        )
        print(
            f"{found.gain:.6g} +- {found.gain_std:.2g} {si_unit(sensor)} per count, "
            f"zero at {found.zero:.2f} +- {found.zero_std:.2g} counts"
        )
    print("written:", calibration)
    return 0


def rig_calibrate_pump(
    plan: Path,
    *,
    port: str | None = None,
    baud: int = 115200,
    steps: tuple[int, ...] = STEPS,
    settle: str = "3s",
    yes: bool = False,
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Step the pump of a water circuit with the controller off, for the output that holds a pressure.

    Under the plan's limits; the result enters the calibration that the plan names. The muscle is
    pressurised: the same must hold as for `run`.

    Parameters
    ----------
    plan
        TOML file with the tables [plan] and [rig]; a pressure limit is needed.
    port
        A serial port or socket://host:port.
    baud
        Of the firmware.
    steps
        Outputs from 0 to 255, repeatable; unless given, 40 to 200 by 20 and down again.
    settle
        Time after each step, with its unit.
    yes
        Start without asking, for scripts.
    units
        Of the table: si, metric or us.
    """
    from rig import Rig, RigError, read_calibration, read_plan
    from rig.calibration import update_calibration
    from rig.control import calibrate_feed_forward
    from rig.link import Link, serial_opener

    with rig_problems():
        test, wait = read_plan(plan), parse_quantity(settle, "time")
        port = known_port(port)
        if test.circuit != "water":
            raise RigError(
                f"the pump of a water circuit is stepped; the circuit is {test.circuit!r}, whose valve "
                "neither fills nor empties at its middle, 127.5 counts, whatever the pressure"
            )
        if test.calibration is None:
            raise RigError("[rig] must name a calibration, as in calibration = 'calibration.toml'")
        beyond = [output for output in steps if not 0 <= output <= 255]
        if beyond:
            raise RigError(f"an output is 0 to 255 counts, got {beyond[0]}")
        calibration = read_calibration(test.calibration)
        tell_preconditions(test)
        confirm(f"{len(steps)} steps of the pump, the controller off", yes=yes)
        unit = unit_system(units)["pressure"]
        with Link(serial_opener(port, baud)) as link, Rig(
            link, calibration, pressure_limit=test.pressure_limit, control=test.control,
            jump_limit=test.jump_limit, guards=test.guards,
        ) as rig:  # fmt: skip
            found = calibrate_feed_forward(
                rig, steps, settle=wait,
                tell=lambda output, pressure: print(
                    f"output {output}: {from_si(pressure, unit, 'pressure'):.4g} {unit}", flush=True
                ),
            )  # fmt: skip
        update_calibration(test.calibration, "feed_forward", found)
        low, high = (f"{from_si(P, unit, 'pressure'):.4g}" for P in found.pressure_range)
    print(f"known from {low} to {high} {unit}, scatter {found.scatter:.2g} counts")
    print("written:", test.calibration)
    return 0


def _read(
    sensor: str, references: Sequence[str], port: str, baud: int, seconds: float
) -> list[float]:
    """Counts at references that a person applies one after the other."""
    from rig.link import Link, mean_counts, serial_opener

    counts = []
    with Link(serial_opener(port, baud)) as link:
        for text in references:
            typed(f"Apply {text} and press Enter: ")
            counts.append(mean_counts(link, seconds)[sensor == "force"])
            print(f"{text}: {counts[-1]:.2f} counts", flush=True)
    return counts
