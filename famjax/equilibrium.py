"""A muscle whose shape follows from equilibrium: profile, braid angle and force are solved for together."""

import functools
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int
from numpy.polynomial.legendre import legint, legvander

from ._arrays import Given, Real, RealArray, as_real, at_each, compiled_method
from ._shape import Balance, Part, Solved, full, modes, reduced_hessian, rules, solve
from .boundary.errors import InputError
from .braids import AbstractBraid
from .compile_options import quick_jit
from .geometries import Bladder, EstimatedGeometry
from .materials import AbstractMaterial
from .muscle import AbstractMuscle, required
from .parameters import Parametrised, parameter

FOUND, BEYOND, OVERHANG, COMPRESSION, LOCKED, UNKNOWN, UNSTABLE, LOST = range(8)
REASONS = (
    "",
    "the length is not between zero and the straight-thread length, or an input is not finite",
    "the shoulder overhangs at a fitting: the muscle is too short for the model at this pressure",
    "the threads would be in compression: the pressure force on the end plus the muscle's force is not > 0",
    "the braid is locked: its threads lie along the circumference",
    "the bladder's bore is closed in this state, or its stress law is undefined at these strains",
    "the equilibrium that was found is unstable",
    "no equilibrium was found: use more modes, or check the dimensions and their units",
)
"""Reasons why a state does not exist, indexed by reason code."""

_RULE = np.polynomial.legendre.leggauss(16)
_PROBE = 0.1  # strain at which a law's stress gives the scale of forces
_TILTED, _SLACK, _ROUND = 0.3, 0.15, 0.02


class Section(Parametrised):
    """A section of a muscle with its own braid, bladder or material.

    Each part is described as if it formed the whole muscle. For example, a section with a share of one
    half whose braid has 9 in of thread and one turn contains 4.5 in of thread and half a turn.

    Attributes:
        share: fraction of the material coordinate, > 0; the shares of all sections sum to one.
        braid: braid of the section; the muscle's braid if None.
        bladder: bladder of the section; the muscle's bladder if None.
        material: material of the section; the muscle's material if None.
        far_bladder: bladder at the far end of a tapered section; None if the section is not tapered.
    """

    share: float = eqx.field(static=True)
    braid: AbstractBraid | None = None
    bladder: Bladder | None = None
    material: AbstractMaterial | None = None
    far_bladder: Bladder | None = None


class Shape(eqx.Module):
    """Shape of a muscle at points from one fitting to the other, in arrays of shape (..., points).

    Attributes:
        position: position z [m] along the axis, 0 to L.
        radius: braid radius r [m].
        braid_angle: angle theta [rad] between thread and circumference.
        thread_tension: total tension [N] in all threads; divide by their number for a single thread.
        axial_strain: bladder strain eps_z [-] along the meridian.
        hoop_strain: bladder strain eps_c [-] at mid-wall.
        thickness: bladder thickness t [m].
    """

    position: Float[Array, "... points"]
    radius: Float[Array, "... points"]
    braid_angle: Float[Array, "... points"]
    thread_tension: Float[Array, "... points"]
    axial_strain: Float[Array, "... points"]
    hoop_strain: Float[Array, "... points"]
    thickness: Float[Array, "... points"]


class State(eqx.Module):
    """State of a muscle at a length and pressure; values are nan if no state exists.

    Attributes:
        force: axial force F [N], positive if the muscle pulls.
        volume: fluid volume V [m3].
        energy: strain energy U [J] of the bladder and threads.
        margin: smallest stiffness of the shape [N/m]; see `EquilibriumMuscle.margin`.
        code: index in `REASONS` of the reason why no state exists; 0 if one exists.
    """

    force: RealArray
    volume: RealArray
    energy: RealArray
    margin: RealArray
    code: Int[Array, "..."]


_quick = functools.partial(compiled_method, jit=quick_jit)


