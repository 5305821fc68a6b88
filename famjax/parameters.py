"""Declare the numbers in a class as fields with unit, kind, range and scale."""

import dataclasses
import math
import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Generic, NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from ._arrays import Real, RealArray, as_number, as_real
from .boundary.units import UNITS

QUANTITY = "quantity"
"""Key of the declaration in a field's metadata."""

_KINDS = {
    "": "number",
    "Pa": "pressure",
    "m": "length",
    "rad": "angle",
    "N": "force",
    "m/N": "compliance",
    "1/N": "strain compliance",
}


@dataclasses.dataclass(frozen=True)
class WithUnit:
    """Unit of a declared number.

    Attributes:
        unit: SI unit, "" for a pure number; for an array with mixed units, a tuple with one unit per entry.
    """

    unit: str | tuple[str, ...] = ""


@dataclasses.dataclass(frozen=True)
class Declared(WithUnit):
    """Declaration of a number that can be identified.

    Attributes:
        unit: SI unit, "" for a pure number.
        name: name in options and reports.
        kind: kind of quantity, which determines the units that a user may choose.
        low, high: plausible range in `unit`; infinite for no limit.
        scale: typical magnitude in `unit`, for solvers; None to derive it from the range or the value.
        linear: True if the force is jointly affine in all numbers that are declared linear.
    """

    name: str | tuple[str, ...] = ""
    kind: str = "number"
    low: float = -math.inf
    high: float = math.inf
    scale: float | None = None
    linear: bool = False

    def __post_init__(self) -> None:
        """Reject an impossible range or scale."""
        if not self.low <= self.high:
            raise ValueError(
                "the range of a parameter must satisfy low <= high, got "
                f"low={self.low} and high={self.high}"
            )
        if self.scale is not None and not 0 < self.scale < math.inf:
            raise ValueError(f"the scale of a parameter must be finite and > 0, got {self.scale}")

    def entry(self, name: str, index: tuple[int, ...]) -> "Declared":
        """Return the declaration of one array entry, with its name."""
        if isinstance(self.unit, str):
            return dataclasses.replace(self, name=name)
        unit = self.unit[index[0]]
        return dataclasses.replace(self, name=name, unit=unit, kind=_KINDS.get(unit, unit))


def parameter(
    unit: str | tuple[str, ...] = "",
    *,
    kind: str | None = None,
    low: float = -math.inf,
    high: float = math.inf,
    scale: float | None = None,
    linear: bool = False,
    name: str | tuple[str, ...] | None = None,
    default: Any = dataclasses.MISSING,
) -> Any:
    """Declare a field for a number, or an array of numbers, that can be identified.

    The field is a scalar unless its annotation has axes, as in `Float[Array, " order"]`. In that case,
    each entry is a parameter, named by formatting `name` with the index of the entry, counted from 1.

    Args:
        unit: SI unit, such as "Pa", "m", "rad" or "N/m"; "" for a pure number. For an array with mixed
            units, a tuple with one unit per entry.
        kind: kind of quantity. By default "pressure" for Pa, "length" for m, "angle" for rad, "force"
            for N, "compliance" for m/N, "strain compliance" for 1/N, and the unit itself for any other.
            Use `kind="stress"` for a stress or a modulus.
        low: lower end of the plausible range, in `unit`.
        high: upper end of the plausible range.
        scale: typical magnitude, in `unit`; by default derived from the range or the current value.
        linear: True if the force is jointly affine in this number and all others that are declared linear.
        name: name of the parameter, if it differs from that of the field. For an array, a pattern such as
            "E_{}", or one name per entry.
        default: default of the field; None for an optional number.

    Returns:
        The field, for the body of a class derived from `Parametrised`.

    >>> from famjax.terms import AbstractForceTerm
    >>> from jaxtyping import Array, Float
    >>> class Tape(AbstractForceTerm):
    ...     stiffness: Float[Array, ""] = parameter("N/m", low=0.0, linear=True)
    ...
    ...     def force(self, at, pressure):
    ...         return self.stiffness * (at.length - 0.3)
    >>> Tape(40.0).declared()["stiffness"].unit
    'N/m'
    """
    for one in (unit,) if isinstance(unit, str) else unit:
        if any(scale.get(one, 1.0) != 1.0 for scale in UNITS.values()):
            raise ValueError(
                f"the unit of a parameter must be an SI unit, such as Pa or m, got {one!r}"
            )
    if kind is not None and kind not in UNITS:
        raise ValueError(f"unknown kind {kind!r}; available: {', '.join(UNITS)}")
    if kind is None:
        kind = _KINDS.get(unit, unit) if isinstance(unit, str) else "number"
    return _field(Declared(unit, name or "", kind, low, high, scale, linear), default)


