"""The base of every class whose numbers can be identified: its parameters by name, and others."""

import dataclasses
import typing
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import Real, RealArray, as_number
from .declared import Declared, declaration, number, parameter

_Self = TypeVar("_Self", bound="Parametrised")


if typing.TYPE_CHECKING:

    @typing.dataclass_transform(field_specifiers=(dataclasses.field, eqx.field, parameter, number))
    class _Declaring(type(eqx.Module)): ...

else:
    _Declaring = type(eqx.Module)


class Parametrised(eqx.Module, metaclass=_Declaring):
    """A module with declared parameters: its own and those of the modules in its fields.

    Of two parameters with one name the later one gets the field that it stands in as prefix, as in
    "terms_2.stiffness". Where the natural parameters are not the fields, a class overrides
    `parameters`, `declared` and `with_parameters` together.
    """

    def parameters(self) -> dict[str, RealArray]:
        """The present values by name, in the declared units, each of shape ()."""
        return _values(self)

    def declared(self) -> dict[str, Declared]:
        """The declarations by name: unit, kind, range, scale, linearity."""
        return {name: place.declared for name, place in _places(self).items()}

    def with_parameters(self: _Self, values: Mapping[str, Real]) -> _Self:
        """The same module with other values of some parameters, everything else as it is.

        Args:
            values: by name, in the declared units, each of shape ().

        Returns:
            The module. Differentiable in the values, and traceable.

        Raises:
            ValueError: an unknown name, or a value that is an array.
        """
        return _replaced(self, checked_values(self, values))

    def parameter_name(self, field: str, index: tuple[int, ...]) -> str:
        """The name of one entry of a declared field; by default as the declaration says.

        Args:
            field: name of the field.
            index: place in the array, () for a scalar.

        Returns:
            The name.
        """
        specs = {one.name: declaration(one) for one in dataclasses.fields(self)}
        spec = specs[field]
        return entry_name(spec, field, index) if isinstance(spec, Declared) else field

    @classmethod
    def template(cls: type[_Self], **fields: Any) -> _Self:
        """An instance to start from; see `famjax.parameters.template`."""
        return _template(cls, fields)


_Module = TypeVar("_Module", bound=eqx.Module)
_Family = TypeVar("_Family", bound=Parametrised)


def template(cls: type[_Family], **fields: Any) -> _Family:
    """An instance of a class whose parameters are in the middle of their ranges.

    Where a range has no middle, a parameter is its scale above its lower end, or its scale. So a law
    can be named by its class alone.

    Args:
        cls: the class.
        fields: what is known; what has neither a default nor a declaration must be among them.

    Returns:
        The instance.

    Raises:
        ValueError: a field is missing that has no default and is no scalar parameter.

    >>> from famjax.materials import NeoHookeanMaterial
    >>> template(NeoHookeanMaterial).parameters().keys()
    dict_keys(['shear_modulus'])
    """
    return cls.template(**fields)


def middle(declared: Declared) -> float:
    """The middle of a range, or a value one scale from its only end, or the scale."""
    scale = 1.0 if declared.scale is None else declared.scale
    low, high = declared.low, declared.high
    if np.isfinite(low) and np.isfinite(high):
        return (low + high) / 2
    if np.isfinite(low):
        return low + scale
    return high - scale if np.isfinite(high) else scale


def checked_values(module: Parametrised, values: Mapping[str, Real]) -> dict[str, RealArray]:
    """The values as scalars.

    Raises:
        ValueError: an unknown name, or a value that is an array.
    """
    known = module.declared()
    for name, value in values.items():
        if name not in known:
            raise ValueError(
                f"{type(module).__name__} has no parameter {name!r}; it has {', '.join(known)}"
            )
        if jnp.ndim(value) != 0:
            raise ValueError(
                f"a parameter is one number; got the shape {jnp.shape(value)} for {name!r}. For "
                "many muscles at once map the function that makes one, by jax.vmap"
            )
    return {name: as_number(value) for name, value in values.items()}


class _Place(NamedTuple):
    """Where a parameter stands.

    Attributes:
        declared: with its name.
        field: of the module.
        at: place of the child module in a field that holds several, else None.
        entry: the index in an array, or the name within the child.
    """

    declared: Declared
    field: str
    at: int | None
    entry: tuple[int, ...] | str


