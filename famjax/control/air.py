"""Time to fill and to vent a muscle through an orifice, by ISO 6358."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._arrays import Given, Real, RealArray, as_number, as_real, at_each, compiled
from ..boundary.errors import InputError
from ..muscle import AbstractMuscle
from .inverse import Answer, Outcome

Volume = Callable[[RealArray], RealArray]
"""Volume of gas [m3] over gauge pressure [Pa]: a `HeldLength`, a `HeldLoad`, a function of your own."""

REFERENCE_PRESSURE = 1e5  # Pa, of ISO 8778, to which the sonic conductance refers
REFERENCE_TEMPERATURE = 293.15  # K
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)
_PANELS = 8  # of the sonic part and of the subsonic part each


class Passage(Answer):
    """A time to fill or to vent, of the broadcast shape of the arguments.

    Attributes:
        time: [s]; nan where the end is not reached.
        code: an `Outcome`: FEASIBLE, BEYOND_LINE or NO_STATE.
    """

    time: RealArray
    code: Int[Array, "..."]


class AirLine(eqx.Module):
    """An orifice between a supply and a muscle, or between the muscle and the atmosphere.

        Q = C p_1 sqrt(T_N/T) psi(p_2/p_1),   (V/n + p dV/dp) dp/dt = +-p_N (T/T_N) Q

    psi is 1 up to the critical ratio b, where the flow is sonic, and sqrt(1 - ((r - b)/(1 - b))^2)
    above it. p are absolute. With the angle of this circle in place of the pressure the integrand has
    no singularity, and the time follows by Gauss-Legendre quadrature, without steps: exact to
    rounding for a constant volume. Neglected: the valve's own time, the hose's resistance and
    waves, and but for the exponent n the change of the gas's temperature.

    Attributes:
        conductance: sonic conductance C [m3/(s Pa)] of valve, fittings and hose together, > 0.
        supply: gauge pressure [Pa].
        critical_ratio: b [-], in (0, 1); some 0.2 to 0.5.
        exponent: polytropic n [-]: 1 for slow, isothermal changes, 1.4 for fast, adiabatic ones.
        dead_volume: of hose and fittings [m3], beside the muscle's.
        temperature: of the gas in the line T [K].
        atmosphere: absolute pressure [Pa].

    References:
        ISO 6358-1:2013, equations 1 and 2.

    >>> line = AirLine(1e-9, 6e5)
    >>> tank = lambda pressure: 1e-3 + 0 * pressure
    >>> print(f"{line.fill(tank, 0.0, 1e5).time:.4f} s")  # sonic: V dp / (p_N C p_1)
    1.4259 s
    """

    conductance: Float[Given, ""] = eqx.field(converter=as_number)
    supply: Float[Given, ""] = eqx.field(converter=as_number)
    critical_ratio: Float[Given, ""] = eqx.field(converter=as_number, default=0.3)
    exponent: Float[Given, ""] = eqx.field(converter=as_number, default=1.0)
    dead_volume: Float[Given, ""] = eqx.field(converter=as_number, default=0.0)
    temperature: Float[Given, ""] = eqx.field(converter=as_number, default=REFERENCE_TEMPERATURE)
    atmosphere: Float[Given, ""] = eqx.field(converter=as_number, default=101325.0)

    def flow(self, upstream: Real, downstream: Real) -> RealArray:
        """Volume flow at reference conditions Q [m3/s], broadcast shape; zero against a higher pressure.

        Args:
            upstream: gauge pressure [Pa].
            downstream: gauge pressure [Pa].
        """
        p_1, p_2 = (as_real(one) + self.atmosphere for one in (upstream, downstream))
        ratio, b = p_2 / p_1, self.critical_ratio
        above = jnp.clip((ratio - b) / (1 - b), 0.0, 1.0)
        subsonic = (above > 0) & (above < 1)
        share = jnp.sqrt(jnp.where(subsonic, 1 - above**2, 1.0))
        thin = jnp.sqrt(REFERENCE_TEMPERATURE / self.temperature)
        return self.conductance * thin * p_1 * jnp.where(ratio < 1, share, 0.0)

    def fill(self, volume: Volume, start: Real, end: Real) -> Passage:
        """Time [s] to fill a muscle from one gauge pressure [Pa] to another.

        Args:
            volume: of the gas over the gauge pressure, see `HeldLength` and `HeldLoad`.
            start: gauge pressure [Pa].
            end: gauge pressure [Pa], from the start to the supply; that itself is reached, in a
                finite time.

        Returns:
            The time with its code, of broadcast shape. Differentiable.
        """
        return _passage(self, volume, as_real(start), as_real(end), True)

    def vent(self, volume: Volume, start: Real, end: Real) -> Passage:
        """Time [s] to vent a muscle to atmosphere from one gauge pressure [Pa] to another.

        As `fill`, with an end from 0 to the start.
        """
        return _passage(self, volume, as_real(start), as_real(end), False)


class _Sweep(eqx.Module):
    """The way of the pressure, by a coordinate u: below 0 the flow is sonic, above it subsonic.

    Filling, u is p/p_1 - b while sonic; then the angle phi in p_2/p_1 = b + (1 - b) sin phi. Venting,
    it is -log(p b/p_atm) while sonic; then again that angle.
    """

    line: AirLine
    volume: Volume
    filling: bool = eqx.field(static=True)

    @property
    def _far(self) -> RealArray:
        """The absolute pressure [Pa] that is held: of the supply or of the atmosphere."""
        return self.line.atmosphere + (self.line.supply if self.filling else 0.0)

    def coordinate(self, pressure: RealArray) -> RealArray:
        """Coordinate u at a gauge pressure [Pa], of any shape."""
        p, b = pressure + self.line.atmosphere, self.line.critical_ratio
        ratio = p / self._far if self.filling else self._far / p
        sonic = (ratio - b) if self.filling else jnp.log(ratio / b)
        above = (ratio - b) / (1 - b)
        # The end itself, with no derivative: the flow is zero there.
        inside = (above > 0) & (above < 1)
        angle = jnp.where(inside, jnp.arcsin(jnp.where(inside, above, 0.0)), 0.5 * np.pi)
        return jnp.where(above > 0, angle, sonic)

    def pressure(self, u: RealArray) -> RealArray:
        """Gauge pressure [Pa] at u."""
        b = self.line.critical_ratio
        ratio = b + (1 - b) * jnp.sin(jnp.maximum(u, 0.0))
        if self.filling:
            p = self._far * jnp.where(u > 0, ratio, b + u)
        else:
            p = self._far / jnp.where(u > 0, ratio, b * jnp.exp(jnp.minimum(u, 0.0)))
        return p - self.line.atmosphere

    def rate(self, u: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
        """dt/du [s] and whether the volume is known; a number in any case, see `Dimensions.where`."""
        line, b = self.line, self.line.critical_ratio
        at = self.pressure(u)
        V, slope = jax.jvp(self.volume, (at,), (jnp.ones_like(at),))
        known = jnp.isfinite(V) & jnp.isfinite(slope)
        V, slope = jnp.where(known, V, 1.0), jnp.where(known, slope, 0.0)
        capacity = (V + line.dead_volume) / line.exponent + (at + line.atmosphere) * slope
        bend = 1 - b
        if not self.filling:
            bend = bend / (b + bend * jnp.sin(jnp.maximum(u, 0.0)))
        speed = REFERENCE_PRESSURE * jnp.sqrt(line.temperature / REFERENCE_TEMPERATURE)
        return capacity * jnp.where(u > 0, bend, 1.0) / (speed * line.conductance), known

    def time(self, start: RealArray, end: RealArray) -> RealArray:
        """Time [s] from one u to another; infinite where no volume is known."""
        even = jnp.linspace(0.0, 1.0, _PANELS + 1, dtype=start.dtype)
        total = jnp.zeros_like(start)
        for side in (jnp.minimum, jnp.maximum):  # no panel has 0 inside
            low, high = side(start, 0.0), side(end, 0.0)
            ends = low * (1 - even) + high * even
            half = 0.5 * jnp.diff(ends)[:, None]
            at = ends[:-1, None] + half * (1 + jnp.asarray(_NODES, half.dtype))
            rates, known = jax.vmap(jax.vmap(self.rate))(at)
            time = jnp.sum(half * jnp.asarray(_WEIGHTS, half.dtype) * rates)
            total += jnp.where(jnp.all(known) | (low == high), time, jnp.inf)
        return total

    def code(self, start: RealArray, end: RealArray, found: Bool[Array, ""]) -> Int[Array, ""]:
        """The code of a passage between two gauge pressures [Pa], whose time is known or not."""
        line, b = self.line, self.line.critical_ratio
        if self.filling:
            inside = (start <= end) & (end <= line.supply) & (start > -line.atmosphere)
        else:
            inside = (start >= end) & (end >= 0)
        sound = (line.conductance > 0) & (b > 0) & (b < 1) & (line.exponent > 0)
        known = sound & jnp.isfinite(start) & jnp.isfinite(end) & (found | ~inside)
        code = jnp.where(inside, Outcome.FEASIBLE, Outcome.BEYOND_LINE)
        return jnp.where(known, code, Outcome.NO_STATE)


@compiled
def _passage(
    line: AirLine, volume: Volume, start: RealArray, end: RealArray, filling: bool
) -> Passage:
    sweep = _Sweep(line, volume, filling)

    def one(start: RealArray, end: RealArray) -> Passage:
        time = sweep.time(sweep.coordinate(start), sweep.coordinate(end))
        code = sweep.code(start, end, jnp.isfinite(time))
        return Passage(jnp.where(code == Outcome.FEASIBLE, time, jnp.nan), code)

    return at_each(one, start, end)


# --- the volume of gas


def fluid_volume(muscle: Any, length: Real, pressure: Real) -> RealArray:
    """Volume of fluid [m3] in a muscle: the volume within the braid minus the rubber.

    Args:
        muscle: with a `volume` of its own, as a `famjax.SafeMuscle`, or with a geometry.
        length: active length L [m].
        pressure: gauge pressure P [Pa].

    Returns:
        V [m3], broadcast shape; nan where the muscle has no state.

    Raises:
        InputError: the model has no geometry, as those of other authors.
    """
    if not hasattr(muscle, "volume"):
        raise InputError(
            f"a fluid volume needs a muscle with a geometry, got {type(muscle).__name__}: give a "
            "function of the gauge pressure [Pa] that returns the volume [m3] instead"
        )
    return muscle.volume(length, pressure)


class HeldLength(eqx.Module):
    """Volume of a muscle at fixed length, as a function of the gauge pressure.

    Attributes:
        muscle: with a geometry.
        length: active length L [m].
    """

    muscle: AbstractMuscle
    length: Float[Given, ""] = eqx.field(converter=as_number)

    def __call__(self, pressure: Real) -> RealArray:
        """V [m3] at a gauge pressure P [Pa], of its shape."""
        return fluid_volume(self.muscle, self.length, pressure)


class HeldLoad(eqx.Module):
    """Volume of a muscle under constant load, as a function of the gauge pressure.

    The muscle is at every moment at the length at which it carries the load; the load's inertia is
    neglected.

    Attributes:
        muscle: with a geometry.
        load: [N].
    """

    muscle: AbstractMuscle
    load: Float[Given, ""] = eqx.field(converter=as_number)

    def __call__(self, pressure: Real) -> RealArray:
        """V [m3] at a gauge pressure P [Pa], of its shape; nan where it does not carry the load."""
        length = self.muscle.length_at_load(self.load, pressure, throw=False)
        return fluid_volume(self.muscle, length, pressure)
