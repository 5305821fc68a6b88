"""MuJoCo's callbacks for muscles: actuators of `gaintype="user"` and `biastype="user"` on a tendon."""

import ctypes
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any


class CompiledPull:
    """The pull by the exported C in a shared library: a callback of little more than Python's cost.

    Attributes:
        force: F [N] at a length [m] and a gauge pressure [Pa].
    """

    def __init__(self, library: str | Path, name: str) -> None:
        """The pull of a library, from such as `gcc -O2 -shared -fPIC NAME.c -o NAME.so`.

        Args:
            library: the file; compiled in double precision.
            name: of the muscle in it.
        """
        self.force = getattr(ctypes.CDLL(str(Path(library).resolve())), f"{name}_force")
        self.force.restype, self.force.argtypes = ctypes.c_double, [ctypes.c_double] * 2


def install(
    model: Any, pulls: Mapping[str, Any], offsets: Mapping[str, float] | None = None
) -> None:
    """Let MuJoCo ask muscles for the force of actuators; the control is the gauge pressure [Pa].

    The length is the actuator's, that of its tendon. With `dyntype="filter"` the pressure is the
    actuator's state. MuJoCo has one such callback in a process: a later call replaces it, and
    `mujoco.set_mjcb_act_bias(None)` and `set_mjcb_act_gain(None)` take it away.

    Args:
        model: `mujoco.MjModel`; other models with actuators of user type must be installed anew.
        pulls: the muscle, as anything with `force(length, pressure)`, of each actuator's name.
        offsets: what an actuator's muscle is longer than its tendon [m], by its name; 0 unless given. A
            tendon of `fixed` type has the length 0 where its joints do.
    """
    mujoco: Any = import_module("mujoco")  # an extra of the project, without types

    wanted = {model.actuator(name).id: pull.force for name, pull in pulls.items()}
    added = {model.actuator(name).id: float(one) for name, one in (offsets or {}).items()}
    states = model.actuator_actadr.tolist()

    def bias(_: Any, data: Any, number: int) -> float:
        state = states[number]
        pressure = data.ctrl[number] if state < 0 else data.act[state]
        length = float(data.actuator_length[number]) + added.get(number, 0.0)
        return -wanted[number](length, float(pressure))

    mujoco.set_mjcb_act_gain(lambda *_: 0.0)
    mujoco.set_mjcb_act_bias(bias)
