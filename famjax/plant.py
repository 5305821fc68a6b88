"""Dynamic models: fluid circuits, friction, loads and a pressure controller.

A circuit is a lumped volume at one pressure. Each step advances its fluid and the momentum of the load:

    d/dt [(V(L, P) + V_dead) w(P)] = Q(P) w(P),    I dv/dt = sum r F - k (q - q_0) - c v + W

Here w is the density of the fluid, divided by its density at the beginning of the step. Fluid is
conserved to within rounding, and no derivative of the volume is needed.
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
ANR_PRESSURE = 1e5  # reference atmosphere of volume flow in ISO 6358 [Pa]
SLOW_FLOW = 0.05  # relative pressure drop below which the flow is a cubic
LAMINAR = 20.0  # Pa: orifice flow is proportional to sqrt(P) well above it, and linear well below
CRACKING = 1e3  # Pa: range of pressure over which a relief valve opens
TICK = 2e-3  # period of the device's controller [s]
_GAMMA = 1 - math.sqrt(0.5)  # coefficient of the stages
_MOST_STEPS = 30  # limit of Newton's method
_INNER = 3600  # bytes of states and commands in an inner loop of a simulation, at most
_BAR = 1e5  # Pa, scale of a pressure


def choked_share(drop: Real, critical_ratio: Real) -> RealArray:
    """Return the ratio of an orifice's flow to its choked flow (ISO 6358); odd and smooth at zero drop.

        psi = 1 up to the critical ratio b of r = p_2/p_1, sqrt(1 - ((r - b)/(1 - b))^2) above it

    Above r = 0.95, the slope of the ellipse grows without limit. In this range, psi is the odd cubic in the
    drop 1 - r that has the same value and slope at r = 0.95. The cubic is 10 % below the ellipse at
    r = 0.97 and 45 % below it at r = 0.99.

    Args:
        drop: (p_1 - p_2) divided by the larger absolute pressure; negative for flow from 2 to 1.
        critical_ratio: b [-], between 0 and 0.95.

    Returns:
        psi, from -1 to 1, with the broadcast shape.

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
    """The fluid supply of a muscle: a valve or pump with a lag, a dump valve and a dead volume.

    Attributes:
        lag: time constant [s] of the actuator, which is the valve or the pump.
        dump_lag: time constant [s] of the dump valve.
        dead_volume: volume [m3] of hose and fittings.
    """

    lag: eqx.AbstractVar[RealArray]
    dump_lag: eqx.AbstractVar[RealArray]
    dead_volume: eqx.AbstractVar[RealArray]

    def __check_init__(self) -> None:
        """Reject numbers that are infinite, nan or below their range."""
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
        """Return the position that the actuator finally reaches at a constant signal from 0 to 1."""

    @abc.abstractmethod
    def flow(self, pressure: Real, opening: Real, dump: Real) -> RealArray:
        """Return the volume flow Q [m3/s] into the muscle, at the pressure in the muscle.

        Args:
            pressure: gauge pressure P [Pa] in the muscle.
            opening: position of the actuator, see `opening`.
            dump: opening of the dump valve, 0 to 1.
        """

    @abc.abstractmethod
    def density(self, pressure: Real, reference: Real) -> RealArray:
        """Return the fluid's density at a gauge pressure [Pa], divided by that at a reference pressure."""

    def pressure(self, root: RealArray) -> RealArray:
        """Return the gauge pressure [Pa] for a value of the variable that a step solves for."""
        return root

    def root(self, pressure: Real) -> RealArray:
        """Return the variable that a step solves for, at a gauge pressure [Pa]; inverts `pressure`."""
        return as_real(pressure)


