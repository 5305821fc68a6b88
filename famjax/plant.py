"""Dynamics: pressure through a valve or from a pump, friction, what the muscle moves, and a controller.

A circuit is a lumped volume of one pressure. Of the fluid that it holds, and of the momentum that the
muscle moves, a step advances

    d/dt [(V(L, P) + V_dead) w(P)] = Q(P) w(P),    I dv/dt = sum r F - k (q - q_0) - c v + W

with w the fluid's density against the present one. Fluid is conserved to rounding, and no derivative of
the volume is asked for.
"""

import abc
import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int

from ._arrays import Given, Real, RealArray, as_number, as_real, compiled
from .boundary.errors import InputError, import_extra
from .compile_options import quick_options
from .muscle import AbstractMuscle
from .parameters import Declared, Parametrised, number, parameter
from .units import INCH, LBF, PSI

ATMOSPHERE = 101325.0  # ambient pressure [Pa], absolute
ANR_PRESSURE = 1e5  # of the reference atmosphere in which ISO 6358 states volume flow [Pa]
SLOW_FLOW = 0.05  # pressure drop over upstream pressure below which the flow is a cubic
LAMINAR = 20.0  # Pa: an orifice's flow is as of sqrt(P) well above it, and linear well below
CRACKING = 1e3  # Pa: a relief valve begins to open about as much below its pressure
TICK = 2e-3  # of the device's controller [s]
_GAMMA = 1 - math.sqrt(0.5)  # of the stages
_MOST_STEPS = 30  # of Newton's method
_BAR = 1e5  # Pa, scale of a pressure


def choked_share(drop: Real, critical_ratio: Real) -> RealArray:
    """Ratio of an orifice's flow to its choked flow, per ISO 6358; odd and smooth through zero.

        psi = 1 up to the critical ratio b of r = p_2/p_1, sqrt(1 - ((r - b)/(1 - b))^2) above it

    Above r = 0.95, where the slope of the ellipse grows beyond all bounds, psi is the odd cubic of the
    drop 1 - r that meets it with its slope: 10 % below it at r = 0.97, 45 % at 0.99.

    Args:
        drop: (p_1 - p_2) over the larger of the absolute pressures, negative for a flow from 2 to 1.
        critical_ratio: b [-], between 0 and 0.95.

    Returns:
        psi, from -1 to 1, broadcast shape.

    References:
        ISO 6358-1:2013, equations 1 and 2.

    >>> print(f"{choked_share(0.6, 0.3):.3f} {choked_share(-0.8, 0.3):.0f}")
    0.990 -1
    """
    size, width = jnp.abs(drop), 1 - critical_ratio
    last = 1 - SLOW_FLOW / width
    joint = jnp.sqrt(1 - last**2)
    secant, slope = joint / SLOW_FLOW, last / (width * joint)
    bend = 0.5 * (slope - secant) / SLOW_FLOW**2
    slow = drop * (secant + bend * (drop**2 - SLOW_FLOW**2))
    x = jnp.clip(1 - size / width, 0.0, last)
    return jnp.where(size < SLOW_FLOW, slow, jnp.sign(drop) * jnp.sqrt(1 - x**2))


class AbstractCircuit(Parametrised):
    """What a muscle is filled and vented by: an actuator with a lag, a dump valve, a dead volume.

    Attributes:
        lag: time constant [s] of the actuator.
        dump_lag: time constant [s] of the dump valve's opening and closing.
        dead_volume: of hose and fittings [m3].
    """

    lag: eqx.AbstractVar[RealArray]
    dump_lag: eqx.AbstractVar[RealArray]
    dead_volume: eqx.AbstractVar[RealArray]

    def __check_init__(self) -> None:
        """Refuse numbers that are not finite or below their range."""
        for field in dataclasses.fields(self):
            value, spec = getattr(self, field.name), field.metadata.get("quantity")
            if not isinstance(spec, Declared) or value is None or isinstance(value, Tracer):
                continue
            if jnp.ndim(value) == 0 and not (spec.low <= (got := float(value)) < math.inf):
                unit = f" {spec.unit}" if spec.unit else ""
                raise InputError(
                    f"{field.name} must be finite and at least {spec.low:g}{unit}, got {got:g}"
                )

    @abc.abstractmethod
    def opening(self, signal: Real) -> RealArray:
        """Where the actuator goes at a signal, 0 to 1 of the full output."""

    @abc.abstractmethod
    def flow(self, pressure: Real, opening: Real, dump: Real) -> RealArray:
        """Flow Q [m3/s] into the muscle, measured at its pressure.

        Args:
            pressure: gauge pressure P [Pa] in the muscle.
            opening: of the actuator.
            dump: opening of the dump valve, 0 to 1.
        """

    @abc.abstractmethod
    def density(self, pressure: Real, reference: Real) -> RealArray:
        """Density of the fluid at a gauge pressure [Pa] over that at another."""

    def pressure(self, root: RealArray) -> RealArray:
        """The gauge pressure [Pa] of the unknown in which a step is solved."""
        return root

    def root(self, pressure: Real) -> RealArray:
        """The unknown of a gauge pressure [Pa]: the inverse of `pressure`."""
        return as_real(pressure)


