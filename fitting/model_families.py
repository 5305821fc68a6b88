"""Families built from any model with declared parameters, including the published models.

The bounds of the published models are wide, so that each model fits as well as it can. Braid
diameter and angle are free parameters and need not describe a muscle that can be built.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax import peers
from famjax.boundary.errors import InputError
from famjax.parameters import Declared

from .data import ForceData, Specimen
from .families import EstimatedSource
from .response import AbstractFamily, Values

_LONGEST = 1.002  # minimum ratio of thread length to longest reading
_DEADBAND = Declared("Pa", "deadband_pressure", low=-200e3, high=200e3)
"""Negative values allow for an overestimated rest length, which has almost the same effect."""

Translate = Callable[[Any, dict[str, Any]], Mapping[str, Any]]
"""Function that converts a family's parameter values to those of the model."""


class ModelFamily(AbstractFamily):
    """A model and its free parameters, without a constraint along the actuation path.

    Attributes:
        model: model that provides all fixed values.
        declared: free parameters with bounds; only linear ones may be unbounded.
        translate: converts the declared parameters to those of the model; None if they are the same.
        label: authors and variant, for tables.
        note: remark for readers of the table.
    """

    model: Any
    declared: tuple[Declared, ...] = eqx.field(static=True)
    translate: Translate | None = eqx.field(static=True, default=None)
    label: str = eqx.field(static=True, default="")
    note: str = eqx.field(static=True, default="")
    nonlinear: tuple[str, ...] = eqx.field(static=True, init=False)

    def __post_init__(self) -> None:
        """Collect the names of the nonlinear parameters."""
        self.nonlinear = tuple(str(d.name) for d in self.declared if not d.linear)

    @property
    def linear(self) -> tuple[str, ...]:
        """Names of the parameters in which the force is affine."""
        return tuple(str(d.name) for d in self.declared if d.linear)

    @classmethod
    def of(
        cls,
        model: famjax.AbstractMuscle,
        label: str = "",
        bounds: Mapping[str, tuple[float, float]] | None = None,
    ) -> "ModelFamily":
        """Create a family from any model with declared parameters.

        Args:
            model: instance of the model, such as `MyModel.template(rest_length=0.3)`.
            label: label for tables; defaults to the class name.
            bounds: (low, high) in SI by name, in place of the declared ranges. Equal bounds fix a
                parameter.

        Returns:
            The family.

        Raises:
            InputError: the model declares no parameters, a name is unknown, or a nonlinear parameter
                has no finite range.
        """
        if isinstance(model, type):
            raise InputError(
                f"give an instance, as {model.__name__}.template(...) makes it; got the class"
            )
        known, given = model.declared(), dict(bounds or {})
        unknown = [name for name in given if name not in known]
        if unknown or not known:
            raise InputError(
                f"{type(model).__name__} declares the parameters {', '.join(known) or 'none'}; "
                f"got bounds of {', '.join(unknown) or 'none'}: declare fields by famjax.parameter"
            )
        ends = {name: given.get(name, (d.low, d.high)) for name, d in known.items()}
        for name, d in known.items():
            if not d.linear and not np.isfinite(ends[name]).all():
                raise InputError(
                    f"{name} of {type(model).__name__} is searched and needs a finite range: "
                    "declare it by famjax.parameter(low=..., high=...), or give bounds"
                )
        held = {name: low for name, (low, high) in ends.items() if low == high}
        free = tuple(bounded(d, *ends[name]) for name, d in known.items() if name not in held)
        label = label or type(model).__name__
        return cls(model.with_parameters(held) if held else model, free, label=label)

    def build(self, values: Values) -> Any:
        """Build the model from these values."""
        given = dict(values)
        return self.model.with_parameters(
            given if self.translate is None else self.translate(self.model, given)
        )

    def rest_length(self, values: Values) -> Float[Array, ""]:
        """Rest length L0 [m] of the model; zero if it has none, since no path is evaluated."""
        del values
        try:
            return jnp.asarray(self.model.rest_length)
        except (AttributeError, ValueError):
            return jnp.zeros(())


