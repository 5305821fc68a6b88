"""One file for one sweep: a line of JSON for the settings, then one for each finished chunk.

A line is written whole as soon as its chunk is done, so that a sweep that was stopped goes on where
it was. A last line that was cut short is done again.
"""

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .._errors import InputError

_FORMAT = "famjax sweep 1"


class SweepFile:
    """The lines of a sweep, in memory and, where there is a path, on the disk.

    Args:
        path: the file; None keeps the lines in memory only.
        settings: of the sweep. A file with others is refused.

    Raises:
        InputError: the file is that of another sweep, or cannot be read or written.
    """

    def __init__(self, path: Path | None, settings: dict[str, Any]) -> None:
        self.path = path
        self.chunks: list[dict[str, Any]] = []
        head = _line({"format": _FORMAT, **settings})
        if path is None:
            return
        try:
            lines = list(_whole_lines(path)) if path.exists() else []
            if lines and lines[0] != head:
                raise InputError(
                    f"{path} holds a sweep of other data or with other settings: give another "
                    "name, or remove it"
                )
            self.chunks = [json.loads(line) for line in lines[1:]]
            kept = "".join([head, *lines[1:]])
            draft = path.with_name(path.name + ".part")
            draft.write_text(kept, encoding="utf-8")
            os.replace(draft, path)
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise InputError(f"the sweep file {path} cannot be used: {error}") from None

    def append(self, chunk: dict[str, Any]) -> None:
        """One more finished chunk, on the disk before this returns."""
        self.chunks.append(chunk)
        if self.path is None:
            return
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(_line(chunk))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(f"the sweep file {self.path} cannot be written: {error}") from None


def _whole_lines(path: Path) -> Iterator[str]:
    """The lines that end; a line without an end was cut short."""
    with path.open(encoding="utf-8", newline="") as file:
        for line in file:
            if line.endswith("\n"):
                yield line


def _line(content: dict[str, Any]) -> str:
    return json.dumps(_plain(content), allow_nan=False, separators=(",", ":")) + "\n"


def _plain(content: Any) -> Any:
    """Content for JSON, which has no nan or infinity: they become null."""
    if isinstance(content, dict):
        return {key: _plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_plain(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content
