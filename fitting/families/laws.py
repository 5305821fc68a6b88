"""Bladder laws that can be identified: any material whose class declares its numbers.

Of the declared numbers those in which the force is affine are the coefficients, which every fit
solves for in one convex programme; the others give the law its shape and are searched.
"""

from collections.abc import Mapping

import equinox as eqx

import famjax
from famjax.boundary.class_path import class_named, class_path
from famjax.boundary.errors import InputError

from ..arguments import check_whole
from .parameters import Entry

_MAX_ORDER = 8


class Law(eqx.Module):
    """A material as a family of laws in its declared numbers.

    Attributes:
        material: any member of the family.
    """

    material: famjax.materials.AbstractMaterial

    @property
    def coefficients(self) -> dict[str, Entry]:
        """The numbers in which the stress is linear, by name."""
        return {n: _entry(d) for n, d in self.material.declared().items() if d.linear}

    @property
    def shape(self) -> dict[str, Entry]:
        """The numbers in which it is not, by name."""
        return {n: _entry(d) for n, d in self.material.declared().items() if not d.linear}

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)

    @property
    def name(self) -> str:
        """What the command line calls it: a known name, or `module:Class`."""
        return type(self.material).law_name or class_path(type(self.material))

    def with_values(self, values: Mapping[str, famjax.Real]) -> famjax.materials.AbstractMaterial:
        """The material of these values [SI], which hold at least those of the law."""
        return self.material.with_parameters({n: values[n] for n in self.material.declared()})


def _entry(declared: famjax.parameters.Declared) -> Entry:
    return Entry(declared.low, declared.high, declared.kind)


def known_laws() -> dict[str, type[famjax.materials.AbstractMaterial]]:
    """The laws of famjax that can be identified, by name."""
    laws = (
        famjax.PolynomialMaterial,
        famjax.materials.OgdenMaterial,
        famjax.materials.MooneyRivlinMaterial,
        famjax.materials.SaturatingMaterial,
        famjax.materials.MonotoneMaterial,
        famjax.materials.NeoHookeanMaterial,
        famjax.materials.YeohMaterial,
    )
    return {law.law_name: law for law in laws}


LawGiven = str | Law | type[famjax.materials.AbstractMaterial] | famjax.materials.AbstractMaterial
"""What a law may be given as."""


def law_named(law: LawGiven, order: int | None) -> Law:
    """The law of that name, class or material; `order` is for the polynomial alone.

    Raises:
        InputError: an unknown name, an order for a law that has none, or a class that declares
            nothing to identify.
    """
    if isinstance(law, Law):
        return law
    given = law if isinstance(law, str) else getattr(law, "__name__", type(law).__name__)
    if isinstance(law, str) and ":" not in law:
        laws = known_laws()
        if law not in laws:
            raise InputError(
                f"the law is one of {', '.join(laws)}, or module:Class for one of your own; "
                f"got {law!r}"
            )
        law = laws[law]
    elif isinstance(law, str):
        law = class_named(law, famjax.materials.AbstractMaterial, "law")
    if law is famjax.PolynomialMaterial:
        return Law(famjax.PolynomialMaterial.template(order=checked_order(order)))
    if order is not None:
        raise InputError(
            f"only the polynomial law has an order, got {order} for {given}: leave the order out, or "
            "name the law polynomial"
        )
    if isinstance(law, type):
        try:
            law = law.template()
        except ValueError as error:
            raise InputError(
                f"{law.__name__} cannot be identified by its class alone: {error}"
            ) from None
    if not isinstance(law, famjax.materials.AbstractMaterial):
        raise InputError(
            f"a law is a name, a famjax.materials.AbstractMaterial or its class, got {law!r}"
        )
    if not law.declared():
        raise InputError(
            f"{type(law).__name__} declares no number to identify: declare its fields by "
            "famjax.parameter(unit, low=..., high=..., linear=...)"
        )
    return Law(law)


def checked_order(order: int | None) -> int:
    """The order of the polynomial law, 3 unless given.

    Raises:
        InputError: none that there is.
    """
    if order is None:
        return 3
    return check_whole("the order of the law", order, 1, _MAX_ORDER)
