"""Families built from any model with declared parameters, including the published models.

The bounds of the published models are wide, so that each model fits as well as it can. The braid
diameter and angle are free parameters and need not describe a muscle that can be built.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

import famjax
from famjax import peers
from famjax.boundary.errors import InputError
from famjax.compile_options import as_arrays
from famjax.parameters import Declared

from .data import ForceData, Specimen
from .families import AbstractGeometrySource, EstimatedSource
from .response import MuscleFamily, Values

_FLATTEST = math.radians(40)
_SAROSI = ("a1", "a2", "a4", "a5", "a6")
_LONGEST = 1.002  # minimum ratio of thread length to longest reading
_DEADBAND = Declared("Pa", "deadband_pressure", low=-200e3, high=200e3)
"""Negative values allow for an overestimated rest length, which has almost the same effect."""

Translate = Callable[[Any, dict[str, Any]], Mapping[str, Any]]
"""Function that converts a family's parameter values to those of the model."""


class ModelSource(AbstractGeometrySource):
    """Source that returns a given model with some of its values changed, independently of the specimen.

    Attributes:
        model: model that provides all other values.
        translate: converts the parameters to those of the model; None if they are the same.
    """

    model: Any
    translate: Translate | None = eqx.field(static=True, default=None)

    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """The model's own geometry."""
        return self.muscle(values).geometry

    def muscle(self, values: Values, material: Any = None, further: Any = None) -> Any:
        """Build the model from these values; law and terms are ignored, since the model has its own."""
        del material, further
        given = dict(values)
        return self.model.with_parameters(
            given if self.translate is None else self.translate(self.model, given)
        )


@dataclasses.dataclass(frozen=True)
class ModelFamily:
    """A model and its free parameters, without any constraint along the actuation path.

    Attributes:
        model: model that provides all fixed values.
        declared: free parameters with bounds; only linear ones may be unbounded.
        translate: converts the declared parameters to those of the model; None if they are the same.
        label: authors and variant, for tables.
        note: remark printed with the table.
    """

    model: Any
    declared: tuple[Declared, ...]
    translate: Translate | None = None
    label: str = ""
    note: str = ""

    @property
    def searched(self) -> list[Declared]:
        """Parameters in which the force is not affine."""
        return [one for one in self.declared if not one.linear]

    @property
    def linear(self) -> list[Declared]:
        """Parameters in which the force is affine."""
        return [one for one in self.declared if one.linear]

    @property
    def family(self) -> MuscleFamily:
        """The family that the engine fits."""
        searched, linear = (
            tuple(str(one.name) for one in of) for of in (self.searched, self.linear)
        )
        source = ModelSource(as_arrays(self.model), self.translate)
        return MuscleFamily(searched, linear, source, None, np.zeros(()))

    @classmethod
    def of(cls, model: famjax.AbstractMuscle, label: str = "") -> "ModelFamily":
        """Create a family from any model with declared parameters, all of which are free.

        Args:
            model: instance of the model, such as `MyModel.template(rest_length=0.3)`.
            label: label for tables; defaults to the class name.

        Raises:
            InputError: the model declares no parameters, or a nonlinear one has no finite range.
        """
        if isinstance(model, type):
            raise InputError(
                f"the model must be an instance, such as {model.__name__}.template(...); got the class"
            )
        known, name = tuple(model.declared().values()), type(model).__name__
        if not known:
            raise InputError(
                f"{name} declares no parameters: declare its fields with famjax.parameter"
            )
        for one in known:
            if not one.linear and not np.isfinite([one.low, one.high]).all():
                raise InputError(
                    f"the force is nonlinear in {one.name} of {name}, so it needs a finite range: declare "
                    "it with famjax.parameter(low=..., high=...)"
                )
        return cls(model, known, label=label or name)


def peer_families(data: ForceData) -> dict[str, ModelFamily]:
    """Return all published models, by name, as families with bounds suited to a force map.

    Args:
        data: force map; its specimen and its ranges of length and pressure set the bounds. Maps with the
            same specimen and ranges share compiled programs.
    """
    pressure, length = data.pressure[data.loaded], data.length[data.loaded]
    ends = float(pressure.min()), float(pressure.max())
    return _peers(data.specimen, ends, float(length.max()))


