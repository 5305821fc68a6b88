"""`famjax rig step` records a small step test; `famjax rig tune` tunes the gains from it."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.files import write_all
from famjax.boundary.units import unit_system
from famjax.compilation_cache import start_jax
from famjax.console import Units, in_units, print_json, print_rows, progress
from famjax.units import PSI
from rig.cli import ended_in_words

if TYPE_CHECKING:
    from famjax import AbstractMuscle
    from famjax.plant import Plant
    from fitting.plant import PlantRecord
    from rig.journal import Record
    from rig.plan import PlanFile

_STEPS = 6  # up and down
_RISE, _ROOM = 20.0, 15.0  # psi: largest step, and margin from its top to the limit
_SETTLE, _HOLD = 4.0, 0.5  # s at each pressure
_STAYS = 1e-4  # m: motion of a machine that is held
_DRAWS = 8
_MISSED = 1.0 * PSI  # RMS error: four times the noise of a transducer
_HELD = {"air": ("dead_volume", 0.3), "water": ("displacement", 0.05)}
"""Parameter that a test at fixed length cannot determine, because it scales all flows, and its
spread."""


def rig_step(
    plan: Path,
    *,
    port: str | None = None,
    baud: int = 115200,
    simulate: bool = False,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("famjax-step"),
    yes: bool = False,
) -> int:
    """Record a small step test, from which `famjax rig tune` identifies the rig.

    The pressure steps up and down between the lowest pressure in the plan and a pressure at most 20 psi
    higher, using the gains in the plan. The rig trips at the plan's pressure limit or at 15 psi above the
    upper step, whichever is lower. Keep the muscle at its rest length; the machine does not move. Writes
    `test.fam` to the output folder. The rig always vents at the end.

    Parameters
    ----------
    plan
        TOML file with the tables [plan] and [rig] for the test whose gains are to be tuned.
    port
        Connect to this serial port, or to socket://host:port.
    baud
        Set the baud rate used by the firmware.
    simulate
        Run the test on a simulated rig.
    output
        Write the journal to this folder; it is created if missing.
    yes
        Start without asking for confirmation; intended for scripts.
    """
    start_jax()
    from rig import cli
    from rig.execution import JOURNAL, prepare, record_test
    from rig.plan import read_plan

    with ended_in_words():
        test = step_test(read_plan(plan))
        if simulate:
            from .simulation import simulate_device

            simulate_device(test, output)
        else:
            cli.tell_preconditions(test)
            calibration, _ = prepare(test, output)
            cli.confirm(f"{_STEPS} pressure steps. {cli.PRESSURISE}", "started", yes=yes)
            output.mkdir(parents=True, exist_ok=True)
            with cli.opened(port, baud) as link:
                record_test(test, link, calibration, output / JOURNAL)
    journal = output / JOURNAL
    print(f"written: {journal}\nnext: famjax rig tune {journal} --plan {plan}")
    return 0


def step_test(test: "PlanFile") -> "PlanFile":
    """Derive the step test from a plan: lower pressures, a lower limit and no stroke."""
    low = min(test.plan.pressures)
    high = min(max(test.plan.pressures), low + _RISE * PSI)
    if high <= low:
        low, high = 0.6 * low, low
    plan = dataclasses.replace(
        test.plan, pressures=(low, high) * (_STEPS // 2), cycles=1, settle=_SETTLE,
        stroke=_STAYS, rate=2 * _STAYS / _HOLD,
    )  # fmt: skip
    limit = min(test.pressure_limit, high + _ROOM * PSI)
    return dataclasses.replace(test, plan=plan, pressure_limit=limit)


def rig_tune(
    journal: Path | None = None,
    *,
    plan: Path,
    simulate: bool = False,
    card: str | None = None,
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("tuned.toml"),
    seed: int = 0,
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Tune the controller gains and the set-pressure rise time, and write them to a copy of the plan.

    Identifies the valve or pump from the journal of `famjax rig step`, then optimises the gains. The
    optimisation simulates the steps and strokes in the plan on several rigs that are consistent with the
    journal, and uses the gradient of the pressure error. Prints the pressure errors expected with the
    gains in the plan and with the tuned gains.

    Parameters
    ----------
    journal
        Journal recorded by `famjax rig step`.
    plan
        TOML file with the tables [plan] and [rig].
    simulate
        Assume parameters for the valve or pump, uncertain by 5 to 30 %, instead of using a journal.
    card
        Card written by `famjax card`, or the name of a bundled muscle; default: the 7/8 in muscle from the
        reference work.
    output
        Write the plan with the tuned gains to this file, which must not exist yet.
    seed
        Set the seed for the random samples and the noise.
    units
        Choose the units for the table: si, metric or us.
    json_
        Print one JSON object in SI units on standard output, and nothing else.
    """
    start_jax()
    from famjax.control.tuning import Duty, Gains, drawn_circuits, expect, tune
    from famjax.muscles import open_card
    from famjax.plant import LinearMcKibben
    from rig.plan import read_plan
    from rig.simulation import CIRCUITS

    from .dynamics import feed_forward

    if (journal is None) != simulate:
        raise InputError(
            "use either a journal recorded by `famjax rig step`, or --simulate for assumed parameters"
        )
    if output.exists():
        raise InputError(f"{output} already exists: choose another file with --output")
    with ended_in_words():
        test = read_plan(plan)
        muscle = LinearMcKibben() if card is None else open_card(card).safe()
        if journal is None:
            circuits, told = drawn_circuits(CIRCUITS[test.circuit](), _DRAWS, seed), []
            forwards = np.array([feed_forward(one) for one in circuits])
        else:
            circuits, forwards, told = _identified(journal, test, muscle, seed)
    plants = [_plant(one, muscle) for one in circuits]
    given, control = test.plan, test.control
    duty = Duty(given.pressures, given.stroke, given.rate, given.settle, test.pressure_limit)
    steps = np.abs(np.diff([0.0, *given.pressures]))
    largest = float(steps.max())
    ramp = largest / given.rise if given.rise else 1e3 * PSI
    now = Gains(control.proportional / 255, control.integral / 255, ramp)
    with progress("optimising the gains") as show:
        found = tune(plants, forwards, duty, seed=seed, progress=show)
    proportional, integral, _ = found.in_counts()
    gains = {
        "proportional_counts_per_psi": proportional, "integral_counts_per_psi_s": integral,
        "rise_s": largest / found.ramp,
    }  # fmt: skip
    text = tuned_text(plan.read_text(encoding="utf-8"), gains)
    write_all(output.parent, {output.name: text.encode()})
    rows = []
    for name, one in (("the plan's", now), ("tuned", found)):
        seen = expect(plants, forwards, one, duty, seed + 1)
        overshoot = 100 * (seen.overshoot / np.where(steps, steps, np.inf)).max()
        rows.append({
            "gains": name, "rms_pressure_Pa": float(seen.rms.mean()),
            "worst_rms_pressure_Pa": float(seen.rms.max()), "overshoot_percent": float(overshoot),
            "settled_rms_pressure_Pa": float(seen.late.mean()),
            "highest_pressure_Pa": float(seen.highest.max()),
        })  # fmt: skip
    if json_:
        print_json({"gains": gains, "expected": rows, "notes": told, "file": str(output)})
        return 0
    for one in told:
        print(f"note: {one}")
    print_rows("Gains", [gains])
    print_rows(
        "Expected values from simulation (true pressures)", in_units(rows, unit_system(units))
    )
    if rows[1]["highest_pressure_Pa"] > test.pressure_limit:
        print(
            "note: the pressure exceeds the limit when a stroke reverses: raise the limit if the muscle "
            "and circuit are rated for it, or remove the highest pressure from the plan"
        )
    print("written:", output)
    return 0


