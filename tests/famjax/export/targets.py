"""Exported muscles in their targets, for tests and benchmarks: C compiled here, a knee in MuJoCo, MJX."""

import ctypes
import dataclasses
import math
import subprocess
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from muscles import FESTO

import famjax
from famjax import Real
from famjax.cards import MuscleCard
from famjax.continuation import Region
from famjax.export import CompiledPlant, Subject, TabulatedPull, export, install, uninstall
from famjax.plant import TICK, Command, simulate

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wconversion")
_KINDS = {"double": ctypes.c_double, "float": ctypes.c_float}
_PRESSURE, _START = 4e5, 0.01  # Pa; m above the equilibrium of the exported load
_HALF_WIDTH = 0.1  # m, of the lever on the shank
_KNEE = """
<mujoco>
  <worldbody>
    <site name="front" pos="{lever} 0 {above}"/>
    <site name="back" pos="-{lever} 0 {above}"/>
    <body name="shank">
      <joint name="knee" type="hinge" axis="0 1 0" damping="1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.04" mass="3.5"/>
      <site name="front lever" pos="{lever} 0 0"/>
      <site name="back lever" pos="-{lever} 0 0"/>
    </body>
  </worldbody>
  <tendon>
    <spatial name="extensor"><site site="front"/><site site="front lever"/></spatial>
    <spatial name="flexor"><site site="back"/><site site="back lever"/></spatial>
  </tendon>
  <actuator>
    <general name="extensor" tendon="extensor" gainprm="0" biastype="user"/>
    <general name="flexor" tendon="flexor" gainprm="0" biastype="user"/>
    <position name="drive" joint="knee" kp="4000" kv="40"/>
  </actuator>
</mujoco>
"""

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]


def _mujoco() -> Any:
    return import_module("mujoco")  # an extra of the project, without types


def compiled(subject: Subject, folder: Path, real: str) -> Callable[[str], Function]:
    """The exported functions by what they return: force, stiffness, pressure."""
    export(subject, ["c"], folder)
    name, shared = subject.identifier, folder / f"{real}.so"
    define = f"-D{name.upper()}_REAL={real}"
    command = ["gcc", *STRICT, "-Os", "-shared", "-fPIC", define, "-o", str(shared)]
    subprocess.run([*command, str(folder / f"{name}.c")], check=True)
    loaded = ctypes.CDLL(str(shared))

    def function(what: str) -> Function:
        found = getattr(loaded, f"{name}_{what}")
        found.restype, found.argtypes = _KINDS[real], [_KINDS[real]] * 2
        return lambda a, b: np.array([found(*x) for x in zip(a.tolist(), b.tolist(), strict=True)])

    return function


def code_sections(source: Path, *options: str, compiler: str = "gcc", size: str = "size") -> dict:
    """Bytes of each section of a C source compiled for size."""
    target = str(source.with_suffix(".o"))
    command = [compiler, *STRICT, "-Os", *options, "-c", "-o", target, str(source)]
    subprocess.run(command, check=True)
    told = subprocess.run([size, "-A", target], capture_output=True, text=True, check=True)
    rows = [line.split() for line in told.stdout.splitlines()]
    return {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}


