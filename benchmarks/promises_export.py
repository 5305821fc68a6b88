"""Promises of exported muscles, each measured in its target."""

import functools
import shutil
import tempfile
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from promise import CannotRunError, Case, Cost, Direction, Promise

import famjax

_STATES = 4000
_LOADS = (200.0, 2e5), (600.0, 4e5), (900.0, 6e5)  # N, Pa
_MUSCLE = "DMSP-20"
_ROLLOUT = 50


def _needs(*tools: str) -> None:
    """Refuse to measure without a command or a package."""
    import importlib.util  # noqa: PLC0415

    for tool in tools:
        if shutil.which(tool) is None and importlib.util.find_spec(tool) is None:
            raise CannotRunError(f"{tool} is not installed")


def _subject(case: Case) -> Any:
    return case.once("exported subject", lambda: famjax.export.read_subject(_MUSCLE))


def _in_folder(measure: Callable[[Case, Path], Any], case: Case) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        return measure(case, Path(folder))


def _c_errors(real: str, case: Case, folder: Path) -> dict[str, float]:
    from export_c import code_sections, compiled, exported_states, telling  # noqa: PLC0415

    subject = _subject(case)
    function = compiled(subject, folder, real)
    length, pressure = exported_states(subject, _STATES)
    force = np.asarray(subject.muscle.force(length, pressure))
    told = telling(subject, length, pressure)
    off = np.abs(function("force")(length, pressure) - force)
    back = np.abs(function("pressure")(length[told], force[told]) - pressure[told])
    source = folder / f"{subject.identifier}.c"
    sizes = code_sections(source, f"-D{subject.identifier.upper()}_REAL={real}")
    return {
        "force": float(off.max() / force[: _STATES // 2].max()),
        "pressure": float(back.max()),
        "code": sizes[".text"],
    }


def _of_c(real: str, figure: str) -> Callable[[Case], float]:
    def measure(case: Case) -> float:
        _needs("gcc")
        of_real = functools.partial(_c_errors, real)
        return case.once(("exported C", real), lambda: _in_folder(of_real, case))[figure]

    return measure


def _equilibria(case: Case, folder: Path) -> float:
    mujoco: Any = import_module("mujoco")  # an extra of the project, without types

    subject = _subject(case)
    xml, _ = famjax.export.export(subject, ["mujoco"], folder)
    model = mujoco.MjModel.from_xml_path(str(xml))
    famjax.export.install(model, {subject.identifier: subject.pull})
    data, off = mujoco.MjData(model), []
    try:
        for load, pressure in _LOADS:
            mujoco.mj_resetData(model, data)
            model.body_mass[1], data.ctrl[0] = load / 9.81, pressure
            stiffness = subject.pull.stiffness(0.27, pressure)
            model.dof_damping[0] = 2 * np.sqrt(load / 9.81 * stiffness)
            mujoco.mj_step(model, data, nstep=5000)
            mujoco.mj_forward(model, data)
            ours = float(subject.muscle.length_at_load(load, pressure))
            off.append(abs(data.ten_length[0] - ours))
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_gain(None)
    return max(off)


def _equilibrium(case: Case) -> float:
    _needs("mujoco")
    return _in_folder(_equilibria, case)


def _derivative(case: Case) -> float:
    _needs("mujoco")
    from export_rollout import rollout_derivatives  # noqa: PLC0415

    exact, difference = _in_folder(lambda _, folder: rollout_derivatives(folder, _ROLLOUT), case)
    return abs(exact / difference - 1)


def _knee(figure: str) -> Callable[[Case], float]:
    def measure(case: Case) -> float:
        _needs("mujoco")
        from export_knee import driven_knee  # noqa: PLC0415

        found = case.once("driven knee", lambda: driven_knee(_subject(case).pull))
        return getattr(found, figure) if found.finite else float("nan")

    return measure


def _cost(kind: str, over: str) -> Callable[[Case], float]:
    def measure(case: Case) -> float:
        _needs("gcc", "mujoco")
        from export_callback import step_costs  # noqa: PLC0415

        costs = case.once(
            "callbacks",
            lambda: _in_folder(lambda case, folder: step_costs(_subject(case), folder), case),
        )
        return costs[kind] / costs[over]

    return measure


def _row(
    name: str,
    measure: Callable[[Case], float],
    to: str,
    statistic: str,
    limit: float,
    direction: Direction = "at most",
    filter_: str = f"{_STATES} states, up to twice the data's lengths and pressures",
    data: str = f"the bundled card {_MUSCLE}",
    cost: Cost = "quick",
) -> Promise:
    command = f"famjax export dmsp-20 --to {to}"
    return Promise(
        17, f"export, {name}", measure, command, data, filter_, statistic, limit, direction,
        cost=cost,
    )  # fmt: skip


_TOLD = f"the taut ones of {_STATES} states between the stops, dF/dP above 1 % of its mean"
_AT_REST = "three loads and pressures"
_TIMES = "one load, least of seven runs"
EXPORT: tuple[Promise, ...] = (
    _row("C in double, force", _of_c("double", "force"), "c",
         "largest error in the largest force [-]", 1e-6),
    _row("C in float, force", _of_c("float", "force"), "c",
         "largest error in the largest force [-]", 1e-4),
    _row("C in double, inverse", _of_c("double", "pressure"), "c", "largest error [Pa]", 1.0,
         filter_=_TOLD),
    _row("C in float, inverse", _of_c("float", "pressure"), "c", "largest error [Pa]", 200.0,
         filter_=_TOLD),
    _row("C in double, code", _of_c("double", "code"), "c", "bytes without tables, gcc -Os", 3000,
         filter_="this machine"),
    _row("C in float, code", _of_c("float", "code"), "c", "bytes without tables, gcc -Os", 3000,
         filter_="this machine"),
    _row("MuJoCo, equilibrium", _equilibrium, "mujoco", "largest difference from length_at_load [m]",
         1e-6, filter_=_AT_REST),
    _row("MuJoCo, knee driven past the stroke", _knee("overrun"), "mujoco",
         "past either end of the stroke, in strokes; nan unless finite", 0.3, "at least",
         filter_="10 s at the default step"),
    _row("MuJoCo, knee at rest", _knee("at_rest"), "mujoco",
         "largest speed of the last second [rad/s]", 0.1, filter_="4 s after the drive is off"),
    _row("MuJoCo, callback in C", _cost("C", "constant"), "c --to mujoco",
         "time of a step, in that with a callback that returns a constant", 1.5, filter_=_TIMES),
    _row("MuJoCo, callback in Python", _cost("plain", "constant"), "mujoco",
         "time of a step, in that with a callback that returns a constant", 4.0, filter_=_TIMES),
    _row("MJX, derivative by E_1", _derivative, "mjx",
         "relative difference from central differences [-]", 1e-6,
         filter_=f"rollout of {_ROLLOUT} steps", data="a cubic law", cost="minutes"),
)  # fmt: skip
"""Issue 17."""
