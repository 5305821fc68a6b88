"""MuJoCo and MJX: callbacks for muscles, a step with muscles, and a load that hangs on one."""

import ctypes
import inspect
import math
import pprint
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import jax
import jax.numpy as jnp
import msgspec

from .._arrays import Real
from ..boundary.errors import InputError
from ..cards import card_as_document
from ..cards.card import as_text
from ..cards.parts import own_modules
from ..muscle import AbstractMuscle
from . import plain
from .circuits import filled, plant_words, resting_signal
from .table import Subject

if TYPE_CHECKING:
    from mujoco import mjx

_GRAVITY = 9.81
_SHARE = 0.5, 2 / 3  # load in the blocked force, and its pressure in the highest


class CompiledPull:
    """The force from the exported C in a shared library: a callback at little more than Python's cost.

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


class CompiledPlant:
    """A muscle with its circuit from the exported C in a shared library."""

    def __init__(self, library: str | Path, name: str) -> None:
        """The plant of a library, from such as `gcc -O2 -shared -fPIC NAME.c -o NAME.so -lm`.

        Args:
            library: the file; compiled in double precision.
            name: of the muscle in it.
        """
        loaded = ctypes.CDLL(str(Path(library).resolve()))
        self._start, self._step, self._pull = (
            getattr(loaded, f"{name}_{of}") for of in ("start", "step", "pull")
        )
        number, state = ctypes.c_double, ctypes.c_void_p
        self._start.argtypes, self._step.argtypes = [state, *[number] * 2], [state, *[number] * 5]
        self._pull.restype, self._pull.argtypes = number, [state, number, number]
        size = ctypes.c_size_t.in_dll(loaded, f"{name}_state_size").value
        self._state = (number * (size // ctypes.sizeof(number)))()

    @property
    def pressure(self) -> float:
        """Gauge pressure [Pa]."""
        return self._state[0]

    @property
    def length(self) -> float:
        """Active length [m] at the end of the last step."""
        return self._state[3]

    @property
    def state(self) -> list[float]:
        """Pressure [Pa], openings, length [m] at the end of the last step, friction; as in the C."""
        return list(self._state)

    @state.setter
    def state(self, state: Sequence[float]) -> None:
        self._state[:] = state

    def start(self, length: float, pressure: float = 0.0) -> None:
        """Put the plant at rest at a length [m] and a gauge pressure [Pa]."""
        self._start(self._state, length, pressure)

    def step(self, signal: float, dump: float, length: float, velocity: float, dt: float) -> None:
        """Advance by dt [s] from a length [m] at a constant velocity [m/s]."""
        self._step(self._state, signal, dump, length, velocity, dt)

    def pull(self, length: float, velocity: float) -> float:
        """Pull [N], friction and viscous loss included."""
        return self._pull(self._state, length, velocity)


def _check_actuators(
    mujoco: Any, model: Any, named: Mapping[int, str], offsets: Mapping[str, float]
) -> None:
    """Refuse actuators by which a muscle would exert no force."""
    for number, name in named.items():
        if model.actuator_biastype[number] != mujoco.mjtBias.mjBIAS_USER:
            raise ValueError(
                f'the actuator {name} must have biastype="user"; it would exert no force'
            )
        of_tendon = model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_TENDON
        first = model.tendon_adr[model.actuator_trnid[number][0]] if of_tendon else 0
        fixed = of_tendon and model.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT
        if fixed and name not in offsets:
            raise ValueError(
                f"the tendon of {name} is fixed, so its length is 0 at zero joint angle: give the length "
                f"of the muscle there as an offset, install(model, pulls, {{'{name}': 0.27}})"
            )


def install(
    model: Any, pulls: Mapping[str, Any], offsets: Mapping[str, float] | None = None
) -> None:
    """Let MuJoCo take the force of actuators from muscles; the control is the gauge pressure [Pa].

    The length is the actuator's, that of its tendon. With `dyntype="filter"` the pressure is the
    actuator's state. MuJoCo has one such callback in a process: a later call replaces it, and
    `uninstall` takes it away. Actuators of other models get no force.

    Args:
        model: `mujoco.MjModel` with an actuator of `gainprm="0" biastype="user"` for each muscle.
        pulls: the muscle, as anything with `force(length, pressure)`, of each actuator's name. Or a
            `CompiledPlant`, whose state is the actuator's by `dyntype="user"` and an `actdim` of its size:
            the control is the signal of valve or pump, 0 to 1, and below 0 the dump valve is open.
        offsets: what an actuator's muscle is longer than its tendon [m], by its name; 0 unless given. A
            tendon of `fixed` type has the length 0 where its joints do.
    """
    mujoco: Any = import_module("mujoco")  # an extra of the project, without types

    wanted = {model.actuator(name).id: pull for name, pull in pulls.items()}
    plants = {k: pull for k, pull in wanted.items() if isinstance(pull, CompiledPlant)}
    called = {model.actuator(name).id: name for name in pulls}
    _check_actuators(mujoco, model, called, offsets or {})
    added = {model.actuator(name).id: float(one) for name, one in (offsets or {}).items()}
    states, copies = model.actuator_actadr.tolist(), {model._address}

    def bias(asked: Any, data: Any, number: int) -> float:
        if number not in wanted or (asked._address not in copies and not copied(asked)):
            return 0.0
        length = float(data.actuator_length[number]) + added.get(number, 0.0)
        if number in plants:
            return -placed(data, number, length).pull(length, float(data.actuator_velocity[number]))
        state, control = states[number], float(data.ctrl[number])
        if control and number in called:  # the first one that is not 0
            name = called.pop(number)
            if control < 1000:
                warnings.warn(f"the control of {name} is {control:g} Pa: is it in Pa, above the "
                              "atmosphere? 1 bar is 1e5 Pa", stacklevel=2)  # fmt: skip
        return -wanted[number].force(length, control if state < 0 else float(data.act[state]))

    def placed(data: Any, number: int, length: float) -> CompiledPlant:
        plant, at = plants[number], data.act[states[number] :][: model.actuator_actnum[number]]
        plant.state = at.tolist()
        if not at[3]:  # reset
            plant.start(length, plant.pressure)
        return plant

    def rates(asked: Any, data: Any, number: int) -> float:
        if number in plants and (asked._address in copies or copied(asked)):
            length = float(data.actuator_length[number]) + added.get(number, 0.0)
            plant, control = placed(data, number, length), float(data.ctrl[number])
            velocity, dt = float(data.actuator_velocity[number]), float(asked.opt.timestep)
            plant.step(max(control, 0.0), float(control < 0), length, velocity, dt)
            for k, value in enumerate(plant.state, states[number]):  # where Euler's step shall end
                data.act_dot[k] = (value - data.act[k]) / dt
        return 0.0

    def copied(asked: Any) -> bool:
        if asked.names == model.names:
            copies.add(asked._address)
        return asked.names == model.names

    uninstall()
    mujoco.set_mjcb_act_gain(lambda *_: 0.0)
    mujoco.set_mjcb_act_bias(bias)
    mujoco.set_mjcb_act_dyn(rates if plants else None)

    def loading(load: Callable[..., Any]) -> Callable[..., Any]:
        # A callback of Python fails while another model is compiled: it waits until that is done.
        def without(*given: Any, **options: Any) -> Any:
            kinds = "gain", "bias", "dyn"
            mine = {of: getattr(mujoco, f"get_mjcb_act_{of}")() for of in kinds}
            for of in kinds:
                getattr(mujoco, f"set_mjcb_act_{of}")(None)
            try:
                return load(*given, **options)
            finally:
                for of, own in mine.items():
                    getattr(mujoco, f"set_mjcb_act_{of}")(own)

        without.loads = load  # pyright: ignore[reportFunctionMemberAccess]
        return without

    for of, name in _LOADERS:
        own = getattr(mujoco, of)
        method = loading(getattr(own, name))
        setattr(own, name, method if of == "MjSpec" else staticmethod(method))


_LOADERS = (
    ("MjModel", "from_xml_path"), ("MjModel", "from_xml_string"), ("MjModel", "from_binary_path"),
    ("MjSpec", "compile"),
)  # fmt: skip


def uninstall() -> None:
    """Remove MuJoCo's callbacks."""
    mujoco: Any = import_module("mujoco")
    for of in ("gain", "bias", "dyn"):
        getattr(mujoco, f"set_mjcb_act_{of}")(None)
    for of, name in _LOADERS:
        own = getattr(mujoco, of)
        load = getattr(getattr(own, name), "loads", None)
        if load is not None:
            setattr(own, name, load)


