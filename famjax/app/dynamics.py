"""`famjax simulate`: simulate a loaded muscle, driven by valve commands or a controller."""

import dataclasses
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from msgspec import Meta

from famjax.boundary.errors import InputError
from famjax.boundary.files import as_svg, csv_text
from famjax.boundary.toml_file import Form, NotNegative, Positive, from_entries
from famjax.boundary.units import parse_quantity, sentence_in_units, unit_system
from famjax.compilation_cache import start_jax
from famjax.console import (
    Output,
    Units,
    add_cwd_to_path,
    in_units,
    print_json,
    print_rows,
    progress,
)

if TYPE_CHECKING:
    from famjax.plant import AbstractCircuit

_COUNTS = 255  # full scale of the valve output


@dataclasses.dataclass(frozen=True)
class _Load:
    """The table [load]. If it has no mass, the length is prescribed."""

    length: Positive | None = None
    mass: Positive | None = None
    stiffness: NotNegative = 0.0
    relaxed: Positive | None = None
    damping: NotNegative = 0.0


@dataclasses.dataclass(frozen=True)
class _Controller:
    """The table [controller], with gains in the units of the device."""

    proportional_counts_per_psi: NotNegative
    integral_counts_per_psi_s: NotNegative


@dataclasses.dataclass(frozen=True)
class _Step:
    """A table [[step]] with either `signal` or `set_pressure`."""

    duration: Positive
    signal: Annotated[float, Meta(ge=0, le=1, description="between 0 and 1")] | None = None
    set_pressure: NotNegative | None = None
    dump: bool = False
    rate: float = 0.0
    force: float = 0.0


_LOAD_FORM = Form(
    {"length": "length", "relaxed": "length"},
    {"mass": "mass_kg", "stiffness": "stiffness_N_per_m", "damping": "damping_N_s_per_m"},
)
_STEP_FORM = Form(
    {"duration": "time", "set_pressure": "pressure", "rate": "rate", "force": "force"}
)