def number(unit: str = "", *, default: Any = dataclasses.MISSING) -> Any:
    """Declare a field for a number, or an array of numbers, that is never identified.

    Args:
        unit: SI unit, "" for a pure number.
        default: default of the field.

    Returns:
        The field, for the body of an `equinox.Module`.
    """
    return _field(WithUnit(unit), default)


def declaration(field: dataclasses.Field[Any]) -> WithUnit | None:
    """Return the declaration of a field; None if the field is not a declared number."""
    return field.metadata.get(QUANTITY)


def _field(quantity: WithUnit, default: Any) -> Any:
    given = {} if default is dataclasses.MISSING else {"default": default}
    return eqx.field(converter=_real_or_none, metadata={QUANTITY: quantity}, **given)


def _real_or_none(value: Any) -> Any:
    return None if value is None else as_number(value)


_Self = TypeVar("_Self", bound="Parametrised")


if typing.TYPE_CHECKING:

    @typing.dataclass_transform(field_specifiers=(dataclasses.field, eqx.field, parameter, number))
    class _Declaring(type(eqx.Module)): ...

else:
    _Declaring = type(eqx.Module)


class Parametrised(eqx.Module, metaclass=_Declaring):
    """A module with declared parameters: its own, and those of the modules in its fields.

    If two parameters have the same name, the later name is prefixed with its field, as in
    "terms_2.stiffness". A class whose natural parameters are not its fields must override all of
    `parameters`, `declared` and `with_parameters`.
    """

    def parameters(self) -> dict[str, RealArray]:
        """Return the current parameter values by name, in the declared units, each of shape ()."""
        inside: dict[_Where, dict[str, RealArray]] = {
            where: child.parameters() for where, child in _children(self)
        }
        found = {}
        for name, place in _places(self).items():
            held = getattr(self, place.where[0])
            if isinstance(place.entry, str):
                found[name] = inside[place.where][place.entry]
            else:
                found[name] = held[place.entry] if place.entry else held
        return found

    def declared(self) -> dict[str, Declared]:
        """Return the declarations by parameter name: unit, kind, range, scale and linearity."""
        return {name: place.declared for name, place in _places(self).items()}

    def with_parameters(self: _Self, values: Mapping[str, Real]) -> _Self:
        """Return the module with new values for some parameters; differentiable and traceable.

        Args:
            values: values by name, in the declared units, each of shape ().

        Raises:
            ValueError: a name is unknown, or a value is an array.
        """
        places = _places(self)
        own: dict[str, dict[tuple[int, ...], RealArray]] = {}
        inside: dict[_Where, dict[str, RealArray]] = {}
        for name, value in checked_values(self, values).items():
            where, entry = places[name].where, places[name].entry
            if isinstance(entry, str):
                inside.setdefault(where, {})[entry] = value
            else:
                own.setdefault(where[0], {})[entry] = value
        module = self  # no constructor runs again
        for field, new in own.items():
            old = getattr(module, field)
            # One stack of all entries compiles faster than one scatter for each.
            every = [new[at] if at in new else old[at] for at in np.ndindex(jnp.shape(old))]
            array = jnp.stack(every).reshape(jnp.shape(old)) if jnp.ndim(old) else every[0]
            module = _with(module, field, array)
        for (field, at), of_child in inside.items():
            held = getattr(module, field)
            if at is None:
                new = held.with_parameters(of_child)
            else:
                new = type(held)([*held[:at], held[at].with_parameters(of_child), *held[at + 1 :]])
            module = _with(module, field, new)
        return module

    def parameter_name(self, field: str, index: tuple[int, ...]) -> str:
        """Return the parameter name of an entry in a declared field, by default from the declaration.

        Args:
            field: name of the field.
            index: index in the array, () for a scalar.
        """
        spec = declaration(next(one for one in dataclasses.fields(self) if one.name == field))
        assert isinstance(spec, Declared)
        if isinstance(spec.name, tuple):
            return spec.name[index[0]]
        pattern, counted = spec.name or field, [str(i + 1) for i in index]
        return pattern.format(*counted) if "{" in pattern else "_".join([pattern, *counted])

    def __repr__(self) -> str:
        return "\n".join(_described(self))

    @classmethod
    def template(cls: type[_Self], **fields: Any) -> _Self:
        """Create an instance with every scalar parameter in the middle of its range.

        If only one bound is finite, the parameter lies one scale inside that bound. If neither is finite,
        the parameter equals its scale.

        Args:
            fields: values of fields. They are required for fields with neither a default nor a declaration.

        Raises:
            ValueError: a missing field has no default and is not a scalar parameter.

        >>> from famjax.materials import NeoHookeanMaterial
        >>> NeoHookeanMaterial.template().parameters().keys()
        dict_keys(['shear_modulus'])
        """
        given = dict(fields)
        for field in dataclasses.fields(cls):
            none = field.default is field.default_factory is dataclasses.MISSING
            if field.name in given or not field.init or not none:
                continue
            spec = declaration(field)
            annotation: Any = field.type
            array = bool(getattr(annotation, "dims", ())) and annotation.index_variadic is None
            if not isinstance(spec, Declared) or array:
                raise ValueError(
                    f"the field {field.name!r} of {cls.__name__} has no default and is not a scalar "
                    f"parameter: pass it, as in {cls.__name__}.template({field.name}=...)"
                )
            given[field.name] = _middle(spec)
        # Conversion by device_put compiles nothing.
        host = (float, np.ndarray)
        return cls(**{n: jax.device_put(v) if isinstance(v, host) else v for n, v in given.items()})


