"""MuJoCo and MJX: muscle callbacks, a simulation step with muscles, and a model with a hanging load."""

import ctypes
import inspect
import math
import pprint
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.sax.saxutils import quoteattr

import jax
import jax.numpy as jnp

from .._arrays import Real
from ..boundary.errors import InputError
from ..cards import card_as_document
from ..cards.card import as_text
from ..muscle import AbstractMuscle
from . import plain
from .circuits import filled, plant_words, resting_signal
from .table import Subject

if TYPE_CHECKING:
    from mujoco import mjx

_GRAVITY = 9.81
_SHARE = 0.5, 2 / 3  # load as a fraction of the blocked force, pressure as one of the highest


class CompiledPull:
    """Force computed by the exported C code in a shared library, faster than the table in Python.

    Attributes:
        force: F [N] at a length [m] and a gauge pressure [Pa].
    """

    def __init__(self, library: str | Path, name: str) -> None:
        """Load a library, for example from `gcc -O2 -shared -fPIC NAME.c -o NAME.so`.

        Args:
            library: path of the library, compiled in double precision.
            name: name of the muscle in the library.
        """
        self.force = getattr(ctypes.CDLL(str(Path(library).resolve())), f"{name}_force")
        self.force.restype, self.force.argtypes = ctypes.c_double, [ctypes.c_double] * 2


