"""Identify a plant by multiple shooting from records of valve signal, pressure and force.

A record is cut into pieces of equal length. The initial pressure of each piece is unknown and must
match the pressure at the end of the previous piece. The opening of the valve (or pump) at the start of
the record is also unknown. Later openings and the friction follow from the recorded signal and length.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from famjax import Real
from famjax.boundary.errors import InputError
from famjax.parameters import Declared, Parametrised
from famjax.plant import TICK, Command, HydraulicCircuit, Plant, PlantState, PneumaticCircuit

from .arguments import check_float64

_JOINED = 30.0  # weight of a pressure jump between pieces, per standard deviation of a reading
FREE: Mapping[type, tuple[str, ...]] = {
    PneumaticCircuit: ("conductance", "critical_ratio", "lag", "leak", "dead_volume"),
    HydraulicCircuit: ("displacement", "needle", "lag", "bulk_modulus"),
}
"""Parameters that are identified by default, for each type of circuit."""


@dataclasses.dataclass(frozen=True)
class PlantRecord:
    """Record of one muscle on a testing machine, sampled at equal time steps.

    Attributes:
        time: time [s], increasing, shape (n,).
        signal: signal to the valve or pump as a fraction of full output, 0 to 1; constant between samples.
        pressure: measured gauge pressure P [Pa].
        length: active length L [m].
        force: measured force F [N]; None if not measured.
        name: name of the record in messages.
    """

    time: Float[np.ndarray, " n"]
    signal: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"] | None = None
    name: str = "record"

    def __post_init__(self) -> None:
        """Check the columns of the record.

        Raises:
            InputError: columns differ in length, there are too few time steps or they are unequal, values
                are not finite, the signal is constant or outside 0 to 1, or the pressure is absolute.
        """
        columns = {
            field.name: np.asarray(value, float)
            for field in dataclasses.fields(self)
            if field.name != "name" and (value := getattr(self, field.name)) is not None
        }
        for name, values in columns.items():
            object.__setattr__(self, name, values)
            if values.shape != columns["time"].shape or not np.isfinite(values).all():
                raise InputError(
                    f"{self.name}: {name} must be finite, with one value for each of the "
                    f"{columns['time'].size} times: trim the record to the part where every column is known"
                )
        steps = np.diff(self.time)
        if steps.size < 20 or not (steps > 0).all() or np.ptp(steps) > 0.5 * np.median(steps):
            raise InputError(
                f"{self.name}: times must increase in at least 20 equal steps; got {steps.size} steps of "
                f"{steps.min(initial=0):.3g} to {steps.max(initial=0):.3g} s: resample the record"
            )
        if self.signal.min() < 0 or self.signal.max() > 1 or np.ptp(self.signal) == 0:
            raise InputError(
                f"{self.name}: the signal to the valve or pump must vary between 0 and 1 (full output); "
                f"got {self.signal.min():g} to {self.signal.max():g}. A pressure set point cannot be used: "
                "record the controller's output"
            )
        if 85e3 < self.pressure.min() < 110e3:
            raise InputError(
                f"{self.name}: pressures must be gauge pressures, but the lowest is "
                f"{self.pressure.min() / 1e3:.4g} kPa, about one atmosphere: subtract the atmospheric "
                "pressure, or start the record with a vented muscle"
            )

    @property
    def step(self) -> float:
        """Mean time [s] between samples."""
        return float(self.time[-1] - self.time[0]) / (self.time.size - 1)

    def part(self, start: int, end: int) -> "PlantRecord":
        """Return a record of the samples from `start` up to, but not including, `end`."""
        return dataclasses.replace(
            self,
            **{
                field.name: value[start:end]
                for field in dataclasses.fields(self)
                if isinstance(value := getattr(self, field.name), np.ndarray)
            },
        )


@dataclasses.dataclass(frozen=True)
class PlantEstimate:
    """An identified parameter of a plant.

    Attributes:
        name, unit: name and unit of the parameter.
        value: value in SI.
        stderr: standard error; nan at a bound.
        at_bound: true if the value is at a limit of its range.
    """

    name: str
    unit: str
    value: float
    stderr: float
    at_bound: bool


@dataclasses.dataclass(frozen=True)
class PlantFit:
    """An identified plant.

    Attributes:
        plant: plant with the identified parameters.
        estimates: identified parameters.
        covariance: covariance of the identified parameters.
        pressure_rms, force_rms: RMS residuals of pressure [Pa] and force [N]; the latter is nan if no
            force was measured.
        warnings: warnings about poorly determined parameters and small signals.
    """

    plant: Plant
    estimates: tuple[PlantEstimate, ...]
    covariance: Float[np.ndarray, "k k"]
    pressure_rms: float
    force_rms: float
    warnings: tuple[str, ...]

    def predict(self, record: PlantRecord) -> PlantState:
        """Predict the plant's states along a record from its signal, length and first pressure."""
        opening, of = self.plant.circuit.opening(record.signal[0]), _pieces(record, math.inf)
        start = _beginnings(self.plant, of.inputs, of.step, record.time.size, opening)
        states = _simulated(self.plant, of.commands, start, of.step)
        return jax.tree.map(
            lambda first, later: np.concatenate([np.asarray(first), np.asarray(later)[0]]),
            start, states,
        )  # fmt: skip

    def plot(self, record: PlantRecord) -> Any:
        """Plot measured and predicted pressure and force against time; return the matplotlib figure."""
        from matplotlib.figure import Figure  # noqa: PLC0415 -- slow to import

        states, figure = self.predict(record), Figure(figsize=(8, 5), layout="constrained")
        rows = [("pressure, kPa", record.pressure / 1e3, states.pressure / 1e3)]
        if record.force is not None:
            rows.append(("force, N", record.force, states.force))
        axes = figure.subplots(2, len(rows), sharex=True, squeeze=False)
        for column, (label, measured, found) in zip(axes.T, rows, strict=True):
            column[0].plot(record.time, measured, ".", ms=2, label="measured")
            column[0].plot(record.time, found, lw=1, label="model")
            column[0].set_ylabel(label)
            column[1].plot(record.time, found - measured, lw=0.8)
            column[1].set(xlabel="time, s", ylabel=f"model - measured, {label.rpartition(' ')[2]}")
        axes[0, 0].legend(frameon=False)
        return figure


