"""Solve the problem described by `famjax fit` options or a `fit.json`, and assess the fit."""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import fitting
from famjax.boundary.errors import InputError, Own, check_trusted
from famjax.boundary.files import Origin
from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import factor, si_unit, to_si
from famjax.console import Output, Units, print_lines, print_table, progress
from fitting import report
from fitting.choice import Choice, validate_choice
from fitting.evidence import DRAWS, FORM, Move, SharedErrors, gather, left_out_kinds, moves_of
from fitting.families import LawGiven, known_laws, law_named
from fitting.faults import doubtful, suspect, suspect_refused
from fitting.parameters import KINDS, Parameter
from fitting.posing import own_parts, taking_part
from fitting.records import fit_hysteresis, leave_out
from fitting.shapes import ShapeSurface
from fitting.verdict import judge

from .fit import Asked

Kinds = Mapping[str, str]
"""Kind of unit for each parameter."""

_TURNS = "turns"


def parameter_kinds(*laws: LawGiven) -> dict[str, str]:
    """Return the kind of unit for every possible parameter of all known laws and of the given laws."""
    kinds = KINDS | {f"E_{n}": "stress" for n in range(1, 9)}
    for one in (*known_laws(), *laws):
        made = law_named(one, None)
        kinds |= {name: entry.kind for name, entry in {**made.shape, **made.coefficients}.items()}
    return kinds


def _parsed(
    entries: Iterable[str], what: str, form: str, kinds: Kinds | None, split: str
) -> dict[str, tuple[list[float], str, str]]:
    """Parse entries such as `name_unit=1:2` into numbers, unit and kind by name."""
    found: dict[str, tuple[list[float], str, str]] = {}
    known = parameter_kinds() if kinds is None else kinds
    for entry in entries:
        key, _, text = (part.strip() for part in entry.partition("="))
        try:
            numbers = [float(one) for one in text.split(split)]
        except ValueError:
            numbers = []
        if not (key and 1 <= len(numbers) <= 2):
            raise InputError(f"{what} {entry!r} must have the form {form}")
        # The longest known name wins, since one name may be a prefix of another.
        name = max((one for one in known if f"{key}_".startswith(f"{one}_")), key=len, default=None)
        if name is None:
            listed = ", ".join(f"{n}_{si_unit(k)}".rstrip("_") for n, k in known.items())
            raise InputError(
                f"{what} {entry!r}: unknown parameter; choose from {listed} (any unit)"
            )
        if name in found:
            raise InputError(f"{what} for {name} given twice: keep only one")
        unit = key[len(name) + 1 :]
        factor(unit, known[name])  # refuse an unknown unit
        found[name] = numbers, unit, known[name]
    return found


