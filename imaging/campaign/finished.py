"""The finished rows of a campaign on the disk, from which a stopped campaign goes on.

One line for the settings and one for each picture, added as soon as it is measured and never
changed again. What the file holds is known by the paths in it, so that pictures may be added, left
out and divided otherwise later.
"""

import contextlib
import dataclasses
import json
import os
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from famjax.boundary.files import write_whole
from famjax.boundary.settings import differing, some_of

from ..errors import ImagingError
from .row import Row, file_facts

PARTS = "parts"
"""Folder of the finished rows in that of a campaign."""
_FORMAT = "famjax measure 2"


class CampaignChanged(ImagingError):  # noqa: N818 - as all names in `imaging.errors`
    """What a campaign has measured so far was measured from other pictures, or otherwise."""


class Finished:
    """The rows that a campaign has finished, in a folder.

    Args:
        folder: made if need be; None keeps nothing.
        settings: what every row depends on, by name; values of JSON.
        resume: go on with the rows that are there; else they are removed.

    Raises:
        CampaignChanged: the rows there were measured with other settings.
        ImagingError: the folder cannot be read or written, or the rows in it are damaged.
    """

    def __init__(
        self, folder: Path | None, settings: dict[str, Any], *, resume: bool = True
    ) -> None:
        self.folder = folder
        self._rows: dict[str, Row] = {}
        if folder is None:
            return
        self._file = folder / "rows.jsonl"
        self._begun = folder / "begun"  # the path of the picture that this process is measuring
        settings = {"format": _FORMAT, **settings}
        with self._on_disk("used"):
            folder.mkdir(parents=True, exist_ok=True)
            head, *rows = (_read(self._file) if resume else []) or [settings]
            if not rows:
                self._file.unlink(missing_ok=True)
        if rows:
            _refuse_other(head, settings, folder)
            self._rows = {_key(row["path"]): Row(**row) for row in rows}
        else:
            self._add([settings])

    def rows_of(self, paths: Iterable[str]) -> dict[str, Row]:
        """The rows of those pictures that need not be measured again, by path as given here.

        A picture that failed is measured again if its file has changed since.

        Raises:
            CampaignChanged: a file that was measured has changed since.
        """
        found: dict[str, Row] = {}
        changed: list[str] = []
        for path in paths:
            row = self._rows.get(_key(path))
            if row is not None and _same_file(row, path):
                found[path] = dataclasses.replace(row, path=path)
            elif row is not None and row.ok:
                changed.append(path)
        if changed:
            raise CampaignChanged(
                f"{len(changed)} pictures have changed since they were measured, so that the table "
                f"would no longer describe them: {some_of(changed)}. Measure all again without "
                "resuming (--no-resume), or give another output folder",
                path=str(self.folder),
            )
        return found

    def trusts(self, paths: Iterable[str]) -> bool:
        """Whether this process may measure these: none has killed one, and the next would know."""
        if self.folder is None:
            return False
        with self._on_disk("used"):
            deadly = self._begun.read_bytes() if self._begun.exists() else b""
        return os.fsdecode(deadly) not in map(_key, paths)

    @contextlib.contextmanager
    def begun(self, path: str) -> Iterator[None]:
        """While a picture is measured in this process: what stays on the disk if that kills it."""
        with self._on_disk("written"):
            self._begun.write_bytes(os.fsencode(_key(path)))
        try:
            yield
        finally:
            self._begun.unlink(missing_ok=True)

    def append(self, rows: list[Row]) -> None:
        """Keep finished rows; they are on the disk when this returns."""
        if self.folder is None or not rows:
            return
        self._add([vars(row) | {"path": _key(row.path)} for row in rows])

    def _add(self, entries: list[dict[str, Any]]) -> None:
        with self._on_disk("written"), self._file.open("ab") as file:
            file.write(_lines(entries))
            file.flush()
            os.fsync(file.fileno())

    def settle(self, paths: Iterable[str]) -> None:
        """Put the rows of a campaign that is done into the order of its paths, others behind them.

        The file then does not depend on which process was faster, or on when the campaign was stopped.
        """
        if self.folder is None:
            return
        with self._on_disk("written"):
            self._begun.unlink(missing_ok=True)
            head, *rows = _read(self._file)
            place = {_key(path): k for k, path in enumerate(paths)}
            latest = {row["path"]: row for row in rows}
            ordered = sorted(latest.values(), key=lambda row: place.get(row["path"], len(place)))
            if ordered != rows:
                write_whole(self._file, _lines([head, *ordered]))

    @contextlib.contextmanager
    def _on_disk(self, what: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise ImagingError(
                f"the finished part of the campaign cannot be {what}: {error}", path=self.folder
            ) from None


def _refuse_other(head: dict[str, Any], settings: dict[str, Any], folder: Path) -> None:
    changes = differing(head, settings)
    if changes:
        raise CampaignChanged(
            f"the pictures there were measured otherwise: {some_of(changes, '; ')}. Measure all "
            "again without resuming (--no-resume), give another output folder, or the same settings",
            path=folder,
        )


def _same_file(row: Row, path: str) -> bool:
    """Whether the file is the one measured: untouched, or touched but with the same content."""
    try:
        status = os.stat(path)
    except OSError:
        return row.size == -1
    if (status.st_size, status.st_mtime_ns) == (row.size, row.modified):
        return True
    return status.st_size == row.size and file_facts(path).get("sha256") == row.sha256


def _key(path: str) -> str:
    return os.path.abspath(path)


def _lines(entries: list[dict[str, Any]]) -> bytes:
    return b"".join(_line(json.dumps(entry).encode()) for entry in entries)


def _line(text: bytes) -> bytes:
    """A line with its checksum: a spoilt digit would still be a number."""
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _read(file: Path) -> list[dict[str, Any]]:
    """The settings and the rows in a file, of which a line that was cut off is removed."""
    content = file.read_bytes() if file.exists() else b""
    whole = content.rfind(b"\n") + 1
    if whole < len(content):  # the campaign was killed, or the power failed, while it was written
        os.truncate(file, whole)
    entries = []
    for number, line in enumerate(content[:whole].splitlines(keepends=True), 1):
        text = line[9:-1]
        if line != _line(text):
            remedy = "remove the line, its picture is then measured again"
            if number == 1:
                remedy = "measure all again without resuming (--no-resume)"
            raise ImagingError(
                f"the finished rows of the campaign are damaged in line {number}; {remedy}",
                path=file,
            )
        entries.append(json.loads(text))
    return entries