def identify_plant(
    records: PlantRecord | Sequence[PlantRecord], plant: Plant, *, free: Sequence[str] | None = None
) -> PlantFit:
    """Identify the parameters of a plant from records of pressure and force.

    The residuals of pressure and measured force, each divided by its RMS, are minimised by multiple
    shooting. The muscle model does not change: identify it beforehand with `identify`.

    Args:
        records: records of one muscle whose length is driven by a testing machine.
        plant: plant with a `DrivenLength`; its parameters are the initial guesses.
        free: names of the parameters to identify, which may belong to the circuit, the friction
            (`friction.share`) or the plant (`viscosity`). By default these are the parameters in `FREE`,
            plus the friction share and viscosity if force was measured while the length changed.

    Returns:
        The identified plant, with standard errors and warnings.

    Raises:
        InputError: there is no record, the plant has no `DrivenLength`, a name is unknown, or a record
            is sampled too slowly to determine the lag.
        RuntimeError: float64 is off.

    References:
        Bock 1983, Recent advances in parameter identification techniques for ODE: multiple shooting.
    """
    records = [records] if isinstance(records, PlantRecord) else list(records)
    check_float64()
    if not records or plant.load.moves:
        raise InputError(
            "a plant is identified from records of one muscle whose length is driven by a machine: pass "
            "a Plant with a DrivenLength, and at least one PlantRecord"
        )
    numbers = _numbers(plant)
    names = _free(plant, numbers, records, free)
    slow = max(records, key=lambda one: one.step)
    if "lag" in names and slow.step > 2 * float(plant.circuit.lag):
        raise InputError(
            f"{slow.name} is sampled every {slow.step * 1e3:.3g} ms, too slowly to determine a lag of "
            f"about {float(plant.circuit.lag) * 1e3:.3g} ms: sample faster, or omit lag from free"
        )
    declared = [numbers[name][0] for name in names]
    problem = _Shooting(plant, names, [_pieces(one) for one in records])
    scale = np.array([_scale(*numbers[name]) for name in names])
    low, high = (np.array([getattr(one, end) for one in declared]) for end in ("low", "high"))
    x, sigma = problem.first, problem.noise()
    begins = np.concatenate([one.pressure[:, 0] for one in problem.pieces])
    unknown = np.concatenate([x / scale, problem.openings, begins])
    whole, none = np.ones(len(records)), np.full(begins.size, np.inf)
    bounds = (
        np.concatenate([low / scale, -1.5 * whole, -none]),
        np.concatenate([high / scale, 1.5 * whole, none]),
    )
    size = np.concatenate([np.ones(len(names)), 0.1 * whole, np.full(begins.size, sigma[0])])
    inside = np.clip(unknown, bounds[0] + 1e-9 * size, bounds[1] - 1e-9 * size)
    found: Any = None
    for _ in range(3):  # reweight pressure and force
        found = least_squares(
            problem.residual, inside, jac=problem.jacobian,  # pyright: ignore[reportArgumentType]
            args=(scale, sigma), bounds=bounds, x_scale=size, xtol=1e-10, ftol=1e-12,
        )  # fmt: skip
        sigma, inside = problem.left(found.x, scale, sigma), found.x
    return _summary(problem, declared, found, scale, sigma, bounds)