class PneumaticCircuit(AbstractCircuit):
    """Air supply with a 5/3 proportional valve: it fills above the bias, vents below it and always leaks.

        Q = p_N C p_1 psi(p_2/p_1)/p from the supply and to the atmosphere, in either direction;
        p V^n = const.

    The gas temperature enters only through the polytropic exponent n. Hose resistance, pressure waves and
    valve dynamics other than a lag are neglected.

    Attributes:
        supply: gauge pressure [Pa] of the supply (Chambers 2021, section 3.2: 115 psi).
        conductance: sonic conductance C [m3/(s Pa)] of the fully open valve; ASSUMED, 100 normal litres
            per minute from 6 to 5 bar gauge.
        critical_ratio: critical pressure ratio b [-]; ASSUMED.
        bias: signal at which the valve is closed (chapter 3: 2.5 V in the range from 0 to 5 V).
        dead_band: signal change on either side of the bias that has no effect; ASSUMED.
        leak: fraction of C that is always open to the supply and to the atmosphere; ASSUMED.
        lag: time constant [s] of the spool; ASSUMED.
        exponent: polytropic exponent n [-], from 1 (isothermal) to 1.4 (adiabatic); ASSUMED.
        dead_volume: volume [m3] of hose and fittings; ASSUMED.
        dump_conductance: sonic conductance [m3/(s Pa)] of the open dump valve; ASSUMED.
        dump_lag: time constant [s] of the dump valve; ASSUMED.
        atmosphere: absolute pressure [Pa] of the atmosphere.

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
        """Return the position that the spool finally reaches, from -1 (vent) to 1 (fill)."""
        above = signal - self.bias
        beyond = jnp.maximum(jnp.abs(above) - self.dead_band, 0.0)
        whole = jnp.where(above > 0, 1 - self.bias, self.bias)
        return jnp.sign(above) * beyond / (whole - self.dead_band)

    def flow(self, pressure: Real, opening: Real, dump: Real) -> RealArray:
        """Return the volume flow Q [m3/s] into the muscle, at the pressure in the muscle."""
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
        """Return the density ratio (p/p_0)^(1/n), where p and p_0 are absolute pressures."""
        p, p_0 = pressure + self.atmosphere, reference + self.atmosphere
        return jnp.exp(jnp.log(p / p_0) / self.exponent)


class HydraulicCircuit(AbstractCircuit):
    """Water supply with a gear pump and a needle valve at the outlet; pump speed sets flow and pressure.

        Q = D w - K u - G P_c log(1 + exp((P - P_r)/P_c)),    P = u sqrt(u^2 + P_l)

    Well above P_l = 20 Pa, u is the square root of P, to within 0.1 % at 5 kPa. Below P_l, u is linear in
    P, as in laminar flow. The relief valve opens gradually over a range of P_c = 1 kPa about P_r. Well
    above P_r, it passes the flow G (P - P_r). Water inertia, pump leakage and the pressure in the return
    line are neglected. Water cannot flow back through the pump.

    Attributes:
        displacement: displacement D [m3/rev] of the pump; ASSUMED.
        full_speed: pump speed [rev/s] at full signal (chapter 3: 5000 rpm).
        lag: time constant [s] of the pump; ASSUMED.
        needle: K [m3/(s Pa^0.5)] of the needle valve, 0 if it is closed; ASSUMED, so that 80 % of full
            speed maintains 100 psi.
        bulk_modulus: effective bulk modulus beta [Pa] of hose, bladder and water with some air; ASSUMED.
        dead_volume: volume [m3] of hose and fittings; ASSUMED.
        relief: gauge pressure P_r [Pa] at which the relief valve opens (chapter 3: 110 psi); None if there
            is no relief valve. A software limit is no substitute for a relief valve.
        relief_conductance: G [m3/(s Pa)], flow of the relief valve per unit of excess pressure; ASSUMED.
        dump: K [m3/(s Pa^0.5)] of the open dump valve, 0 if there is none; ASSUMED.
        dump_lag: time constant [s] of the dump valve; ASSUMED.
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
        """Return the speed that the pump finally reaches, as a fraction of full speed."""
        return as_real(signal)

    def flow(self, pressure: Real, opening: Real, dump: Real) -> RealArray:
        """Return the flow Q [m3/s] into the muscle."""
        leaves = (self.needle + self.dump * dump) * self.root(pressure)
        if self.relief is not None:
            over = jax.nn.softplus((pressure - self.relief) / CRACKING)
            leaves += self.relief_conductance * CRACKING * over
        return self.displacement * self.full_speed * opening - leaves

    def density(self, pressure: Real, reference: Real) -> RealArray:
        """Return the density ratio exp((P - P_0)/beta)."""
        return jnp.exp((pressure - reference) / self.bulk_modulus)

    def pressure(self, root: RealArray) -> RealArray:
        """Return the gauge pressure P [Pa] for a value of u."""
        return root * jnp.sqrt(root**2 + LAMINAR)

    def root(self, pressure: Real) -> RealArray:
        """Return u, the signed square root of P [Pa]."""
        P = as_real(pressure)
        return P * jnp.sqrt(2 / (LAMINAR + jnp.sqrt(LAMINAR**2 + 4 * P**2)))

    def steady_signal(self, pressure: float) -> float:
        """Return the signal that maintains a gauge pressure [Pa]."""
        full = self.displacement * self.full_speed
        return float(self.needle * self.root(pressure) / full)