def _plant(circuit: Any, muscle: "AbstractMuscle") -> "Plant":
    from famjax.plant import DahlFriction, DrivenLength, Plant

    return Plant(circuit, muscle, DrivenLength(), DahlFriction())


def _identified(
    journal: Path, test: "PlanFile", muscle: Any, seed: int
) -> tuple[list[Any], np.ndarray, list[str]]:
    """Sample circuits that are consistent with a step test; return them with feed-forward and notes."""
    from fitting.plant import FREE, identify_plant
    from rig.journal import read_journal, stored_calibration
    from rig.simulation import CIRCUITS

    record = read_journal(journal)
    if any(note["stroke_m"] > 2 * _STAYS for note in record.notes_of("strokes")):
        raise InputError(
            f"{journal} is from a test in which the machine moved: record a step test instead, with "
            "`famjax rig step`"
        )
    forward = stored_calibration(record).feed_forward
    circuit = "water" if any(forward.coefficients[1:]) else "air"
    if circuit != test.circuit:
        raise InputError(
            f"{journal} is from the {circuit} circuit, but the plan describes the {test.circuit} "
            "circuit: use the plan with which the step test was recorded"
        )
    rest, assumed = float(muscle.rest_length), CIRCUITS[test.circuit]()
    held, spread = _HELD[test.circuit]
    free = [name for name in FREE[type(assumed)] if name != held]
    rows = plant_record(record, rest)
    fit = identify_plant(rows, _plant(assumed, muscle), free=free)
    if not fit.pressure_rms < _MISSED:
        raise InputError(
            f"the model of the {test.circuit} circuit must match the recorded pressure to within "
            f"{_MISSED / PSI:g} psi RMS, but the error is {fit.pressure_rms / PSI:.2g} psi: check the "
            "journal and the supply, and look for leaks"
        )
    known = {name: float(value) for name, value in assumed.parameters().items()}
    volume = float(muscle.volume(rest, rows.pressure.mean())) + known.get("dead_volume", 0.0)
    declared, rng, circuits = assumed.declared(), np.random.default_rng(seed), []
    size = np.sqrt(np.diag(np.nan_to_num(fit.covariance)))
    scale = np.where(size, size, 1.0)
    correlation = np.nan_to_num(fit.covariance / np.outer(scale, scale))
    draws = size * rng.multivariate_normal(
        np.zeros(len(free)), correlation, _DRAWS, check_valid="ignore"
    )
    factors = np.exp(spread * rng.standard_normal(_DRAWS))
    draws[0], factors[0] = 0.0, 1.0
    for draw, factor in zip(draws, factors, strict=True):
        values = {e.name: e.value + off for e, off in zip(fit.estimates, draw, strict=True)}
        values[held] = known[held] * factor
        if held == "displacement":  # same pressures with other flows
            values["needle"] *= factor
            values["bulk_modulus"] /= factor
        else:
            values["conductance"] *= 1 + (values[held] - values[held] / factor) / volume
        for name, value in values.items():
            values[name] = float(np.clip(value, declared[name].low, declared[name].high))
        circuits.append(assumed.with_parameters(values))
    powers = forward.scale ** np.arange(len(forward.coefficients))
    found = np.tile(np.array(forward.coefficients) / 255 / powers, (len(circuits), 1))
    told = [f"{e.name} {e.value:.4g} +- {e.stderr:.2g} {e.unit}".rstrip() for e in fit.estimates]
    return circuits, found, [*told, *fit.warnings]