class PneumaticCircuit(AbstractCircuit):
    """Air through a 5/3 proportional valve: fills above the bias, vents below it, leaks at it.

        p_N C p_1 psi(p_2/p_1) from the supply and to the atmosphere, either way; p V^n constant

    Neglected: the gas's temperature (polytropic exponent n), the hose's resistance and waves, and the
    valve's own dynamics but for a lag.

    Attributes:
        supply: gauge pressure [Pa] (Chambers 2021, section 3.2: 115 psi).
        conductance: sonic conductance C [m3/(s Pa)] of the open valve; ASSUMED, 100 normal litres a
            minute from 6 to 5 bar gauge.
        critical_ratio: b [-]; ASSUMED.
        bias: signal at which the valve is closed (2.5 V of 0 to 5 V, chapter 3).
        dead_band: signal to either side of the bias that opens nothing; ASSUMED.
        leak: part of C that stays open to supply and to atmosphere; ASSUMED.
        lag: time constant [s] of the spool; ASSUMED.
        exponent: polytropic n [-], between isothermal 1 and adiabatic 1.4; ASSUMED.
        dead_volume: of hose and fittings [m3]; ASSUMED.
        dump_conductance: C [m3/(s Pa)] of the open dump valve; ASSUMED.
        dump_lag: time constant [s] of its opening and closing; ASSUMED.
        atmosphere: absolute pressure [Pa].

    References:
        ISO 6358-1:2013, equations 1 and 2.
    """

    supply: Float[Given, ""] = parameter("Pa", low=0.0, high=1e6, default=115 * PSI)
    conductance: Float[Given, ""] = parameter("m3/(s Pa)", low=0.0, high=1e-7, default=3.9e-9)
    critical_ratio: Float[Given, ""] = parameter(low=0.05, high=0.6, default=0.3)
    bias: Float[Given, ""] = parameter(low=0.2, high=0.8, default=128 / 255)
    dead_band: Float[Given, ""] = parameter(low=0.0, high=0.1, default=3 / 255)
    leak: Float[Given, ""] = parameter(low=0.0, high=0.1, default=0.004)
    lag: Float[Given, ""] = parameter("s", low=1e-4, high=0.5, default=0.012)
    exponent: Float[Given, ""] = parameter(low=1.0, high=1.4, default=1.2)
    dead_volume: Float[Given, ""] = parameter("m3", low=0.0, high=1e-3, default=5e-6)
    dump_conductance: Float[Given, ""] = parameter("m3/(s Pa)", low=0.0, high=1e-7, default=8e-9)
    dump_lag: Float[Given, ""] = parameter("s", low=1e-4, high=0.5, default=0.015)
    atmosphere: Float[Given, ""] = number("Pa", default=ATMOSPHERE)

    def opening(self, signal: Real) -> RealArray:
        """Where the spool goes, from -1 (vent) to 1 (fill)."""
        above = signal - self.bias
        beyond = jnp.maximum(jnp.abs(above) - self.dead_band, 0.0)
        whole = jnp.where(above > 0, 1 - self.bias, self.bias)
        return jnp.sign(above) * beyond / (whole - self.dead_band)

    def flow(self, pressure: Real, opening: Real, dump: Real) -> RealArray:
        """Flow Q [m3/s] into the muscle, measured at its pressure."""
        p = pressure + self.atmosphere
        filling = self.leak + jnp.maximum(opening, 0.0)
        venting = self.leak + jnp.maximum(-opening, 0.0)
        vents = self.conductance * venting + self.dump_conductance * dump
        p_in, p_out = self.supply + self.atmosphere, self.atmosphere
        high, above = jnp.maximum(p_in, p), jnp.maximum(p, p_out)
        enters = high * choked_share((p_in - p) / high, self.critical_ratio)
        leaves = above * choked_share((p - p_out) / above, self.critical_ratio)
        return ANR_PRESSURE * (self.conductance * filling * enters - vents * leaves) / p

    def density(self, pressure: Real, reference: Real) -> RealArray:
        """(p/p_0)^(1/n), of absolute pressures: what p V^n constant leaves of the volume's inverse."""
        p, p_0 = pressure + self.atmosphere, reference + self.atmosphere
        return jnp.exp(jnp.log(p / p_0) / self.exponent)


class HydraulicCircuit(AbstractCircuit):
    """Water from a gear pump, out through a needle valve: speed sets flow, flow sets pressure.

        Q = D w - K u - G P_c log(1 + exp((P - P_r)/P_c)),    P = u sqrt(u^2 + P_l)

    u is the square root of P, well above P_l = 20 Pa, and linear in it below, where flow is laminar:
    0.1 % off at 5 kPa. The relief valve cracks over P_c = 1 kPa; a thousandth of that flow is left
    7 P_c below P_r, G (P - P_r) as far above it. Neglected: inertia of the water, leakage inside the
    pump (it lets nothing back), and the pressure in the return line.

    Attributes:
        displacement: of the pump, D [m3/rev]; ASSUMED.
        full_speed: [rev/s] at the full signal (chapter 3: 5000 rpm).
        lag: time constant [s] of the pump; ASSUMED.
        needle: K [m3/(s Pa^0.5)]; 0 is a blocked needle. ASSUMED: 80 % of full speed holds 100 psi.
        bulk_modulus: beta [Pa] of water, hose and bladder with some air; ASSUMED.
        dead_volume: of hose and fittings [m3]; ASSUMED.
        relief: gauge pressure [Pa] at which the relief valve opens (chapter 3: 110 psi); None
            where there is none. No software takes its place.
        relief_conductance: its flow over the pressure in excess [m3/(s Pa)]; ASSUMED.
        dump: K [m3/(s Pa^0.5)] of the open dump valve; 0 where there is none; ASSUMED.
        dump_lag: time constant [s] of its opening and closing; ASSUMED.
    """

    displacement: Float[Given, ""] = parameter("m3", low=0.0, high=1e-5, default=0.8e-6)
    full_speed: Float[Given, ""] = parameter("1/s", low=0.0, high=500.0, default=5000 / 60)
    lag: Float[Given, ""] = parameter("s", low=1e-4, high=1.0, default=0.1)
    needle: Float[Given, ""] = parameter(
        "m3/(s Pa^0.5)", low=0.0, high=1e-6, default=0.8 * 0.8e-6 * 5000 / 60 / math.sqrt(100 * PSI)
    )
    bulk_modulus: Float[Given, ""] = parameter("Pa", low=1e6, high=2.2e9, default=35e6)
    dead_volume: Float[Given, ""] = parameter("m3", low=0.0, high=1e-3, default=20e-6)
    relief: Float[Given, ""] | None = parameter("Pa", low=0.0, high=2e6, default=110 * PSI)
    relief_conductance: Float[Given, ""] = parameter("m3/(s Pa)", low=0.0, high=1e-7, default=2e-9)
    dump: Float[Given, ""] = parameter("m3/(s Pa^0.5)", low=0.0, high=1e-5, default=4e-7)
    dump_lag: Float[Given, ""] = parameter("s", low=1e-4, high=0.5, default=0.015)

    def opening(self, signal: Real) -> RealArray:
        """The speed of the pump, 0 to 1 of its full speed."""
        return as_real(signal)

    def flow(self, pressure: Real, opening: Real, dump: Real) -> RealArray:
        """Flow Q [m3/s] into the muscle."""
        leaves = (self.needle + self.dump * dump) * self.root(pressure)
        if self.relief is not None:
            over = jax.nn.softplus((pressure - self.relief) / CRACKING)
            leaves += self.relief_conductance * CRACKING * over
        return self.displacement * self.full_speed * opening - leaves

    def density(self, pressure: Real, reference: Real) -> RealArray:
        """exp((P - P_0)/beta)."""
        return jnp.exp((pressure - reference) / self.bulk_modulus)

    def pressure(self, root: RealArray) -> RealArray:
        """P [Pa] of its square root u, signed."""
        return root * jnp.sqrt(root**2 + LAMINAR)

    def root(self, pressure: Real) -> RealArray:
        """The signed square root u of P [Pa]."""
        P = as_real(pressure)
        return P * jnp.sqrt(2 / (LAMINAR + jnp.sqrt(LAMINAR**2 + 4 * P**2)))

    def steady_signal(self, pressure: float) -> float:
        """The signal whose flow the needle passes at a gauge pressure [Pa]."""
        full = self.displacement * self.full_speed
        return float(self.needle * self.root(pressure) / full)


