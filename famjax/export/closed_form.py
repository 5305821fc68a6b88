"""Write the closed-form equations of a muscle as readable MATLAB and Python (NumPy) code.

Statements use Python operators; for MATLAB, these are converted to element-wise operators.
"""

import itertools
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from .. import materials
from ..braids import Braid, CompliantBraid
from ..geometries import EndEffectGeometry, EstimatedGeometry
from ..muscle import AbstractMuscle, Muscle
from ..terms import BladderWall, PressurisedBraid


class ClosedForm(NamedTuple):
    """Numbers and statements that compute the force G of a muscle in SI.

    Attributes:
        numbers: value of each number and its description with the unit, by name.
        statements: names and expressions in order. An expression contains L, P and names from earlier
            statements; the last name is G.
    """

    numbers: dict[str, tuple[float, str]]
    statements: list[tuple[str, str]]


Stress = tuple[dict[str, tuple[float, str]], str]
"""Parameters of a bladder law, and the stress as an expression in the strains e and o."""


def _polynomial(law: materials.PolynomialMaterial) -> Stress:
    E = {f"E_{k}": (float(one), "Pa, bladder law") for k, one in enumerate(law.coefficients, 1)}
    terms = " + ".join(f"E_{k} * abs(e)**{k}" for k in range(1, len(E) + 1))
    return E, f"sign(e) * ({terms})"


def _saturating(law: materials.SaturatingMaterial) -> Stress:
    numbers = {
        "E_inf": (float(law.final_modulus), "Pa, bladder law"),
        "S": (float(law.saturation_stress), "Pa, bladder law"),
        "s": (float(law.strain_scale), "-, bladder law"),
    }
    return numbers, "E_inf * e - S * sign(e) * expm1(-abs(e) / s)"


def _ogden(pairs: Iterable[tuple[Any, Any]], about: Iterable[str] = ()) -> Stress:
    """Write a bladder law as a sum of Ogden terms, each with a modulus mu and an exponent alpha."""
    meanings = itertools.chain(about, itertools.repeat("bladder law"))
    numbers, terms = {}, []
    for k, (modulus, exponent) in enumerate(pairs, 1):
        numbers[f"mu_{k}"] = (float(modulus), f"Pa, {next(meanings)}")
        numbers[f"alpha_{k}"] = (float(exponent), "-, bladder law")
        terms.append(f"mu_{k} * ((1 + e)**alpha_{k} - ((1 + e) * (1 + o))**-alpha_{k})")
    return numbers, " + ".join(terms)


_STRESSES: Mapping[type, Callable[[Any], Stress]] = {
    materials.PolynomialMaterial: _polynomial,
    materials.SaturatingMaterial: _saturating,
    materials.OgdenMaterial: lambda law: _ogden(zip(law.moduli, law.exponents, strict=True)),
    materials.MooneyRivlinMaterial: lambda law: _ogden(
        [(2 * law.c10, 2.0), (-2 * law.c01, -2.0)], ("Mooney-Rivlin law, 2 C10", "-2 C01")
    ),
    materials.NeoHookeanMaterial: lambda law: _ogden([(law.shear_modulus, 2.0)]),
}
"""Laws with a closed form: stress as a function of strain e in its own direction and o in the other."""


def closed_form(muscle: AbstractMuscle) -> ClosedForm | None:
    """Return the equations of a muscle; None if it has no closed form, so only a table can be exported.

    Args:
        muscle: muscle to write. It has a closed form if it is a cylinder, with or without rounded ends,
            with inextensible or linearly elastic threads, a bladder law and a pressurised braid.
    """
    if not isinstance(muscle, Muscle):
        return None
    terms: dict[type, Any] = {type(one): one for one in muscle.terms.terms}
    geometry: Any = muscle.geometry
    ends = geometry.end_factor if isinstance(geometry, EndEffectGeometry) else None
    cylinder = geometry if ends is None else geometry.cylinder
    if (
        not isinstance(cylinder, EstimatedGeometry)
        or type(cylinder.braid) not in (Braid, CompliantBraid)
        or terms.keys() != {BladderWall, PressurisedBraid}
        or len(terms) != len(muscle.terms.terms)
        or type(muscle.material) not in _STRESSES
    ):
        return None
    braid, bladder = cylinder.braid, cylinder.bladder
    law, stress = _STRESSES[type(muscle.material)](muscle.material)
    numbers = {
        "L0": (bladder.rest_length, "m, rest length"),
        "B0": (braid.rest_thread_length, "m, thread length"),
        "N": (braid.turns, "-, number of turns of one thread"),
        "V": (bladder.volume, "m^3, rubber volume"),
        "r0": (bladder.rest_mid_radius, "m, mid-wall radius at rest"),
        "P_d": (terms[PressurisedBraid].deadband_pressure, "Pa, deadband"),
    }
    cut, B, wall, middle = "L", "B0", "V / (2 * pi * R * l)", "R / r0 - 1"
    if ends is not None:
        numbers["k"] = (ends, "-, end factor")
        cut = "L0 * (1 - k * (1 - L / L0))"
    if isinstance(braid, CompliantBraid):
        numbers["c"] = (braid.compliance, "1/N, thread compliance")
        B = "B0 / (1 - c * B0 * P * l / (2 * pi * N**2))"
    if not bladder.embedded:
        numbers["t_b"] = (braid.thickness, "m, braid thickness")
        wall, middle = "R - t_b - sqrt((R - t_b)**2 - V / (pi * l))", "(R - t_b - t / 2) / r0 - 1"
    known = {name: (float(value), about) for name, (value, about) in numbers.items()}
    along = re.sub(r"\be\b", "e_z", re.sub(r"\bo\b", "e_c", stress))
    around = re.sub(r"\be\b", "e_c", re.sub(r"\bo\b", "e_z", stress))
    statements = [
        ("l", cut), ("B", B), ("R", "sqrt(B**2 - l**2) / (2 * pi * N)"), ("t", wall),
        ("e_z", "l / L0 - 1"), ("e_c", middle), ("s_z", along), ("s_c", around),
        ("braid", "(P - P_d) * (3 * l**2 - B**2) / (4 * pi * N**2)"),
        ("G", "braid + s_z * V / l - s_c * t * l**2 / (2 * pi * R * N**2)"),
    ]  # fmt: skip
    return ClosedForm({**known, **law}, statements)


def matlab_lines(form: ClosedForm) -> tuple[str, str]:
    """Format the numbers and statements as MATLAB code."""
    numbers, statements = python_lines(form)
    lines = [f"{re.sub(r'[*]{2}|[*/]', _dotted, one.strip())};" for one in statements.split("\n")]
    return re.sub("  # ", "; % ", numbers), "\n".join(lines)


def python_lines(form: ClosedForm) -> tuple[str, str]:
    """Format the numbers and statements as Python code; the statements form a function body."""
    numbers = [f"{name} = {value!r}  # {about}" for name, (value, about) in form.numbers.items()]
    return "\n".join(numbers), "\n    ".join(f"{name} = {text}" for name, text in form.statements)


def _dotted(found: re.Match[str]) -> str:
    return "." + found[0].replace("**", "^")
