"""The numbers of a plant, identified from records of valve, pressure and force by multiple shooting.

A record is cut into pieces of equal length. The pressure at which each begins is an unknown, held to the
end of the piece before it, and so is the actuator's opening at the beginning of the record. Later openings
and the friction follow from the record's own signal and length.
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
from famjax.parameters import Declared
from famjax.plant import TICK, Command, HydraulicCircuit, Plant, PlantState, PneumaticCircuit

_PIECE = 1.0  # s, of multiple shooting
_JOINED = 30.0  # weight of a pressure's jump between pieces, in standard deviations of a reading
_ROUNDS = 3  # of weighing pressure and force by what is left
_TOGETHER = 0.98  # correlation beyond which two numbers cannot be separated
_UNTOLD = 0.5  # standard error over the value
_ABSOLUTE = 85e3, 110e3  # Pa: a least pressure between these is hardly a gauge pressure
FREE: Mapping[type, tuple[str, ...]] = {
    PneumaticCircuit: ("conductance", "critical_ratio", "lag", "leak", "dead_volume"),
    HydraulicCircuit: ("displacement", "needle", "lag", "bulk_modulus"),
}
"""Numbers of a circuit that a record tells, unless others are named."""


@dataclasses.dataclass(frozen=True)
class PlantRecord:
    """A test of one muscle on a machine, sampled at equal steps.

    Attributes:
        time: [s], rising, shape (n,).
        signal: to valve or pump, 0 to 1 of the full output, held from each sample to the next.
        pressure: gauge pressure P [Pa], measured.
        length: active length L [m].
        force: pull F [N], measured; None where it was not.
        dump: 1 where the dump valve was open; never unless given.
        name: for messages.
    """

    time: Float[np.ndarray, " n"]
    signal: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"] | None = None
    dump: Float[np.ndarray, " n"] | None = None
    name: str = "record"

    def __post_init__(self) -> None:
        """Refuse what is no record of a plant.

        Raises:
            InputError: columns of different lengths, times that are not equal steps, values that are not
                finite, a signal beyond 0 to 1 or that never changes, an absolute pressure.
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
                    f"{self.name}: {name} must be finite, one value for each of {columns['time'].size} "
                    "times: cut the record to where all of its columns are known"
                )
        steps = np.diff(self.time)
        if steps.size < 20 or not (steps > 0).all() or np.ptp(steps) > 0.5 * np.median(steps):
            raise InputError(
                f"{self.name}: times must rise in equal steps, at least 20 of them; got steps of "
                f"{steps.min(initial=0):.3g} to {steps.max(initial=0):.3g} s: resample the record"
            )
        if self.signal.min() < 0 or self.signal.max() > 1 or np.ptp(self.signal) == 0:
            raise InputError(
                f"{self.name}: the signal to valve or pump must lie in 0 to 1 of the full output and "
                f"change; got {self.signal.min():g} to {self.signal.max():g}. A set pressure is no "
                "signal: record the controller's output"
            )
        if _ABSOLUTE[0] < self.pressure.min() < _ABSOLUTE[1]:
            raise InputError(
                f"{self.name}: the least pressure is {self.pressure.min() / 1e3:.4g} kPa, that of the "
                "atmosphere: subtract it, as pressures are gauge pressures, or begin with a vented muscle"
            )

    @property
    def step(self) -> float:
        """Mean time [s] between samples."""
        return float(self.time[-1] - self.time[0]) / (self.time.size - 1)

    def part(self, start: int, end: int) -> "PlantRecord":
        """The samples from one place to another."""
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
    """A number of a plant.

    Attributes:
        name, unit: of the number.
        value: in SI.
        stderr: standard error; nan at a bound.
        at_bound: whether it lies at an end of its range.
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
        plant: with the numbers that were found.
        estimates: of the free numbers.
        covariance: of the same.
        pressure_rms, force_rms: what is left [Pa], [N]; nan without forces.
        warnings: what the records do not tell.
    """

    plant: Plant
    estimates: tuple[PlantEstimate, ...]
    covariance: Float[np.ndarray, "k k"]
    pressure_rms: float
    force_rms: float
    warnings: tuple[str, ...]

    def predict(self, record: PlantRecord) -> PlantState:
        """The states at the samples of a record, from its signal, its length and its first pressure."""
        opening = self.plant.circuit.opening(record.signal[0])
        start = _beginnings(self.plant, _inputs(record), record.step, record.time.size, opening)
        commands = jax.tree.map(lambda leaf: leaf[None], _commands(record))
        states = _run(self.plant, commands, start, record.step)
        return jax.tree.map(
            lambda first, later: np.concatenate([np.asarray(first), np.asarray(later)[0]]),
            start, states,
        )  # fmt: skip

    def plot(self, record: PlantRecord) -> Any:
        """Measured and predicted pressure and force against time, a matplotlib figure."""
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
    records: PlantRecord | Sequence[PlantRecord],
    plant: Plant,
    *,
    free: Sequence[str] | None = None,
) -> PlantFit:
    """The numbers of a plant that explain records of pressure and force best.

    Least squares of the pressure, and of the force where it was measured, each against what is left
    of it, by multiple shooting. The muscle's own law and geometry are held: identify them by `identify`.

    Args:
        records: of one muscle, with the machine driving its length.
        plant: circuit, muscle and friction as far as they are known, with `DrivenLength`.
        free: names of numbers of circuit, friction (`friction.share`) and plant (`viscosity`) to be found;
            those of `FREE`, the friction's share and the viscosity unless given.

    Returns:
        The plant with standard errors, and what the records do not tell.

    Raises:
        InputError: no plant of one driven muscle, an unknown name, a record that is sampled slower than
            the lag, or float32.

    References:
        Bock 1983, Recent advances in parameter identification techniques for ODE: multiple shooting.
    """
    records = [records] if isinstance(records, PlantRecord) else list(records)
    if not jax.config.read("jax_enable_x64"):
        raise InputError(
            'a plant is identified in float64: jax.config.update("jax_enable_x64", True)'
        )
    if not records or plant.load.moves:
        raise InputError(
            "a plant is identified from records of one muscle whose length a machine drives: give a "
            "Plant with a DrivenLength, and at least one PlantRecord"
        )
    declared = _declared(plant)
    names = _free(plant, declared, records, free)
    slow = max(records, key=lambda one: one.step)
    if "lag" in names and slow.step > 2 * float(plant.circuit.lag):
        raise InputError(
            f"{slow.name} is sampled every {slow.step * 1e3:.3g} ms, too slowly to determine a "
            "lag of about "
            f"{float(plant.circuit.lag) * 1e3:.3g} ms: record faster, or leave lag out of free"
        )
    problem = _Shooting(plant, names, [_pieces(one) for one in records])
    scale = np.array([_scale(declared[n], v) for n, v in zip(names, problem.first, strict=True)])
    low, high = (np.array([getattr(declared[n], end) for n in names]) for end in ("low", "high"))
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
    for _ in range(_ROUNDS):
        found = least_squares(
            problem.residual, inside, jac=problem.jacobian,  # pyright: ignore[reportArgumentType]
            args=(scale, sigma), bounds=bounds, x_scale=size, xtol=1e-10, ftol=1e-12,
        )  # fmt: skip
        sigma, inside = problem.left(found.x, scale, sigma), found.x
    return _summary(problem, declared, found, scale, sigma, bounds)