def mjx_step(
    model: "mjx.Model",
    data: "mjx.Data",
    muscles: Mapping[int, tuple[AbstractMuscle, Real]],
    offsets: Mapping[int, Real] | None = None,
) -> "mjx.Data":
    """One step of MJX with muscles, which pull at the tendon lengths at its start.

    It can be jitted, scanned, mapped, and differentiated by every number of the muscles. MJX takes
    no user actuators: a muscle's is a motor of gain 1 on its tendon, without limits.

    Args:
        model: of MJX.
        data: the state.
        muscles: muscle and gauge pressure [Pa] by the number of the actuator.
        offsets: what a muscle is longer than its tendon [m], by the same number; 0 unless given. A tendon
            of `fixed` type has the length 0 where its joints do.

    Returns:
        The state after the step.
    """
    from mujoco import mjx  # noqa: PLC0415 -- an extra of the project

    placed = mjx.tendon(model, mjx.com_pos(model, mjx.kinematics(model, data)))
    control = jnp.asarray(data.ctrl)
    for number, (muscle, pressure) in muscles.items():
        tendon = placed.ten_length[int(model.actuator_trnid[number, 0])]
        length = tendon + (offsets or {}).get(number, 0.0)
        control = control.at[number].set(-muscle.force(length, pressure))
    after = mjx.step(model, data.replace(ctrl=control))
    # In float64 MJX widens integers of tendons, which a scan does not take.
    return jax.tree.map(lambda new, old: new.astype(old.dtype), after, data)