def _described(part: eqx.Module) -> list[str]:
    """Describe a module in lines of text: its class, then every field with value and unit."""
    lines = [type(part).__name__]
    for field in dataclasses.fields(part):
        value, spec = getattr(part, field.name), declaration(field)
        parts = value if isinstance(value, tuple) else (value,)
        if parts and all(isinstance(one, eqx.Module) for one in parts):
            for one in parts:
                first, *rest = _described(one)
                lines += [f"  {field.name}: {first}", *(f"  {line}" for line in rest)]
            continue
        text = eqx.tree_pformat(value)
        if isinstance(value, jax.Array | np.ndarray) and not isinstance(value, Tracer):
            text = np.array2string(np.asarray(value), formatter={"all": "{:.6g}".format})
        unit = spec.unit if spec is not None and isinstance(spec.unit, str) else ""
        lines.append(f"  {field.name}: {text} {unit}".rstrip())
    return lines


def _middle(declared: Declared) -> float:
    """Return the middle of a range, a value one scale inside its only finite bound, or the scale."""
    scale = 1.0 if declared.scale is None else declared.scale
    low, high = declared.low, declared.high
    if math.isinf(high):
        return scale if math.isinf(low) else low + scale
    return high - scale if math.isinf(low) else (low + high) / 2


def checked_values(module: Parametrised, values: Mapping[str, Real]) -> dict[str, RealArray]:
    """Check parameter values by name, and return them as scalar arrays.

    Raises:
        ValueError: a name is unknown, or a value is an array.
    """
    known = module.declared()
    for name, value in values.items():
        if name not in known:
            raise ValueError(
                f"{type(module).__name__} has no parameter {name!r}; it has {', '.join(known)}"
            )
        if jnp.ndim(value) != 0:
            raise ValueError(
                f"a parameter must be one number; got shape {jnp.shape(value)} for {name!r}. For many "
                "muscles, apply jax.vmap to a function that creates one"
            )
    return {name: as_number(value) for name, value in values.items()}


_Where: TypeAlias = tuple[str, int | None]
"""A field, and an index into the field if it contains several modules."""


