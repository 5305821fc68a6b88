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
from ..muscle import LINEAR, SEATING_FORCE, AbstractMuscle, MountedMuscle, Muscle
from ..terms import BladderWall, PressurisedBraid


class ClosedForm(NamedTuple):
    """Numbers and statements that compute the force G of a muscle in SI.

    Attributes:
        numbers: value of each number and its description with the unit, by name.
        statements: names and expressions in order. An expression contains L, P and names from earlier
            statements; the last name is G.
        rig: numbers `c_rig` and `n_rig` of a compliant rig, in the same form; empty for a rigid rig.
    """

    numbers: dict[str, tuple[float, str]]
    statements: list[tuple[str, str]]
    rig: dict[str, tuple[float, str]]


_DEFLECTION = f"c_rig * G * ((G / {SEATING_FORCE})**2 + {LINEAR}**2)**((n_rig - 1) / 2)"
"""Deflection [m] of the rig under a force G [N], see `famjax.muscle.give_way`."""


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
            with inextensible or linearly elastic threads, a bladder law and a pressurised braid. The rig
            may be compliant.
    """
    rig: dict[str, tuple[float, str]] = {}
    if isinstance(muscle, MountedMuscle):
        compliance, exponent = float(muscle.compliance), muscle.exponent
        about = "m/N, compliance of the rig at 100 N", "-, exponent of the rig's deflection"
        values = compliance, 1.0 if exponent is None else float(exponent)
        rig = dict(zip(("c_rig", "n_rig"), zip(values, about, strict=True), strict=True))
        muscle = muscle.muscle
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
    return ClosedForm({**known, **law}, statements, rig)


_IN_MATLAB = """G = muscle_force(L, P);
low = min(-0.1 * G, 1.1 * G);
high = max(-0.1 * G, 1.1 * G);
for k = 1:60 % the rig deflects, so G is the force of the muscle at a shorter length
    G = (low + high) / 2;
    more = muscle_force(L - DEFLECTION, P) > G;
    low(more) = G(more);
    high(~more) = G(~more);
end"""
_IN_PYTHON = """G = muscle_force(L, P)
    low, high = np.minimum(-0.1 * G, 1.1 * G), np.maximum(-0.1 * G, 1.1 * G)
    for _ in range(60):  # the rig deflects, so G is the force of the muscle at a shorter length
        G = (low + high) / 2
        more = muscle_force(L - DEFLECTION, P) > G
        low, high = np.where(more, G, low), np.where(more, high, G)"""


def matlab_words(form: ClosedForm) -> dict[str, str]:
    """Return MATLAB code for the words NUMBERS, STATEMENTS and ALONE of the template."""
    numbers, rig = (_numbers(one).replace("  # ", "; % ") for one in (form.numbers, form.rig))
    statements = "\n".join(f"{name} = {_dotted(text)};" for name, text in form.statements)
    if not rig:
        return {"NUMBERS": numbers, "STATEMENTS": statements, "ALONE": ""}
    about = "% Return the force [N] of the muscle alone, without the rig."
    lines = "function G = muscle_force(L, P)", about, numbers, statements, "G = real(G);", "end"
    alone = "\n" + "\n".join(lines) + "\n"
    return {
        "NUMBERS": rig,
        "STATEMENTS": _IN_MATLAB.replace("DEFLECTION", _dotted(_DEFLECTION)),
        "ALONE": alone,
    }


def python_words(form: ClosedForm) -> dict[str, str]:
    """Return NumPy code for the words NUMBERS, STATEMENTS and ALONE of the template."""
    numbers = _numbers({**form.numbers, **form.rig})
    statements = "\n    ".join(f"{name} = {text}" for name, text in form.statements)
    if not form.rig:
        return {"NUMBERS": numbers, "STATEMENTS": statements, "ALONE": ""}
    about = '"""Return the force [N] of the muscle alone, without the rig."""'
    lines = "def muscle_force(L, P):", about, statements, "return G"
    alone = "\n    ".join(lines) + "\n\n\n"
    return {
        "NUMBERS": numbers,
        "STATEMENTS": _IN_PYTHON.replace("DEFLECTION", _DEFLECTION),
        "ALONE": alone,
    }


def _numbers(numbers: Mapping[str, tuple[float, str]]) -> str:
    return "\n".join(f"{name} = {value!r}  # {about}" for name, (value, about) in numbers.items())


def _dotted(text: str) -> str:
    return re.sub(r"[*]{2}|[*/]", lambda found: "." + found[0].replace("**", "^"), text)