def _declared(plant: Plant) -> dict[str, Declared]:
    """Every number of circuit, friction and plant, by name."""
    own = {n: d for n, d in plant.declared().items() if n == "viscosity"}
    friction = {} if plant.friction is None else plant.friction.declared()
    return {**plant.circuit.declared(), **{f"friction.{n}": d for n, d in friction.items()}, **own}


def _free(
    plant: Plant,
    declared: Mapping[str, Declared],
    records: Sequence[PlantRecord],
    free: Sequence[str] | None,
) -> tuple[str, ...]:
    """The names of what is searched."""
    if free is None:
        free = FREE.get(type(plant.circuit), tuple(plant.circuit.declared()))
        if any(one.force is not None and np.ptp(one.length) > 0 for one in records):
            free = (*free, *(n for n in ("friction.share", "viscosity") if n in declared))
    unknown = [name for name in free if name not in declared]
    if unknown or not free:
        raise InputError(
            f"free must name numbers of the plant: {', '.join(declared)}; "
            f"got {', '.join(unknown) or 'none'}"
        )
    return tuple(free)


def _scale(declared: Declared, value: float) -> float:
    return abs(value) or (declared.high / 100 if math.isfinite(declared.high) else 1.0)


def _with(plant: Plant, names: Sequence[str], values: Sequence[Any]) -> Plant:
    """The plant with other numbers."""
    given = dict(zip(names, values, strict=True))
    friction = {n.partition(".")[2]: given.pop(n) for n in [*given] if n.startswith("friction.")}
    if "viscosity" in given:
        plant = eqx.tree_at(lambda one: one.viscosity, plant, jnp.asarray(given.pop("viscosity")))
    if friction:
        made = plant.friction.with_parameters(friction)
        plant = eqx.tree_at(lambda one: one.friction, plant, made)
    return eqx.tree_at(lambda one: one.circuit, plant, plant.circuit.with_parameters(given))


