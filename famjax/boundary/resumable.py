"""One file for one long work: a line of JSON for its settings, then one for each finished part.

A line is written whole as soon as its part is done, so that work that was stopped goes on where it
was. A last line that was cut short is done again.
"""

import json
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .errors import InputError


class ResumableFile:
    """The finished parts of a work, in memory and, where there is a path, on the disk.

    Args:
        path: the file; None keeps the parts in memory only.
        kind: of the work, such as "sweep".
        settings: of the work. A file with others is refused.

    Raises:
        InputError: the file is that of another work, or cannot be read or written.
    """

    def __init__(self, path: Path | None, kind: str, settings: dict[str, Any]) -> None:
        self.path, self.kind = path, kind
        self.parts: list[dict[str, Any]] = []
        head = _line({"format": f"famjax {kind} 1", **settings})
        if path is None:
            return
        try:
            lines = list(_whole_lines(path)) if path.exists() else []
            if lines and lines[0] != head:
                raise InputError(
                    f"{path} holds a {kind} of other data or with other settings: give another "
                    "name, or remove it"
                )
            self.parts = [json.loads(line) for line in lines[1:]]
            kept = "".join([head, *lines[1:]])
            draft = path.with_name(path.name + ".part")
            draft.write_text(kept, encoding="utf-8")
            os.replace(draft, path)
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise InputError(f"the {kind} file {path} cannot be used: {error}") from None

    def append(self, part: dict[str, Any]) -> None:
        """One more finished part, on the disk before this returns."""
        self.parts.append(part)
        if self.path is None:
            return
        try:
            with self.path.open("a", encoding="utf-8") as file:
                file.write(_line(part))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise InputError(
                f"the {self.kind} file {self.path} cannot be written: {error}"
            ) from None


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
