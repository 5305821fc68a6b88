"""The steps of `famjax fit` between identifying the muscle and writing the files."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import fitting
from famjax.boundary.tasks import AnyExecutor
from fitting.choice import Choice, validate_choice
from fitting.evidence import Evidence, gather, left_out_kinds
from fitting.verdict import Judgement, doubtful, judge, suspect

from .measured_shape import shared_moves

if TYPE_CHECKING:
    from fitting.shapes import ShapeSurface

Tell = Callable[[str, int, int], None]
"""Called with what is under way, what is done of it, and what there is to do."""


def gathered(
    result: fitting.Identification,
    choice: Choice | None,
    options: Mapping[str, Any],
    *,
    validation: bool,
    errors: fitting.data.SharedErrors,
    surface: "ShapeSurface | None",
    executor: AnyExecutor,
    progress: Tell,
    **asked: Any,
) -> Evidence:
    """The evidence that was asked for; a choice is made anew in every fold of a validation.

    Args:
        result: the fit.
        choice: of its family; None where one was asked for.
        options: of the fit.
        validation: leave out each pressure and each length.
        errors: that are stated of all readings.
        surface: the measured shape, or None.
        executor: what refits.
        progress: called as it comes.
        **asked: what else `fitting.evidence.gather` is to find.
    """
    evidence = gather(
        result, validation=validation and choice is None, seed=options["seed"], executor=executor,
        progress=progress,
        known=None if choice is None else (choice.error, choice.left_out),
        noise=options["noise"] if choice is None else None,
        shared=shared_moves(result.data, errors, surface),
        **asked,
    )  # fmt: skip
    if choice is None or not validation:
        return evidence
    found = [
        validate_choice(
            choice, kind, **options, executor=executor,
            progress=lambda done, total, kind=kind: progress(
                f"choosing with one {kind} left out", done, total
            ),
        )
        for kind in left_out_kinds(result)
    ]  # fmt: skip
    return dataclasses.replace(evidence, validations=tuple(found))


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