# --- files


def mujoco_files(subject: Subject) -> dict[str, bytes]:
    """`NAME.xml` with user actuators, and `NAME_mujoco.py`, which needs MuJoCo and nothing else.

    With a plant the actuator's state is the plant's, and the module has `CompiledPlant` for the C.
    """
    name = subject.identifier
    limits = f'ctrllimited="true" ctrlrange="0 {subject.pull.pressure_limit!r}"'
    module = filled("mujoco.py.in", {
        "HEADING": docstring(subject.about_table),
        "name": name,
        "PLAIN": Path(plain.__file__).read_text(encoding="utf-8"),
        "CALLBACK": "\n\n".join(map(inspect.getsource, _WRITTEN))
        + f"\n\n_LOADERS = {_LOADERS!r}",
        "TABLE": pprint.pformat(subject.table, compact=True, width=100, sort_dicts=False),
    })  # fmt: skip
    kind = 'gainprm="0" biastype="user" '
    if subject.plant is None:
        load = _hanging_load(subject, kind + limits)
    else:
        memory = plant_words(subject)["MEMORY"]
        kind += f'dyntype="user" actdim="{4 + memory}" ctrllimited="true" ctrlrange="-1 1"'
        rest = f'ctrl="{resting_signal(subject.plant)!r}" act="{{}} 0 0 0{" 0" * memory}"'
        load = _hanging_load(subject, kind, lambda _, at: rest.format(at))
    return {
        f"{name}.xml": load,
        f"{name}_mujoco.py": module,
    }


_WRITTEN = (CompiledPull, CompiledPlant, _check_actuators, install, uninstall)
"""Parts of the written module."""


def mjx_files(subject: Subject) -> dict[str, bytes]:
    """`NAME_mjx.xml` with a motor, the card, and `NAME_mjx.py` with the step; needs famjax.

    Raises:
        InputError: the muscle is not of a card.
    """
    if subject.card is None:
        raise InputError(
            "an MJX model takes its muscle from a card, and this one has none: call "
            "famjax.export.mjx_step with the muscle itself"
        )
    name, document = subject.identifier, card_as_document(subject.card)
    words = {
        "HEADING": docstring(subject.about),
        "name": name,
        "OWN": own_modules(msgspec.to_builtins(document.members)),
    }
    motor = 'gainprm="1" biastype="none" ctrllimited="false"'
    return {
        f"{name}_mjx.xml": _hanging_load(subject, motor, lambda load, _: f'ctrl="{-load}"'),
        f"{name}_card.json": as_text(document).encode(),
        f"{name}_mjx.py": filled("mjx.py.in", words),
    }


def _hanging_load(
    subject: Subject,
    actuator: str,
    key: Callable[[float, float], str] = lambda _, at: f'ctrl="{at}"',
) -> bytes:
    """A load of half the blocked force on the muscle, with the equilibrium as a keyframe.

    Args:
        subject: the muscle.
        actuator: attributes of the actuator, which is of the muscle's name.
        key: of the load [N] and the pressure [Pa] at rest, the keyframe's control and state.
    """
    pull = subject.pull
    at = _SHARE[1] * pull.pressures[-1]
    load = _SHARE[0] * pull.force(float(subject.muscle.rest_length), at)
    length = float(subject.muscle.length_at_load(load, at))
    return filled("hanging_load.xml", {
        "MODEL": quoteattr(subject.name),
        "ABOUT": quoteattr("; ".join(line.strip() for line in subject.about_table)),
        "GRAVITY": _GRAVITY,
        "LENGTH": length,
        "MASS": load / _GRAVITY,
        "DAMPING": 2 * math.sqrt(load / _GRAVITY * pull.stiffness(length, at)),  # critical
        "name": subject.identifier,
        "ACTUATOR": actuator,
        "KEY": key(load, at),
    })  # fmt: skip


def docstring(lines: Iterable[str]) -> str:
    """Lines that do not end a docstring of Python."""
    return "\n".join(lines).replace("\\", "/").replace('"', "'")
