"""What commands take: force maps and files, and parameters with their units, as numbers in SI."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from famjax.boundary.errors import InputError
from famjax.boundary.near import meant
from famjax.boundary.units import UNITS, si_unit, to_si
from famjax.console import parse_entries

if TYPE_CHECKING:
    from fitting import ForceData
    from fitting.evidence import SharedErrors
    from fitting.families import LawGiven
    from fitting.parameters import Parameter

_STANDARD_INPUT = "<stdin>"
"""What the command line puts in the place of `-`."""


def load_fitting() -> ModuleType:
    """The fitting package, with JAX in float64; compiled programs are kept on disk."""
    import fitting
    from famjax.compilation_cache import start_jax

    start_jax()
    return fitting


def schema_of(path: Path) -> str:
    """The schema that a JSON file names; "" of any other file, whose reader says what is wrong."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(found.get("schema")) if isinstance(found, dict) else ""


def warn_unidentified(name: object, verdict: str | None, reasons: Sequence[str] | None) -> None:
    """Say on standard error that nothing was identified, where that is so."""
    from famjax.cards import unidentified

    doubt = unidentified(str(name), verdict, reasons)
    if doubt is not None:
        print(f"warning: {doubt}", file=sys.stderr)


def load_map(data: str, specimen: Mapping[str, Any]) -> "ForceData":
    """A force map: a bundled one by its name, a CSV file, or standard input; specimen in SI."""
    from fitting import load_bundled, read_csv
    from fitting.reading import bundled_map_name, bundled_names

    if bundled_map_name(data) is not None and not Path(data).exists():
        return load_bundled(data, specimen)
    if data == _STANDARD_INPUT:
        return read_csv(sys.stdin, specimen)
    if not Path(data).exists():
        known = bundled_names()
        raise InputError(
            f"no such file: {data}; bundled maps are {' and '.join(known)}{meant(data, known)}"
        )
    return read_csv(data, specimen)


Kinds = Mapping[str, str]
"""Kind of unit of every parameter by name."""


def parameter_kinds(*laws: "LawGiven") -> dict[str, str]:
    """Kinds of unit of all parameters that a fit may have: of every known law, and of those given."""
    from fitting.families import known_laws, law_named
    from fitting.parameters import KINDS

    kinds = dict(KINDS)
    for one in (*known_laws(), *laws):
        made = law_named(one, None)
        kinds |= {name: entry.kind for name, entry in {**made.shape, **made.coefficients}.items()}
    return kinds


def _name_and_unit(key: str, entry: str, what: str, kinds: Kinds) -> tuple[str, str, str]:
    """Name, unit and kind of a key such as `braid_diameter_mm`, or `end_factor` without a unit."""
    if kinds.get(key) == "number":
        return key, "", "number"
    # The longest name that is known: a unit may hold an underscore no more than a name may end so.
    names = [name for name in kinds if key.startswith(f"{name}_")]
    name = max(names, key=len, default=key.rpartition("_")[0])
    unit = key[len(name) + 1 :]
    kind = kinds.get(name, "stress" if name.startswith("E_") else None)
    if key in kinds:
        known = ", ".join(UNITS[kinds[key]])
        raise InputError(f"{what} {entry!r}: {key} needs a unit, one of {known}, as in "
                         f"{key}_{next(reversed(UNITS[kinds[key]]))}=...")  # fmt: skip
    if kind is None:
        known = ", ".join(f"{n}_{si_unit(k)}".rstrip("_") for n, k in kinds.items())
        raise InputError(f"{what} {entry!r}: unknown parameter; known, with any unit: {known}")
    return name, unit, kind


