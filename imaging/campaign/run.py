"""Thousands of pictures through any executor, stopped and resumed at will, into one table."""

import contextlib
import functools
import importlib.metadata
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from famjax.boundary.settings import some_of
from famjax.boundary.tasks import AnyExecutor, run_tasks

from ..camera.orientation import shown_size
from ..errors import ImagingError, MixedSizes
from ..recipe import Recipe
from ..shape.recipe_file import recipe_as_dict, recipe_text
from .finished import PARTS, Finished
from .row import Row, dead_row, measured_rows
from .table import Table

_TASKS = 32  # chunks are smaller than asked for where there would be fewer than this of them
_FEW = 4  # pictures, which take less time than the start of a process


def process(
    paths: Iterable[str | Path],
    recipe: Recipe,
    output: str | Path | None = None,
    executor: AnyExecutor | Literal["auto"] = "auto",
    chunk: int = 64,
    resume: bool = True,
    progress: Callable[[int, int], None] | None = None,
    *,
    rest_length: float | None = None,
    reader: Callable[..., Any] | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Table:
    """The shape in every picture, each measured on its own; a picture that fails is a row with the reason.

    Rows are kept in `output/parts` as soon as they are done. A campaign that was stopped, killed or
    extended goes on with the pictures that are not there yet.

    A picture with which a worker dies costs that picture: it is tried again alone, and then a row with
    the reason. One that kills this process is found in `output` by the next run, which measures in
    separate processes.

    Args:
        paths: of the pictures, all of one size; one named twice is measured once.
        recipe: how to measure, the same for all.
        output: folder for the finished rows, made if need be; None keeps them in memory only.
        executor: this process, processes or a cluster, whose workers must see the files: see
            `famjax.boundary.tasks.AnyExecutor`. "auto" is a process for each core, or this one for up
            to four pictures with an `output`.
        chunk: most pictures of one task of an executor that is given; fewer where there are few
            pictures. This process and a number of processes have one.
        resume: go on with what is in `output`; else begin anew.
        progress: called with (pictures done, pictures) whenever some are done.
        rest_length: L0 [m] of the contraction; the longest measured picture if None.
        reader: see `measure`; must be picklable.
        provenance: further entries of the table's provenance.

    Returns:
        The table, its rows in the order of the paths.

    Raises:
        ImagingError: no paths, or a folder that cannot be used.
        MixedSizes: the pictures differ in size; nothing has been measured.
        CampaignChanged: `output` holds rows of another recipe, or of a picture that has changed.
        EngineLost: the executor is gone; the finished rows are kept.
    """
    names = _unique(paths)
    size = common_size(names)
    if size is not None:
        _refuse_crop(recipe, size)
    version = importlib.metadata.version("famjax")
    settings = {"version": version, "recipe": recipe_as_dict(recipe)}
    finished = Finished(None if output is None else Path(output) / PARTS, settings, resume=resume)
    rows = finished.rows_of(names)
    missing = [name for name in names if name not in rows]
    if executor == "auto":
        few = len(missing) <= _FEW and finished.trusts(missing)
        executor = None if few else os.cpu_count() or 1
    elif executor is None and output is not None and not finished.trusts(missing):
        executor = 1

    def record(done: list[Row], *, keep: bool = True) -> None:
        if keep:
            finished.append(done)
        rows.update((row.path, row) for row in done)
        if progress is not None:
            progress(len(rows), len(names))

    record([])
    store = _Pictures(record, finished.folder)
    work = functools.partial(measured_rows, recipe=recipe, reader=reader)
    if executor is None:
        with _one_thread():
            run_tasks(functools.partial(_begun, work, finished), missing, store=store)
    else:
        own = isinstance(executor, int)
        each = 1 if own else max(1, min(chunk, math.ceil(len(missing) / _TASKS)))
        lost = _lost_in(executor, work, missing, each, store)
        if each > 1:
            lost = _lost_in(executor, work, lost, 1, store)
        why = "the process that measured it ended abnormally, each time"
        if not own:
            why = "its executor broke with it, each time; run again to measure it"
        for path in lost:
            record([dead_row(path, why)], keep=own)
    if all(name in rows for name in names):
        finished.settle(names)
    return Table.from_rows(
        [rows[name] for name in names],
        scale_relative_stderr=recipe.scale.relative_stderr,
        rest_length=rest_length,
        provenance={
            "famjax_version": version,
            "recipe": recipe_text(recipe),
            **(provenance or {}),
        },
    )


class _Pictures:
    """Takes the rows of tasks; which pictures are done is known before."""

    def __init__(self, record: Callable[[list[Row]], None], folder: Path | None) -> None:
        self._record, self.folder = record, folder

    def __contains__(self, index: int, /) -> bool:
        return False

    def keep(self, index: int, rows: list[Row], /) -> None:
        """Rows of some pictures."""
        del index
        self._record(rows)


def _lost_in(
    executor: AnyExecutor,
    work: Callable[[Sequence[str]], list[Row]],
    paths: Sequence[str],
    each: int,
    store: _Pictures,
) -> list[str]:
    """Measure pictures, some in one task; those of tasks with which workers died are returned."""
    chunks = [paths[k : k + each] for k in range(0, len(paths), each)]
    lost: list[str] = []
    run_tasks(
        work, chunks, executor=executor, store=store, threads=True,
        refuse=lambda index, _: lost.extend(chunks[index]),
    )  # fmt: skip
    return lost


def _begun(work: Callable[[Sequence[str]], list[Row]], finished: Finished, path: str) -> list[Row]:
    with finished.begun(path):
        return work([path])


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """OpenCV has one thread here meanwhile, as it has in a worker."""
    import cv2  # noqa: PLC0415

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def _unique(paths: Iterable[str | Path]) -> list[str]:
    names: dict[str, str] = {}
    for path in paths:
        names.setdefault(os.path.abspath(path), str(path))
    if not names:
        raise ImagingError("there are no pictures to measure")
    return list(names.values())


def common_size(paths: Sequence[str]) -> tuple[int, int] | None:
    """Width and height of the pictures by the headers of their files [px]; None if no header has it.

    A file whose header cannot be read is left to the measurement, which reports what is wrong with it.

    Raises:
        MixedSizes: names the pictures that differ from the most common size.
    """
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 -- loaded when pictures are

    by_size: dict[tuple[int, int], list[str]] = {}
    for path in paths:
        try:
            with Image.open(path) as picture:
                by_size.setdefault(shown_size(picture), []).append(path)
        except (OSError, UnidentifiedImageError, SyntaxError):
            continue
    if len(by_size) < 2:
        return next(iter(by_size), None)
    (usual, most), *others = sorted(by_size.items(), key=lambda item: -len(item[1]))
    differing = [f"{path} ({w} x {h})" for (w, h), some in others for path in some]
    (width, height), (first, *_) = others[0]
    raise MixedSizes(
        "the pictures of a campaign must have one size, because one crop offset and one scale hold "
        f"for all; {len(most)} have {usual[0]} x {usual[1]} px, but not {some_of(differing)}. "
        "Measure them in a campaign of their own",
        path=first,
        width=width,
        height=height,
    )


def _refuse_crop(recipe: Recipe, size: tuple[int, int]) -> None:
    try:
        recipe.camera(*size)
    except ValueError as error:
        raise ImagingError(f"the recipe does not fit the pictures: {error}") from None
