"""Exported muscles in their targets: C on this machine, MuJoCo with its callbacks, MJX with derivatives."""

import dataclasses
import importlib.util
import math
import runpy
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from row import CannotRunError, Case
from scipy.io import loadmat, savemat

# isort: split
from targets import (
    Course,
    code_sections,
    compiled,
    driven_knee,
    exported_states,
    rollout_derivatives,
    telling,
)

import famjax
from famjax.export import CompiledPull, Subject, export, install, uninstall
from famjax.plant import DahlFriction, HydraulicCircuit, Plant, PneumaticCircuit

STATES, ROLLOUT = 4000, 50
LOADS = (200.0, 2e5), (600.0, 4e5), (900.0, 6e5)  # N, Pa


def _needs(*tools: str) -> None:
    """Refuse to measure without a command or a package."""
    for tool in tools:
        if shutil.which(tool) is None and importlib.util.find_spec(tool) is None:
            raise CannotRunError(f"{tool} is not installed")


def _mujoco() -> Any:
    return import_module("mujoco")  # an extra of the project, without types


def _subject(case: Case) -> Subject:
    return case.once("exported subject", lambda: famjax.export.read_subject("DMSP-20"))


def in_equations(case: Case) -> dict[str, float]:
    """The equations as they are written for NumPy and MATLAB."""
    _needs("octave-cli")
    subject = _subject(case)
    rng, region = np.random.default_rng(4), subject.muscle.region
    L, P = (rng.uniform(low, high, 10_000) for low, high in (region.length, region.pressure))
    force = np.asarray(subject.muscle.force(L, P))
    beyond = [(0.5 * L.min(), 3e5), (0.28, 2 * P.max()), (0.28, -1e4)]
    with tempfile.TemporaryDirectory() as name:
        export(subject, ["matlab", "python"], name)
        module = runpy.run_path(str(Path(name) / f"{subject.identifier}.py"))
        savemat(Path(name) / "states.mat", {"L": L, "P": P, "beyond": np.array(beyond)})
        function = f"{subject.identifier}_force"
        commands = (
            f"load states.mat; F = {function}(L, P); N = {function}(beyond(:, 1), beyond(:, 2));"
            f"E = 0; try, {function}(28, 3e5); catch, E = 1; end; save -v7 back.mat F N E"
        )
        subprocess.run(
            ["octave-cli", "--norc", "--quiet", "--eval", commands], cwd=name, check=True
        )
        back = loadmat(Path(name) / "back.mat", squeeze_me=True)
    answers = [module["force"](*at) for at in beyond]
    try:
        module["force"](28.0, 3e5)
    except ValueError:
        refused = True
    else:
        refused = False
    return {
        "NumPy, largest error in the largest force":
            float(np.abs(module["force"](L, P) - force).max() / force.max()),
        "Octave, largest error in the largest force":
            float(np.abs(back["F"] - force).max() / force.max()),
        "answers out of range that are no NaN":
            float(np.isfinite(answers).sum() + np.isfinite(back["N"]).sum()),
        "lengths in cm that are no error": float(not refused) + float(back["E"] == 0),
    }  # fmt: skip