@functools.lru_cache(maxsize=32)
def _peers(
    specimen: Specimen, pressures: tuple[float, float], longest: float
) -> dict[str, ModelFamily]:
    rest, P, nominal = specimen.rest_length, pressures[1], specimen.nominal_diameter
    steepest = min(math.asin(min(1.0, rest / (_LONGEST * longest))), math.radians(85))
    if steepest <= _FLATTEST:
        raise InputError(
            f"a loaded reading has a length of {longest * 1e3:.5g} mm, which is too long for a "
            f"braid with a rest length of {rest * 1e3:.5g} mm: check the rest length and "
            "the unit of the length column"
        )
    low, high = (0.2 * nominal, 3 * nominal) if nominal else (3e-3, 80e-3)
    D = Declared("m", "braid_diameter", low=low, high=high)
    both = D, Declared("rad", "braid_angle", low=_FLATTEST, high=steepest)
    held, source = nominal or low, EstimatedSource(specimen)

    def braid(given: dict[str, Any]) -> famjax.Braid:
        diameter, at_rest = given.pop("braid_diameter"), given.pop("braid_angle")
        return famjax.Braid.from_rest(diameter=diameter, braid_angle=at_rest, length=rest)

    def of_braid(model: Any, given: dict[str, Any]) -> Mapping[str, Any]:
        if "rest_diameter" in model.declared():
            given["rest_diameter"] = given["braid_diameter"]
        made = braid(given)
        return {**given, "rest_thread_length": made.rest_thread_length, "turns": made.turns}

    def of_cylinder(model: Any, given: dict[str, Any]) -> Mapping[str, Any]:
        if "bladder_diameter" in model.declared():  # the bladder lies within the threads
            cylinder: Any = source.geometry(given)
            given["bladder_diameter"] = cylinder.bladder.rest_diameter
        return given

    threads = famjax.Braid.from_rest(diameter=held, braid_angle=_FLATTEST, length=rest)
    cylinder = source.geometry({"braid_diameter": held, "braid_angle": _FLATTEST})
    elastic = famjax.Muscle(cylinder, famjax.PolynomialMaterial([1e6]))
    mooney = famjax.Muscle(cylinder, famjax.materials.MooneyRivlinMaterial(1e5, 1e5))
    late, moduli = (*both, _DEADBAND), ("c0", "c1", "c2", "c3")
    martens = peers.Martens(threads, rest, held, specimen.wall_thickness, np.ones(4))
    rows: list[tuple] = [
        ("gaylord", "Gaylord 1958", peers.Gaylord(threads), both, of_braid),
        ("tondu_lopez", "Tondu & Lopez 2000, k", peers.TonduLopez(threads, rest), (*both, "k_far"),
         of_braid),
        ("ferraresi_deadband", "Ferraresi, deadband", elastic, (*late, "E_1"), of_cylinder),
        ("kothera", "Kothera 2009, deadband", peers.Kothera(elastic), (*late, "E_1"), of_cylinder),
        ("klute_hannaford", "Klute & Hannaford 2000, deadband", mooney, (*late, "C10", "C01"),
         of_cylinder),
        ("martens_diameter", "Martens & Boblan 2017, diameter", martens, (*both, *moduli), of_braid),
    ]  # fmt: skip
    if pressures[0] < P:
        note = "pressure nodes 1 and 2 are at " + " and ".join(
            f"{one / 1e3:.4g} kPa" for one in pressures
        )
        for name, label, least in (
            ("robinson_2", "Robinson 2015, order 2", -math.inf),
            ("pillsbury_2", "Pillsbury 2015, order 2, positive", 0.0),
        ):
            law = famjax.materials.PressurePolynomialMaterial(pressures, np.ones((2, 2)), odd=False)
            model = famjax.Muscle(cylinder, law)
            laws = [
                dataclasses.replace(d, low=least, high=math.inf)
                for d in model.declared().values()
                if d.linear
            ]
            rows.append((name, label, model, (*late, *laws), of_cylinder, note))
    # Models that depend only on length and pressure.
    for names, a1 in ((("a2", "a4", "a5", "a6"), 1 / famjax.units.BAR), (_SAROSI, 0.0)):
        model = peers.Sarosi(rest, a3=-10.0, **{**dict.fromkeys(_SAROSI, 0.0), "a1": a1})
        count = len(names) + 1
        rows.append((f"sarosi_{count}", f"Sarosi 2012, {count} parameters", model, ("a3", *names)))
    model = peers.Hildebrandt(rest, np.ones(3), np.ones(5))
    free = [one for one, d in model.declared().items() if d.linear]
    rows.append(("hildebrandt", "Hildebrandt 2002", model, free))
    return {name: _family(*row) for name, *row in rows}


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
