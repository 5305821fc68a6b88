"""Where the report comes from: command, date, versions, and the SHA-256 of every file that was read."""

import hashlib
import importlib.metadata
from pathlib import Path

from famjax.boundary.origin import Origin
from fitting.saved import PageTable, versions

from ..evaluation import shown_pictures
from ..sheet import SHEET, Sheet
from ..steps import digest

_FURTHER = ("scipy", "matplotlib", "opencv-python-headless", "pillow")


def input_digests(sheet: Sheet) -> dict[str, str]:
    """SHA-256 of every file of the folder that the evaluation reads, by its path in the folder."""
    records, photographs = sheet.records, sheet.photographs
    named = [records.journal, records.machine_log, records.force_map]
    if photographs is not None:
        named += [photographs.ruler, photographs.recipe]
    files = [sheet.folder / SHEET, *(sheet.path(name) for name in named if name is not None)]
    if photographs is not None:
        files += shown_pictures(sheet, photographs)
    return {_within(path, sheet.folder): digest(path) for path in files}


def origin_table(origin: Origin) -> PageTable:
    """Command, date and versions."""
    found = versions() | {name: importlib.metadata.version(name) for name in _FURTHER}
    rows = [
        ("command", origin.command),
        ("date of the first run", origin.date),
        ("versions", ", ".join(f"{name} {version}" for name, version in found.items())),
    ]
    return PageTable("Provenance.", ("what", "which"), rows, text=True)


def input_table(digests: dict[str, str], photographs: int) -> PageTable:
    """Every input but the photographs by itself, and these as one digest over theirs."""
    names = [*digests]
    single, pictures = names[: len(names) - photographs], names[len(names) - photographs :]
    rows = [(name, digests[name]) for name in single]
    if pictures:
        listed = input_lines({name: digests[name] for name in pictures})
        rows.append(
            (f"{len(pictures)} photographs, over their lines of inputs.sha256",
             hashlib.sha256(listed.encode()).hexdigest())
        )  # fmt: skip
    return PageTable("SHA-256 of the inputs.", ("file", "SHA-256"), rows, text=True)


def input_lines(digests: dict[str, str]) -> str:
    """As `sha256sum --check` reads them, in the folder."""
    return "".join(f"{value}  {name}\n" for name, value in digests.items())


def _within(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix() if path.is_relative_to(folder) else path.as_posix()