def in_c(case: Case, real: str) -> dict[str, float]:
    """Force, pressure of a force, and size of the exported C."""
    _needs("gcc")
    subject = _subject(case)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        function = compiled(subject, folder, real)
        length, pressure = exported_states(subject, STATES)
        force = np.asarray(subject.muscle.force(length, pressure))
        told = telling(subject, length, pressure)
        off = np.abs(function("force")(length, pressure) - force)
        back = np.abs(function("pressure")(length[told], force[told]) - pressure[told])
        source = folder / f"{subject.identifier}.c"
        sizes = code_sections(source, f"-D{subject.identifier.upper()}_REAL={real}")
    return {
        "force, largest error in the largest force": float(off.max() / force[: STATES // 2].max()),
        "pressure of a force, largest error [Pa]": float(back.max()),
        "code without tables, gcc -Os [bytes]": float(sizes[".text"]),
    }


def in_mujoco(case: Case) -> dict[str, float]:
    """Equilibria at three loads, a driven knee, and what a callback costs."""
    _needs("mujoco", "gcc")
    mujoco, subject = _mujoco(), _subject(case)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        xml, _ = export(subject, ["mujoco"], folder)
        model = mujoco.MjModel.from_xml_path(str(xml))
        data, off = mujoco.MjData(model), []
        data.ctrl[0] = LOADS[1][1]
        mujoco.mj_forward(model, data)
        alone = float(np.abs(data.actuator_force).max())
        install(model, {subject.identifier: subject.pull})
        try:
            for load, pressure in LOADS:
                mujoco.mj_resetData(model, data)
                model.body_mass[1], data.ctrl[0] = load / 9.81, pressure
                stiffness = subject.pull.stiffness(0.27, pressure)
                model.dof_damping[0] = 2 * np.sqrt(load / 9.81 * stiffness)
                mujoco.mj_step(model, data, nstep=5000)
                mujoco.mj_forward(model, data)
                off.append(data.ten_length[0] - subject.muscle.length_at_load(load, pressure))
        finally:
            uninstall()
        costs = step_costs(subject, folder)
    knee = driven_knee(subject.pull)
    return {
        "equilibrium, difference from length_at_load [m]": float(np.abs(off).max()),
        "force without the callback [N]": alone,
        "knee, driven past either end of the stroke [strokes]": knee.overrun
        if knee.finite
        else math.nan,
        "knee, largest speed of the last second [rad/s]": knee.at_rest if knee.finite else math.nan,
        "step, C over a callback that returns a constant": costs["C"] / costs["constant"],
        "step, Python over a callback that returns a constant": costs["plain"] / costs["constant"],
    }


@dataclasses.dataclass(frozen=True)
class _Pull:
    force: Callable[[float, float], float]


def step_costs(
    subject: Subject, folder: Path, steps: int = 2000, runs: int = 7
) -> dict[str, float]:
    """Time [s] of steps of the exported model by kind of callback, least of several runs."""
    mujoco = _mujoco()
    export(subject, ["c", "mujoco"], folder)
    name = subject.identifier
    library, source = folder / f"{name}.so", folder / f"{name}.c"
    command = ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", str(source), "-o", str(library)]
    subprocess.run(command, check=True)
    pulls = {
        "constant": _Pull(lambda *_: 500.0),
        "C": CompiledPull(library, name),
        "plain": subject.pull,
    }
    model = mujoco.MjModel.from_xml_path(str(folder / f"{name}.xml"))
    costs = dict.fromkeys(pulls, math.inf)
    try:
        for _ in range(runs):
            for kind, pull in pulls.items():
                install(model, {name: pull})
                data = mujoco.MjData(model)
                mujoco.mj_resetDataKeyframe(model, data, 0)
                began = time.perf_counter()
                mujoco.mj_step(model, data, nstep=steps)
                costs[kind] = min(costs[kind], time.perf_counter() - began)
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_gain(None)
    return costs


def with_plants(case: Case, kind: str) -> dict[str, float]:
    """Air and water under commands, with a moving length and Dahl friction, against the plant."""
    _needs("gcc", *{"mujoco": ["mujoco"], "c": []}.get(kind, ["fmpy"]))
    subject, worst = _subject(case), {"pressure": 0.0, "force": 0.0}
    for circuit in (PneumaticCircuit(), HydraulicCircuit()):
        plant = Plant(circuit, subject.muscle, friction=DahlFriction(), viscosity=20.0)
        course = Course.of(dataclasses.replace(subject, plant=plant))
        with tempfile.TemporaryDirectory() as name:
            if kind in ("c", "mujoco"):
                measure = course.errors_in_c if kind == "c" else course.errors_in_mujoco
                errors = measure(Path(name))
            else:
                errors = course.errors_in_fmu(Path(name), kind)
        worst = {of: max(worst[of], errors[of]) for of in worst}
    return {f"{of}, largest difference in its range": one for of, one in worst.items()}


def in_mjx(_: Case) -> dict[str, float]:
    """The derivative of a rollout."""
    _needs("mujoco")
    with tempfile.TemporaryDirectory() as folder:
        exact, difference = rollout_derivatives(Path(folder), ROLLOUT)
    return {"derivative by E_1, relative difference from central ones": abs(exact / difference - 1)}