def plant_record(record: "Record", length: float) -> "PlantRecord":
    """Convert the journal of a test at constant length [m] to the input of `identify_plant`.

    The pressure in a record is the mean over its ticks; it is shifted to the time of the last tick.

    Raises:
        InputError: the device controlled the pressure for less than a second.
    """
    from fitting.plant import PlantRecord
    from rig.protocol import RUN

    from .isobaric import table

    rows = table(record)
    runs = np.flatnonzero(rows["state"] == RUN)
    longest = max(np.split(runs, np.flatnonzero(np.diff(rows["seq"][runs]) != 1) + 1), key=len)[:-1]
    if longest.size < 100:
        raise InputError(
            f"{record.path}: the device must control the pressure for at least 100 consecutive records "
            f"(1 s), got {longest.size}: record a test with `famjax rig step`"
        )
    pressure = 0.6 * rows["pressure_Pa"][longest] + 0.4 * rows["pressure_Pa"][longest + 1]
    time = rows["device_time_s"][longest]
    return PlantRecord(
        time - time[0], rows["output"][longest] / 255, pressure, np.full(time.size, length),
        name=str(record.path),
    )  # fmt: skip


def tuned_text(text: str, gains: Mapping[str, float]) -> str:
    """Replace the gains and `rise_s` in the text of a plan, and leave all other text unchanged."""
    if not re.search(r"^\s*rise_s\s*=", text, re.MULTILINE):
        text = re.sub(r"^(\s*\[plan\].*\n)", r"\1rise_s = 0\n", text, count=1, flags=re.MULTILINE)
    for key, value in gains.items():
        new = rf"\g<1>{value:.4g}"
        text = re.sub(rf"^(\s*{key}\s*=\s*)[^\s#]+", new, text, flags=re.MULTILINE)
    return text