# --- friction


class AbstractFriction(Parametrised):
    """What the way by which a muscle came adds to its pull; it does not depend on the rate."""

    @abc.abstractmethod
    def start(self, length: Real, pressure: Real) -> Any:
        """Initial state of a history that starts at a length [m] and a gauge pressure [Pa]."""

    @abc.abstractmethod
    def moved(self, state: Any, length: Real, pressure: Real) -> Any:
        """The state after a motion to a length and a pressure that does not turn round."""

    @abc.abstractmethod
    def added(self, state: Any, length: Real, pressure: Real, force: Real) -> RealArray:
        """What is added to the static pull [N] in a state at that length, pressure and pull."""


class DahlFriction(AbstractFriction):
    """Dahl's friction: F_f = (F_c + f |F|) z,  dz/dL = (sign(dL) - z)/travel.

    Attributes:
        share: f [-], of the pull; ASSUMED where it is not measured.
        dry: F_c [N], without a pull.
        travel: [m] of motion over which the friction turns round after a reversal; ASSUMED.

    References:
        Dahl 1968, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1.
    """

    share: Float[Given, ""] = parameter(low=0.0, high=0.3, default=0.02)
    dry: Float[Given, ""] = parameter("N", low=0.0, high=1e3, default=0.0)
    travel: Float[Given, ""] = parameter("m", low=1e-6, high=0.05, default=2e-4)

    def start(self, length: Real, pressure: Real) -> Float[Array, "2"]:  # noqa: ARG002
        """Length [m], and z = 0."""
        return jnp.stack([as_real(length), jnp.zeros_like(as_real(length))])

    def moved(self, state: Float[Array, "2"], length: Real, pressure: Real) -> Float[Array, "2"]:  # noqa: ARG002
        """Length [m] and z after a motion."""
        way = length - state[0]
        towards = jnp.sign(way)
        z = towards + (state[1] - towards) * jnp.exp(-jnp.abs(way) / self.travel)
        return jnp.stack([as_real(length), z])

    def added(
        self,
        state: Float[Array, "2"],
        length: Real,  # noqa: ARG002
        pressure: Real,  # noqa: ARG002
        force: Real,
    ) -> RealArray:
        """F_f [N], positive after the muscle was lengthened."""
        return (self.dry + self.share * jnp.abs(force)) * state[1]


class SlipFriction(AbstractFriction):
    """Slip elements, such as a `famjax.slip.MaxwellSlip` or the `CentredSlip` of a fitted hysteresis.

    Neglected: the little volume that they take up.

    Attributes:
        elements: an object with `start`, `moved` and `added`, such as `famjax.slip.MaxwellSlip`.
    """

    elements: Any

    def start(self, length: Real, pressure: Real) -> Any:
        """The state of the elements."""
        return self.elements.start(length, pressure)

    def moved(self, state: Any, length: Real, pressure: Real) -> Any:
        """The state of the elements after a motion."""
        return self.elements.moved(state, length, pressure)

    def added(self, state: Any, length: Real, pressure: Real, force: Real) -> RealArray:  # noqa: ARG002
        """The elements' part of the pull [N]."""
        return self.elements.added(state, length, pressure)


# --- what a muscle moves


class DrivenLength(eqx.Module):
    """A machine that holds the muscle, or moves it at the rate dL/dt [m/s] of the command."""

    moves = False

    def lengths(self, position: RealArray) -> Float[Array, "1"]:
        """The position is the active length L [m]."""
        return position[None]

    def acceleration(
        self, position: RealArray, velocity: RealArray, pulls: Float[Array, " n"], drive: RealArray
    ) -> RealArray:
        """None: the machine is rigid."""
        del position, pulls, drive
        return jnp.zeros_like(velocity)


