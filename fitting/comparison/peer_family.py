"""A published model as something that can be fitted: parameters, bounds, and how to build it."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

import famjax
from famjax.boundary.errors import InputError

from ..data import ForceData, Specimen
from ..families import EstimatedSource
from ..response import AbstractFamily

_MARGIN = 1.002  # at least, of thread length over the longest reading

Model: TypeAlias = famjax.AbstractMuscle
"""Whatever has `force(length, pressure)`."""

Values: TypeAlias = Mapping[str, Float[Array, ""]]
"""Parameters [SI] by name."""


@dataclasses.dataclass(frozen=True)
class PeerParameter:
    """One parameter of a peer, in SI.

    Attributes:
        name: by which it is reported.
        unit: SI unit, "" for a number.
        low, high: bounds; infinite ones only where `linear`.
        linear: the force is affine in it, together with all others that are so.
    """

    name: str
    unit: str
    low: float = -math.inf
    high: float = math.inf
    linear: bool = False


@dataclasses.dataclass(frozen=True)
class PeerFamily:
    """A published model and the box in which its parameters are sought.

    Attributes:
        label: authors and variant, for tables.
        parameters: what is fitted.
        build: the model of the values [SI] by name.
        note: what a reader of the table should know.
        origin: name and context from which the registry makes it; None for a family of one's own.
    """

    label: str
    parameters: tuple[PeerParameter, ...]
    build: Callable[[Values], Model]
    note: str = ""
    origin: "tuple[str, PeerContext] | None" = None

    @classmethod
    def of(
        cls,
        model: famjax.AbstractMuscle,
        label: str = "",
        bounds: Mapping[str, tuple[float, float]] | None = None,
    ) -> "PeerFamily":
        """Any model with declared parameters as a peer.

        Args:
            model: one of the family, such as `MyModel.template(rest_length=0.3)`.
            label: for tables; the name of the class unless given.
            bounds: (low, high) in SI by name, in place of the declared ranges; one value holds a
                parameter.

        Returns:
            The family.

        Raises:
            InputError: nothing is declared, an unknown name, or no finite range for a parameter in
                which the force is not linear.
        """
        if isinstance(model, type):
            raise InputError(
                f"give one of the family, as {model.__name__}.template(...) makes it; got the class"
            )
        declared, given = model.declared(), dict(bounds or {})
        unknown = [name for name in given if name not in declared]
        if unknown or not declared:
            raise InputError(
                f"{type(model).__name__} declares the parameters {', '.join(declared) or 'none'}; "
                f"got bounds of {', '.join(unknown) or 'none'}: declare fields by famjax.parameter"
            )
        ends = {n: given.get(n, (d.low, d.high)) for n, d in declared.items()}
        open_ended = [n for n, d in declared.items() if not d.linear
                      and not (math.isfinite(ends[n][0]) and math.isfinite(ends[n][1]))]  # fmt: skip
        if open_ended:
            raise InputError(
                f"{open_ended[0]} of {type(model).__name__} is searched and needs a finite range: "
                "declare it by famjax.parameter(low=..., high=...), or give bounds"
            )
        held = {n: low for n, (low, high) in ends.items() if low == high}
        parameters = tuple(
            PeerParameter(n, d.unit if isinstance(d.unit, str) else "", *ends[n], linear=d.linear)
            for n, d in declared.items()
            if n not in held
        )
        return cls(
            label or type(model).__name__,
            parameters,
            lambda values: model.with_parameters({**held, **values}),
        )

    @property
    def linear(self) -> tuple[PeerParameter, ...]:
        """Parameters that the fit solves for."""
        return tuple(p for p in self.parameters if p.linear)

    @property
    def nonlinear(self) -> tuple[PeerParameter, ...]:
        """Parameters that are searched from many starts."""
        return tuple(p for p in self.parameters if not p.linear)


class FamilyOfPeer(AbstractFamily):
    """A peer as the engine sees it.

    Attributes:
        nonlinear, linear: names of its parameters.
        make: the model of the values by name.
        origin: see `PeerFamily`.
    """

    nonlinear: tuple[str, ...] = eqx.field(static=True)
    linear: tuple[str, ...] = eqx.field(static=True)
    make: Callable[[Values], Model] = eqx.field(static=True)
    origin: "tuple[str, PeerContext] | None" = eqx.field(static=True)

    def build(self, values: Values) -> Model:
        """The model of these values."""
        return self.make(values)

    def rest_length(self, values: Values) -> Float[Array, ""]:
        """Of no account: a peer has no actuation path."""
        del values
        return jnp.zeros(())


@dataclasses.dataclass(frozen=True)
class PeerContext:
    """What the bounds depend on besides the model: the muscle and the ranges of its map.

    Attributes:
        specimen: the muscle.
        pressures: lowest and highest gauge pressure [Pa] of a loaded reading.
        longest: longest length [m] of a loaded reading.
        largest_force: [N].
    """

    specimen: Specimen
    pressures: tuple[float, float]
    longest: float
    largest_force: float

    @classmethod
    def of(cls, data: ForceData) -> "PeerContext":
        """The context of a force map."""
        pressure, length = data.pressure[data.loaded], data.length[data.loaded]
        ends = (float(pressure.min()), float(pressure.max()))
        return cls(data.specimen, ends, float(length.max()), data.max_force)

    @property
    def rest(self) -> float:
        """Rest length L0 [m]."""
        return self.specimen.rest_length

    @property
    def geometry(self) -> tuple[PeerParameter, PeerParameter]:
        """Braid diameter and angle at rest, with threads longer than the longest reading."""
        nominal = self.specimen.nominal_diameter
        low, high = (0.2 * nominal, 3 * nominal) if nominal else (3e-3, 80e-3)
        longest = math.asin(min(1.0, self.rest / (_MARGIN * self.longest)))
        flattest, steepest = math.radians(40), min(longest, math.radians(85))
        if steepest <= flattest:
            raise InputError(
                f"a loaded reading has the length {self.longest * 1e3:.5g} mm, too long for a "
                f"braid with a rest length of {self.rest * 1e3:.5g} mm: check the rest length and "
                "the unit of the length column"
            )
        return (
            PeerParameter("braid_diameter", "m", low, high),
            PeerParameter("braid_angle", "rad", flattest, steepest),
        )

    def braid(self, values: Values) -> famjax.Braid:
        """The braid with these values at rest."""
        return famjax.Braid.from_rest(
            diameter=values["braid_diameter"], braid_angle=values["braid_angle"], length=self.rest
        )

    def cylinder(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """The estimated geometry with these values at rest."""
        known = {name: values[name] for name in ("braid_diameter", "braid_angle")}
        return EstimatedSource(self.specimen).geometry(known)
