"""Thousands of pictures through any executor, stopped and resumed at will, into one table."""

import contextlib
import functools
import importlib.metadata
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from ..camera.orientation import shown_size
from ..errors import ImagingError, MixedSizes
from ..recipe import Recipe
from ..shape.recipe_file import recipe_as_dict, recipe_text
from .finished import PARTS, Finished, some_of
from .row import Row, measured_rows
from .table import Table
from .workers import Rows, Work, dead_row, in_executor, in_processes

_TASKS = 32  # chunks are smaller than asked for where there would be fewer than this of them
_FEW = 4  # pictures, which take less time than the start of a process


def process(
    paths: Iterable[str | Path],
    recipe: Recipe,
    output: str | Path | None = None,
    executor: Executor | None = None,
    chunk: int = 64,
    resume: bool = True,
    progress: Callable[[int, int], None] | None = None,
    *,
    workers: int | None = None,
    rest_length: float | None = None,
    reader: Callable[..., Any] | None = None,
    provenance: Mapping[str, str] | None = None,
) -> Table:
    """The shape in every picture, each measured on its own; a picture that fails is a row with the reason.

    Rows are kept in `output/parts` as soon as they are done. A campaign that was stopped, killed or
    extended goes on with the pictures that are not there yet.

    Up to four pictures are measured in this process where there is an `output`. If one of them kills it,
    the next run finds that in `output` and measures in separate processes, as it does with more.

    Args:
        paths: of the pictures, all of one size; one named twice is measured once.
        recipe: how to measure, the same for all.
        output: folder for the finished rows, made if need be; None keeps them in memory only.
        executor: any `concurrent.futures.Executor`, for a cluster a dask client's
            `get_executor()`; its workers must see the files. Processes of this machine if None.
        chunk: most pictures of one task of the executor; fewer where there are few pictures.
        resume: go on with what is in `output`; else begin anew.
        progress: called with (pictures done, pictures) whenever some are done.
        workers: number of processes where there is no executor; one for each core if None, or none
            for few pictures.
        rest_length: L0 [m] of the contraction; the longest measured picture if None.
        reader: see `measure`; must be picklable.
        provenance: further entries of the table's provenance.

    Returns:
        The table, its rows in the order of the paths.

    Raises:
        ImagingError: no paths, or a folder that cannot be used.
        MixedSizes: the pictures differ in size; nothing has been measured.
        CampaignChanged: `output` holds rows of another recipe, or of a picture that has changed.
    """
    names = _unique(paths)
    size = common_size(names)
    if size is not None:
        _refuse_crop(recipe, size)
    if workers is not None and workers < 1:
        raise ImagingError(f"at least one worker is needed, got {workers}")
    version = importlib.metadata.version("famjax")
    settings = {"version": version, "recipe": recipe_as_dict(recipe)}
    finished = Finished(None if output is None else Path(output) / PARTS, settings, resume=resume)
    rows = finished.rows_of(names)
    missing = [name for name in names if name not in rows]
    work = functools.partial(measured_rows, recipe=recipe, reader=reader)
    lost: list[str] = []
    if executor is not None:
        each = max(1, min(chunk, math.ceil(len(missing) / _TASKS)))
        chunks = [missing[k : k + each] for k in range(0, len(missing), each)]
        measured = in_executor(executor, chunks, work, len(chunks), lost)
    elif workers is None and len(missing) <= _FEW and finished.trusts(missing):
        measured = _in_this_process(missing, work, finished)
    else:
        count = max(1, min(workers or os.cpu_count() or 1, len(missing)))
        measured = in_processes(count, missing, work)

    def record(done: list[Row]) -> None:
        rows.update((row.path, row) for row in done)
        if progress is not None:
            progress(len(rows), len(names))

    record([])
    try:
        for done in measured:
            finished.append(done)
            record(done)
    except KeyboardInterrupt:
        # Wherever it was raised, the pictures under way come back.
        with contextlib.suppress(KeyboardInterrupt):
            done = measured.throw(KeyboardInterrupt)
            while True:
                finished.append(done)
                record(done)
                done = next(measured)
        raise
    if lost:
        record([dead_row(path, "its executor broke; run again to measure it") for path in lost])
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


def _in_this_process(paths: Sequence[str], work: Work, finished: Finished) -> Rows:
    """The rows of every picture, measured here by one thread."""
    import cv2  # noqa: PLC0415

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for path in paths:
            with finished.begun(path):
                rows = work([path])
            yield rows
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