class EquilibriumMuscle(AbstractMuscle):
    """A muscle whose shape minimises the energy; its threads are pinned together where they cross.

    The energy at length L and gauge pressure P is the integral over the material coordinate Z of

        W(r, mu) - P pi r^2 z',   r'^2 + z'^2 = mu^2 = B^2 - (2 pi N r)^2

    where W is the strain energy of the bladder and of any elastic threads. The force is the derivative of
    this energy with respect to length, and the volume follows from its derivative with respect to
    pressure. Force and volume are therefore consistent, and the model never creates energy. If there is
    no stable shape, the results are nan, and `reason` explains why.

    Friction, gravity and the width of the threads are neglected. The bladder is assumed to stick to the
    braid.

    Attributes:
        braid: threads around the bladder, inextensible or elastic.
        bladder: rubber tube under, or embedded in, the braid.
        material: stress law of the bladder.
        end_diameter: braid diameter D [m] at both fittings, or only at the first.
        other_end_diameter: braid diameter D [m] at the second fitting; None for the same as the first.
        deadband_pressure: P_d [Pa], subtracted from the gauge pressure.
        sections: sections in order along the muscle, if they differ; empty for a uniform muscle.
        modes: polynomial degree of the radius in each section; chosen from the slenderness if omitted.

    References:
        Chambers 2021, chapters 6 and 8 (open question: a braid term for the real shape).

    >>> import famjax
    >>> braid, tube = famjax.Braid(9.89, 1.09, 0.011), famjax.Bladder(9.28125, 0.875, 0.0625)
    >>> latex = famjax.PolynomialMaterial([257.8, -57.9, 32.7])  # inches, psi
    >>> muscle = EquilibriumMuscle(braid, tube, latex, end_diameter=0.863)
    >>> print(f"{muscle.force(9.28125, 100.0):.0f} {2 * muscle.profile(9.28125, 100.0).radius[50]:.3f}")
    982 1.040
    """

    braid: AbstractBraid
    bladder: Bladder
    material: AbstractMaterial
    end_diameter: Float[Given, ""] = parameter("m", low=0.0)
    other_end_diameter: Float[Given, ""] | None = parameter("m", low=0.0, default=None)
    deadband_pressure: Float[Given, ""] = parameter("Pa", low=0.0, default=0.0)
    sections: tuple[Section, ...] = ()
    modes: int = eqx.field(static=True, default=0)

    def __init__(
        self,
        braid: AbstractBraid,
        bladder: Bladder,
        material: AbstractMaterial,
        *,
        end_diameter: Real,
        other_end_diameter: Real | None = None,
        deadband_pressure: Real = 0.0,
        sections: Sequence[Section] = (),
        modes: int | None = None,
    ) -> None:
        """Create a muscle; see the attributes.

        Raises:
            InputError: the shares do not sum to one, a dimension of a bladder is not positive, or a
                fitting is wider than the braid can be. Traced numbers are not checked.
        """
        self.braid, self.bladder, self.material = braid, bladder, material
        self.end_diameter = as_real(end_diameter)
        other = other_end_diameter
        self.other_end_diameter = None if other is None else as_real(other)
        self.deadband_pressure = as_real(deadband_pressure)
        self.sections = tuple(sections)
        _check(self)
        self.modes = _modes_for(self) if modes is None else modes

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m], taken from the bladder."""
        lengths = [s * jnp.mean(p.bladder.rest_length) for s, p in parts_of(self)]
        return jnp.asarray(sum(lengths))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the length range [m], from just below the neutral length to the length at bore closure."""
        thread = sum(share * part.braid.rest_thread_length for share, part in parts_of(self))
        cylinders = [(s, EstimatedGeometry(p.braid, p.bladder)) for s, p in parts_of(self)]
        longest = sum(share * one.length_range()[1] for share, one in cylinders)
        return 0.57 * jnp.asarray(thread), jnp.asarray(longest)

    @_quick
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the static force F [N] at length L [m] and gauge pressure P [Pa]; arguments broadcast."""

        def one(length: RealArray, pressure: RealArray) -> RealArray:
            balance, solved, code = _balance(self, length, pressure)
            return jnp.where(code == FOUND, solved.y[0][-1] * balance.force_scale, jnp.nan)

        return at_each(one, as_real(length), as_real(pressure))

    @_quick
    def state(self, length: Real, pressure: Real) -> "State":
        """Return force, volume, energy, stability margin and reason code, with the broadcast shape."""

        def one(length: RealArray, pressure: RealArray) -> State:
            balance, solved, code = _balance(self, length, pressure)
            volume = _length_and_volume(balance, solved)[1]
            values = (
                solved.y[0][-1] * balance.force_scale,
                volume,
                _energy(balance, solved) + self.deadband_pressure * volume,
                _margin(balance, solved),
            )
            known: Any = (jnp.where(code == FOUND, v, jnp.nan) for v in values)
            return State(*known, code=code)

        return at_each(one, as_real(length), as_real(pressure))

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3], see `AbstractGeometry.inner_volume`; arguments broadcast."""
        return self.state(length, pressure).volume

    def energy(self, length: Real, pressure: Real) -> RealArray:
        """Return the strain energy U [J] of the bladder and threads, with the broadcast shape.

        In equilibrium, dU = F dL + P dV. If the stress law has no strain energy, U is the work done by the
        stresses along a straight path in strain. The work P_d V against the deadband is counted as stored.
        """
        return self.state(length, pressure).energy

    def margin(self, length: Real, pressure: Real) -> RealArray:
        """Return the shape's smallest stiffness [N/m] at fixed length and pressure: the stability margin.

        The margin is the smallest eigenvalue of the second derivative of the energy, normalised by the mean
        square change in radius. It has the broadcast shape. For a long muscle, the condition
        margin > 0 approaches the condition for a cylinder, dF/dr < 0.
        """
        return self.state(length, pressure).margin

    def profile(self, length: Real, pressure: Real, points: int = 101) -> Shape:
        """Return the shape at active length L [m] and gauge pressure P [Pa].

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa].
            points: number of points in each section, equally spaced along the threads.

        Returns:
            The shape. Its arrays have the broadcast shape plus a last axis of points; they are nan if no
            shape exists.
        """
        return self._profile(as_real(length), as_real(pressure), points)

    @quick_jit
    def _profile(self, length: RealArray, pressure: RealArray, points: int) -> Shape:
        def one(length: RealArray, pressure: RealArray) -> Shape:
            balance, solved, code = _balance(self, length, pressure)
            shape = _shape(balance, solved, points)
            return jax.tree.map(lambda leaf: jnp.where(code == FOUND, leaf, jnp.nan), shape)

        return at_each(one, length, pressure)

    def cut_to_length(self, rest_length: RealArray) -> "EquilibriumMuscle":
        """Return the muscle with another rest length [m] and the same fittings; see `famjax.cut_to_length`.

        Raises:
            ValueError: the muscle has sections, so the position of the cut is ambiguous.
        """
        if self.sections:
            raise ValueError(
                "a muscle with sections cannot be cut to length: create a muscle with different sections"
            )
        cut = EstimatedGeometry(self.braid, self.bladder).cut_to_length(rest_length)
        return EquilibriumMuscle(
            cut.braid, cut.bladder, self.material, end_diameter=self.end_diameter,
            other_end_diameter=self.other_end_diameter, deadband_pressure=self.deadband_pressure,
        )  # fmt: skip

    def reason(self, length: float, pressure: float) -> str:
        """Explain why no state exists at this length [m] and pressure [Pa]; "" if one exists."""
        return REASONS[int(self.state(length, pressure).code)]

    def blocked_force(self, pressure: Real) -> RealArray:
        """Return the blocked force [N]: the force at zero contraction and gauge pressure P [Pa]."""
        return self.force(self.rest_length, pressure)

    def length_at_load(self, load: Real, pressure: Real, *, throw: bool = True) -> RealArray:
        """Return the active length L [m] at which the muscle carries the load; see `AbstractMuscle`.

        The length follows from a single equilibrium solution at this load, without a root search.
        """
        length, found = self._loaded(load, pressure)
        return required(length, found, "equilibrium length") if throw else length

    @_quick
    def _loaded(self, load: Real, pressure: Real) -> tuple[RealArray, Bool[Array, "..."]]:
        def one(load: RealArray, pressure: RealArray) -> tuple[RealArray, Bool[Array, ""]]:
            balance, solved, code = _balance(self, None, pressure, load)
            length, _ = _length_and_volume(balance, solved)
            return jnp.where(code == FOUND, length, jnp.nan), code == FOUND

        return at_each(one, as_real(load), as_real(pressure))