def _commands(record: PlantRecord) -> Command:
    """Signal, dump and rate from each sample to the next, shape (n - 1,)."""
    signal, dump, length, _ = _inputs(record)
    return Command(signal[:-1], dump[:-1], np.diff(length) / record.step)


def _inputs(record: PlantRecord) -> "_Inputs":
    dump = np.zeros_like(record.signal) if record.dump is None else record.dump
    return _Inputs(record.signal, dump, record.length, record.pressure)


class _Inputs(NamedTuple):
    """Columns of a record that a plant is given, shape (n,); the pressure is where pieces begin."""

    signal: Float[Array | np.ndarray, " n"]
    dump: Float[Array | np.ndarray, " n"]
    length: Float[Array | np.ndarray, " n"]
    pressure: Float[Array | np.ndarray, " n"]


def _pieces(record: PlantRecord) -> "_Pieces":
    """The record as pieces of one length; what is left at its end is not used."""
    count = max(1, min(record.time.size - 1, round(_PIECE / record.step)))
    number = (record.time.size - 1) // count
    commands = jax.tree.map(
        lambda leaf: leaf[: number * count].reshape(number, count), _commands(record)
    )

    def cut(values: np.ndarray) -> np.ndarray:
        places = np.arange(number)[:, None] * count + np.arange(count + 1)
        return values[places]

    force = None if record.force is None else cut(record.force)
    return _Pieces(record, commands, cut(record.pressure), force)


@dataclasses.dataclass(frozen=True)
class _Pieces:
    """A record in pieces: commands (m, n), pressure and force (m, n + 1)."""

    record: PlantRecord
    commands: Command
    pressure: Float[np.ndarray, "m n1"]
    force: Float[np.ndarray, "m n1"] | None


def _beginnings(
    plant: Plant, inputs: _Inputs, step: float, every: int, opening: Real
) -> PlantState:
    """The states in which pieces begin, with the measured pressures; leading axis (m,).

    Openings and friction depend on signal, length and pressure alone: they follow through the whole record.
    """
    first = plant.start(inputs.length[0], inputs.pressure[0])
    first = eqx.tree_at(lambda one: one.opening, first, jnp.asarray(opening))

    def onward(state: PlantState, at: Any) -> tuple[PlantState, PlantState]:
        signal, dump, L, P = at
        openings, dumps = plant.actuators(state, Command(signal, dump))(step)
        memory = plant.moved(state.memory, L[None], P[None])
        force = plant.pulls(memory, L[None], P[None], jnp.zeros(1))[0]
        after = PlantState(P, openings[0], dumps[0], L, state.velocity, force, memory)
        return after, after

    before, after = (jax.tree.map(lambda leaf, cut=cut: jnp.asarray(leaf)[cut], inputs)
                     for cut in (slice(None, -1), slice(1, None)))  # fmt: skip
    columns = before.signal, before.dump, after.length, after.pressure
    later = jax.lax.scan(onward, first, columns)[1]
    return jax.tree.map(
        lambda one, others: jnp.concatenate([one[None], others])[:-1:every], first, later
    )


