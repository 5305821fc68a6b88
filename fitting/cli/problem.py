"""A fit as it was asked for, from options or from a `fit.json`: solved, assessed and judged."""

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import fitting
from famjax.boundary.sentence import Quantity, Sentence
from famjax.boundary.tasks import AnyExecutor
from fitting.choice import Choice
from fitting.data import Specimen
from fitting.evidence import (
    Evidence,
    Move,
    SharedErrors,
    drawn_moves,
    gather,
    left_out_kinds,
    moves_of,
)
from fitting.faults import doubtful, suspect
from fitting.nested import validate_choice
from fitting.parameters import Parameter
from fitting.posing import own_parts, taking_part
from fitting.shapes import ShapeSurface
from fitting.verdict import Judgement, judge

from .inputs import parameter_kinds, parse_bounds, parse_errors, parse_free, parse_priors

Tell = Callable[[str, int, int], None]
"""Called with what is under way, what is done of it, and what there is to do."""

_TURNS = "turns"
_SAVED = ("pressure_tolerance", "length_tolerance", "force_limit")


@dataclasses.dataclass(frozen=True)
class Asked:
    """The options of `famjax fit` that make the problem, as they were typed."""

    law: str | None = None
    order: int | None = None
    constraint: str = "drucker"
    free: tuple[str, ...] = ()
    geometry: str | None = None
    term: tuple[str, ...] = ()
    shape: str | None = None
    bounds: tuple[str, ...] = ()
    prior: tuple[str, ...] = ()
    noise: float | None = None
    error: tuple[str, ...] = ()
    censored: bool = False
    objective: str = "sum_of_squares"

    @property
    def chosen(self) -> bool:
        """Whether the law is chosen among several."""
        named = (self.law, self.order, self.geometry, self.shape)
        return not (any(one is not None for one in named) or self.term or self.censored)