def parts_of(muscle: EquilibriumMuscle) -> list[tuple[float, Part]]:
    """Return the share and the parts of each section; the bladder is the one at the section's start."""
    whole = Part(muscle.braid, muscle.bladder, muscle.material)
    if not muscle.sections:
        return [(1.0, whole)]
    return [
        (one.share, Part(one.braid or whole.braid, one.bladder or whole.bladder,
                         one.material or whole.material))
        for one in muscle.sections
    ]  # fmt: skip


def _ends(muscle: EquilibriumMuscle) -> Float[Array, "2"]:
    other = muscle.other_end_diameter
    return jnp.stack([muscle.end_diameter, muscle.end_diameter if other is None else other]) / 2


def _modes_for(muscle: EquilibriumMuscle) -> int:
    """Return the number of modes required to resolve the shoulders; slender sections need more."""
    slender = [s * p.bladder.rest_length / muscle.end_diameter for s, p in parts_of(muscle)]
    if any(isinstance(one, Tracer) for one in slender):
        return 32
    return int(np.clip(12 + 4 * np.sqrt(float(max(slender))), 16, 64))


def _check(muscle: EquilibriumMuscle) -> None:
    """Reject impossible dimensions; traced numbers are not checked."""
    shares, parts = zip(*parts_of(muscle), strict=True)
    if min(shares) <= 0 or abs(sum(shares) - 1) > 1e-9:
        raise InputError(
            f"the shares of the sections must be > 0 and sum to 1; their sum is {sum(shares):.6g}"
        )
    far = [one.far_bladder for one in muscle.sections if one.far_bladder is not None]
    for one in [*(part.bladder for part in parts), *far]:
        for name in ("rest_length", "rest_diameter", "rest_thickness"):
            value = getattr(one, name)
            if not isinstance(value, Tracer) and not float(value) > 0:
                raise InputError(f"the {name} of a bladder must be > 0, got {float(value):.4g} m")
    for radius, part in zip(_ends(muscle), (parts[0], parts[-1]), strict=True):
        widest = part.braid.rest_thread_length / (np.pi * part.braid.turns)
        if any(isinstance(one, Tracer) for one in (radius, widest)):
            continue
        if not 0 < 2 * float(radius) < float(widest):
            raise InputError(
                f"an end diameter must be > 0 and less than {float(widest):.4g} m, where the threads lie "
                f"along the circumference, got {2 * float(radius):.4g} m"
            )