class MovingLoad(Parametrised):
    """A mass that one muscle lifts, or a joint that two turn against each other.

        I dv/dt = sum r F - k (q - q_0) - c v + W + drive,    L = M - r q

    `hung` makes the one, `joint` the other. Neglected: the muscle's own mass, and friction in the
    bearing but for c.

    Attributes:
        inertia: I [kg], or [kg m2] of a joint.
        radius: r of each muscle, moment arms [m] of a joint, positive where a pull raises q, shape (n,).
        middle: M, active length [m] of each muscle at q = 0, shape (n,).
        stiffness: k of a spring [N/m], or [N m/rad].
        relaxed: q_0, where the spring is relaxed.
        damping: c [N s/m], or [N m s/rad].
        weight: W [N], or [N m], a constant force that raises q.
    """

    inertia: Float[Given, ""] = parameter("kg", low=1e-6, high=1e4)
    radius: Float[Given, " n"] = number("m")
    middle: Float[Given, " n"] = number("m")
    stiffness: Float[Given, ""] = parameter("N/m", low=0.0, high=1e7, default=0.0)
    relaxed: Float[Given, ""] = number("m", default=0.0)
    damping: Float[Given, ""] = parameter("N s/m", low=0.0, high=1e5, default=0.0)
    weight: Float[Given, ""] = parameter("N", low=-1e5, high=1e5, default=0.0)

    moves = True

    @classmethod
    def hung(
        cls, mass: Real, *, gravity: Real = 9.80665, stiffness: Real = 0.0, relaxed: Real = 0.0,
        damping: Real = 0.0,
    ) -> "MovingLoad":  # fmt: skip
        """A mass [kg] that hangs on one muscle, with a spring that pulls it to a length `relaxed` [m]."""
        weight = as_real(mass) * gravity
        return cls(mass, [-1.0], [0.0], stiffness, relaxed, damping, weight)

    @classmethod
    def joint(
        cls,
        inertia: Real,
        *,
        radii: Real,
        lengths: Real,
        stiffness: Real = 0.0,
        damping: Real = 0.0,
    ) -> "MovingLoad":
        """A joint of two muscles over pulleys of radii r > 0 > r [m], of lengths [m] at angle 0."""
        return cls(inertia, radii, lengths, stiffness, 0.0, damping)

    def lengths(self, position: RealArray) -> Float[Array, " n"]:
        """Active length L [m] of each muscle."""
        return self.middle - self.radius * position

    def acceleration(
        self, position: RealArray, velocity: RealArray, pulls: Float[Array, " n"], drive: RealArray
    ) -> RealArray:
        """dv/dt [m/s2], or [rad/s2], under the pulls [N] and an outer force [N] or torque [N m]."""
        spring = self.stiffness * (position - self.relaxed) + self.damping * velocity
        return (jnp.sum(self.radius * pulls) - spring + self.weight + drive) / self.inertia


# --- the plant


class Command(eqx.Module):
    """What is commanded during a step, or during each of n steps along a leading axis.

    Attributes:
        signal: of valve or pump, 0 to 1 of the full output; one for each of two muscles, shape (2,).
            Of a `Regulated` plant it is the set pressure [Pa].
        dump: 1 where the dump valve is open, else 0; as the signal.
        drive: rate dL/dt [m/s] of a `DrivenLength`, outer force [N] or torque [N m] on a `MovingLoad`.
    """

    signal: RealArray = eqx.field(converter=as_number)
    dump: RealArray = eqx.field(converter=as_number, default=0.0)
    drive: RealArray = eqx.field(converter=as_number, default=0.0)


class PlantState(eqx.Module):
    """State of a plant, and what one measures of it; arrays of two muscles have the shape (2,).

    Attributes:
        pressure: gauge pressure P [Pa] of each muscle.
        opening: of the actuator, see `AbstractCircuit.opening`.
        dump: opening of the dump valve, 0 to 1.
        position: q, of one muscle that is driven or lifts a mass its active length L [m].
        velocity: dq/dt.
        force: pull [N] of each muscle, friction included.
        memory: states of the friction.
    """

    pressure: RealArray
    opening: RealArray
    dump: RealArray
    position: RealArray
    velocity: RealArray
    force: RealArray
    memory: tuple[Any, ...]


