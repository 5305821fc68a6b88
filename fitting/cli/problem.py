"""The problem that the options of `famjax fit` or a `fit.json` describe: solve, assess, judge."""

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import fitting
from famjax.boundary.errors import InputError, Own, check_trusted
from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.toml_file import from_entries
from famjax.boundary.units import UNITS, si_unit, to_si
from famjax.console import parse_entries
from fitting.choice import Choice, validate_choice
from fitting.evidence import (
    DRAWS,
    FORM,
    Evidence,
    Move,
    SharedErrors,
    gather,
    left_out_kinds,
    moves_of,
)
from fitting.families import LawGiven, known_laws, law_named
from fitting.faults import doubtful, suspect
from fitting.parameters import KINDS, Parameter
from fitting.posing import own_parts, taking_part
from fitting.shapes import ShapeSurface
from fitting.verdict import Judgement, judge

from .fit import Asked

Tell = Callable[[str, int, int], None]
"""Progress callback: task, number of steps done, total number of steps."""
Kinds = Mapping[str, str]
"""Kind of unit of each parameter."""

_TURNS = "turns"


def parameter_kinds(*laws: LawGiven) -> dict[str, str]:
    """Return the kind of unit of every possible parameter, for all known and the given laws."""
    kinds = dict(KINDS)
    for one in (*known_laws(), *laws):
        made = law_named(one, None)
        kinds |= {name: entry.kind for name, entry in {**made.shape, **made.coefficients}.items()}
    return kinds


def _name_and_unit(key: str, entry: str, what: str, kinds: Kinds) -> tuple[str, str, str]:
    """Split a key such as `braid_diameter_mm`, or `end_factor` without a unit, into name, unit and kind."""
    if kinds.get(key) == "number":
        return key, "", "number"
    if key in kinds:
        known = list(UNITS[kinds[key]])
        raise InputError(
            f"{what} {entry!r}: {key} needs a unit ({', '.join(known)}), as in {key}_{known[-1]}=..."
        )
    # The longest known name wins, since one name may be a prefix of another.
    names = [name for name in kinds if key.startswith(f"{name}_")]
    name = max(names, key=len, default=key.rpartition("_")[0])
    kind = kinds.get(name, "stress" if name.startswith("E_") else None)
    if kind is None:
        listed = ", ".join(f"{n}_{si_unit(k)}".rstrip("_") for n, k in kinds.items())
        raise InputError(f"{what} {entry!r}: unknown parameter; choose from {listed} (any unit)")
    return name, key[len(name) + 1 :], kind


def _parsed(
    entries: Iterable[str], what: str, form: str, kinds: Kinds | None, split: str
) -> dict[str, tuple[list[float], str, str]]:
    """Parse entries such as `name_unit=1:2` into numbers, unit and kind by name."""
    found: dict[str, tuple[list[float], str, str]] = {}
    known = parameter_kinds() if kinds is None else kinds
    for entry in entries:
        key, _, text = (part.strip() for part in entry.partition("="))
        if not text or not key:
            raise InputError(f"{what} {entry!r} must read {form}")
        name, unit, kind = _name_and_unit(key, entry, what, known)
        if name in found:
            raise InputError(f"{what} of {name} given twice: give it once")
        try:
            numbers = [float(one) for one in text.split(split)]
        except ValueError:
            numbers = []
        if not 1 <= len(numbers) <= 2:
            wanted = form.partition("=")[2].partition(",")[0]
            raise InputError(f"{what} {entry!r}: {text!r} is not {wanted}")
        found[name] = numbers, unit, kind
    return found


def parse_bounds(
    entries: Iterable[str], kinds: Kinds | None = None
) -> dict[str, tuple[float, float]]:
    """Parse entries such as `braid_diameter_mm=20:23.6` into bounds in SI by parameter name.

    A single value fixes the parameter: `deadband_pressure_kPa=40`.

    Raises:
        InputError: an entry is malformed, a name or unit is unknown, or a name is given twice.

    >>> parse_bounds(["E_1_MPa=0:10", "braid_diameter_mm=21"])
    {'E_1': (0.0, 10000000.0), 'braid_diameter': (0.021, 0.021)}
    """
    found = _parsed(entries, "bounds", "name_unit=min:max, as in E_1_MPa=0:10", kinds, ":")
    return {
        name: (to_si(numbers[0], unit, kind), to_si(numbers[-1], unit, kind))
        for name, (numbers, unit, kind) in found.items()
    }


