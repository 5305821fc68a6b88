"""The steps of `famjax fit` between reading the map and writing the files, with their progress."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from rich.progress import Progress

import fitting
from famjax.boundary.tasks import AnyExecutor
from fitting.choice import Choice, validate_choice
from fitting.evidence import Evidence, gather, left_out_kinds
from fitting.verdict import Judgement, doubtful, judge, suspect

from .measured_shape import shared_moves

_LARGE = 2000
"""Readings from which other processes choose sooner than this one, see `fitting.choose`."""


class Steps:
    """A fit in the making: what was found so far.

    Attributes:
        result: the identification, of the family chosen or asked for.
        choice: of the family; None where one was asked for.
        evidence: validation and uncertainty.
        judgement: the verdict.
    """

    result: fitting.Identification
    choice: Choice | None
    evidence: Evidence
    judgement: Judgement

    def __init__(
        self,
        data: fitting.ForceData,
        options: Mapping[str, Any],
        progress: Progress,
        executor: AnyExecutor = None,
    ) -> None:
        self._data, self._options, self._progress = data, dict(options), progress
        self._executor = executor
        self._task = progress.add_task(f"identifying {data.specimen.name}", total=None)

    def _show(self, what: str, done: int, total: int) -> None:
        self._progress.update(self._task, description=what, completed=done, total=total)

    def choose(self) -> None:
        """The family that predicts best what was left out."""
        large = self._data.force.size >= _LARGE
        self.choice = fitting.choose(
            self._data, **self._options, executor=self._executor if large else None,
            progress=self._show,
        )  # fmt: skip
        self.result = self.choice.chosen

    def identify(self, **asked: Any) -> None:
        """The family asked for, by law, order and dependence."""
        self.choice = None
        name = f"identifying {self._data.specimen.name}"
        self.result = fitting.identify(
            self._data, **self._options, **asked,
            progress=lambda done, total: self._show(name, done, total),
        )  # fmt: skip

    def gather(
        self,
        *,
        validation: bool,
        profiles: bool,
        replicates: int,
        posterior: bool,
        errors: fitting.data.SharedErrors,
        surface: fitting.shapes.ShapeSurface | None,
    ) -> None:
        """The evidence that was asked for; a choice is made anew in every fold of a validation."""
        choice = self.choice
        self.evidence = gather(
            self.result, validation=validation and choice is None, profiles=profiles,
            replicates=replicates, seed=self._options["seed"], executor=self._executor,
            progress=self._show,
            error=None if choice is None else choice.error, posterior=posterior,
            noise=self._options["noise"] if choice is None else None,
            shared=shared_moves(self.result.data, errors, surface),
        )  # fmt: skip
        if choice is not None and validation:
            found = [
                validate_choice(
                    choice, kind, **self._options, executor=self._executor,
                    progress=lambda done, total, kind=kind: self._show(
                        f"choosing with one {kind} left out", done, total
                    ),
                )
                for kind in left_out_kinds(self.result)
            ]  # fmt: skip
            self.evidence = dataclasses.replace(self.evidence, validations=tuple(found))

    def judge(self) -> None:
        """The verdict; data that are fitted poorly are questioned."""
        suspicions = ()
        if doubtful(self.result):
            suspicions = suspect(
                self.result,
                progress=lambda done, total: self._show("looking for what is wrong", done, total),
            )
        left_out = None if self.choice is None else self.choice.left_out
        self.judgement = judge(self.result, suspicions, left_out)