def exported_states(subject: Subject, count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Lengths and pressures, a half in the muscle's region and a half up to twice its ends."""
    rng, half = np.random.default_rng(seed), count // 2
    length, pressure = (
        np.concatenate([rng.uniform(axis[0], axis[-1], half), rng.uniform(0, 2 * axis[-1], half)])
        for axis in (subject.pull.lengths, subject.pull.pressures)
    )
    return length, pressure


def telling(subject: Subject, length: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """Where a force tells the pressure: taut, between the stops, its area above 1 % of the mean."""
    pull, states = subject.pull, [*zip(length.tolist(), pressure.tolist(), strict=True)]
    area, force = (np.array([ask(*one) for one in states]) for ask in (pull.area, pull.force))
    between = (pull.stops[0] < length) & (length < pull.stops[1])
    return between & (force > pull.slack_width) & (area > 0.01 * area[: len(area) // 2].mean())


class KneeRun(NamedTuple):
    overrun: float  # of the identified stroke at either end, the lesser, in strokes
    fastest: float  # largest speed of all 10 s [rad/s]
    at_rest: float  # that of the last second, the drive being off [rad/s]
    finite: bool  # whether every state was


def driven_knee(pull: TabulatedPull, *, overrun: float = 0.3, seconds: float = 10.0) -> KneeRun:
    """Swing a knee past the data, up to 1.3 times the highest pressure, then let it come to rest."""
    mujoco = _mujoco()
    short, long = pull.lengths[0], pull.lengths[-1]
    reach = (0.5 + overrun) * (long - short)
    xml = _KNEE.format(lever=_HALF_WIDTH, above=0.5 * (short + long))
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    install(model, {"extensor": pull, "flexor": pull})
    # A little more than the angle at which the distance from lever to anchor has changed so much.
    amplitude = 1.1 * math.asin(min(reach / _HALF_WIDTH, 1.0))
    highest, steps = pull.pressures[-1], round(seconds / model.opt.timestep)
    lengths, speeds = np.empty((steps, 2)), np.empty(steps)
    try:
        for k in range(steps):
            now = k * model.opt.timestep
            wave = math.sin(2 * math.pi * 1.3 * now)
            if now < 0.6 * seconds:
                data.ctrl[:2] = 0.65 * highest * (1 + wave), 0.65 * highest * (1 - wave)
                data.ctrl[2] = amplitude * math.sin(math.pi * now)
            else:
                model.actuator_gainprm[2, 0] = model.actuator_biasprm[2, 1:3] = 0.0
            mujoco.mj_step(model, data)
            lengths[k], speeds[k] = data.ten_length, abs(data.qvel[0])
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_gain(None)
    past = min(short - lengths.min(axis=0).max(), lengths.max(axis=0).min() - long)
    finite = bool(np.isfinite(lengths).all() and np.isfinite(speeds).all())
    last = float(speeds[-round(1.0 / model.opt.timestep) :].max())
    return KneeRun(float(past) / (long - short), float(speeds.max()), last, finite)


@dataclasses.dataclass(frozen=True)
class Course:
    """Commands and a moving length over 10 s, and what the plant does under them each 2 ms."""

    subject: Subject  # with the plant
    signal: np.ndarray  # of valve or pump in each of n ticks
    length: np.ndarray  # a sine [m] at the n + 1 ends of the ticks; between them it is straight
    pressure: np.ndarray  # of the plant after each tick [Pa]
    force: np.ndarray  # its pull [N]

    @classmethod
    def of(cls, subject: Subject, seconds: float = 10.0) -> "Course":
        """The course under random commands and a sine of 12 mm at 0.3 Hz, with a dump at its end."""
        assert subject.plant is not None
        count = round(seconds / TICK)
        low, high = (0.25, 0.8) if hasattr(subject.plant.circuit, "bias") else (0.55, 1.0)
        signal = np.repeat(np.random.default_rng(0).uniform(low, high, 20), count // 20)
        length = _sine(TICK * np.arange(count + 1))[0]
        dumps = _dumped(TICK * np.arange(count), seconds)
        signal = np.where(dumps > 0, 0.0, signal)
        command = Command(signal, dumps, np.diff(length) / TICK)
        start = subject.plant.start(length[0])
        found = jax.jit(simulate)(subject.plant, command, TICK, start=start)
        return cls(subject, signal, length, np.asarray(found.pressure), np.asarray(found.force))

    def errors(self, pressure: np.ndarray, force: np.ndarray) -> dict[str, float]:
        """Largest differences from the plant, in parts of its ranges."""
        pairs = {"pressure": (pressure, self.pressure), "force": (force, self.force)}
        return {of: float(np.abs(a - b).max() / np.ptp(b)) for of, (a, b) in pairs.items()}

    def compiled(self, folder: Path) -> CompiledPlant:
        """The plant of the C export, which compiles without a warning."""
        export(self.subject, ["c"], folder)
        name, library = self.subject.identifier, folder / "plant.so"
        command = ["gcc", *STRICT, "-O2", "-shared", "-fPIC", "-o", str(library)]
        subprocess.run([*command, str(folder / f"{name}.c"), "-lm"], check=True)
        return CompiledPlant(library, name)

    def errors_in_c(self, folder: Path) -> dict[str, float]:
        plant, found = self.compiled(folder), []
        plant.start(self.length[0], 0.0)
        for at, signal, dump, velocity in self._ticks():
            plant.step(signal, dump, at, velocity, TICK)
            found.append((plant.state[0], plant.pull(at + velocity * TICK, velocity)))
        return self.errors(*np.array(found).T)

    def errors_in_fmu(self, folder: Path, kind: str) -> dict[str, float]:
        """Errors of the FMU in `CoSimulation`, or in `ModelExchange` with exact inputs."""
        (file,) = export(self.subject, ["fmu"], folder)
        times = TICK * np.arange(len(self.signal) + 1)
        ends = np.repeat(times, 2)[1:-1]  # of ticks, in which commands are constant
        moved = (np.repeat(self.length, 2)[1:-1], np.repeat(np.diff(self.length) / TICK, 2))
        commands = np.repeat([self.signal, _dumped(times[:-1], times[-1])], 2, axis=1)
        inputs = [ends, *commands, *(moved if kind == "CoSimulation" else _sine(ends))]
        found = import_module("fmpy").simulate_fmu(
            str(file), stop_time=times[-1], fmi_type=kind, relative_tolerance=1e-8,
            input=np.rec.fromarrays(inputs, names=["time", "signal", "dump", "length", "velocity"]),
            output=["pressure", "force"],
            # The solver of model exchange holds its inputs from one output to the next.
            output_interval=TICK if kind == "CoSimulation" else TICK / 8,
        )  # fmt: skip
        both = (found[name] for name in ("pressure", "force"))
        pressure, force = (np.interp(times[1:], found["time"], one) for one in both)
        return self.errors(pressure, force)

    def errors_in_mujoco(self, folder: Path) -> dict[str, float]:
        """Errors of the exported actuator, its tendon moved by hand."""
        xml, _ = export(self.subject, ["mujoco"], folder)
        model, name = _mujoco().MjModel.from_xml_path(str(xml)), self.subject.identifier
        data, found, longest = _mujoco().MjData(model), [], -model.body_pos[1, 2]
        model.opt.timestep = TICK
        install(model, {name: self.compiled(folder)})
        try:
            for at, signal, dump, velocity in self._ticks():
                data.qpos[0], data.qvel[0], data.ctrl[0] = (longest - at, -velocity, signal - dump)
                _mujoco().mj_step(model, data)
                data.qpos[0], data.qvel[0] = longest - at - velocity * TICK, -velocity
                _mujoco().mj_forward(model, data)
                found.append((data.act[0], -data.actuator_force[0]))
        finally:
            uninstall()
        return self.errors(*np.array(found).T)

    def _ticks(self) -> Iterator[tuple[float, float, float, float]]:
        dumps = _dumped(TICK * np.arange(len(self.signal)), len(self.signal) * TICK)
        each = self.length[:-1], self.signal, dumps, np.diff(self.length) / TICK
        return zip(*(one.tolist() for one in each), strict=True)


def _sine(time: Any) -> tuple[Any, Any]:
    """Length [m] and velocity [m/s]."""
    rate = 2 * math.pi * 0.3
    return 0.27 + 0.012 * np.sin(rate * time), 0.012 * rate * np.cos(rate * time)


def _dumped(time: np.ndarray, end: float) -> np.ndarray:
    return np.where(time >= end - 0.4 - 1e-9, 1.0, 0.0)


def cubic_card() -> MuscleCard:
    """The card of a muscle like the DMSP-20 with a cubic law, of which E_1 is a coefficient."""
    mounted = famjax.MountedMuscle(FESTO, jnp.asarray(0.0))
    return MuscleCard("Test-20", (mounted,), np.ones(1), Region([0.225, 0.3], [0.0, 6e5]))


def rollout(folder: Path, steps: int) -> tuple[Callable[[Real], jax.Array], float]:
    """The height [m] of the load after some steps as a function of E_1 [Pa], and E_1 itself."""
    from mujoco import mjx

    export(Subject.of_card(cubic_card()), ["mjx"], folder)
    model = mjx.put_model(_mujoco().MjModel.from_xml_path(str(folder / "test_20_mjx.xml")))
    muscle = famjax.cards.read_card(folder / "test_20_card.json").safe()

    def moduli(of: famjax.SafeMuscle) -> jax.Array:
        return of.continued.muscle.terms.terms[0].material.coefficients  # type: ignore[attr-defined]

    def end(first: Real) -> jax.Array:
        changed = eqx.tree_at(moduli, muscle, moduli(muscle).at[0].set(first))
        data = mjx.make_data(model).replace(qpos=jnp.array([_START]))

        def step(data: mjx.Data, _: None) -> tuple[mjx.Data, None]:
            return famjax.export.mjx_step(model, data, {0: (changed, _PRESSURE)}), None

        return jax.lax.scan(step, data, None, length=steps)[0].qpos[0]

    return jax.jit(end), float(moduli(muscle)[0])


def rollout_derivatives(folder: Path, steps: int) -> tuple[float, float]:
    """Derivative [m/Pa] of the load's height by E_1, exact and by central differences."""
    end, first = rollout(folder, steps)
    width = 1e-4 * first
    difference = (end(first + width) - end(first - width)) / (2 * width)
    return float(jax.grad(end)(first)), float(difference)
