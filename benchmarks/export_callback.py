"""What a muscle costs a step of MuJoCo, by the kind of its callback."""

import subprocess
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp

from famjax.export import CompiledPull, Subject, export, install

_STEPS, _RUNS = 2000, 7
KINDS = ("native", "constant", "C", "plain", "jitted")
"""A motor of MuJoCo's own, a callback that returns a constant, the exported C, the exported Python,
the model under `equinox.filter_jit`."""


class _Pull:
    def __init__(self, force: Callable[[float, float], float]) -> None:
        self.force = force


def step_costs(subject: Subject, folder: Path) -> dict[str, float]:
    """Time [us] of one step of the exported model by kind of callback, least of several runs.

    Args:
        subject: the muscle.
        folder: of the exported files.
    """
    mujoco: Any = import_module("mujoco")  # an extra of the project, without types

    export(subject, ["c", "mujoco"], folder)
    name = subject.identifier
    library = folder / f"{name}.so"
    source = folder / f"{name}.c"
    command = ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", str(source), "-o", str(library)]
    subprocess.run(command, check=True)
    jitted = eqx.filter_jit(subject.muscle.force)
    pulls = {
        "constant": _Pull(lambda *_: 500.0),
        "C": CompiledPull(library, name),
        "plain": subject.pull,
        "jitted": _Pull(
            lambda length, pressure: float(jitted(jnp.float64(length), jnp.float64(pressure)))
        ),
    }
    model = mujoco.MjModel.from_xml_path(str(folder / f"{name}.xml"))
    costs: dict[str, float] = {kind: float("inf") for kind in KINDS}
    try:
        for _ in range(_RUNS):
            for kind in KINDS:
                if kind in pulls:
                    install(model, {name: pulls[kind]})
                else:
                    model.actuator_gaintype[0] = model.actuator_biastype[0] = 0
                costs[kind] = min(costs[kind], _step_cost(model))
                model.actuator_gaintype[0] = mujoco.mjtGain.mjGAIN_USER
                model.actuator_biastype[0] = mujoco.mjtBias.mjBIAS_USER
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_gain(None)
    return costs


def _step_cost(model: object) -> float:
    mujoco: Any = import_module("mujoco")  # an extra of the project, without types

    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    began = time.perf_counter()
    mujoco.mj_step(model, data, nstep=_STEPS)
    return 1e6 * (time.perf_counter() - began) / _STEPS