class Plant(Parametrised):
    """One muscle with its circuit and what it moves, or two that turn a joint.

    A step is a two-stage diagonally implicit rule of second order, L-stable (Alexander 1977), in the
    fluid and the momentum; lags and driven lengths are exact. The signal is constant in a step. At
    2 ms it is within 0.005 psi of an adaptive solution in the root mean square; water that is dumped
    arrives at zero within 0.05 psi, and where a relief valve closes a tick is 0.1 psi off.
    Neglected: the pressure drop between circuit and muscle, and the muscle's own mass.

    Attributes:
        circuit: of the muscle; a tuple of two for a joint.
        muscle: with `force(length, pressure)` and `volume(length, pressure)`; a tuple of two.
        load: what is moved.
        friction: of the muscle, or None; a tuple of two.
        viscosity: loss [N s/m] in proportion to dL/dt.

    References:
        Alexander 1977, SIAM Journal on Numerical Analysis 14(6), 1006-1021: the rule.

    >>> plant = Plant(PneumaticCircuit(), LinearMcKibben())
    >>> states = simulate(plant, Command(jnp.full(100, 0.7)), TICK)  # 0.2 s of 3.5 V
    >>> print(f"{states.pressure[-1] / PSI:.1f} psi, {states.force[-1] / LBF:.0f} lbf")
    46.1 psi, 460 lbf
    """

    circuit: Any
    muscle: Any
    load: Any = DrivenLength()
    friction: Any = None
    viscosity: Float[Given, ""] = parameter("N s/m", low=0.0, high=1e5, default=0.0)

    def __check_init__(self) -> None:
        """Refuse parts that do not go together."""
        n = len(self._each(self.muscle))
        arms = self.load.radius.size if self.load.moves else 1
        if {len(self._each(self.circuit)), len(self._frictions), arms} != {n}:
            raise InputError(
                "a plant has a circuit, a moment arm and a friction or None for each muscle; two muscles "
                f"need a MovingLoad.joint. Got {n} muscles and {arms} moment arms"
            )

    @staticmethod
    def _each(part: Any) -> tuple[Any, ...]:
        return part if isinstance(part, tuple) else (part,)

    @property
    def _frictions(self) -> tuple[AbstractFriction | None, ...]:
        if self.friction is None:
            return (None,) * len(self._each(self.muscle))
        return self._each(self.friction)

    def start(self, position: Real | None = None, pressure: Real = 0.0) -> PlantState:
        """The plant at rest, valves and pump at rest too.

        Args:
            position: q; by default the rest length of one muscle, or angle 0.
            pressure: gauge pressure [Pa] of each muscle.

        Raises:
            InputError: the muscle has no volume there.
        """
        single = not isinstance(self.muscle, tuple)
        shape = () if single else (len(self.muscle),)
        rest = self.muscle.rest_length if single else 0.0
        q = as_real(rest if position is None else position)
        P = jnp.broadcast_to(as_real(pressure), shape) + 0 * q
        none = jnp.zeros_like(P)
        lengths, pressures = self.load.lengths(q), P.reshape(-1)
        fluid = self._fluid(lengths, pressures, pressures)
        if not isinstance(fluid, Tracer) and not bool(jnp.all(fluid > 0)):
            raise InputError(
                f"the muscle must hold fluid where the plant starts, at {lengths} m and {pressures} Pa; "
                f"with its hose it holds {fluid} m3: give a length within its range, or another muscle"
            )
        memory = tuple(
            None if one is None else one.start(L, own)
            for one, L, own in zip(self._frictions, lengths, pressures, strict=True)
        )
        forces = self.pulls(memory, lengths, pressures, jnp.zeros_like(lengths))
        return PlantState(P, none, none, q, jnp.zeros_like(q), forces.reshape(shape), memory)

    def step(self, state: PlantState, command: Command, dt: Real) -> PlantState:
        """The state a time dt [s] later, 2 ms for example, under a constant command."""
        shape, driven, moves = state.pressure.shape, as_real(command.drive), self.load.moves
        before, q0 = state.pressure.reshape(-1), state.position
        v0, n, h = state.velocity if moves else driven, before.size, _GAMMA * dt
        actuators = self.actuators(state, command)

        def stage(time: Real, fluid: RealArray, q: RealArray, v: RealArray, guess: RealArray):
            """What solves a stage, from the explicit parts of fluid, q and v."""
            openings, dumps = actuators(time)

            def at(z: RealArray) -> tuple[RealArray, RealArray, RealArray]:
                pressures = self._from_roots(z[:n])
                return (q + h * z[n], z[n], pressures) if moves else (q, driven, pressures)

            def residual(z: RealArray) -> RealArray:
                position, speed, pressures = at(z)
                lengths = self.load.lengths(position)
                flows = self._flows(pressures, openings, dumps) * self._densities(pressures, before)
                left = self._fluid(lengths, pressures, before) - h * flows - fluid
                if not moves:
                    return left
                memory = self.moved(state.memory, lengths, pressures)
                pulls = self.pulls(memory, lengths, pressures, self._rates(speed))
                gained = h * self.load.acceleration(position, speed, pulls, driven)
                return jnp.append(left, speed - v - gained)

            z = newton(residual, guess)
            return z, *at(z)

        on = (1 - _GAMMA) / _GAMMA
        held, roots = self._fluid(self.load.lengths(q0), before, before), self._roots(before)
        guess = jnp.append(roots, v0) if moves else roots
        z, q1, v1, P1 = stage(h, held, q0 if moves else q0 + h * v0, v0, guess)
        fluid = held + on * (self._fluid(self.load.lengths(q1), P1, before) - held)
        q2 = q0 + ((1 - _GAMMA) * v1 if moves else v1) * dt
        _, q, v, P = stage(dt, fluid, q2, v0 + on * (v1 - v0), z)
        openings, dumps = (one.reshape(shape) for one in actuators(dt))
        lengths = self.load.lengths(q)
        memory = self.moved(state.memory, lengths, P)
        force = self.pulls(memory, lengths, P, self._rates(v)).reshape(shape)
        return PlantState(P.reshape(shape), openings, dumps, q, v, force, memory)

    def actuators(self, state: PlantState, command: Command) -> Callable[[Real], Any]:
        """Openings of actuators and dump valves, which follow a constant command with their lags.

        Args:
            state: where they begin.
            command: of valves or pumps, and of dump valves.

        Returns:
            A function of the time [s] since the state: both openings [-], shapes (n,).
        """
        circuits, shape = self._each(self.circuit), state.pressure.shape
        signals, wanted = (
            jnp.broadcast_to(one, shape).reshape(-1) for one in (command.signal, command.dump)
        )
        goals = jnp.stack([c.opening(s) for c, s in zip(circuits, signals, strict=True)])
        lags, dump_lags = (
            jnp.stack([getattr(c, name) for c in circuits]) for name in ("lag", "dump_lag")
        )
        behind, dump_behind = state.opening.reshape(-1) - goals, state.dump.reshape(-1) - wanted
        return lambda time: (
            goals + behind * jnp.exp(-time / lags),
            wanted + dump_behind * jnp.exp(-time / dump_lags),
        )

    def _of_circuits(self, method: str, *each: RealArray) -> RealArray:
        parts = zip(self._each(self.circuit), *each, strict=True)
        return jnp.stack([getattr(circuit, method)(*own) for circuit, *own in parts])

    def _from_roots(self, roots: RealArray) -> RealArray:
        return self._of_circuits("pressure", roots)

    def _roots(self, pressures: RealArray) -> RealArray:
        return self._of_circuits("root", pressures)

    def _flows(self, pressures: RealArray, openings: RealArray, dumps: RealArray) -> RealArray:
        return self._of_circuits("flow", pressures, openings, dumps)

    def _densities(self, pressures: RealArray, before: RealArray) -> RealArray:
        return self._of_circuits("density", pressures, before)

    def _fluid(self, lengths: RealArray, pressures: RealArray, before: RealArray) -> RealArray:
        """Fluid [m3] in each muscle and its hose, at its density at the pressures `before`."""
        each = zip(
            self._each(self.circuit), self._each(self.muscle), lengths, pressures, strict=True
        )
        volumes = jnp.stack([m.volume(L, P) + c.dead_volume for c, m, L, P in each])
        return volumes * self._densities(pressures, before)

    def _rates(self, speed: RealArray) -> RealArray:
        """dL/dt [m/s] of each muscle."""
        return -self.load.radius * speed if self.load.moves else speed[None]

    def moved(self, memory: Sequence[Any], lengths: RealArray, pressures: RealArray) -> tuple:
        """The states of the friction after a motion that does not turn round.

        Args:
            memory: states before it, one of each muscle.
            lengths: active lengths L [m] after it, shape (n,).
            pressures: gauge pressures P [Pa] after it, shape (n,).
        """
        each = zip(self._frictions, memory, lengths, pressures, strict=True)
        return tuple(None if f is None else f.moved(one, L, P) for f, one, L, P in each)

    def pulls(
        self, memory: Sequence[Any], lengths: RealArray, pressures: RealArray, rates: RealArray
    ) -> RealArray:
        """Pull [N] of each muscle with friction and viscous loss, shape (n,).

        Args:
            memory: states of the friction, one of each muscle.
            lengths: active lengths L [m], shape (n,).
            pressures: gauge pressures P [Pa], shape (n,).
            rates: dL/dt [m/s], shape (n,).
        """
        parts = self._each(self.muscle), self._frictions, memory
        pulls = []
        for m, f, one, L, P in zip(*parts, lengths, pressures, strict=True):
            F = m.force(L, P)
            pulls.append(F if f is None else F + f.added(one, L, P, F))
        return jnp.stack(pulls) + self.viscosity * rates