# --- friction


class DahlFriction(Parametrised):
    """Dahl's friction: F_f = (F_c + f |F|) z,  dz/dL = (sign(dL) - z)/travel.

    Attributes:
        share: f [-], friction as a fraction of the force; ASSUMED if not measured.
        dry: F_c [N], friction at zero force.
        travel: travel [m] over which the friction reverses; ASSUMED.

    References:
        Dahl 1968, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1.
    """

    share: Float[Given, ""] = parameter(low=0.0, high=0.3, default=0.02)
    dry: Float[Given, ""] = parameter("N", low=0.0, high=1e3, default=0.0)
    travel: Float[Given, ""] = parameter("m", low=1e-6, high=0.05, default=2e-4)

    def start(self, length: Real, pressure: Real) -> Float[Array, "2"]:  # noqa: ARG002
        """Return the initial state: the length [m] and z = 0."""
        return jnp.stack([as_real(length), jnp.zeros_like(as_real(length))])

    def moved(self, state: Float[Array, "2"], length: Real, pressure: Real) -> Float[Array, "2"]:  # noqa: ARG002
        """Return the state, length [m] and z, after a monotone motion."""
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
        """Return the friction F_f [N] at a static force [N]; positive after lengthening."""
        return (self.dry + self.share * jnp.abs(force)) * state[1]


# --- loads


class DrivenLength(eqx.Module):
    """A testing machine that holds the muscle, or moves it at the commanded rate dL/dt [m/s]."""

    moves = False

    def lengths(self, position: RealArray) -> Float[Array, "1"]:
        """Return the active length L [m], which is the position."""
        return position[None]