def parse_priors(entries: Iterable[str], kinds: Kinds | None = None) -> dict[str, Parameter]:
    """Parse entries such as `rest_length_mm=296+-0.5` into parameters with a prior.

    Raises:
        InputError: an entry is malformed, or a name or unit is unknown.

    >>> parse_priors(["rest_length_mm=296+-0.5"])["rest_length"].prior
    (296.0, 0.5)
    """
    form = "name_unit=mean+-std, as in rest_length_mm=296+-0.5"
    found = {}
    for name, (numbers, unit, _) in _parsed(entries, "prior", form, kinds, "+-").items():
        if len(numbers) != 2:
            raise InputError(f"the prior of {name} must read {form}")
        found[name] = Parameter(prior=(numbers[0], numbers[1]), unit=unit)
    return found


def parse_free(names: Iterable[str], kinds: Kinds) -> dict[str, Parameter]:
    """Return named parameters, to be identified within their standard bounds.

    Raises:
        InputError: a name is unknown.
    """
    for name in names:
        if name not in kinds:
            raise InputError(f"--free {name}: unknown parameter; available: {', '.join(kinds)}")
    return {name: Parameter() for name in names}


def parse_errors(entries: Iterable[str]) -> tuple[SharedErrors, float | None]:
    """Parse standard errors: calibration errors shared by all readings, and the force noise [N] or None.

    Raises:
        InputError: an entry is malformed, a name or unit is unknown, or a name is given twice.

    >>> errors, noise = parse_errors(["wall_thickness_mm=0.05", "noise_N=1.5"])
    >>> errors.stated(), noise
    ({'wall_thickness': 5e-05}, 1.5)
    """
    numbers = {}
    for name, value in parse_entries(entries, "error", "wall_thickness_mm=0.05").items():
        try:
            numbers[name] = float(value)
        except ValueError:
            raise InputError(
                f"error {name}={value}: {value!r} is not a number; put the unit into the name, as in "
                "wall_thickness_mm=0.05"
            ) from None
    names = [name for name in numbers if name.startswith("noise_")]
    if len(names) > 1:
        raise InputError(f"error: the noise of a reading is given twice, {' and '.join(names)}")
    noise = [to_si(numbers.pop(name), name.removeprefix("noise_"), "force") for name in names]
    return from_entries(SharedErrors, numbers, FORM, where="error: "), next(iter(noise), None)