def _balance(
    muscle: EquilibriumMuscle,
    length: RealArray | None,
    pressure: RealArray,
    load: RealArray | None = None,
) -> tuple[Balance, Solved, Int[Array, ""]]:
    """Solve for equilibrium at a scalar length or load; return equations, solution and reason code."""
    parts, ends = parts_of(muscle), _ends(muscle)
    pressure = pressure - muscle.deadband_pressure
    far = [one.far_bladder for one in muscle.sections] or [None]
    straight = jnp.asarray(sum(share * part.braid.rest_thread_length for share, part in parts))
    if load is None:
        assert length is not None
        reach = straight * (1.1 if any(part.elastic for _, part in parts) else 1.0)
        there = (length > 0) & (length < reach) & jnp.isfinite(pressure)
        length = jnp.where(there, length, jax.lax.stop_gradient(muscle.rest_length))
        pressure = jnp.where(there, pressure, 1.0)
    else:  # from Gaylord's cylinder, a little longer
        there = (pressure > 0) & jnp.isfinite(load + pressure)
        load, pressure = jnp.where(there, load, 0.0), jnp.where(there, pressure, 1.0)
        turns = sum(share * part.braid.turns for share, part in parts)
        square = (straight**2 + 4 * jnp.pi * turns**2 * load / pressure) / 3
        length = jnp.clip(
            1.05 * jnp.sqrt(jnp.maximum(square, 0.0)), 0.6 * straight, 0.98 * straight
        )
    dtype = jnp.result_type(length, pressure, ends)
    scale = jnp.abs(pressure) * jnp.pi * jnp.mean(ends) ** 2
    for share, part in parts:
        probe = jnp.asarray(_PROBE, dtype)
        stresses = part.material.stresses(probe, probe, pressure)
        section = part.bladder.volume / part.bladder.rest_length
        scale += share * section * (jnp.abs(stresses[0]) + jnp.abs(stresses[1]))
    shares = tuple(share for share, _ in parts)
    stations = rules(shares, muscle.modes)
    balance = Balance(
        parts=tuple(part.tapered(end, rule.x)
                    for (_, part), end, rule in zip(parts, far, stations, strict=True)),
        ends=ends.astype(dtype),
        length=jnp.asarray(length, dtype),
        pressure=jnp.asarray(pressure, dtype),
        load=None if load is None else jnp.asarray(load, dtype),
        force_scale=jax.lax.stop_gradient(scale).astype(dtype),
        shares=shares,
        order=muscle.modes,
        symmetric=muscle.other_end_diameter is None and not muscle.sections,
    )  # fmt: skip
    solved = solve(balance)
    return balance, solved, jnp.where(there, _code(balance, solved), BEYOND)