def newton(residual: Callable[[RealArray], RealArray], guess: RealArray) -> RealArray:
    """The root of a few equations by Newton's method, with implicit derivatives of any order.

    Args:
        residual: r(z), of shape (n,).
        guess: where the search begins, shape (n,).

    Returns:
        z: what the last step leaves is of the order of its square.
    """

    def matrix(function: Callable[[RealArray], RealArray], z: RealArray) -> RealArray:
        columns = [jax.jvp(function, (z,), (one,))[1] for one in jnp.eye(z.size, dtype=z.dtype)]
        return jnp.stack(columns, axis=1)

    def solve(function: Callable[[RealArray], RealArray], z: RealArray) -> RealArray:
        enough = float(jnp.finfo(z.dtype).eps) ** 0.5

        def goes_on(at: tuple[RealArray, RealArray, Array]) -> Array:
            return (at[1] > enough) & (at[2] < _MOST_STEPS)

        def better(at: tuple[RealArray, RealArray, Array]) -> tuple[RealArray, RealArray, Array]:
            z, _, count = at
            step = linear_solve(matrix(function, z), function(z))
            size = jnp.max(jnp.abs(step) / (jnp.abs(z) + 1.0))
            return z - step, size, count + 1

        start = z, jnp.full((), jnp.inf, z.dtype), jnp.array(0)
        return jax.lax.while_loop(goes_on, better, start)[0]

    def tangent(linear: Callable[[RealArray], RealArray], value: RealArray) -> RealArray:
        return linear_solve(matrix(linear, jnp.zeros_like(value)), value)

    return jax.lax.custom_root(residual, jax.lax.stop_gradient(guess), solve, tangent)


def linear_solve(matrix: Float[Array, "n n"], value: Float[Array, " n"]) -> Float[Array, " n"]:
    """The x of A x = b for a few unknowns, by elimination without pivots: no call of LAPACK."""
    n = value.size
    A, b = [[matrix[i, j] for j in range(n)] for i in range(n)], [value[i] for i in range(n)]
    for k in range(n):
        for i in range(k + 1, n):
            factor = A[i][k] / A[k][k]
            A[i] = [a - factor * top for a, top in zip(A[i], A[k], strict=True)]
            b[i] = b[i] - factor * b[k]
    for k in reversed(range(n)):
        b[k] = (b[k] - sum(A[k][j] * b[j] for j in range(k + 1, n))) / A[k][k]
    return jnp.stack(b)


def simulate(plant: Any, commands: Command, dt: Real, *, start: Any = None) -> Any:
    """The states at the ends of n steps, by `jax.lax.scan`.

    Args:
        plant: a `Plant`, or a `Regulated` one.
        commands: leaves of shape (n,), (n, 2) for the signals of two muscles, or () for what is
            constant.
        dt: of a step [s].
        start: state before the first step; `plant.start()` if omitted.

    Returns:
        The states, each leaf with a leading axis (n,). Differentiable in every number of the plant,
        in the commands and in the start.

    Raises:
        InputError: all commands are constant, or they are not of one length.
    """
    leaves = jax.tree.leaves(commands)
    counts = {leaf.shape[0] for leaf in leaves if leaf.ndim}
    if len(counts) != 1:
        raise InputError(
            f"commands need one value for each step, as many in signal, dump and drive; got {counts}"
        )
    return _simulated(plant, commands, as_real(dt), plant.start() if start is None else start)


@compiled
def _simulated(plant: Any, commands: Command, dt: RealArray, start: Any) -> Any:
    (count,) = {leaf.shape[0] for leaf in jax.tree.leaves(commands) if leaf.ndim}
    each = jax.tree.map(lambda x: x if x.ndim else jnp.broadcast_to(x, (count,)), commands)

    def step(state: Any, command: Command) -> tuple[Any, Any]:
        after = plant.step(state, command, dt)
        return after, after

    return jax.lax.scan(step, start, each)[1]