class MovingLoad(Parametrised):
    """A mass lifted by one muscle (`hung`), or a joint turned by two muscles (`joint`).

        I dv/dt = sum r F - k (q - q_0) - c v + W + drive,    L = M - r q

    The mass of the muscles and dry friction in the bearing are neglected.

    Attributes:
        inertia: I [kg], or [kg m2] for a joint.
        radius: r of each muscle; in a joint, its moment arm [m]. It is positive if the muscle increases q
            when it pulls; shape (n,).
        middle: M, active length [m] of each muscle at q = 0, shape (n,).
        stiffness: spring stiffness k [N/m], or [N m/rad] for a joint.
        relaxed: q_0, position at which the spring is relaxed.
        damping: c [N s/m], or [N m s/rad] for a joint.
        weight: W [N], or [N m] for a joint, a constant force that increases q.
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
        """Create a mass [kg] hung from one muscle, with a spring that is relaxed at a muscle length [m]."""
        weight = as_real(mass) * gravity
        return cls(mass, [-1.0], [0.0], stiffness, relaxed, damping, weight)

    @classmethod
    def joint(
        cls,
        inertia: Real,
        *,
        radii: Real | Sequence[float],
        lengths: Real | Sequence[float],
        stiffness: Real = 0.0,
        damping: Real = 0.0,
    ) -> "MovingLoad":
        """Create a joint with two muscles, with pulley radii [m] > 0 and < 0 and lengths [m] at angle 0."""
        return cls(inertia, radii, lengths, stiffness, 0.0, damping)

    def lengths(self, position: RealArray) -> Float[Array, " n"]:
        """Return the active length L [m] of each muscle."""
        return self.middle - self.radius * position

    def acceleration(
        self, position: RealArray, velocity: RealArray, pulls: Float[Array, " n"], drive: RealArray
    ) -> RealArray:
        """Return dv/dt [m/s2] or [rad/s2] for muscle forces [N] and external force [N] or torque [N m]."""
        spring = self.stiffness * (position - self.relaxed) + self.damping * velocity
        return (jnp.sum(self.radius * pulls) - spring + self.weight + drive) / self.inertia


# --- the plant


class Command(eqx.Module):
    """Commands during one step, or during n steps along a leading axis.

    Attributes:
        signal: signal to the valve or pump, 0 to 1; for a `Regulated` plant, the set pressure [Pa]. The
            shape is (2,) for two muscles.
        dump: 1 opens the dump valve, 0 closes it; same shape as the signal.
        drive: rate dL/dt [m/s] of a `DrivenLength`; external force [N] or torque [N m] on a `MovingLoad`.
    """

    signal: RealArray = eqx.field(converter=as_number)
    dump: RealArray = eqx.field(converter=as_number, default=0.0)
    drive: RealArray = eqx.field(converter=as_number, default=0.0)


class PlantState(eqx.Module):
    """State of a plant, with its measurable quantities; arrays have the shape (2,) for two muscles.

    Attributes:
        pressure: gauge pressure P [Pa] of each muscle.
        opening: position of the actuator, see `AbstractCircuit.opening`.
        dump: opening of the dump valve, 0 to 1.
        position: q; the active length L [m] except in a joint.
        velocity: dq/dt.
        force: force [N] of each muscle, including friction.
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
    """One muscle with its circuit and load, or two muscles that turn a joint.

    Each step advances fluid and momentum by a two-stage diagonally implicit Runge-Kutta method, which is
    of second order and L-stable (Alexander 1977). Lags and driven lengths are integrated exactly. The
    signal is constant during a step. With steps of 2 ms, the pressure is within 0.005 psi RMS of an
    adaptive solution. The error reaches 0.05 psi when the pressure of dumped water falls to zero, and
    0.1 psi in a step in which a relief valve closes. The mass of the muscle, and the pressure drop
    between the circuit and the muscle, are neglected.

    Attributes:
        circuit: circuit of the muscle; a tuple of two for a joint.
        muscle: muscle with `force(length, pressure)` and `volume(length, pressure)`; a tuple of two for a
            joint.
        load: `DrivenLength` or `MovingLoad`.
        friction: `DahlFriction`; a `famjax.slip.MaxwellSlip` or `CentredSlip`, whose contribution to the
            volume is neglected; or None. A tuple of two for a joint.
        viscosity: viscous coefficient [N s/m], force per unit of dL/dt.

    References:
        Alexander 1977, SIAM Journal on Numerical Analysis 14(6), 1006-1021: the integration method.

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
        """Reject circuits, loads and frictions that do not match the number of muscles."""
        n = len(self._each(self.muscle))
        arms = self.load.radius.size if self.load.moves else 1
        if {len(self._each(self.circuit)), len(self._frictions), arms} != {n}:
            raise InputError(
                "a plant needs one circuit, one moment arm and one friction (or None) per muscle; two "
                f"muscles need a MovingLoad.joint. Got {n} muscles and {arms} moment arms"
            )

    @staticmethod
    def _each(part: Any) -> tuple[Any, ...]:
        return part if isinstance(part, tuple) else (part,)

    @property
    def _frictions(self) -> tuple[Any, ...]:
        if self.friction is None:
            return (None,) * len(self._each(self.muscle))
        return self._each(self.friction)

    def start(self, position: Real | None = None, pressure: Real = 0.0) -> PlantState:
        """Return the initial state, with load, valves and pump at rest.

        Args:
            position: q; by default the rest length of one muscle, or the angle 0.
            pressure: gauge pressure [Pa] of each muscle.

        Raises:
            InputError: the muscle contains no fluid at this position.
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
                f"the muscle must contain fluid at the start, at {lengths} m and {pressures} Pa, but "
                f"the muscle and hose contain {fluid} m3. Start at a length within the muscle's range, or "
                "use another muscle"
            )
        memory = tuple(
            None if one is None else one.start(L, own)
            for one, L, own in zip(self._frictions, lengths, pressures, strict=True)
        )
        forces = self.pulls(memory, lengths, pressures, jnp.zeros_like(lengths))
        return PlantState(P, none, none, q, jnp.zeros_like(q), forces.reshape(shape), memory)

    def step(self, state: PlantState, command: Command, dt: Real) -> PlantState:
        """Return the state after a time dt [s], such as 2 ms, under a constant command."""
        shape, driven, moves = state.pressure.shape, as_real(command.drive), self.load.moves
        before, q0 = state.pressure.reshape(-1), state.position
        v0, n, h = state.velocity if moves else driven, before.size, _GAMMA * dt
        actuators = self.actuators(state, command)

        def stage(time: Real, fluid: RealArray, q: RealArray, v: RealArray, guess: RealArray):
            """Solve one stage, given the explicit parts of fluid, q and v."""
            openings, dumps = actuators(time)

            def at(z: RealArray) -> tuple[RealArray, RealArray, RealArray]:
                pressures = self._of_circuits("pressure", z[:n])
                return (q + h * z[n], z[n], pressures) if moves else (q, driven, pressures)

            def residual(z: RealArray) -> RealArray:
                position, speed, pressures = at(z)
                lengths = self.load.lengths(position)
                flows = self._of_circuits("flow", pressures, openings, dumps)
                flows = flows * self._of_circuits("density", pressures, before)
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
        held = self._fluid(self.load.lengths(q0), before, before)
        roots = self._of_circuits("root", before)
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
        """Return a function for the lagged positions of actuators and dump valves under a constant command.

        Args:
            state: initial state.
            command: constant command to the valves or pumps and to the dump valves.

        Returns:
            A function of the time [s] since the initial state that returns both positions [-], shapes (n,).
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

    def _fluid(self, lengths: RealArray, pressures: RealArray, before: RealArray) -> RealArray:
        """Return the fluid [m3] in each muscle and hose, measured at the pressures `before`."""
        each = zip(
            self._each(self.circuit), self._each(self.muscle), lengths, pressures, strict=True
        )
        volumes = jnp.stack([m.volume(L, P) + c.dead_volume for c, m, L, P in each])
        return volumes * self._of_circuits("density", pressures, before)

    def _rates(self, speed: RealArray) -> RealArray:
        """Return dL/dt [m/s] of each muscle."""
        return -self.load.radius * speed if self.load.moves else speed[None]

    def moved(self, memory: Sequence[Any], lengths: RealArray, pressures: RealArray) -> tuple:
        """Return the friction states after a monotone motion.

        Args:
            memory: friction states before the motion, one for each muscle.
            lengths: active lengths L [m] after the motion, shape (n,).
            pressures: gauge pressures P [Pa] after the motion, shape (n,).
        """
        each = zip(self._frictions, memory, lengths, pressures, strict=True)
        return tuple(None if f is None else f.moved(one, L, P) for f, one, L, P in each)

    def pulls(
        self, memory: Sequence[Any], lengths: RealArray, pressures: RealArray, rates: RealArray
    ) -> RealArray:
        """Return the force [N] of each muscle, including friction and viscous loss, shape (n,).

        Args:
            memory: friction states, one for each muscle.
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
    """Solve a small system of equations by Newton's method, with implicit derivatives of any order.

    Args:
        residual: r(z), shape (n,).
        guess: starting point, shape (n,).

    Returns:
        z, with an error of the order of the last step squared.
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
    """Solve A x = b for a few unknowns by elimination without pivoting, which avoids a LAPACK call."""
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
    """Return the state after each of n steps, computed with `jax.lax.scan`.

    Args:
        plant: a `Plant` or a `Regulated` plant.
        commands: commands, with leaves of shape (n,), (n, 2) for two muscles, or () for a constant.
        dt: duration of a step [s].
        start: state before the first step; `plant.start()` if omitted.

    Returns:
        The states, each leaf with a leading axis (n,). They are differentiable with respect to every
        number in the plant, the commands and the initial state.

    Raises:
        InputError: all commands are constant, or their numbers of steps differ.
    """
    leaves = jax.tree.leaves(commands)
    counts = {leaf.shape[0] for leaf in leaves if leaf.ndim}
    if len(counts) != 1:
        raise InputError(
            "commands need one value per step, and the same number of steps in signal, dump and drive; got "
            f"step counts {counts}"
        )
    return _simulated(plant, commands, as_real(dt), plant.start() if start is None else start)


@compiled
def _simulated(plant: Any, commands: Command, dt: RealArray, start: Any) -> Any:
    (count,) = {leaf.shape[0] for leaf in jax.tree.leaves(commands) if leaf.ndim}
    each = jax.tree.map(lambda x: x if x.ndim else jnp.broadcast_to(x, (count,)), commands)

    # For a gradient, each step is computed again, because loops that carry little data run faster.
    @functools.partial(jax.checkpoint, prevent_cse=False)
    def step(state: Any, command: Command) -> tuple[Any, Any]:
        after = plant.step(state, command, dt)
        return after, after

    # XLA makes one function of a loop that carries little, and runs others operation by operation.
    width = sum(x.nbytes for x in jax.tree.leaves(start)) + sum(
        x.nbytes // count for x in jax.tree.leaves(each)
    )
    short = max(k for k in range(1, max(_INNER // width, 1) + 1) if count % k == 0)
    each = jax.tree.map(lambda x: x.reshape(count // short, short, *x.shape[1:]), each)
    states = jax.lax.scan(lambda state, some: jax.lax.scan(step, state, some), start, each)[1]
    return jax.tree.map(lambda x: x.reshape(count, *x.shape[2:]), states)


class SteppedPlant:
    """A plant with one driven muscle that a simulated device advances tick by tick, in plain numbers.

    Each tick runs one compiled program on two small arrays. All plants with the same structure share the
    program. A tick takes a quarter of the time of `Plant.step`.

    Args:
        plant: plant with a `DrivenLength`.
        dt: duration of a tick [s].

    Attributes:
        pressure: gauge pressure P [Pa] in the muscle.
        force: force [N], including friction.
        length: active length L [m].
    """

    def __init__(self, plant: Plant, dt: float) -> None:
        self.dt, state = dt, plant.start()
        self.pressure, self.force = float(state.pressure), float(state.force)
        self.length = float(state.position)
        self._rest = ravel_pytree((state.opening, state.dump, state.memory))[0].tolist()
        arrays, static = eqx.partition(plant, eqx.is_array)
        shapes = tuple(leaf.shape for leaf in jax.tree.leaves(arrays))
        self._tick = _tick(jax.tree.structure(arrays), shapes, static)
        self._numbers = ravel_pytree(arrays)[0]

    def step(self, signal: float, dump: float | bool, length: float) -> None:
        """Advance by one tick, in which the machine moves the muscle to a length [m]."""
        drive = (length - self.length) / self.dt
        row = [self.dt, signal, dump, drive, self.length, self.pressure, *self._rest]
        self.length = length
        self.pressure, self.force, *self._rest = np.asarray(
            self._tick(self._numbers, np.array(row))
        ).tolist()


@functools.lru_cache(maxsize=16)
def _tick(structure: Any, shapes: tuple[tuple[int, ...], ...], static: Any) -> Callable[..., Array]:
    """Return the compiled tick for plants with the same structure."""
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
    """Return the states at given times under a constant command, by a fifth-order implicit method.

    The motion must be monotone. The package diffrax is required; the extra `dynamics` installs it.

    Args:
        plant: the plant.
        state: state at time 0.
        command: constant command.
        times: increasing times [s], shape (n,).
        tolerance: relative tolerance of each step, and absolute tolerance in bar, m and m/s.

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
        rise = (plant._of_circuits("flow", P, *actuators(time)) - swept) / capacity
        pulls = plant.pulls(plant.moved(state.memory, lengths, P), lengths, P, rates)
        gained = plant.load.acceleration(q, v, pulls, driven) if moves else jnp.zeros_like(v)
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
        integral: integral I, as a fraction of the full output.
        total: sum of the errors [Pa] over the ticks in the current record.
        phase: number of ticks completed in the current record.
    """

    integral: RealArray
    total: RealArray
    phase: Int[Array, ""]


class PressureController(Parametrised):
    """The firmware's PI controller, with feed-forward: u = v(P) + K_p e + I, dI/dt = K_i e.

    The integral is updated at the end of each record. The quantisation of the converter and output,
    and the 256 psi limit on the error, are neglected.

    Attributes:
        proportional: K_p [1/Pa], as a fraction of the full output.
        integral: K_i [1/(Pa s)], as a fraction of the full output.
        feed_forward: coefficients of v(P) in increasing powers of the set pressure [Pa], shape (k,).
        low, high: limits of the integral I.
        ticks: number of ticks in a record.

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
        """Return the initial state."""
        none = jnp.zeros_like(self.proportional)
        return ControllerState(none, none, jnp.array(0))

    def step(
        self, state: ControllerState, set_pressure: Real, pressure: Real, dt: Real
    ) -> tuple[ControllerState, RealArray]:
        """Return the state after a tick, and the signal for the next tick.

        Args:
            state: state before the tick.
            set_pressure: gauge set pressure [Pa].
            pressure: measured gauge pressure [Pa].
            dt: duration of a tick [s].
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
        plant: state of the plant.
        controller: state of the controller.
        signal: output of the controller for the next step, 0 to 1.
    """

    plant: PlantState
    controller: ControllerState
    signal: RealArray