def _numbers(plant: Plant) -> dict[str, tuple[Declared, float]]:
    """Return the declaration and value of every parameter of circuit, friction and plant, keyed by name."""
    found = {}
    for prefix, part in (("", plant.circuit), ("friction.", plant.friction)):
        if isinstance(part, Parametrised):
            values = part.parameters()
            found |= {prefix + n: (one, float(values[n])) for n, one in part.declared().items()}
    return found | {"viscosity": (plant.declared()["viscosity"], float(plant.viscosity))}


def _free(
    plant: Plant,
    known: Mapping[str, Any],
    records: Sequence[PlantRecord],
    free: Sequence[str] | None,
) -> tuple[str, ...]:
    """Return the names of the parameters to identify."""
    if free is None:
        free = FREE.get(type(plant.circuit), tuple(plant.circuit.declared()))
        if any(one.force is not None and np.ptp(one.length) > 0 for one in records):
            free = (*free, *(n for n in ("friction.share", "viscosity") if n in known))
    unknown = [name for name in free if name not in known]
    if unknown or not free:
        raise InputError(
            f"free must contain names of plant parameters, chosen from {', '.join(known)}; "
            f"got {', '.join(unknown) or 'none'}"
        )
    return tuple(free)


def _scale(declared: Declared, value: float) -> float:
    return abs(value) or (declared.high / 100 if math.isfinite(declared.high) else 1.0)


def _with(plant: Plant, names: Sequence[str], values: Sequence[Any]) -> Plant:
    """Return the plant with new values for some parameters."""
    given = dict(zip(names, values, strict=True))
    friction = {n.partition(".")[2]: given.pop(n) for n in [*given] if n.startswith("friction.")}
    if "viscosity" in given:
        plant = eqx.tree_at(lambda one: one.viscosity, plant, jnp.asarray(given.pop("viscosity")))
    if friction:
        made = plant.friction.with_parameters(friction)
        plant = eqx.tree_at(lambda one: one.friction, plant, made)
    return eqx.tree_at(lambda one: one.circuit, plant, plant.circuit.with_parameters(given))


class _Inputs(NamedTuple):
    """Columns of a record that drive a plant, shape (n,); pressure is used only for the initial states."""

    signal: Float[Array | np.ndarray, " n"]
    length: Float[Array | np.ndarray, " n"]
    pressure: Float[Array | np.ndarray, " n"]


class _Pieces(NamedTuple):
    """A record cut into m pieces: commands of shape (m, n), pressure and force of shape (m, n + 1)."""

    step: float
    inputs: _Inputs
    commands: Command
    pressure: Float[np.ndarray, "m n1"]
    force: Float[np.ndarray, "m n1"] | None