def _places(module: eqx.Module) -> dict[str, _Place]:
    """Every parameter of a module and of its children, by name."""
    found: dict[str, _Place] = {}
    for field in dataclasses.fields(module):
        value, spec = getattr(module, field.name, None), declaration(field)
        if isinstance(spec, Declared) and value is not None:
            for index in np.ndindex(jnp.shape(value)):
                name = (
                    module.parameter_name(field.name, index)
                    if isinstance(module, Parametrised)
                    else entry_name(spec, field.name, index)
                )
                if name in found:
                    name = f"{field.name}.{name}"
                found[name] = _Place(spec.entry(name, index), field.name, None, index)
        for at, child in _children(value):
            label = field.name if at is None else f"{field.name}_{at + 1}"
            for inner, one in _declared(child).items():
                name = inner if inner not in found else f"{label}.{inner}"
                own = dataclasses.replace(one, name=name)
                found[name] = _Place(own, field.name, at, inner)
    return found


def _values(module: eqx.Module) -> dict[str, RealArray]:
    """Every parameter's present value, by name."""
    found: dict[str, RealArray] = {}
    of_children: dict[tuple[str, int | None], dict[str, RealArray]] = {}
    for name, place in _places(module).items():
        held = getattr(module, place.field)
        if not isinstance(place.entry, str):
            found[name] = held[place.entry] if place.entry else held
            continue
        at = place.field, place.at
        if at not in of_children:
            child = held if place.at is None else held[place.at]
            of_children[at] = (
                child.parameters() if isinstance(child, Parametrised) else _values(child)
            )
        found[name] = of_children[at][place.entry]
    return found


def entry_name(spec: Declared, field: str, index: tuple[int, ...]) -> str:
    """The name of an entry as its declaration says it."""
    if isinstance(spec.name, tuple):
        return spec.name[index[0]]
    pattern, counted = spec.name or field, [str(i + 1) for i in index]
    return pattern.format(*counted) if "{" in pattern else "_".join([pattern, *counted])


def _children(value: Any) -> Iterator[tuple[int | None, eqx.Module]]:
    """The modules in a field: itself, or those in a tuple or list."""
    if isinstance(value, eqx.Module):
        yield None, value
    elif isinstance(value, tuple | list):
        for at, one in enumerate(value):
            if isinstance(one, eqx.Module):
                yield at, one


def _declared(child: eqx.Module) -> dict[str, Declared]:
    """Declarations of a child, which may be a module that knows of none itself."""
    if isinstance(child, Parametrised):
        return child.declared()
    return {name: place.declared for name, place in _places(child).items()}


def _replaced(module: _Module, values: Mapping[str, RealArray]) -> _Module:
    """The module with other values; no constructor runs again."""
    places = _places(module)
    entries: dict[str, dict[tuple[int, ...], RealArray]] = {}
    inner: dict[tuple[str, int | None], dict[str, RealArray]] = {}
    for name, value in values.items():
        place = places[name]
        if isinstance(place.entry, str):
            inner.setdefault((place.field, place.at), {})[place.entry] = value
        else:
            entries.setdefault(place.field, {})[place.entry] = value
    for field, new in entries.items():
        old = getattr(module, field)
        # One stack of all entries, not one scatter for each: less to compile.
        every = [new[index] if index in new else old[index] for index in np.ndindex(jnp.shape(old))]
        array = jnp.stack(every).reshape(jnp.shape(old)) if jnp.ndim(old) else every[0]
        module = _with(module, field, array)
    for (field, at), of_child in inner.items():
        held = getattr(module, field)
        child = held if at is None else held[at]
        new = (
            child.with_parameters(of_child)
            if isinstance(child, Parametrised)
            else _replaced(child, of_child)
        )
        if at is not None:
            new = type(held)([*held[:at], new, *held[at + 1 :]])
        module = _with(module, field, new)
    return module


def _with(module: _Module, field: str, value: Any) -> _Module:
    return eqx.tree_at(lambda m: getattr(m, field), module, value)


def _template(cls: type[_Family], fields: Mapping[str, Any]) -> _Family:
    given = dict(fields)
    for field in dataclasses.fields(cls):
        has_default = (
            field.default is not dataclasses.MISSING
            or field.default_factory is not dataclasses.MISSING
        )
        if field.name in given or not field.init or has_default:
            continue
        spec = declaration(field)
        annotation: Any = field.type
        array = bool(getattr(annotation, "dims", ())) and annotation.index_variadic is None
        if not isinstance(spec, Declared) or array:
            raise ValueError(
                f"the field {field.name!r} of {cls.__name__} has no default and is no scalar "
                f"parameter: give it, as in template({cls.__name__}, {field.name}=...)"
            )
        given[field.name] = middle(spec)
    # JAX compiles a program for each shape that it takes in as a number or NumPy array; not so here.
    host = (float, np.ndarray)
    return cls(**{n: jax.device_put(v) if isinstance(v, host) else v for n, v in given.items()})