class Regulated(Parametrised):
    """A plant with a pressure controller; `Command.signal` is the set pressure [Pa] of each muscle.

    Attributes:
        plant: plant with one muscle, or with the two muscles of a joint.
        controller: controller that reads the true pressure at the end of each step. In a joint, each muscle
            has a controller with these gains.
    """

    plant: Plant
    controller: PressureController

    def start(self, position: Real | None = None, pressure: Real = 0.0) -> RegulatedState:
        """Return the state of the plant at rest, with zero controller output."""
        at = self.plant.start(position, pressure)
        begun, none = self.controller.start(), jnp.zeros_like(at.pressure)
        begun = ControllerState(begun.integral + none, begun.total + none, begun.phase)
        return RegulatedState(at, begun, none)

    def step(self, state: RegulatedState, command: Command, dt: Real) -> RegulatedState:
        """Advance the plant under the current controller output, then the controller by one tick."""
        own = Command(state.signal, command.dump, command.drive)
        after = self.plant.step(state.plant, own, dt)
        controller, signal = self.controller.step(
            state.controller, command.signal, after.pressure, dt
        )
        return RegulatedState(after, controller, signal)


# --- a muscle for rigs


class LinearMcKibben(AbstractMuscle):
    """A muscle with an inelastic braid and a linear bladder, for a rig without a muscle model.

        V = (B^2 L - L^3)/(4 pi N^2) - V_solid,  F = max(P - P_d, 0)(3 L^2 - B^2)/(4 pi N^2) - k (L0 - L)

    The defaults describe the 7/8 in muscle of the reference work. Stiffness and deadband were chosen to
    match its published blocked force to within 5 %, and its free contraction at 40 psi and above to within
    0.03.

    Attributes:
        rest_length: L0 [m].
        thread_length: B [m].
        turns: N [-], number of turns of one thread.
        solid_volume: volume V_solid [m3] of the bladder and braid.
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
        """Return the static force F [N], with the broadcast shape."""
        area = (3 * as_real(length) ** 2 - self.thread_length**2) / self._four
        spring = self.bladder_stiffness * (self.rest_length - length)
        return jnp.maximum(pressure - self.deadband_pressure, 0.0) * area - spring

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3], with the broadcast shape."""
        L = as_real(length) + jnp.zeros_like(as_real(pressure))
        return (self.thread_length**2 * L - L**3) / self._four - self.solid_volume

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest active length [m] for the equilibrium search.

        The range extends from just below the neutral length to 2 % above L0, or halfway to B if that is
        shorter.
        """
        longest = (self.rest_length + self.thread_length) / 2
        neutral = self.thread_length / math.sqrt(3)
        return 0.95 * neutral, jnp.minimum(1.02 * self.rest_length, longest)

    @property
    def _four(self) -> RealArray:
        return 4 * jnp.pi * self.turns**2