def _code(balance: Balance, solved: Solved) -> Int[Array, ""]:
    """Return the reason code for the solver's last point."""
    stable = jnp.all(jnp.isfinite(jnp.linalg.cholesky(reduced_hessian(solved.point.matrix))))
    rooms, kept = solved.point.rooms, solved.point.kept
    far = 0 if balance.symmetric else -1
    inner = solved.last[1]
    across = jnp.stack([inner[0][0, 0], inner[-1][-1, 0]])
    along = jnp.stack([rooms[0, 1], rooms[far, 1]])
    pushed = balance.pressure * jnp.pi * jnp.mean(rooms[:, 0] ** 2)
    why = jnp.select(
        [
            ~kept,
            pushed + solved.point.aim * balance.force_scale < _SLACK * pushed,
            jnp.min(along / jnp.hypot(along, across)) < _TILTED,
            jnp.min(rooms[:, 2]) < _ROUND * jnp.max(rooms[:, 2]),
        ],
        [UNKNOWN, COMPRESSION, OVERHANG, LOCKED],
        LOST,
    )
    return jnp.where(solved.found, jnp.where(stable, FOUND, UNSTABLE), why)


def _axial_rate(state: RealArray, part: Part, pressure: RealArray) -> RealArray:
    """Return z' = mu m / sqrt(m^2 + p^2) at one station."""
    radius, _, force, across, stretch = full(state)
    along = pressure * jnp.pi * radius**2 + force
    meridian, *_ = part.place(radius, stretch)
    return meridian * along / jnp.hypot(along, across)


def _length_and_volume(balance: Balance, solved: Solved) -> tuple[RealArray, RealArray]:
    """Return the length [m] and the fluid volume [m3]."""
    length = volume = jnp.zeros_like(balance.pressure)
    rates = balance.each(_axial_rate, solved.y)
    for rule, part, state, rate in zip(
        balance.rules, balance.parts, balance.states(solved.y), rates, strict=True
    ):
        weights = rule.weights.astype(length.dtype)
        length += weights @ rate
        volume += weights @ (jnp.pi * state[:, 0] ** 2 * rate - part.bladder.volume_within_braid)
    return length, volume