class SteppedPlant:
    """A plant of one driven muscle, advanced tick by tick in plain numbers, as a simulated device needs it.

    A tick is one program of two small arrays: all plants of one structure share it.

    Args:
        plant: with a `DrivenLength`.
        dt: of a tick [s].

    Attributes:
        plant: may be replaced in operation, as by one with a blocked needle.
        pressure: gauge pressure P [Pa] in the muscle.
        force: pull [N], friction included.
        length: active length L [m].
    """

    def __init__(self, plant: Plant, dt: float) -> None:
        self.dt, self.plant = dt, plant
        state = plant.start()
        self.pressure, self.force = float(state.pressure), float(state.force)
        self.length = float(state.position)
        self._rest = ravel_pytree((state.opening, state.dump, state.memory))[0].tolist()

    @property
    def plant(self) -> Plant:
        """The plant."""
        return self._plant

    @plant.setter
    def plant(self, plant: Plant) -> None:
        self._plant = plant
        arrays, static = eqx.partition(plant, eqx.is_array)
        shapes = tuple(leaf.shape for leaf in jax.tree.leaves(arrays))
        self._tick = _tick(jax.tree.structure(arrays), shapes, static)
        self._numbers = ravel_pytree(arrays)[0]

    def step(self, signal: float, dump: float | bool, length: float) -> None:
        """Advance by a tick, in which the machine brings the muscle to a length [m]."""
        drive = (length - self.length) / self.dt
        row = [self.dt, signal, dump, drive, self.length, self.pressure, *self._rest]
        self.length = length
        self.pressure, self.force, *self._rest = np.asarray(
            self._tick(self._numbers, np.array(row))
        ).tolist()


@functools.lru_cache(maxsize=16)
def _tick(structure: Any, shapes: tuple[tuple[int, ...], ...], static: Any) -> Callable[..., Array]:
    """The program of a tick for plants of one structure: numbers and row to pressure, force, rest."""
    ends = np.cumsum([math.prod(shape) for shape in shapes])

    def tick(numbers: RealArray, row: RealArray) -> RealArray:
        parts = jnp.split(numbers, ends[:-1])
        leaves = [one.reshape(shape) for one, shape in zip(parts, shapes, strict=True)]
        plant: Plant = eqx.combine(jax.tree.unflatten(structure, leaves), static)
        dt, signal, dump, drive, length, pressure = row[:6]
        start = plant.start(length, pressure)
        opening, shut, memory = ravel_pytree((start.opening, start.dump, start.memory))[1](row[6:])
        at = PlantState(pressure, opening, shut, length, drive, start.force, memory)
        after = plant.step(at, Command(signal, dump, drive), dt)
        rest = ravel_pytree((after.opening, after.dump, after.memory))[0]
        return jnp.concatenate([jnp.stack([after.pressure, after.force]), rest])

    return jax.jit(tick, compiler_options=quick_options())


def solve_adaptively(
    plant: Plant, state: PlantState, command: Command, times: Real, *, tolerance: float = 1e-9
) -> PlantState:
    """The states at given times under one command, by an implicit rule of fifth order of diffrax.

    The friction is that of a motion without reversals. Requires the extra `dynamics`.

    Args:
        plant: what `Plant.step` advances.
        state: at time 0.
        command: constant.
        times: [s], rising, shape (n,).
        tolerance: of each step, relative, and of 1 bar, 1 m and 1 m/s.

    Returns:
        The states, each leaf with a leading axis (n,).
    """
    diffrax: Any = import_extra("diffrax", "dynamics")

    actuators, driven = plant.actuators(state, command), as_real(command.drive)
    count, moves = state.pressure.size, plant.load.moves

    def parts(y: RealArray) -> tuple[RealArray, RealArray, RealArray]:
        return y[:count] * _BAR, y[count], y[count + 1] if moves else driven

    def rate(time: Any, y: Any, _: None) -> RealArray:
        P, q, v = parts(y)
        one, zero = jnp.ones_like(P), jnp.zeros_like(P)
        lengths, rates = plant.load.lengths(q), plant._rates(v)
        fluid = functools.partial(plant._fluid, before=P)
        swept = jax.jvp(fluid, (lengths, P), (rates, zero))[1]
        capacity = jax.jvp(fluid, (lengths, P), (zero, one))[1]
        rise = (plant._flows(P, *actuators(time)) - swept) / capacity
        pulls = plant.pulls(plant.moved(state.memory, lengths, P), lengths, P, rates)
        gained = plant.load.acceleration(q, v, pulls, driven)
        return jnp.concatenate([rise / _BAR, jnp.stack([v, gained])])

    start = jnp.stack([state.position, state.velocity])
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rate), diffrax.Kvaerno5(), 0.0, as_real(times)[-1], None,
        jnp.concatenate([state.pressure.reshape(-1) / _BAR, start]),
        saveat=diffrax.SaveAt(ts=as_real(times)), max_steps=None,
        stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
    )  # fmt: skip

    def seen(time: RealArray, y: Any) -> PlantState:
        P, q, v = parts(y)
        shape, lengths = state.pressure.shape, plant.load.lengths(q)
        openings, dumps = (one.reshape(shape) for one in actuators(time))
        memory = plant.moved(state.memory, lengths, P)
        force = plant.pulls(memory, lengths, P, plant._rates(v)).reshape(shape)
        return PlantState(P.reshape(shape), openings, dumps, q, v, force, memory)

    return jax.vmap(seen)(as_real(times), solution.ys)


# --- the controller


class ControllerState(eqx.Module):
    """State of a `PressureController`.

    Attributes:
        integral: I, part of the full output.
        total: sum of the errors [Pa] over the ticks of the present record.
        phase: ticks of the present record that have passed.
    """

    integral: RealArray
    total: RealArray
    phase: Int[Array, ""]