def _simulated(plant: Plant, commands: Command, start: PlantState, step: float) -> PlantState:
    """The states after every sample of the pieces, shape (m, n)."""
    substeps = max(1, round(step / TICK))

    def one(state: PlantState, command: Command) -> tuple[PlantState, PlantState]:
        def tick(_: Any, now: PlantState) -> PlantState:
            return plant.step(now, command, step / substeps)

        after = jax.lax.fori_loop(0, substeps, tick, state)
        return after, after

    return jax.vmap(lambda state, command: jax.lax.scan(one, state, command)[1])(start, commands)


_run = eqx.filter_jit(_simulated)


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
    """Pressures and forces of the pieces, and their derivatives.

    Args:
        plant: whose other numbers are held.
        names: of `numbers`.
        inputs: of the whole record.
        commands: of its pieces, shape (m, n).
        step: between samples [s].
        numbers: of the plant [SI].
        opening: of the actuator where the record begins.
        first: pressure [Pa] at which each piece begins.

    Returns:
        (values, columns): derivatives in the numbers, in the opening, and in the piece's own pressure.
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
    """Residuals of all pieces and their derivatives."""

    def __init__(self, plant: Plant, names: tuple[str, ...], pieces: list[_Pieces]) -> None:
        self.plant, self.names, self.pieces = plant, names, pieces
        values = _declared_values(plant)
        openings = [plant.circuit.opening(one.record.signal[0]) for one in pieces]
        self.first = np.array([float(values[name]) for name in names])
        self.openings = np.array([float(one) for one in openings])
        self._last: tuple[bytes, list] = (b"", [])

    def noise(self) -> np.ndarray:
        """Standard deviations of a reading of pressure and force, by what changes from one to the next."""

        def of(values: list[np.ndarray]) -> float:
            second = np.concatenate([np.diff(one, 2, axis=1).ravel() for one in values])
            scatter = float(np.median(np.abs(second))) / 0.6745 / math.sqrt(6)
            return max(
                scatter,
                1e-4 * max(float(np.ptp(np.concatenate([v.ravel() for v in values]))), 1e-9),
            )

        forces = [one.force for one in self.pieces if one.force is not None]
        return np.array([of([one.pressure for one in self.pieces]), of(forces) if forces else 1.0])

    def _states(
        self, u: np.ndarray, scale: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        key = u.tobytes() + scale.tobytes()
        if self._last[0] == key:
            return self._last[1]
        k, found, place = len(self.names), [], len(self.names) + len(self.pieces)
        for r, of in enumerate(self.pieces):
            first = u[place : place + of.pressure.shape[0]]
            place += first.size
            unknown = (jnp.asarray(one) for one in (u[:k] * scale, u[k + r], first))
            values, columns = _shot(
                self.plant, self.names, _inputs(of.record), of.commands, of.record.step, *unknown
            )
            found.append((first, np.asarray(values), np.asarray(columns)))
        self._last = key, found
        return found

    def residual(self, u: np.ndarray, scale: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Readings against the model and jumps between pieces, in standard deviations."""
        return self._rows(u, scale, sigma)[0]

    def jacobian(self, u: np.ndarray, scale: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Derivatives of the residual."""
        return self._rows(u, scale, sigma)[1]

    def _rows(
        self, u: np.ndarray, scale: np.ndarray, sigma: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        k, rows, jacobians, place = len(self.names), [], [], len(self.names) + len(self.pieces)
        each = zip(self.pieces, self._states(u, scale), strict=True)
        for r, (of, (first, values, columns)) in enumerate(each):
            number = first.size
            kinds = [(0, of.pressure[:, 1:])] + ([] if of.force is None else [(1, of.force[:, 1:])])
            for kind, measured in kinds:
                rows.append(((values[:, kind] - measured) / sigma[kind]).ravel())
                own = np.zeros((number, measured.shape[1], u.size))
                own[:, :, :k] = np.moveaxis(columns[:-2, :, kind], 0, -1) * scale
                own[:, :, k + r] = columns[-2, :, kind]
                for m in range(number):
                    own[m, :, place + m] = columns[-1, m, kind]
                jacobians.append(own.reshape(-1, u.size) / sigma[kind])
            rows.append((first - of.pressure[:, 0]) / sigma[0])
            began = np.zeros((number, u.size))
            began[np.arange(number), place + np.arange(number)] = 1 / sigma[0]
            # The reading at a border is that of the piece before it, too.
            rows[-1][1:], began[1:] = 0.0, 0.0
            jacobians.append(began)
            jumps = _JOINED / sigma[0] * (values[:-1, 0, -1] - first[1:])
            leaps = np.zeros((number - 1, u.size))
            leaps[:, :k] = np.moveaxis(columns[:-2, :-1, 0, -1], 0, -1) * scale
            leaps[:, k + r] = columns[-2, :-1, 0, -1]
            for m in range(number - 1):
                leaps[m, place + m], leaps[m, place + m + 1] = columns[-1, m, 0, -1], -1.0
            rows.append(jumps)
            jacobians.append(leaps * _JOINED / sigma[0])
            place += number
        return np.concatenate(rows), np.concatenate(jacobians)

    def left(self, u: np.ndarray, scale: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Root mean squares of what is left of pressure and force."""
        off: list[list[np.ndarray]] = [[], []]
        for of, (_, values, _) in zip(self.pieces, self._states(u, scale), strict=True):
            off[0].append((values[:, 0] - of.pressure[:, 1:]).ravel())
            if of.force is not None:
                off[1].append((values[:, 1] - of.force[:, 1:]).ravel())
        return np.array([
            math.sqrt(np.mean(np.concatenate(one) ** 2)) if one else before
            for one, before in zip(off, sigma, strict=True)
        ])  # fmt: skip


def _declared_values(plant: Plant) -> dict[str, Any]:
    friction = {} if plant.friction is None else plant.friction.parameters()
    return {
        **plant.circuit.parameters(), **{f"friction.{n}": v for n, v in friction.items()},
        "viscosity": plant.viscosity,
    }  # fmt: skip


def _summary(
    problem: _Shooting,
    declared: Mapping[str, Declared],
    found: Any,
    scale: np.ndarray,
    sigma: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
) -> PlantFit:
    """Estimates with standard errors, and what the records do not tell."""
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
    places = np.flatnonzero(~at_bound)
    covariance[np.ix_(places, places)] = whole[:free, :free] * np.outer(
        scale[places], scale[places]
    )
    errors = np.sqrt(np.diag(covariance))
    estimates = tuple(
        PlantEstimate(n, str(declared[n].unit), float(v), float(e), bool(b))
        for n, v, e, b in zip(names, values, errors, at_bound, strict=True)
    )
    warnings = [f"{one.name} lies at an end of its range" for one in estimates if one.at_bound]
    warnings += [
        f"the records hardly determine {one.name}: {one.value:.3g} +- {one.stderr:.2g} {one.unit}".rstrip()
        for one in estimates if one.stderr > _UNTOLD * abs(one.value)
    ]  # fmt: skip
    correlation = covariance / np.outer(errors, errors)
    warnings += [
        f"{names[i]} and {names[j]} cannot be separated (correlation {correlation[i, j]:+.3f})"
        for i in range(k) for j in range(i) if abs(correlation[i, j]) > _TOGETHER
    ]  # fmt: skip
    plant = _with(problem.plant, names, [float(one) for one in values])
    widest = max(
        float(np.max(np.abs(np.asarray(plant.circuit.opening(one.record.signal)))))
        for one in problem.pieces
    )
    if widest < 0.5:
        warnings.append(f"the valve never opened fully (at most {widest:.0%}): drive it further")
    forces = any(one.force is not None for one in problem.pieces)
    return PlantFit(
        plant, estimates, covariance, float(sigma[0]), float(sigma[1]) if forces else math.nan,
        tuple(warnings),
    )  # fmt: skip