@dataclasses.dataclass(frozen=True)
class Problem:
    """A force map and the options of its fit.

    Attributes:
        asked: options as typed.
        data: map to fit, with notes on a measured shape.
        options: arguments of `fitting.identify` and `fitting.choose`.
        errors: calibration errors shared by all readings.
        surface: measured shape, or None.
    """

    asked: Asked
    data: fitting.ForceData
    options: Mapping[str, Any]
    errors: SharedErrors
    surface: ShapeSurface | None

    @classmethod
    def of(cls, data: fitting.ForceData, asked: Asked) -> "Problem":
        """Build the problem from a map and the command-line options.

        Raises:
            InputError: an option is invalid.
        """
        if asked.geometry is not None and asked.shape is not None:
            raise fitting.InputError(
                "--shape also sets the geometry: give either --shape or --geometry, got both"
            )
        errors, noise = parse_errors(asked.shared_error)
        parts, declared = own_parts([data], asked.geometry, asked.term)
        kinds = {}
        if asked.bounds or asked.free or asked.prior:
            kinds = parameter_kinds(*filter(None, [asked.law]))
        kinds |= {name: one.kind for name, one in declared.items()}
        kinds |= {} if asked.shape is None else {_TURNS: "number"}
        bounds = parse_bounds(asked.bounds, kinds)
        named = parse_free(asked.free, kinds) | parse_priors(asked.prior, kinds)
        options = parts | {
            "constraint": asked.constraint,
            "bounds": bounds,
            "parameters": named | taking_part(declared, {**bounds, **named}),
            "noise": noise,
            "objective": asked.objective,
            "ends": asked.ends,
        }
        fitted, surface = data, None
        if asked.shape is not None and asked.ends == "equilibrium":
            options["pictures"] = asked.shape
        elif asked.shape is not None:
            fitted, options, surface = _with_shape(data, Path(asked.shape), options)
        return cls(asked, fitted, options, errors, surface)

    @classmethod
    def of_fit(cls, fit: fitting.Identification, own: Own = ()) -> "Problem":
        """Rebuild the problem of a fit loaded by `fitting.load_fit`, with the same `own`.

        Raises:
            InputError: the file does not contain a problem, a file named in it is missing, or a class named
                in it is not trusted.
        """
        held = fit.document.get("problem")
        if held is None:
            raise fitting.InputError(
                "the file does not contain its problem: give a fit.json written by famjax fit. For the fit "
                "of a script, call fitting.validate, fitting.profile, fitting.bootstrap or fitting.sample"
            )
        asked: dict[str, Any] = {
            key: tuple(one) if isinstance(one, list) else one for key, one in held["asked"].items()
        }
        for kind in ("law", "geometry", "term"):
            for path in np.atleast_1d(asked.get(kind) or []):
                if ":" in path:
                    check_trusted(str(path), own, kind)
        return cls.of(fit.data, Asked(**asked))

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of `fit.json` that describes the problem."""
        return {"asked": dataclasses.asdict(self.asked)}

    def solve(self, progress: Tell) -> tuple[fitting.Identification, Choice | None]:
        """Return the fit, and the choice of its law if no law was given."""
        asked = self.asked
        if asked.chosen:
            choice = fitting.choose(self.data, **self.options, progress=progress)
            return choice.chosen, choice
        name = f"identifying {self.data.specimen.name}"
        censored = asked.objective == "censored"
        options = {**self.options, "objective": "sum_of_squares"} if censored else self.options
        found = fitting.identify(
            self.data, **options, law=asked.law or "polynomial", order=asked.order,
            censored=censored, progress=lambda done, total: progress(name, done, total),
        )  # fmt: skip
        return found, None

    def evidence(
        self,
        result: fitting.Identification,
        choice: Choice | None,
        progress: Tell,
        *,
        validation: bool = False,
        executor: AnyExecutor = None,
        **wanted: Any,
    ) -> Evidence:
        """Gather the requested evidence; the law is chosen again in every fold of a cross-validation.

        Args:
            result: the fit.
            choice: choice of its law; None if the law was given.
            progress: progress callback.
            validation: cross-validate by pressure and by length.
            executor: executor for the repeated choices.
            **wanted: further arguments of `fitting.evidence.gather`.
        """
        found = gather(
            result, validation=validation and choice is None, progress=progress,
            known=None if choice is None else (choice.error, choice.left_out),
            noise=self.options["noise"] if choice is None else None,
            shared=self._moves(result.data),
            **wanted,
        )  # fmt: skip
        if choice is None or not validation:
            return found
        anew = [
            validate_choice(
                choice, kind, **self.options, executor=executor,
                progress=lambda done, total, kind=kind: progress(
                    f"choosing with one {kind} left out", done, total
                ),
            )
            for kind in left_out_kinds(result)
        ]  # fmt: skip
        return dataclasses.replace(found, validations=tuple(anew))

    def _moves(self, data: fitting.ForceData) -> dict[str, list[Move]]:
        """Return the effects of the stated calibration errors and of the error of the shape."""
        surface = self.surface
        if surface is None:
            return moves_of(data, self.errors)
        draws = [Move(None, surface.geometry(data.specimen, draw=draw)) for draw in range(DRAWS)]
        return {**moves_of(data, self.errors, surface.geometry), "shape": draws}


def judged(
    result: fitting.Identification, choice: Choice | None, evidence: Evidence, progress: Tell
) -> Judgement:
    """Return the verdict; after a poor fit, likely errors in the data are tested."""
    suspicions = ()
    if doubtful(result):
        progress("testing likely errors", 0, 1)
        suspicions = suspect(result)
    question = "" if choice is None else choice.open_question
    return judge(result, suspicions, evidence.left_out, question)


def _with_shape(
    data: fitting.ForceData, pictures: Path, options: Mapping[str, Any]
) -> tuple[fitting.ForceData, dict[str, Any], ShapeSurface]:
    """Return the map with notes on the shape, the options of a fit with this geometry, and the shape.

    The turns of the threads are identified from the force unless the user sets them, since diameters
    alone do not determine them.
    """
    surface = fitting.shape_surface(pictures)
    geometry = surface.geometry(data.specimen)
    low, high = (float(one) for one in geometry.length_range())
    outside = (data.length < low) | (data.length > high)
    if outside.any():
        raise fitting.InputError(
            f"all lengths must be within those of the pictures, {low * 1e3:.4g} to {high * 1e3:.4g} mm; "
            f"{int(outside.sum())} readings of {data.source} are outside: photograph the whole stroke, or "
            "remove these readings"
        )
    named = {*options["bounds"], *options["parameters"]}
    least, most = surface.threads.turns_range()
    free = {} if _TURNS in named else {_TURNS: Parameter(min=least, max=most)}
    # The data of a saved fit already have the notes.
    noted = dataclasses.replace(data, notes=tuple(dict.fromkeys((*data.notes, *surface.summary()))))
    fitted = {**options, "geometry": geometry, "parameters": {**options["parameters"], **free}}
    return noted, fitted, surface