def simulate(
    card: str,
    plan: Path,
    *,
    every: str = "10ms",
    own: tuple[str, ...] = (),
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("famjax-simulation"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Simulate a loaded muscle driven by valve commands: pressure, length and force over time.

    Writes `simulation.csv` and `simulation.svg`, and prints the state at the end of each step of the
    plan. The concept page on dynamics contains an example plan and lists what the model neglects.

    Parameters
    ----------
    card
        Card written by `famjax card`, or the name of a bundled muscle (DMSP-10 or DMSP-20).
    plan
        TOML file with the tables [circuit], [load] and one [[step]] per command; optionally [friction]
        and [controller].
    every
        Set the time between rows of the table, with its unit; it is rounded to a multiple of 2 ms.
    own
        Trust and import your own module, which defines classes named in the card, for example
        `--own my_rubber`; repeatable. Other modules named in the card are never imported.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units for the table and the files: si, metric or us.
    json_
        Print one JSON object in SI units on standard output, and nothing else.
    """
    start_jax()
    import jax
    import numpy as np

    from famjax.compile_options import quick_jit
    from famjax.plans import read_plan
    from famjax.plant import TICK, Command, simulate as run

    folder, each = Output(output), max(round(parse_quantity(every, "time") / TICK), 1)
    tables = read_plan(plan)
    steps = _steps(tables, plan)
    system, length = _system(tables, plan, card, own, controlled=steps[0].signal is None)
    plant = getattr(system, "plant", system)
    counts = [max(round(one.duration / TICK), 1) for one in steps]
    asked = [one.set_pressure if one.signal is None else one.signal for one in steps]
    drives = [one.force if plant.load.moves else one.rate for one in steps]
    command = Command(*(np.repeat(np.array(one, float), counts) for one in (
        asked, [one.dump for one in steps], drives)))  # fmt: skip
    with progress("simulating"):
        states = quick_jit(run)(system, command, TICK, start=system.start(length))
        jax.block_until_ready(states)
    states = getattr(states, "plant", states)
    time = TICK * np.arange(1, sum(counts) + 1)
    found = np.stack([time, states.pressure, states.position, states.force], axis=1)
    if (bad := ~np.isfinite(found).all(axis=1)).any():
        raise InputError(
            f"{plan}: the model has no valid state from {time[bad][0]:.3f} s on, at a length of "
            f"{found[bad][0, 2]:.4g} m: shorten the stroke, or increase the stiffness or damping"
        )
    (short, long), (_, highest) = (
        np.asarray(plant.muscle.region.length),
        plant.muscle.region.pressure,
    )
    beyond = (found[:, 2] < short) | (found[:, 2] > long) | (found[:, 1] > highest)
    if beyond.any():
        told = (
            f"the muscle is outside its measured range ({1e3 * short:.4g} to {1e3 * long:.4g} mm, up to "
            f"{1e-3 * highest:.4g} kPa) for {TICK * beyond.sum():.3g} s, first at {time[beyond][0]:.3g} s; "
            "the forces there are extrapolated"
        )
        print(f"note: {sentence_in_units(told, units)}", file=sys.stderr)
    names = ("time_s", "pressure_Pa", "length_m", "force_N")
    rows: Any = [dict(zip(names, row, strict=True)) for row in found.tolist()]
    table = in_units(rows[each - 1 :: each], unit_system(units))
    table = [{name: float(f"{value:.9g}") for name, value in row.items()} for row in table]
    summary = [rows[k - 1] for k in np.cumsum(counts)]
    paths = folder.write(
        {"simulation.csv": csv_text(table).encode(), "simulation.svg": _drawn(table)}
    )
    if json_:
        print_json({"steps": summary, "files": [str(path) for path in paths]})
        return 0
    print_rows("End of each step", in_units(summary, unit_system(units)))
    folder.tell(paths)
    return 0


def _steps(tables: dict[str, Any], plan: Path) -> list[_Step]:
    given = tables.get("step") or []
    steps = [
        from_entries(_Step, one, _STEP_FORM, where=f"{plan}: [[step]] {k}: ")
        for k, one in enumerate(given, 1)
    ]
    kinds = {(one.signal is None, one.set_pressure is None) for one in steps}
    if kinds not in ({(True, False)}, {(False, True)}):
        raise InputError(
            f"{plan}: a plan must have at least one [[step]]. Either every step must have a signal, or "
            "every step must have a set pressure, such as set_pressure_kPa, and the plan must have a table "
            "[controller]"
        )
    return steps


def _system(
    tables: dict[str, Any], plan: Path, card: str, own: tuple[str, ...], *, controlled: bool
) -> tuple[Any, float]:
    """Return the plant, with its controller if there is one, and its initial length [m]."""
    from famjax.muscles import open_card
    from famjax.plans import circuit_of, friction_of
    from famjax.plant import DrivenLength, MovingLoad, Plant, PressureController, Regulated
    from famjax.units import PSI

    circuit = circuit_of(tables, plan)
    load = from_entries(_Load, tables.get("load", {}), _LOAD_FORM, where=f"{plan}: [load]: ")
    control = None
    if controlled:
        entries = tables.get("controller", {})
        gains = from_entries(_Controller, entries, where=f"{plan}: [controller]: ")
        proportional, integral = (one / _COUNTS / PSI for one in dataclasses.astuple(gains))
        control = PressureController(proportional, integral, feed_forward(circuit))
    if own:
        add_cwd_to_path()
    opened = open_card(card, own=own)
    for note in opened.provenance.notes:
        print(f"note: {note}", file=sys.stderr)
    muscle = opened.safe()
    length = float(muscle.rest_length) if load.length is None else load.length
    low, high = (float(one) for one in muscle.stops())
    if not low <= length <= high:
        raise InputError(
            f"{plan}: [load]: the length at the start must be between {1e3 * low:.4g} and "
            f"{1e3 * high:.4g} mm for this muscle, got {1e3 * length:.4g} mm"
        )
    relaxed = length if load.relaxed is None else load.relaxed
    moved = DrivenLength() if load.mass is None else MovingLoad.hung(
        load.mass, stiffness=load.stiffness, relaxed=relaxed, damping=load.damping
    )  # fmt: skip
    plant = Plant(circuit, muscle, moved, friction_of(tables, plan, muscle))
    return (plant if control is None else Regulated(plant, control)), length


def feed_forward(circuit: "AbstractCircuit") -> Any:
    """Return the coefficients of the output that holds a pressure, as found in a calibration."""
    from famjax.units import PSI
    from rig.calibration import fit_feed_forward

    steady: Any = getattr(circuit, "steady_signal", None)
    if steady is None:  # a valve, closed at its bias
        return [float(circuit.parameters()["bias"])]
    pressures = [5 * PSI * k for k in range(1, 24)]
    found = fit_feed_forward(pressures, [_COUNTS * steady(P) for P in pressures])
    return [one / _COUNTS / found.scale**k for k, one in enumerate(found.coefficients)]


def _drawn(rows: list[dict[str, float]]) -> bytes:
    """Plot pressure, length and force over time, as SVG."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 6), layout="constrained")
    time, *others = rows[0]
    for axes, key in zip(figure.subplots(len(others), 1, sharex=True), others, strict=True):
        name, _, unit = key.rpartition("_")
        axes.plot([row[time] for row in rows], [row[key] for row in rows], color="k")
        axes.set(xlabel="time [s]", ylabel=f"{name} [{unit}]")
    return as_svg(figure).encode()