class PressureController(Parametrised):
    """PI with feed-forward, as the device's firmware: u = v(P) + K_p e + I, dI/dt = K_i e.

    The integral is advanced at the end of each record. Neglected: the steps of the converter and of
    the output, and readings further than 256 psi away.

    Attributes:
        proportional: K_p [1/Pa], part of the full output.
        integral: K_i [1/(Pa s)].
        feed_forward: coefficients of v(P), rising powers of the set pressure [Pa], shape (k,).
        low, high: limits of I.
        ticks: of a record.

    References:
        Chambers 2021, section 3.2.
    """

    proportional: Float[Given, ""] = parameter("1/Pa", low=0.0, high=1e-4)
    integral: Float[Given, ""] = parameter("1/(Pa s)", low=0.0, high=1e-3)
    feed_forward: Float[Given, " k"] = eqx.field(converter=as_number, default=(128 / 255,))
    low: Float[Given, ""] = number(default=-128 / 255)
    high: Float[Given, ""] = number(default=128 / 255)
    ticks: int = eqx.field(static=True, default=5)

    def start(self) -> ControllerState:
        """The state after a start."""
        none = jnp.zeros_like(self.proportional)
        return ControllerState(none, none, jnp.array(0))

    def step(
        self, state: ControllerState, set_pressure: Real, pressure: Real, dt: Real
    ) -> tuple[ControllerState, RealArray]:
        """The state after a tick that reads a pressure, and the signal from then on.

        Args:
            state: before.
            set_pressure: gauge pressure [Pa].
            pressure: gauge pressure [Pa] that is measured.
            dt: of a tick [s].
        """
        error = as_real(set_pressure - pressure)
        total, phase = state.total + error, state.phase + 1
        ends = phase == self.ticks
        wound = jnp.clip(state.integral + self.integral * total * dt, self.low, self.high)
        integral = jnp.where(ends, wound, state.integral)
        held = functools.reduce(lambda sum_, c: sum_ * set_pressure + c, self.feed_forward[::-1])
        signal = jnp.clip(held + self.proportional * error + integral, 0.0, 1.0)
        after = ControllerState(integral, jnp.where(ends, 0.0, total), jnp.where(ends, 0, phase))
        return after, signal


class RegulatedState(eqx.Module):
    """State of a `Regulated` plant.

    Attributes:
        plant: the plant's.
        controller: the controller's.
        signal: the output, 0 to 1, that the next step begins with.
    """

    plant: PlantState
    controller: ControllerState
    signal: RealArray


class Regulated(Parametrised):
    """A plant of one muscle whose pressure is controlled; `Command.signal` is the set pressure [Pa].

    Attributes:
        plant: of one muscle.
        controller: reads the true pressure at the end of each step.
    """

    plant: Plant
    controller: PressureController

    def start(self, position: Real | None = None, pressure: Real = 0.0) -> RegulatedState:
        """The plant at rest, with the output off."""
        at = self.plant.start(position, pressure)
        return RegulatedState(at, self.controller.start(), jnp.zeros_like(at.pressure))

    def step(self, state: RegulatedState, command: Command, dt: Real) -> RegulatedState:
        """The plant's step under the present output, then a tick of the controller."""
        own = Command(state.signal, command.dump, command.drive)
        after = self.plant.step(state.plant, own, dt)
        controller, signal = self.controller.step(
            state.controller, command.signal, after.pressure, dt
        )
        return RegulatedState(after, controller, signal)


# --- a muscle for rigs


class LinearMcKibben(AbstractMuscle):
    """A muscle of an inelastic braid and a linear bladder, for a rig without a muscle model.

        V = (B^2 L - L^3)/(4 pi N^2) - V_solid,  F = max(P - P_d, 0)(3 L^2 - B^2)/(4 pi N^2) - k (L0 - L)

    The defaults are the reference work's 7/8 in muscle; stiffness and deadband were chosen to come
    within 5 % of its printed blocked force, and within 0.03 of its free contraction from 40 psi.

    Attributes:
        rest_length: L0 [m].
        thread_length: B [m].
        turns: N of one thread.
        solid_volume: of bladder and braid [m3], in which there is no fluid.
        bladder_stiffness: k [N/m]; ASSUMED.
        deadband_pressure: P_d [Pa]; ASSUMED.

    References:
        Chambers 2021, tables 6.11 and 6.12.
    """

    rest_length: Float[Given, ""] = parameter("m", low=0.0, default=9.28125 * INCH)
    thread_length: Float[Given, ""] = parameter("m", low=0.0, default=9.89 * INCH)
    turns: Float[Given, ""] = parameter(low=0.0, default=1.09)
    solid_volume: Float[Given, ""] = parameter("m3", low=0.0, default=1.754 * INCH**3)
    bladder_stiffness: Float[Given, ""] = parameter("N/m", low=0.0, default=22.6 * LBF / INCH)
    deadband_pressure: Float[Given, ""] = parameter("Pa", low=0.0, default=3.3 * PSI)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N], broadcast shape."""
        area = (3 * as_real(length) ** 2 - self.thread_length**2) / self._four
        spring = self.bladder_stiffness * (self.rest_length - length)
        return jnp.maximum(pressure - self.deadband_pressure, 0.0) * area - spring

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, broadcast shape."""
        L = as_real(length) + jnp.zeros_like(as_real(pressure))
        return (self.thread_length**2 * L - L**3) / self._four - self.solid_volume

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just beyond the neutral angle to 2 % above L0, or half way to the threads' length."""
        longest = (self.rest_length + self.thread_length) / 2
        neutral = self.thread_length / math.sqrt(3)
        return 0.95 * neutral, jnp.minimum(1.02 * self.rest_length, longest)

    @property
    def _four(self) -> RealArray:
        return 4 * jnp.pi * self.turns**2