def parse_bounds(
    entries: Iterable[str], kinds: Kinds | None = None
) -> dict[str, tuple[float, float]]:
    """Parse entries such as `braid_diameter_mm=20:23.6` into bounds in SI units, by parameter name.

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
            raise InputError(f"the prior on {name} must have the form {form}")
        found[name] = Parameter(prior=(numbers[0], numbers[1]), unit=unit)
    return found


def parse_errors(entries: Iterable[str]) -> tuple[SharedErrors, float | None]:
    """Parse standard errors into calibration errors shared by all readings and the force noise [N] or None.

    Raises:
        InputError: an entry is malformed, a name or unit is unknown, or a name is given twice.

    >>> errors, noise = parse_errors(["wall_thickness_mm=0.05", "noise_N=1.5"])
    >>> errors.stated(), noise
    ({'wall_thickness': 5e-05}, 1.5)
    """
    fields = [one.name for one in dataclasses.fields(SharedErrors)]
    kinds = {name: FORM.kinds.get(name, "number") for name in fields} | {"noise": "force"}
    form = "name_unit=value, as in wall_thickness_mm=0.05"
    parsed = _parsed(entries, "error", form, kinds, "+-").items()
    found = {name: to_si(numbers[0], unit, kind) for name, (numbers, unit, kind) in parsed}
    noise = found.pop("noise", None)
    try:
        return SharedErrors(**found), noise
    except ValueError as error:
        raise InputError(str(error)) from None


def identify_options(
    maps: Sequence[fitting.ForceData], asked: Asked, laws: Iterable[LawGiven]
) -> tuple[dict[str, Any], Kinds]:
    """Convert typed options to arguments of `fitting.identify`; also return each parameter's kind of unit.

    Raises:
        InputError: an option is invalid.
    """
    parts, declared = own_parts(maps, asked.geometry, asked.term)
    kinds = parameter_kinds(*laws) if asked.bounds or asked.free or asked.prior else {}
    kinds |= {name: one.kind for name, one in declared.items()}
    kinds |= {} if asked.shape is None else {_TURNS: "number"}
    limits = parse_bounds(asked.bounds, kinds)
    for name in asked.free:
        if name not in kinds:
            raise InputError(f"--free {name}: unknown parameter; available: {', '.join(kinds)}")
    named = {name: Parameter() for name in asked.free} | parse_priors(asked.prior, kinds)
    parameters = named | taking_part(declared, {**limits, **named})
    return {**parts, "bounds": limits, "parameters": parameters}, kinds


def asked_of(fit: fitting.Identification, own: Own = ()) -> Asked:
    """Return the options of `famjax fit` that are stored in a fit.

    Args:
        fit: a fit loaded by `fitting.load_fit`.
        own: the trusted modules, as passed to `fitting.load_fit`.

    Raises:
        InputError: the file does not contain the options, or a class named in them is not trusted.
    """
    held = fit.document.get("problem")
    if held is None:
        raise InputError(
            "the file does not contain the options of the fit: use a fit.json written by famjax fit. For a "
            "fit from a script, call fitting.validate, fitting.profile, fitting.bootstrap or fitting.sample"
        )
    asked: dict[str, Any] = {
        key: tuple(one) if isinstance(one, list) else one for key, one in held["asked"].items()
    }
    for kind in ("law", "geometry", "term"):
        for path in np.atleast_1d(asked.get(kind) or []):
            if ":" in path:
                check_trusted(str(path), own, kind)
    return Asked(**asked)


def solve(
    data: fitting.ForceData,
    asked: Asked,
    place: Output,
    units: Units,
    *,
    verbose: bool,
    as_json: bool,
    pairs: Any = None,
    validation: bool = False,
    executor: AnyExecutor = None,
    **wanted: Any,
) -> int:
    """Fit a map, gather evidence, write the files and print the result.

    Args:
        data: the map.
        asked: options of the fit.
        place: folder for the files.
        units: units for output and report.
        verbose: True to print all tables and notes as well.
        as_json: True to print the contents of `fit.json` instead.
        pairs: branches of raw ramps, to which hysteresis is fitted; None to omit hysteresis.
        validation: True to cross-validate; if no law was given, it is chosen again in every fold.
        executor: executor for the repeated choices.
        **wanted: further evidence, see `fitting.evidence.gather`.

    Returns:
        The exit code: 1 if no muscle was identified.

    Raises:
        InputError: an option is invalid, or the data cannot support the fit.
    """
    data, options, errors, surface = _options(data, asked)
    with progress("identifying") as show:

        def tell(what: str, done: int, total: int) -> None:
            show(done, total, what)

        result, choice = _identified(data, asked, options, tell)
        moves = moves_of(result.data, errors, *([] if surface is None else [surface.geometry]))
        if surface is not None:
            specimen = result.data.specimen
            moves["shape"] = [
                Move(None, surface.geometry(specimen, draw=draw)) for draw in range(DRAWS)
            ]
        evidence = gather(
            result, validation=validation and choice is None, progress=tell, shared=moves,
            known=None if choice is None else (choice.error, choice.left_out),
            noise=options["noise"] if choice is None else None, **wanted,
        )  # fmt: skip
        if choice is not None and validation:
            anew = [
                validate_choice(
                    choice, kind, **options, executor=executor,
                    progress=functools.partial(tell, f"choosing with one {kind} left out"),
                )
                for kind in left_out_kinds(result)
            ]  # fmt: skip
            evidence = dataclasses.replace(evidence, validations=tuple(anew))
        if pairs is not None:
            evidence = dataclasses.replace(evidence, hysteresis=leave_out(fit_hysteresis(pairs)))
        suspicions = ()
        if doubtful(result):  # test likely errors in the data
            tell("checking for errors in the data", 0, 1)
            suspicions = suspect(result)
    question = "" if choice is None else choice.open_question
    judgement = judge(result, suspicions, evidence.left_out, question)
    paths = report.write_fit(
        result, place.folder, units, evidence, Origin.of_this_command(), choice=choice,
        judgement=judgement, problem={"asked": dataclasses.asdict(asked)},
    )  # fmt: skip
    if as_json:
        print(paths[0].read_text(encoding="utf-8"))
    else:
        _print(report.Findings(result, evidence, choice, judgement), units, verbose=verbose)
        place.tell(paths)
    return 0 if judgement.passed else 1


def _print(found: report.Findings, units: Units, *, verbose: bool) -> None:
    notes, data = found.notes(units), found.result.data
    print(f"{data.specimen.name}  ({data.source})")
    if verbose:
        for title, header, rows in found.tables(units):
            print_table(title, header, rows)
        print("\n".join(("", *(f"note: {one}" for one in notes))))
    print_lines(found.summary(units))
    if notes and not verbose:
        many = f"{len(notes)} note{'s' * (len(notes) != 1)}"
        print(f"For {many} and all tables, see report.html or use --verbose")


def _options(
    data: fitting.ForceData, asked: Asked
) -> tuple[fitting.ForceData, dict[str, Any], SharedErrors, ShapeSurface | None]:
    """Return the map, the arguments of `identify` or `choose`, calibration errors and measured shape."""
    if asked.geometry is not None and asked.shape is not None:
        raise InputError(
            "--shape also sets the geometry, so use either --shape or --geometry, not both"
        )
    options, _ = identify_options([data], asked, [asked.law] if asked.law else [])
    options |= {name: getattr(asked, name) for name in ("constraint", "objective", "ends")}
    errors, options["noise"] = parse_errors(asked.shared_error)
    if asked.shape is not None and asked.ends == "equilibrium":
        options["pictures"] = asked.shape
    elif asked.shape is not None:
        data, options, surface = _with_shape(data, Path(asked.shape), options)
        return data, options, errors, surface
    return data, options, errors, None


def _identified(
    data: fitting.ForceData,
    asked: Asked,
    options: dict[str, Any],
    tell: Callable[[str, int, int], None],
) -> tuple[fitting.Identification, Choice | None]:
    """Return the fit and, if no law was given, the choice that it comes from."""
    if asked.chosen:
        try:
            choice = fitting.choose(data, **options, progress=tell)
        except InputError as error:
            for suspicion in suspect_refused(data):
                raise InputError(suspicion.sentence) from error
            raise
        return choice.chosen, choice
    censored = asked.objective == "censored"
    options |= {"objective": "sum_of_squares"} if censored else {}
    told = functools.partial(tell, f"identifying {data.specimen.name}")
    law = asked.law or "polynomial"
    return fitting.identify(
        data, **options, law=law, order=asked.order, censored=censored, progress=told
    ), None


def _with_shape(
    data: fitting.ForceData, pictures: Path, options: Mapping[str, Any]
) -> tuple[fitting.ForceData, dict[str, Any], ShapeSurface]:
    """Return the map with notes on the shape, the options of a fit with this geometry, and the shape.

    The number of turns of a thread is identified from the force unless the user sets it, since diameters
    alone do not determine it.
    """
    surface = fitting.shape_surface(pictures)
    geometry = surface.geometry(data.specimen)
    low, high = (float(one) for one in geometry.length_range())
    outside = (data.length < low) | (data.length > high)
    if outside.any():
        raise fitting.InputError(
            f"all lengths must be within the photographed range, {low * 1e3:.4g} to {high * 1e3:.4g} mm, "
            f"but {int(outside.sum())} readings in {data.source} are outside it: photograph the whole "
            "stroke, or remove these readings"
        )
    named = {*options["bounds"], *options["parameters"]}
    least, most = surface.threads.turns_range()
    free = {} if _TURNS in named else {_TURNS: Parameter(min=least, max=most)}
    # The data of a saved fit already have the notes.
    noted = dataclasses.replace(data, notes=tuple(dict.fromkeys((*data.notes, *surface.summary()))))
    fitted = {**options, "geometry": geometry, "parameters": {**options["parameters"], **free}}
    return noted, fitted, surface