def bounded(declared: Declared, low: float, high: float) -> Declared:
    """Return the declaration with a different range."""
    unit = declared.unit if isinstance(declared.unit, str) else ""
    return Declared(unit, declared.name, low=low, high=high, linear=declared.linear)


def peer_families(data: ForceData) -> dict[str, ModelFamily]:
    """Return all published models as families with bounds for a force map, by name.

    Args:
        data: force map; its specimen and ranges set the bounds. Maps with the same specimen and range
            share compiled programs.
    """
    pressure, length = data.pressure[data.loaded], data.length[data.loaded]
    ends = float(pressure.min()), float(pressure.max())
    return _peers(data.specimen, ends, float(length.max()))


def _braid_at_rest(specimen: Specimen, longest: float) -> tuple[Declared, Declared]:
    """Bounds of braid diameter and angle at rest; the threads exceed the longest reading [m]."""
    rest, nominal = specimen.rest_length, specimen.nominal_diameter
    low, high = (0.2 * nominal, 3 * nominal) if nominal else (3e-3, 80e-3)
    flattest = math.radians(40)
    steepest = min(math.asin(min(1.0, rest / (_LONGEST * longest))), math.radians(85))
    if steepest <= flattest:
        raise InputError(
            f"a loaded reading has the length {longest * 1e3:.5g} mm, too long for a "
            f"braid with a rest length of {rest * 1e3:.5g} mm: check the rest length and "
            "the unit of the length column"
        )
    return (
        Declared("m", "braid_diameter", low=low, high=high),
        Declared("rad", "braid_angle", low=flattest, high=steepest),
    )


