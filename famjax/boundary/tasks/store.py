"""The finished parts of a long work: in memory, or a folder from which the work goes on.

A folder has a manifest with the settings and one Parquet file for each part. A file depends on its
part alone and appears whole, so that a finished folder is the same, byte for byte, whatever worked
on it, in which order, and however often it was stopped.
"""

import importlib.util
import json
import re
import shutil
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files import UNFINISHED, write_whole
from ..settings import differing, some_of
from .part_file import Damaged, arrow_modules, part_bytes, read_part

MANIFEST = "manifest.json"
PARTS = "parts"
_FORMAT = "famjax parts 1"
_NAME = re.compile(r"(\d{6,})\.parquet")

Part = dict[str, Any]
"""Arrays and plain values by name; nan stays nan."""


class Store:
    """Parts of a work by their index, 0 to `count` - 1.

    With a folder, a part is on the disk when `keep` returns, and parts are read from there when they
    are asked for; the extra `tables` is needed. A part that is damaged is reported by a warning and
    counts as not done.

    Args:
        folder: made if need be; None keeps the parts in memory, whatever they are.
        kind: of the work, such as "sweep".
        settings: what every part depends on, values of JSON. A folder with others is refused.
        count: number of parts.
        names: of the parts, one for each.

    Raises:
        InputError: the folder is that of another work, or cannot be read or written.
    """

    def __init__(
        self,
        folder: Path | str | None,
        kind: str,
        settings: dict[str, Any],
        count: int,
        names: Sequence[str] | None = None,
    ) -> None:
        self.folder = None if folder is None else Path(folder)
        self.kind, self._count = kind, count
        self._memory: dict[int, Any] = {}
        self._done: set[int] = set()
        if self.folder is None:
            return
        head = {"format": _FORMAT, "kind": kind, "parts": count, "settings": settings}
        if names is not None:
            head["names"] = list(names)
        arrow_modules()  # or there is nothing to keep parts with, which is said before the work
        text = json.dumps(head, indent=1, allow_nan=False) + "\n"
        try:
            (self.folder / PARTS).mkdir(parents=True, exist_ok=True)
            self._refuse_other(self.folder / MANIFEST, json.loads(text))
            if not (self.folder / MANIFEST).exists():
                write_whole(self.folder / MANIFEST, text.encode())
            self._done = self._found(self.folder / PARTS)
        except OSError as error:
            raise InputError(f"the {kind} folder {self.folder} cannot be used: {error}") from None

    def __contains__(self, index: int) -> bool:
        return index in self._done

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> Any:
        if index not in self._done:
            raise IndexError(f"part {index} of the {self.kind} is not done")
        return self._memory[index] if self.folder is None else read_part(self._file(index))

    def __iter__(self) -> Iterator[Any]:
        """The parts that are done, by index."""
        return (self[index] for index in sorted(self._done))

    def keep(self, index: int, part: Any) -> None:
        """One more finished part.

        Raises:
            InputError: it cannot be written.
        """
        if self.folder is None:
            self._memory[index] = part
        else:
            try:
                write_whole(self._file(index), part_bytes(part))
            except OSError as error:
                raise InputError(
                    f"the {self.kind} folder {self.folder} cannot be written: {error}"
                ) from None
        self._done.add(index)

    def remove(self) -> None:
        """Remove manifest and parts from the disk, and the folder if nothing else is in it."""
        if self.folder is not None:
            shutil.rmtree(self.folder / PARTS)
            (self.folder / MANIFEST).unlink()
            if not any(self.folder.iterdir()):
                self.folder.rmdir()

    def _file(self, index: int) -> Path:
        assert self.folder is not None
        return self.folder / PARTS / f"{index:06d}.parquet"

    def _refuse_other(self, manifest: Path, head: dict[str, Any]) -> None:
        if not manifest.exists():
            if any(manifest.parent.joinpath(PARTS).iterdir()):
                raise InputError(
                    f"{manifest.parent} holds parts without a {MANIFEST}: give another folder, or "
                    "remove it"
                )
            return
        try:
            there = json.loads(manifest.read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(
                f"{manifest} is damaged ({error}): give another folder, or remove it"
            ) from None
        if there != head:
            raise InputError(
                f"{manifest.parent} holds a {self.kind} of other data or with other settings: "
                f"{some_of(differing(there, head), '; ')}. Give another folder, or remove it"
            )

    def _found(self, parts: Path) -> set[int]:
        """The parts that are there and sound; drafts are removed."""
        found = set()
        for file in sorted(parts.iterdir()):
            named = _NAME.fullmatch(file.name)
            if file.name.endswith(UNFINISHED):
                file.unlink()
            elif named is not None and int(named[1]) < self._count:
                try:
                    read_part(file)
                except Damaged as error:
                    warnings.warn(f"{error}; it is done again", UserWarning, stacklevel=3)
                    file.unlink()
                else:
                    found.add(int(named[1]))
        return found


def keepable(folder: Path) -> Path | None:
    """The folder, or None with a warning where the package that writes parts is not installed."""
    if importlib.util.find_spec("pyarrow") is not None:
        return folder
    warnings.warn(
        "what is finished is kept in memory alone, and work that is stopped begins anew: for parts "
        'on the disk, python -m pip install "famjax[tables]"',
        UserWarning,
        stacklevel=2,
    )
    return None