def _pieces(record: PlantRecord, seconds: float = 1.0) -> _Pieces:
    """Cut a record into pieces of equal length; samples left over at the end are dropped."""
    last, step = record.time.size - 1, record.step
    count = max(1, min(last, round(min(seconds / step, last))))
    at = np.arange(last // count)[:, None] * count + np.arange(count + 1)
    held, rate = at[:, :-1], np.diff(record.length) / step
    return _Pieces(
        step, _Inputs(record.signal, record.length, record.pressure),
        Command(record.signal[held], 0.0 * rate[held], rate[held]), record.pressure[at],
        None if record.force is None else record.force[at],
    )  # fmt: skip


def _beginnings(
    plant: Plant, inputs: _Inputs, step: float, every: int, opening: Real
) -> PlantState:
    """Return the state at the start of each piece, from the measured pressures; the leading axis is (m,).

    Openings and friction depend only on signal, length and pressure, so they are computed in one pass
    over the whole record.
    """
    first = plant.start(inputs.length[0], inputs.pressure[0])
    first = eqx.tree_at(lambda one: one.opening, first, jnp.asarray(opening))

    def onward(state: PlantState, at: Any) -> tuple[PlantState, PlantState]:
        signal, L, P = at
        openings, dumps = plant.actuators(state, Command(signal, 0.0 * signal))(step)
        memory = plant.moved(state.memory, L[None], P[None])
        force = plant.pulls(memory, L[None], P[None], jnp.zeros(1))[0]
        after = PlantState(P, openings[0], dumps[0], L, state.velocity, force, memory)
        return after, after

    before, after = (jax.tree.map(lambda leaf, cut=cut: jnp.asarray(leaf)[cut], inputs)
                     for cut in (slice(None, -1), slice(1, None)))  # fmt: skip
    columns = before.signal, after.length, after.pressure
    later = jax.lax.scan(onward, first, columns)[1]
    return jax.tree.map(
        lambda one, others: jnp.concatenate([one[None], others])[:-1:every], first, later
    )


@eqx.filter_jit
def _simulated(plant: Plant, commands: Command, start: PlantState, step: float) -> PlantState:
    """Return the states after every sample of the pieces, shape (m, n)."""
    substeps = max(1, round(step / TICK))

    def one(state: PlantState, command: Command) -> tuple[PlantState, PlantState]:
        def tick(_: Any, now: PlantState) -> PlantState:
            return plant.step(now, command, step / substeps)

        after = jax.lax.fori_loop(0, substeps, tick, state)
        return after, after

    return jax.vmap(lambda state, command: jax.lax.scan(one, state, command)[1])(start, commands)


@eqx.filter_jit
def _shot(
    plant: Plant,
    names: tuple[str, ...],
    inputs: _Inputs,
    commands: Command,
    step: float,
    numbers: Float[Array, " k"],
    opening: Float[Array, ""],
    first: Float[Array, " m"],
) -> tuple[Float[Array, "m 2 n"], Float[Array, "columns m 2 n"]]:
    """Return the pressures and forces along the pieces, with their derivatives.

    Args:
        plant: plant that supplies the fixed parameters.
        names: names of the parameters in `numbers`.
        inputs: columns of the whole record.
        commands: commands in each piece of the record, shape (m, n).
        step: time between samples [s].
        numbers: values of the free parameters [SI].
        opening: opening of the valve or pump at the start of the record.
        first: initial pressure [Pa] of each piece.

    Returns:
        (values, columns); the columns are derivatives with respect to the parameters, the opening, and
        the initial pressure of the same piece.
    """
    number, count = commands.signal.shape

    def of_all(at: Float[Array, " unknowns"]) -> Float[Array, "m 2 n"]:
        known = _with(plant, names, list(at[:-2]))
        start = _beginnings(known, inputs, step, count, at[-2])
        start = jax.tree.map(lambda leaf: leaf[:number], start)
        start = eqx.tree_at(lambda one: one.pressure, start, first + at[-1])
        states = _simulated(known, commands, start, step)
        return jnp.stack([states.pressure, states.force], axis=1)

    at = jnp.concatenate([numbers, jnp.stack([opening, jnp.zeros(())])])
    columns = jax.vmap(lambda way: jax.jvp(of_all, (at,), (way,))[1])(jnp.eye(at.size))
    return of_all(at), columns


class _Shooting:
    """Residuals of all pieces, with their derivatives."""

    def __init__(self, plant: Plant, names: tuple[str, ...], pieces: list[_Pieces]) -> None:
        self.plant, self.names, self.pieces = plant, names, pieces
        numbers = _numbers(plant)
        self.first = np.array([numbers[name][1] for name in names])
        self.openings = np.array(
            [float(plant.circuit.opening(one.inputs.signal[0])) for one in pieces]
        )
        self._last: tuple[bytes, list] = (b"", [])

    def noise(self) -> np.ndarray:
        """Return the standard deviations of pressure and force readings, based on second differences."""

        def of(values: list[np.ndarray]) -> float:
            second = np.concatenate([np.diff(one, 2, axis=1).ravel() for one in values])
            scatter = float(np.median(np.abs(second))) / 0.6745 / math.sqrt(6)
            spread = float(np.ptp(np.concatenate([one.ravel() for one in values])))
            return max(scatter, 1e-4 * max(spread, 1e-9))

        forces = [one.force for one in self.pieces if one.force is not None]
        return np.array([of([one.pressure for one in self.pieces]), of(forces) if forces else 1.0])

    def _parts(self, u: np.ndarray, scale: np.ndarray) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Return (kind, values, derivatives) of all residuals: 0 pressure, 1 force, 2 start, 3 jump."""
        key = u.tobytes() + scale.tobytes()
        if self._last[0] == key:
            return self._last[1]
        k, parts, place = len(self.names), [], len(self.names) + len(self.pieces)
        for r, of in enumerate(self.pieces):
            piece = np.arange(len(of.pressure))
            first, own = u[place + piece], np.eye(u.size)[place + piece]
            unknown = (jnp.asarray(one) for one in (u[:k] * scale, u[k + r], first))
            found = _shot(self.plant, self.names, of.inputs, of.commands, of.step, *unknown)
            values, columns = (np.asarray(one) for one in found)
            slope = np.zeros((*values.shape, u.size))
            slope[..., :k] = np.moveaxis(columns[:-2], 0, -1) * scale
            slope[..., k + r] = columns[-2]
            slope[piece, ..., place + piece] = columns[-1]
            parts += [
                (0, values[:, 0] - of.pressure[:, 1:], slope[:, 0]),
                (2, first[:1] - of.pressure[:1, 0], own[:1]),
                (3, values[:-1, 0, -1] - first[1:], slope[:-1, 0, -1] - own[1:]),
            ]
            if of.force is not None:
                parts.append((1, values[:, 1] - of.force[:, 1:], slope[:, 1]))
            place += piece.size
        self._last = key, parts
        return parts

    def residual(self, u: np.ndarray, scale: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Return model minus readings, and the jumps between pieces, in standard deviations."""
        std = [*sigma, sigma[0], sigma[0] / _JOINED]
        return np.concatenate([off.ravel() / std[kind] for kind, off, _ in self._parts(u, scale)])

    def jacobian(self, u: np.ndarray, scale: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Return the derivatives of the residual."""
        std = [*sigma, sigma[0], sigma[0] / _JOINED]
        return np.concatenate(
            [slope.reshape(-1, u.size) / std[kind] for kind, _, slope in self._parts(u, scale)]
        )

    def left(self, u: np.ndarray, scale: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Return the RMS residuals of pressure [Pa] and force [N]."""
        left = sigma.copy()
        for kind in (0, 1):
            off = [one.ravel() for of, one, _ in self._parts(u, scale) if of == kind]
            if off:
                left[kind] = math.sqrt(np.mean(np.concatenate(off) ** 2))
        return left


def _summary(
    problem: _Shooting,
    declared: Sequence[Declared],
    found: Any,
    scale: np.ndarray,
    sigma: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
) -> PlantFit:
    """Return the fit: estimates with standard errors, and warnings."""
    k, names = len(problem.names), problem.names
    values = found.x[:k] * scale
    near = 1e-6 * np.maximum(np.abs(found.x[:k]), 1e-3)
    at_bound = (found.x[:k] - bounds[0][:k] < near) | (bounds[1][:k] - found.x[:k] < near)
    J = problem.jacobian(found.x, scale, sigma)
    kept = np.concatenate([~at_bound, np.ones(found.x.size - k, bool)])
    Q = J[:, kept]
    size = np.linalg.norm(Q, axis=0)
    size[size == 0] = 1.0
    inner = np.linalg.pinv(Q / size)
    whole = (inner @ inner.T) / np.outer(size, size)
    free = int((~at_bound).sum())
    covariance = np.full((k, k), np.nan)
    at = np.flatnonzero(~at_bound)
    covariance[np.ix_(at, at)] = whole[:free, :free] * np.outer(scale[at], scale[at])
    errors = np.sqrt(np.diag(covariance))
    estimates = tuple(
        PlantEstimate(n, str(one.unit), float(v), float(e), bool(b))
        for n, one, v, e, b in zip(names, declared, values, errors, at_bound, strict=True)
    )
    warnings = [f"{one.name} is at a limit of its range" for one in estimates if one.at_bound]
    warnings += [
        f"the records barely determine {one.name}: {one.value:.3g} +- {one.stderr:.2g} {one.unit}".rstrip()
        for one in estimates if one.stderr > 0.5 * abs(one.value)
    ]  # fmt: skip
    correlation = covariance / np.outer(errors, errors)
    warnings += [
        f"{names[i]} and {names[j]} cannot be separated (correlation {correlation[i, j]:+.3f})"
        for i in range(k) for j in range(i) if abs(correlation[i, j]) > 0.98
    ]  # fmt: skip
    plant = _with(problem.plant, names, [float(one) for one in values])
    widest = max(
        float(np.max(np.abs(np.asarray(plant.circuit.opening(one.inputs.signal)))))
        for one in problem.pieces
    )
    if widest < 0.5:
        warnings.append(
            f"the valve or pump never exceeded {widest:.0%} of full output: use larger signals"
        )
    forces = any(one.force is not None for one in problem.pieces)
    return PlantFit(
        plant, estimates, covariance, float(sigma[0]), float(sigma[1]) if forces else math.nan,
        tuple(warnings),
    )  # fmt: skip