class CompiledPlant:
    """A muscle and its circuit, computed by the exported C code in a shared library.

    Attributes:
        state: pressure [Pa], openings of the valve or pump and of the dump valve, length [m] at the end of
            the last step, and state of the friction, as in the C code.
    """

    def __init__(self, library: str | Path, name: str) -> None:
        """Load a library, for example from `gcc -O2 -shared -fPIC NAME.c -o NAME.so -lm`.

        Args:
            library: path of the library, compiled in double precision.
            name: name of the muscle in the library.
        """
        loaded = ctypes.CDLL(str(Path(library).resolve()))
        self._start, self._step, self._pull = (
            getattr(loaded, f"{name}_{of}") for of in ("start", "step", "pull")
        )
        number, state = ctypes.c_double, ctypes.c_void_p
        self._start.argtypes, self._step.argtypes = [state, *[number] * 2], [state, *[number] * 5]
        self._pull.restype, self._pull.argtypes = number, [state, number, number]
        size = ctypes.c_size_t.in_dll(loaded, f"{name}_state_size").value
        self.state = (number * (size // ctypes.sizeof(number)))()

    def start(self, length: float, pressure: float = 0.0) -> None:
        """Start the plant at rest, at a length [m] and a gauge pressure [Pa]."""
        self._start(self.state, length, pressure)

    def step(self, signal: float, dump: float, length: float, velocity: float, dt: float) -> None:
        """Advance by dt [s] from a length [m] at a constant velocity [m/s]."""
        self._step(self.state, signal, dump, length, velocity, dt)

    def pull(self, length: float, velocity: float) -> float:
        """Return the force [N], including friction and viscous loss."""
        return self._pull(self.state, length, velocity)


def _check_actuators(
    mujoco: Any, model: Any, pulls: Mapping[str, Any], offsets: Mapping[str, float]
) -> None:
    """Raise an error for actuators through which a muscle would exert no force."""
    for name, pull in pulls.items():
        number = model.actuator(name).id
        if model.actuator_biastype[number] != mujoco.mjtBias.mjBIAS_USER:
            raise ValueError(f'the actuator {name} must have biastype="user" to exert a force')
        user = model.actuator_dyntype[number] == mujoco.mjtDyn.mjDYN_USER
        if isinstance(pull, CompiledPlant) and model.actuator_actnum[number] != len(pull.state):
            raise ValueError(
                f'for a plant, the actuator {name} must have dyntype="user" actdim="{len(pull.state)}"'
            )
        if user and not isinstance(pull, CompiledPlant):
            raise ValueError(f'the actuator {name} has dyntype="user": pass a CompiledPlant for it')
        of_tendon = model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_TENDON
        first = model.tendon_adr[model.actuator_trnid[number][0]] if of_tendon else 0
        fixed = of_tendon and model.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT
        if fixed and name not in offsets:
            raise ValueError(
                f"the tendon of {name} is fixed, so its length is 0 at zero joint angle: pass the length "
                f"of the muscle at that angle as an offset, install(model, pulls, {{'{name}': 0.27}})"
            )


def install(
    model: Any, pulls: Mapping[str, Any], offsets: Mapping[str, float] | None = None
) -> None:
    """Make MuJoCo actuators exert the forces of muscles; the control is the gauge pressure [Pa].

    The length of a muscle is the actuator length, which is the length of its tendon. With
    `dyntype="filter"`, the actuator state is the pressure. MuJoCo has one set of callbacks per process: a
    later call replaces them, and `uninstall` removes them. While they are installed, user actuators in
    other models exert no force.

    Args:
        model: `mujoco.MjModel` with an actuator that has `gainprm="0" biastype="user"` for each muscle.
        pulls: muscle for each actuator name: any object with `force(length, pressure)`. For a
            `CompiledPlant`, the actuator needs `dyntype="user"`, and `actdim` must equal the size of the
            plant's state. Its control is the valve or pump signal, 0 to 1; a negative control opens the
            dump valve.
        offsets: length of each muscle minus the length of its tendon [m], by actuator name; 0 by default.
            A tendon of type `fixed` has zero length at zero joint angle.
    """
    mujoco: Any = import_module("mujoco")  # an optional package without types

    numbers = {model.actuator(name).id: name for name in pulls}
    added = {number: float((offsets or {}).get(name, 0.0)) for number, name in numbers.items()}
    _check_actuators(mujoco, model, pulls, offsets or {})
    wanted, known = {n: pulls[name] for n, name in numbers.items()}, dict(numbers)
    states, names = model.actuator_actadr.tolist(), model.names
    limits = {number: model.actuator_ctrlrange[number].tolist() for number in wanted
              if model.actuator_ctrllimited[number]}  # fmt: skip
    beyond = set[int]()

    def bias(asked: Any, data: Any, number: int) -> float:
        if number not in wanted or asked.names != names:
            return 0.0
        length = float(data.actuator_length[number]) + added[number]
        if isinstance(wanted[number], CompiledPlant):
            return -placed(data, number, length).pull(length, float(data.actuator_velocity[number]))
        state, control = states[number], float(data.ctrl[number])
        if control and number in numbers:  # first nonzero control
            name = numbers.pop(number)
            if control < 1000:
                warnings.warn(f"the control of {name} is {control:g} Pa: it must be a gauge pressure "
                              "in Pa (1 bar = 1e5 Pa)", stacklevel=2)  # fmt: skip
        low, high = limits.get(number, (control, control))
        if not low <= control <= high and number not in beyond:
            beyond.add(number)
            warnings.warn(f"the control of {known[number]} is {control:g} Pa: it is limited to its "
                          f"ctrlrange, {low:g} to {high:g} Pa", stacklevel=2)  # fmt: skip
        control = min(max(control, low), high)
        return -wanted[number].force(length, control if state < 0 else float(data.act[state]))

    def placed(data: Any, number: int, length: float) -> CompiledPlant:
        plant, at = wanted[number], data.act[states[number] :][: model.actuator_actnum[number]]
        plant.state[:] = at.tolist()
        if not at[3]:  # reset
            plant.start(length, at[0])
        return plant

    def rates(asked: Any, data: Any, number: int) -> float:
        if isinstance(wanted.get(number), CompiledPlant) and asked.names == names:
            length = float(data.actuator_length[number]) + added[number]
            plant, control = placed(data, number, length), float(data.ctrl[number])
            velocity, dt = float(data.actuator_velocity[number]), float(asked.opt.timestep)
            plant.step(max(control, 0.0), float(control < 0), length, velocity, dt)
            for k, value in enumerate(plant.state, states[number]):
                data.act_dot[k] = (value - data.act[k]) / dt  # reached by MuJoCo's Euler step
        return 0.0

    def loading(load: Callable[..., Any]) -> Callable[..., Any]:
        # A Python callback fails while another model is compiled: remove it during compilation.
        def without(*given: Any, **options: Any) -> Any:
            _set_callbacks(mujoco, None, None, None)
            try:
                return load(*given, **options)
            finally:
                _set_callbacks(mujoco, *callbacks)

        without.loads = load  # pyright: ignore[reportFunctionMemberAccess]
        return without

    uninstall()
    plants = any(isinstance(one, CompiledPlant) for one in wanted.values())
    callbacks = (lambda *_: 0.0), bias, rates if plants else None
    _set_callbacks(mujoco, *callbacks)
    for of, name in _LOADERS:
        own = getattr(mujoco, of)
        method = loading(getattr(own, name))
        setattr(own, name, method if of == "MjSpec" else staticmethod(method))


_LOADERS = ("MjModel", "from_xml_path"), ("MjModel", "from_xml_string"), ("MjSpec", "compile")


def _set_callbacks(mujoco: Any, gain: Any, bias: Any, dyn: Any) -> None:
    mujoco.set_mjcb_act_gain(gain)
    mujoco.set_mjcb_act_bias(bias)
    mujoco.set_mjcb_act_dyn(dyn)


def uninstall() -> None:
    """Remove MuJoCo's callbacks."""
    mujoco: Any = import_module("mujoco")
    _set_callbacks(mujoco, None, None, None)
    for of, name in _LOADERS:
        own = getattr(mujoco, of)
        load = getattr(getattr(own, name), "loads", None)
        if load is not None:
            setattr(own, name, load)


def mjx_step(
    model: "mjx.Model", data: "mjx.Data", muscles: Mapping[int, tuple[AbstractMuscle, Real]],
    offsets: Mapping[int, Real] | None = None,
) -> "mjx.Data":  # fmt: skip
    """Advance MJX by one step, with muscle forces computed from the tendon lengths before the step.

    The function can be jitted, scanned, vmapped, and differentiated with respect to every parameter of
    the muscles. MJX has no user actuators: use a motor with gain 1 on the tendon, without limits.

    Args:
        model: MJX model.
        data: MJX state.
        muscles: muscle and gauge pressure [Pa], by actuator number.
        offsets: length of each muscle minus the length of its tendon [m], by actuator number; 0 by
            default. A tendon of type `fixed` has zero length at zero joint angle.

    Returns:
        The state after the step.

    Raises:
        ValueError: there is no offset for a `fixed` tendon, so the length of the muscle is unknown.
    """
    mujoco: Any = import_module("mujoco")
    from mujoco import mjx  # noqa: PLC0415 -- an optional package

    placed = mjx.tendon(model, mjx.com_pos(model, mjx.kinematics(model, data)))
    control = jnp.asarray(data.ctrl)
    for number, (muscle, pressure) in muscles.items():
        which = int(model.actuator_trnid[number, 0])
        fixed = model.wrap_type[model.tendon_adr[which]] == mujoco.mjtWrap.mjWRAP_JOINT
        if fixed and number not in (offsets or {}):
            raise ValueError(
                f"the tendon of actuator {number} is fixed, so its length is 0 at zero joint angle: pass "
                f"the length of the muscle at that angle as an offset, offsets={{{number}: 0.27}}"
            )
        length = placed.ten_length[which] + (offsets or {}).get(number, 0.0)
        control = control.at[number].set(-muscle.force(length, pressure))
    after = mjx.step(model, data.replace(ctrl=control))
    # In float64, MJX widens the integers of tendons, which a scan rejects.
    return jax.tree.map(lambda new, old: new.astype(old.dtype), after, data)


# --- files


def mujoco_files(subject: Subject) -> dict[str, bytes]:
    """Write `NAME.xml` with a user actuator, and `NAME_mujoco.py`, which needs only MuJoCo.

    If there is a plant, the actuator state is its state, and the module contains `CompiledPlant`.
    """
    name, rest = subject.identifier, _at_rest(subject)
    actuator, key = 'gainprm="0" biastype="user" ctrllimited="true" ', f'ctrl="{rest.pressure}"'
    if subject.plant is None:
        actuator += f'ctrlrange="0 {subject.pull.pressure_limit!r}"'
    else:
        memory = plant_words(subject)["MEMORY"]
        actuator += f'dyntype="user" actdim="{4 + memory}" ctrlrange="-1 1"'
        state = f"{rest.pressure} 0 0 0{' 0' * memory}"
        key = f'ctrl="{resting_signal(subject.plant)!r}" act="{state}"'
    code = [*map(inspect.getsource, _WRITTEN), f"_LOADERS = {_LOADERS!r}"]
    pull = "PULL" if subject.plant is None else f'CompiledPlant("{name}.so", "{name}")'
    words = table_words(subject) | {"name": name, "CALLBACK": "\n\n".join(code), "USED": pull}
    module = filled("mujoco.py.in", words)
    return {f"{name}.xml": _hanging_load(subject, rest, actuator, key), f"{name}_mujoco.py": module}


def table_words(subject: Subject) -> dict[str, str]:
    """Return the substitutions for a Python module that contains a table."""
    return {
        "HEADING": docstring(subject.about_table),
        "PLAIN": Path(plain.__file__).read_text(encoding="utf-8"),
        "TABLE": pprint.pformat(subject.table, compact=True, width=100, sort_dicts=False),
    }


_WRITTEN = (CompiledPull, CompiledPlant, _check_actuators, install, _set_callbacks, uninstall)
"""Code that is copied into the exported module."""


def mjx_files(subject: Subject) -> dict[str, bytes]:
    """Write `NAME_mjx.xml` with a motor, the card, and `NAME_mjx.py`, whose step function needs famjax.

    Raises:
        InputError: the muscle has no card.
    """
    if subject.card is None:
        raise InputError(
            "an MJX model requires a card: without one, call famjax.export.mjx_step instead"
        )
    name, rest, text = (
        subject.identifier,
        _at_rest(subject),
        as_text(card_as_document(subject.card)),
    )
    own = sorted(set(re.findall(r'"type": "([\w.]+):', text)))
    words = {"HEADING": docstring(subject.about), "name": name, "OWN": own}
    motor = 'gainprm="1" biastype="none" ctrllimited="false"'
    return {
        f"{name}_mjx.xml": _hanging_load(subject, rest, motor, f'ctrl="{-rest.load}"'),
        f"{name}_card.json": text.encode(),
        f"{name}_mjx.py": filled("mjx.py.in", words),
    }


class _Rest(NamedTuple):
    """A load of half the blocked force [N], a pressure [Pa], and the length [m] under that load."""

    load: float
    pressure: float
    length: float


def _at_rest(subject: Subject) -> _Rest:
    pressure = _SHARE[1] * subject.pull.pressures[-1]
    load = _SHARE[0] * subject.pull.force(float(subject.muscle.rest_length), pressure)
    return _Rest(load, pressure, float(subject.muscle.length_at_load(load, pressure)))


def _hanging_load(subject: Subject, rest: _Rest, actuator: str, key: str) -> bytes:
    """Build a model with a hanging load, given the attributes of its actuator and its keyframe at rest."""
    stiffness = subject.pull.stiffness(rest.length, rest.pressure)
    return filled("hanging_load.xml", {
        "MODEL": quoteattr(subject.name), "name": subject.identifier,
        "ABOUT": quoteattr("; ".join(line.strip() for line in subject.about_table)),
        "GRAVITY": _GRAVITY, "LENGTH": rest.length, "MASS": rest.load / _GRAVITY,
        "DAMPING": 2 * math.sqrt(rest.load / _GRAVITY * stiffness),  # critical
        "ACTUATOR": actuator, "KEY": key,
    })  # fmt: skip


def docstring(lines: Iterable[str]) -> str:
    """Join lines into a Python docstring, and replace characters that would end it."""
    return "\n".join(lines).replace("\\", "/").replace('"', "'")