def _energy(balance: Balance, solved: Solved) -> RealArray:
    """Return the strain energy [J], integrated along a straight path in strain from rest."""
    nodes, weights = (1 + _RULE[0]) / 2, _RULE[1] / 2

    def stored(state: RealArray, part: Part, pressure: RealArray) -> RealArray:
        radius, *_, stretch = full(state)
        strains = jnp.stack([*part.strains(radius, stretch), stretch])
        rates = jax.vmap(lambda share: part.resistances(share * strains, pressure))
        at, along = (jnp.asarray(one, radius.dtype) for one in (nodes, weights))
        return along @ rates(at) @ strains

    each = zip(balance.rules, balance.each(stored, solved.y), strict=True)
    return jnp.asarray(sum(jnp.sum(rule.weights.astype(w.dtype) * w) for rule, w in each))


def _margin(balance: Balance, solved: Solved) -> RealArray:
    free, mass = balance.free, 0.0
    for rule in balance.rules:
        values = rule.values[:, free]
        mass = mass + (values.T * rule.weights) @ values
    root = np.linalg.inv(np.linalg.cholesky(mass)).astype(balance.ends.dtype)
    least = jnp.linalg.eigvalsh(root @ reduced_hessian(solved.point.matrix) @ root.T)[0]
    return least * balance.force_scale / balance.radius_scale


def _shape(balance: Balance, solved: Solved, points: int) -> Shape:
    """Return the shape at points in each section, from polynomials through the values at its stations."""
    dtype, start, found = balance.ends.dtype, jnp.zeros_like(balance.length), []
    at = np.linspace(-1, 1, points)
    radii = jnp.zeros(len(balance.shares) * balance.order + 1, dtype)
    radii = radii.at[balance.free].set(solved.y[0][:-1] * balance.radius_scale)
    radii = radii.at[jnp.array([0, len(balance.shares)])].set(balance.ends)
    rates = balance.each(_axial_rate, solved.y)
    for i, (rule, part, state) in enumerate(
        zip(balance.rules, balance.parts, balance.states(solved.y), strict=True)
    ):
        size = rule.x.size
        to_series = np.linalg.inv(legvander(2 * rule.x - 1, size - 1))  # from values at stations
        through = (legvander(at, size - 1) @ to_series).astype(dtype)
        grown = legvander(at, size) @ legint(np.eye(size), lbnd=-1) @ to_series
        z = start + (grown * balance.shares[i] / 2).astype(dtype) @ rates[i]
        start = z[-1]
        radius: Any = modes(balance.shares, balance.order, i, at)[0].astype(dtype) @ radii
        stretch: Any = through @ state[:, 4] if part.elastic else jnp.zeros_like(radius)
        bladder = jax.tree.map(lambda leaf, t=through: t @ leaf, part.bladder)
        own = Part(part.braid, bladder, part.material)
        meridian, _, outer = own.place(radius, stretch)
        axial, hoop = own.strains(radius, stretch)
        stress = own.material.stresses(axial, hoop, balance.pressure)[0]
        along = balance.pressure * jnp.pi * radius**2 + state[0, 2]
        rubber = bladder.volume * stress / (1 + axial) / bladder.rest_length
        carried = jnp.hypot(along, through @ state[:, 3]) - rubber
        shape = Shape(
            position=z,
            radius=radius,
            braid_angle=jnp.arctan2(meridian, 2 * jnp.pi * part.braid.turns * radius),
            thread_tension=carried * part.braid.rest_thread_length * (1 + stretch) / meridian,
            axial_strain=axial,
            hoop_strain=hoop,
            thickness=bladder.thickness(meridian, outer),
        )
        found.append(shape)
    return jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *found)