@dataclasses.dataclass(frozen=True)
class Problem:
    """A map and what is asked of it.

    Attributes:
        given: the map as it was read.
        asked: the options.
        data: the map that is fitted, with notes on a measured shape.
        options: of `fitting.identify` and `fitting.choose`.
        errors: that all readings share.
        surface: the measured shape, or None.
    """

    given: fitting.ForceData
    asked: Asked
    data: fitting.ForceData
    options: Mapping[str, Any]
    errors: SharedErrors
    surface: ShapeSurface | None

    @classmethod
    def of(cls, data: fitting.ForceData, asked: Asked) -> "Problem":
        """The problem that options make of a map.

        Raises:
            InputError: what is wrong with them.
        """
        if asked.geometry is not None and asked.shape is not None:
            raise fitting.InputError(
                "--shape is a geometry already: give either --shape or --geometry, got both"
            )
        errors = parse_errors(asked.error)
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
            "noise": asked.noise,
            "objective": asked.objective,
        }
        fitted, surface = data, None
        if asked.shape is not None:
            fitted, options, surface = _with_shape(data, Path(asked.shape), options)
        return cls(data, asked, fitted, options, errors, surface)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> "Problem":
        """The problem of a `fit.json`.

        Raises:
            InputError: the file does not hold one, or a file that it names is not there any more.
        """
        held = document.get("problem")
        if held is None:
            raise fitting.InputError(
                "the file does not hold its problem: assess a fit.json of famjax fit; of a fit in a "
                "script call fitting.validate, fitting.profile, fitting.bootstrap or fitting.sample"
            )
        asked: dict[str, Any] = {
            key: tuple(one) if isinstance(one, list) else one for key, one in held["asked"].items()
        }
        known = document["data"]
        columns = {
            key.rpartition("_")[0]: np.array(values) for key, values in known["readings"].items()
        }
        specimen = {key.removesuffix("_m"): value for key, value in known["specimen"].items()}
        data = fitting.ForceData(
            **columns, specimen=Specimen(**specimen), source=known["source"],
            notes=tuple(_sentence(one) for one in held["notes"]),
            assumed=tuple(held["assumed"]), units=held["units"],
            **{name: held[name] for name in _SAVED},
        )  # fmt: skip
        return cls.of(data, Asked(**asked))

    def as_dict(self) -> dict[str, Any]:
        """What `fit.json` holds of it beside the readings and the specimen, in SI."""
        data = self.given
        return {
            "asked": dataclasses.asdict(self.asked),
            "notes": [_parts(one) for one in data.notes],
            "assumed": list(data.assumed),
            "units": dict(data.units),
            **{name: getattr(data, name) for name in _SAVED},
        }

    def solve(self, progress: Tell) -> tuple[fitting.Identification, Choice | None]:
        """The fit, and the choice of its law where none was asked for."""
        asked = self.asked
        if asked.chosen:
            choice = fitting.choose(self.data, **self.options, progress=progress)
            return choice.chosen, choice
        name = f"identifying {self.data.specimen.name}"
        found = fitting.identify(
            self.data, **self.options, law=asked.law or "polynomial", order=asked.order,
            censored=asked.censored, progress=lambda done, total: progress(name, done, total),
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
        """The evidence that is wanted; a choice is made anew in every fold of a validation.

        Args:
            result: the fit.
            choice: of its law; None where one was asked for.
            progress: called as it comes.
            validation: leave out each pressure and each length.
            executor: what chooses anew.
            **wanted: what else `fitting.evidence.gather` is to find.
        """
        found = gather(
            result, validation=validation and choice is None, progress=progress,
            known=None if choice is None else (choice.error, choice.left_out),
            noise=self.asked.noise if choice is None else None,
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
        """What errors that all readings share move: those that are stated, and that of the shape."""
        surface = self.surface
        if surface is None:
            return moves_of(data, self.errors)
        draws = drawn_moves(lambda draw: surface.geometry(data.specimen, draw=draw))
        return {**moves_of(data, self.errors, surface.geometry), "shape": draws}


def _parts(note: str) -> Any:
    """A note for JSON, which keeps the quantities in it."""
    if isinstance(note, Sentence):
        return [_parts(one) if isinstance(one, str) else one._asdict() for one in note.parts]
    return note


def _sentence(parts: Any) -> str:
    if isinstance(parts, str):
        return parts
    return Sentence(
        *(Quantity(**one) if isinstance(one, dict) else _sentence(one) for one in parts)
    )


def judged(
    result: fitting.Identification, choice: Choice | None, evidence: Evidence, progress: Tell
) -> Judgement:
    """The verdict; data that are fitted poorly are questioned."""
    suspicions = ()
    if doubtful(result):
        suspicions = suspect(
            result, progress=lambda done, total: progress("looking for what is wrong", done, total)
        )
    question = "" if choice is None else choice.open_question
    return judge(result, suspicions, evidence.left_out, question)


def _with_shape(
    data: fitting.ForceData, pictures: Path, options: Mapping[str, Any]
) -> tuple[fitting.ForceData, dict[str, Any], ShapeSurface]:
    """The map with notes on the shape, the options of a fit with that geometry, and the shape.

    The turns of the threads are identified unless they are named: the force tells them, and the
    diameters alone do not.
    """
    surface = fitting.shape_surface(pictures)
    geometry = surface.geometry(data.specimen)
    low, high = (float(one) for one in geometry.length_range())
    outside = (data.length < low) | (data.length > high)
    if outside.any():
        raise fitting.InputError(
            f"{int(outside.sum())} readings of {data.source} lie outside the lengths of the pictures, "
            f"{low * 1e3:.4g} to {high * 1e3:.4g} mm: photograph the whole stroke, or leave them out"
        )
    named = {*options["bounds"], *options["parameters"]}
    least, most = surface.threads.turns_range()
    free = {} if _TURNS in named else {_TURNS: Parameter(min=least, max=most)}
    noted = dataclasses.replace(data, notes=(*data.notes, *surface.summary()))
    fitted = {**options, "geometry": geometry, "parameters": {**options["parameters"], **free}}
    return noted, fitted, surface