@functools.lru_cache(maxsize=32)
def _peers(
    specimen: Specimen, pressures: tuple[float, float], longest: float
) -> dict[str, ModelFamily]:
    rest, P = specimen.rest_length, pressures[1]
    D, angle = both = _braid_at_rest(specimen, longest)
    held = specimen.nominal_diameter or D.low
    source = EstimatedSource(specimen)

    def braid(given: dict[str, Any]) -> famjax.Braid:
        diameter, at_rest = given.pop("braid_diameter", held), given.pop("braid_angle")
        return famjax.Braid.from_rest(diameter=diameter, braid_angle=at_rest, length=rest)

    def of_braid(model: Any, given: dict[str, Any]) -> Mapping[str, Any]:
        if "rest_diameter" in model.declared():
            given["rest_diameter"] = given.get("braid_diameter", held)
        made = braid(given)
        return {**given, "rest_thread_length": made.rest_thread_length, "turns": made.turns}

    def of_stretching(model: Any, given: dict[str, Any]) -> Mapping[str, Any]:
        del model
        strain, made = given.pop("thread_strain"), braid(given)
        tension = P * rest * made.rest_thread_length / (2 * math.pi * made.turns**2)
        return {"rest_thread_length": made.rest_thread_length, "turns": made.turns,
                "braid_compliance": strain / tension}  # fmt: skip

    def of_cylinder(model: Any, given: dict[str, Any]) -> Mapping[str, Any]:
        if "bladder_diameter" in model.declared():  # the bladder lies within the threads
            cylinder: Any = source.geometry(given)
            given["bladder_diameter"] = cylinder.bladder.rest_diameter
        return given

    threads = famjax.Braid.from_rest(diameter=held, braid_angle=angle.low, length=rest)
    stretching = famjax.braids.CompliantBraid.of(threads, 0.0)
    gaylord, tondu = peers.Gaylord(threads), peers.TonduLopez(threads, rest)
    cylinder = source.geometry({"braid_diameter": held, "braid_angle": angle.low})
    elastic = famjax.Muscle(cylinder, famjax.PolynomialMaterial([1e6]))
    mooney = famjax.Muscle(cylinder, famjax.materials.MooneyRivlinMaterial(1e5, 1e5))
    strain = Declared("", "thread_strain", low=0.0, high=0.5)
    late = (*both, _DEADBAND)
    rows: list[tuple] = [
        ("gaylord", "Gaylord 1958", gaylord, both, of_braid),
        ("gaylord_deadband", "Gaylord, deadband", gaylord, late, of_braid),
        ("gaylord_offset", "Gaylord, force offset", gaylord, (*both, "force_offset"), of_braid),
        ("davis", "Davis 2003, stretching braid", peers.Gaylord(stretching), (*both, strain), of_stretching,
         "thread_strain is that at rest and the highest pressure, of unstretched geometry"),
        ("tondu_lopez", "Tondu & Lopez 2000, k", tondu, (*both, "k_far"), of_braid),
        ("tondu_lopez_deadband", "Tondu & Lopez, k, deadband", tondu, (*late, "k_far"), of_braid),
        ("tondu_lopez_pressure", "Tondu & Lopez, k(P)", tondu, (*both, "k_far", "k_rise"), of_braid),
        ("ferraresi", "Ferraresi 2001", elastic, (*both, "E_1"), of_cylinder),
        ("ferraresi_deadband", "Ferraresi, deadband", elastic, (*late, "E_1"), of_cylinder),
        ("kothera", "Kothera 2009, deadband", peers.Kothera(elastic), (*late, "E_1"), of_cylinder),
        ("klute_hannaford", "Klute & Hannaford 2000, deadband", mooney, (*late, "C10", "C01"),
         of_cylinder),
    ]  # fmt: skip
    if pressures[0] < pressures[1]:
        ends = " and ".join(f"{one / 1e3:.4g}" for one in pressures)
        for name, label, order, low in (
            ("robinson_1", "Robinson 2015, order 1", 1, -math.inf),
            ("robinson_2", "Robinson 2015, order 2", 2, -math.inf),
            ("pillsbury_2", "Pillsbury 2015, order 2, positive", 2, 0.0),
        ):
            powers = famjax.materials.PlainPowerMaterial(pressures, np.ones((2, order)))
            model = famjax.Muscle(cylinder, powers)
            laws = [bounded(d, low, math.inf) for d in model.declared().values() if d.linear]
            note = f"nodes 1 and 2 are {ends} kPa"
            rows.append((name, label, model, (*late, *laws), of_cylinder, note))
    martens = peers.Martens(threads, rest, held, specimen.wall_thickness, np.ones(4))
    moduli, label = ("c0", "c1", "c2", "c3"), "Martens & Boblan 2017"
    if specimen.nominal_diameter is not None:
        rows.append(("martens", label, martens, (angle, *moduli), of_braid))
    rows.append(("martens_diameter", f"{label}, diameter", martens, (*both, *moduli), of_braid))
    rows += _without_braid(rest)
    return {name: _family(*row) for name, *row in rows}


def _without_braid(rest: float) -> list[tuple]:
    """Models that depend only on length and pressure."""
    rows: list[tuple] = []
    numbers = dict.fromkeys(("a1", "a2", "a4", "a5", "a6"), 0.0)
    for names, a1, translate in (
        (("a2", "a4", "a5"), 0.0, _relaxed),
        (("a2", "a4", "a5", "a6"), 1 / famjax.units.BAR, None),
        (tuple(numbers), 0.0, None),
    ):
        model = peers.Sarosi(rest, a3=-10.0, **{**numbers, "a1": a1})
        count = len(names) + 1
        label = f"Sarosi 2012, {count} parameters"
        rows.append((f"sarosi_{count}", label, model, ("a3", *names), translate))
    model = peers.Hildebrandt(rest, np.ones(3), np.ones(5))
    free = [name for name, d in model.declared().items() if d.linear]
    rows.append(("hildebrandt", "Hildebrandt 2002", model, free))
    return rows


def _relaxed(model: Any, given: dict[str, Any]) -> Mapping[str, Any]:
    """Sarosi's model with four parameters: no force at rest length and zero pressure."""
    del model
    return {**given, "a6": -given["a2"]}


def _family(
    label: str,
    model: Any,
    free: Sequence[Declared | str],
    translate: Translate | None = None,
    note: str = "",
) -> ModelFamily:
    known = model.declared()
    chosen = tuple(known[one] if isinstance(one, str) else one for one in free)
    return ModelFamily(model, chosen, translate, label, note)