def parse_bounds(
    entries: Iterable[str], kinds: Kinds | None = None
) -> dict[str, tuple[float, float]]:
    """Bounds by parameter name in SI, from entries such as `braid_diameter_mm=20:23.6`.

    A single value holds the parameter: `deadband_pressure_kPa=40`.

    Raises:
        InputError: an entry that is not of this form, an unknown name or unit, or a name twice.

    >>> parse_bounds(["E_1_MPa=0:10", "braid_diameter_mm=21"])
    {'E_1': (0.0, 10000000.0), 'braid_diameter': (0.021, 0.021)}
    """
    bounds: dict[str, tuple[float, float]] = {}
    known = parameter_kinds() if kinds is None else kinds
    for entry in entries:
        key, equals, interval = entry.partition("=")
        if not equals or not key.strip():
            raise InputError(f"bounds {entry!r} must read name_unit=min:max, as in E_1_MPa=0:10")
        name, unit, kind = _name_and_unit(key.strip(), entry, "bounds", known)
        if name in bounds:
            raise InputError(f"bounds of {name} are given twice")
        ends = interval.split(":")
        try:
            low, high = float(ends[0]), float(ends[-1])
        except ValueError:
            raise InputError(f"bounds {entry!r}: {interval!r} is not min:max") from None
        if len(ends) > 2:
            raise InputError(f"bounds {entry!r}: {interval!r} is not min:max")
        bounds[name] = (to_si(low, unit, kind), to_si(high, unit, kind))
    return bounds


def as_parameters(
    bounds: Mapping[str, tuple[float, float]], kinds: Kinds
) -> dict[str, "Parameter"]:
    """Bounds in SI as parameters."""
    from fitting.parameters import Parameter

    return {
        name: Parameter(min=low, max=high, unit=si_unit(kinds.get(name, "stress")))
        for name, (low, high) in bounds.items()
    }


def parse_free(names: Iterable[str], kinds: Kinds | None = None) -> dict[str, "Parameter"]:
    """Parameters that take part with their standard bounds, from their names.

    Raises:
        InputError: an unknown name.
    """
    from fitting.parameters import Parameter

    found, known = {}, parameter_kinds() if kinds is None else kinds
    for name in names:
        if name not in known:
            raise InputError(f"--free {name}: unknown parameter; known are {', '.join(known)}")
        found[name] = Parameter()
    return found


def parse_priors(entries: Iterable[str], kinds: Kinds | None = None) -> dict[str, "Parameter"]:
    """Parameters with a prior, from entries such as `rest_length_mm=296+-0.5`.

    Raises:
        InputError: an entry that is not of this form, or an unknown name or unit.

    >>> parse_priors(["rest_length_mm=296+-0.5"])["rest_length"].prior
    (296.0, 0.5)
    """
    from fitting.parameters import Parameter

    found, known = {}, parameter_kinds() if kinds is None else kinds
    for entry in entries:
        key, equals, value = entry.partition("=")
        mean, plus_minus, std = value.partition("+-")
        if not (equals and plus_minus):
            raise InputError(
                f"prior {entry!r} must read name_unit=mean+-std, as in rest_length_mm=296+-0.5"
            )
        name, unit, _ = _name_and_unit(key.strip(), entry, "prior", known)
        if name in found:
            raise InputError(f"the prior of {name} is given twice")
        try:
            found[name] = Parameter(prior=(float(mean), float(std)), unit=unit)
        except ValueError:
            raise InputError(f"prior {entry!r}: {value!r} is not mean+-std") from None
    return found


def parse_errors(entries: Iterable[str]) -> "SharedErrors":
    """Standard errors that all readings share, from entries such as `wall_thickness_mm=0.05`.

    Raises:
        InputError: an entry that is not of this form, an unknown name or unit, or a name twice.

    >>> parse_errors(["wall_thickness_mm=0.05", "pressure_reading=0.0025"]).stated()
    {'pressure_reading': 0.0025, 'wall_thickness': 5e-05}
    """
    from famjax.boundary.toml_file import from_entries
    from fitting.evidence import FORM, SharedErrors

    numbers = {}
    for name, value in parse_entries(entries, "error", "wall_thickness_mm=0.05").items():
        try:
            numbers[name] = float(value)
        except ValueError:
            raise InputError(
                f"error {name}={value}: {value!r} is not a number; the unit belongs to the name, as in "
                "wall_thickness_mm=0.05"
            ) from None
    return from_entries(SharedErrors, numbers, FORM, where="error: ")