class _Place(NamedTuple):
    """Location of a parameter.

    Attributes:
        declared: declaration with its name.
        where: field of the module that contains the parameter, or the child module with the parameter.
        entry: index in an array, or name within the child module.
    """

    declared: Declared
    where: _Where
    entry: tuple[int, ...] | str


def _places(module: Parametrised) -> dict[str, _Place]:
    """Return the location of every parameter of a module and its children, by name."""
    found: dict[str, _Place] = {}
    children = dict(_children(module))
    for field in dataclasses.fields(module):
        value, spec = getattr(module, field.name, None), declaration(field)
        if isinstance(spec, Declared) and value is not None:
            for index in np.ndindex(jnp.shape(value)):
                name = module.parameter_name(field.name, index)
                if name in found:
                    name = f"{field.name}.{name}"
                found[name] = _Place(spec.entry(name, index), (field.name, None), index)
        for where, child in children.items():
            if where[0] != field.name:
                continue
            label = field.name if where[1] is None else f"{field.name}_{where[1] + 1}"
            for inner, one in child.declared().items():
                name = inner if inner not in found else f"{label}.{inner}"
                found[name] = _Place(dataclasses.replace(one, name=name), where, inner)
    return found


def _children(module: Parametrised) -> Iterator[tuple[_Where, Parametrised]]:
    """Yield the child modules in the fields of a module, including those in tuples and lists."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name, None)
        if isinstance(value, Parametrised):
            yield (field.name, None), value
        elif isinstance(value, tuple | list):
            for at, one in enumerate(value):
                if isinstance(one, Parametrised):
                    yield (field.name, at), one


def _with(module: _Self, field: str, value: Any) -> _Self:
    return eqx.tree_at(lambda m: getattr(m, field), module, value)


_Model = TypeVar("_Model", bound=Parametrised)


class Apart(eqx.Module, Generic[_Model]):
    """A model, and its free parameters with their bounds, all scaled to order one.

    A parameter with two finite bounds is scaled to 0 at the lower bound and 1 at the upper bound. Any
    other parameter is divided by its scale.

    Attributes:
        whole: the model; its other parameters keep their values.
        names: names of the free parameters.
        scaled: current values, scaled, shape (free,).
        low, high: scaled bounds, shape (free,); infinite for no bound.
        offset, scale: value = offset + scale * scaled, in the declared units, shape (free,).
    """

    whole: _Model
    names: tuple[str, ...] = eqx.field(static=True)
    scaled: Float[Array, " free"]
    low: Float[Array, " free"]
    high: Float[Array, " free"]
    offset: Float[Array, " free"]
    scale: Float[Array, " free"]

    @property
    def si(self) -> Float[Array, " free"]:
        """Current values in the declared units."""
        return self.offset + self.scale * self.scaled

    def values(self, scaled: Real) -> dict[str, RealArray]:
        """Return the values of the free parameters by name, in the declared units."""
        values = self.offset + self.scale * as_real(scaled)
        return {name: values[i] for i, name in enumerate(self.names)}

    def muscle(self, scaled: Real) -> _Model:
        """Return the model with these scaled parameters; works under jit, grad and vmap.

        The caller must keep `scaled` between `low` and `high`. To work in R^n instead, use `unbounded` and
        `scaled_from_unbounded`.
        """
        return self.whole.with_parameters(self.values(scaled))

    def scaled_from_unbounded(self, z: Real) -> Float[Array, " free"]:
        """Map z in R^n, smoothly and one to one, to scaled parameters strictly within their bounds.

        For a parameter with two bounds, the map is a logistic curve; with one bound, it is softplus; and
        without bounds, it is the identity.
        """
        z = as_real(z)
        lower, upper, low, high = self._ends
        curves = [jax.nn.sigmoid(z), low + jax.nn.softplus(z), high - jax.nn.softplus(-z)]
        return jnp.select([lower & upper, lower, upper], curves, z)

    @property
    def unbounded(self) -> Float[Array, " free"]:
        """The point z in R^n that `scaled_from_unbounded` maps to the current values.

        Raises:
            ValueError: a current value is not strictly within its bounds.
        """
        inside = (self.scaled > self.low) & (self.scaled < self.high)
        if not isinstance(inside, Tracer) and not np.all(inside):
            outside = [n for n, one in zip(self.names, np.asarray(inside), strict=True) if not one]
            raise ValueError(
                f"{', '.join(outside)}: no point in R^n corresponds to a value at or beyond its bounds. "
                "Start strictly within the bounds, or choose other bounds"
            )
        lower, upper, low, high = self._ends
        share = jnp.where(lower & upper, self.scaled, 0.5)
        up = _inverse_softplus(jnp.where(lower & ~upper, self.scaled - low, 1.0))
        down = -_inverse_softplus(jnp.where(upper & ~lower, high - self.scaled, 1.0))
        logit = jnp.log(share) - jnp.log1p(-share)
        return jnp.select([lower & upper, lower, upper], [logit, up, down], self.scaled)

    @property
    def _ends(self) -> tuple[Bool[Array, " free"], Bool[Array, " free"], RealArray, RealArray]:
        """Return masks of the parameters with lower and upper bounds, and the bounds; 0 if infinite."""
        lower, upper = jnp.isfinite(self.low), jnp.isfinite(self.high)
        return lower, upper, jnp.where(lower, self.low, 0.0), jnp.where(upper, self.high, 0.0)


def take_apart(
    model: _Model,
    free: Iterable[str] | None = None,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> Apart[_Model]:
    """Split a model into a vector of bounded free parameters, scaled to order one, and the rest.

    Args:
        model: a muscle, or any other module with declared parameters.
        free: names of the parameters that may change; by default all declared ones.
        bounds: (low, high) by name, in the declared units, in place of the declared ranges.

    Returns:
        `Apart` with `.scaled`, `.low`, `.high` and `.names`, and with the inverse, `.muscle(scaled)`.

    Raises:
        ValueError: a name is unknown or repeated, a bounded parameter is not free, or a lower bound is
            not below the upper one.

    >>> from famjax.materials import NeoHookeanMaterial
    >>> apart = take_apart(NeoHookeanMaterial(2e5), bounds={"shear_modulus": (0.0, 1e6)})
    >>> print(apart.names, apart.scaled, apart.muscle(apart.scaled * 2).shear_modulus)
    ('shear_modulus',) [0.2] 400000.0
    """
    known, values = model.declared(), model.parameters()
    names = tuple(known if free is None else free)
    given = {} if bounds is None else dict(bounds)
    for name in (*names, *given):
        if name not in known:
            raise ValueError(
                f"{type(model).__name__} has no parameter {name!r}; it has {', '.join(known)}"
            )
    if len(set(names)) < len(names):
        raise ValueError(f"each free parameter must be named only once, got {', '.join(names)}")
    for name, (low, high) in given.items():
        if name not in names:
            raise ValueError(f"bounds apply only to free parameters; {name!r} is not free")
        if not low < high:
            raise ValueError(
                f"the lower bound of {name!r} must be below the upper one, got {low} and {high}. "
                "To fix a parameter, omit it from `free`"
            )
    at = jnp.stack([values[name] for name in names]) if names else jnp.zeros(0)
    ends = [given.get(name, (known[name].low, known[name].high)) for name in names]
    low, high = (jnp.asarray(end, at.dtype) for end in np.array(ends, float).reshape(-1, 2).T)
    ranged = jnp.isfinite(low) & jnp.isfinite(high)
    offset = jnp.where(ranged, low, 0.0)
    magnitude = jnp.stack([_scale(known[n], values[n]) for n in names]) if names else at
    scale = jnp.where(ranged, high - low, magnitude)
    return Apart(
        whole=model,
        names=names,
        scaled=(at - offset) / scale,
        low=(low - offset) / scale,
        high=(high - offset) / scale,
        offset=offset,
        scale=scale,
    )


def _scale(declared: Declared, value: RealArray) -> RealArray:
    """Return the declared scale; if there is none, the magnitude of the value, or 1 for a value of 0."""
    if declared.scale is not None:
        return jnp.asarray(declared.scale, value.dtype)
    size = jax.lax.stop_gradient(jnp.abs(value))
    return jnp.where(size > 0, size, 1.0)


def _inverse_softplus(x: RealArray) -> RealArray:
    """Return the z for which log(1 + exp(z)) = x > 0."""
    return x + jnp.log(-jnp.expm1(-x))
