"""The finished parts of a campaign on the disk, from which a stopped campaign goes on.

One file for each finished chunk, complete when it appears and never changed again. What a part holds
is known by the paths in it, so that pictures may be added, left out and chunked otherwise later.
"""

import contextlib
import io
import json
import math
import os
import zipfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ImagingError
from .row import Row, file_facts

_FORMAT = "famjax measure 1"
_HEAD = "campaign.json"
_PART = "part-*.npz"
_BEGUN = "begun"
"""File with the path of the picture that the campaign's own process is measuring, or has died of."""


class CampaignChanged(ImagingError):  # noqa: N818 - as all names in `_errors`
    """What a campaign has measured so far was measured from other pictures, or otherwise."""


class Shards:
    """The rows that a campaign has finished, in a folder.

    Args:
        folder: of the parts, made if need be; None keeps nothing.
        settings: what every row depends on, by name; values of JSON.
        resume: go on with the parts that are there; else they are removed.

    Raises:
        CampaignChanged: the parts there were measured with other settings.
        ImagingError: the folder cannot be read or written, or a part in it is damaged.
    """

    def __init__(
        self, folder: Path | None, settings: dict[str, Any], *, resume: bool = True
    ) -> None:
        self.folder = folder
        self._rows: dict[str, Row] = {}
        self._next = 0
        if folder is None:
            return
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for unfinished in folder.glob(".part-*"):
                unfinished.unlink()
            parts = sorted(folder.glob(_PART))
            if not resume:
                for part in parts:
                    part.unlink()
                parts = []
            head = folder / _HEAD
            if parts and head.exists():
                _refuse_other(json.loads(head.read_text(encoding="utf-8")), settings, folder)
            _write(head, json.dumps({"format": _FORMAT, **settings}, indent=1).encode())
        except (OSError, json.JSONDecodeError) as error:
            raise _unusable(error, folder) from None
        for part in parts:
            self._rows |= {_key(row.path): row for row in _read(part)}
        self._next = 1 + max((int(part.stem.split("-")[1]) for part in parts), default=-1)

    def finished(self, paths: Iterable[str]) -> dict[str, Row]:
        """The rows of those pictures that need not be measured again, by path as given here.

        A picture that failed is measured again if its file has changed since.

        Raises:
            CampaignChanged: a file that was measured has changed since.
        """
        found: dict[str, Row] = {}
        changed: list[str] = []
        for path in paths:
            row = self._rows.get(_key(path))
            if row is None:
                continue
            if _same_file(row, path):
                found[path] = Row(**{**vars(row), "path": path})
            elif row.ok:
                changed.append(path)
        if changed:
            raise CampaignChanged(
                f"{len(changed)} pictures have changed since they were measured, so that the table "
                f"would no longer describe them: {_some(changed)}. Measure all again without "
                "resuming (--no-resume), or give another output folder",
                path=str(self.folder),
            )
        return found

    def trusts(self, paths: Iterable[str]) -> bool:
        """Whether this process may measure these: none has died of one, and the next would know."""
        if self.folder is None:
            return False
        try:
            deadly = os.fsdecode((self.folder / _BEGUN).read_bytes())
        except FileNotFoundError:
            return True
        except OSError as error:
            raise _unusable(error, self.folder) from None
        return deadly not in map(_key, paths)

    @contextlib.contextmanager
    def begun(self, path: str) -> Iterator[None]:
        """While a picture is measured in this process: what stays on the disk if it dies of it."""
        assert self.folder is not None
        mark = self.folder / _BEGUN
        try:
            mark.write_bytes(os.fsencode(_key(path)))
        except OSError as error:
            raise _unwritable(error, self.folder) from None
        try:
            yield
        finally:
            mark.unlink(missing_ok=True)

    def append(self, rows: list[Row]) -> None:
        """Keep a finished chunk; it is on the disk when this returns."""
        if self.folder is None or not rows:
            return
        content = io.BytesIO()
        np.savez(
            content,
            rows=np.frombuffer(json.dumps([_plain(row) for row in rows]).encode(), np.uint8),
            diameter=np.stack([row.diameter for row in rows]),
            diameter_stderr=np.stack([row.diameter_stderr for row in rows]),
        )
        try:
            _write(self.folder / f"part-{self._next:06d}.npz", content.getvalue())
        except OSError as error:
            raise _unwritable(error, self.folder) from None
        self._next += 1


def _unusable(error: Exception, folder: Path) -> ImagingError:
    return ImagingError(
        f"the finished part of the campaign cannot be used: {error}", path=str(folder)
    )


def _unwritable(error: Exception, folder: Path) -> ImagingError:
    return ImagingError(
        f"a finished part of the campaign cannot be written: {error}", path=str(folder)
    )


def _refuse_other(head: dict[str, Any], settings: dict[str, Any], folder: Path) -> None:
    old, new = _flat(head), _flat({"format": _FORMAT, **settings})
    told = [
        f"{name} was {old.get(name, 'not given')}, now {new.get(name, 'not given')}"
        for name in [*new, *(set(old) - set(new))]
        if old.get(name) != new.get(name)
    ]
    if told:
        raise CampaignChanged(
            f"the pictures there were measured otherwise: {_some(told, '; ')}. Measure all again "
            "without resuming (--no-resume), give another output folder, or the same settings",
            path=str(folder),
        )


def _flat(settings: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(settings, dict):
        return {name: settings}
    flat: dict[str, Any] = {}
    for key, value in settings.items():
        flat |= _flat(value, f"{name}.{key}" if name else key)
    return flat


def _some(texts: list[str], between: str = ", ") -> str:
    shown = [text if len(text) < 200 else text[:200] + " ..." for text in texts[:5]]
    more = f"{between}and {len(texts) - 5} more" if len(texts) > 5 else ""
    return between.join(shown) + more


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


def _write(path: Path, content: bytes) -> None:
    """Write a file that is complete when it appears, and stays after a loss of power."""
    draft = path.with_name("." + path.name)
    with draft.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(draft, path)
    if os.name == "posix":  # elsewhere a folder cannot be opened
        folder = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _read(part: Path) -> list[Row]:
    try:
        with np.load(part) as content:
            rows = json.loads(content["rows"].tobytes())
            profiles = content["diameter"], content["diameter_stderr"]
            return [_row(*each) for each in zip(rows, *profiles, strict=True)]
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise ImagingError(
            f"this part of the campaign is damaged ({error}); remove the file, its pictures are "
            "then measured again",
            path=str(part),
        ) from None


def _plain(row: Row) -> dict[str, Any]:
    """The row for JSON, which has no nan; its path absolute."""
    plain = {k: v for k, v in vars(row).items() if not isinstance(v, np.ndarray)}
    plain["path"] = _key(row.path)
    plain["numbers"] = {k: None if math.isnan(v) else v for k, v in row.numbers.items()}
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in plain.items()}


def _row(plain: dict[str, Any], diameter: np.ndarray, diameter_stderr: np.ndarray) -> Row:
    plain = {k: math.nan if v is None else v for k, v in plain.items()}
    plain["numbers"] = {k: math.nan if v is None else v for k, v in plain["numbers"].items()}
    return Row(**plain, diameter=diameter, diameter_stderr=diameter_stderr)
