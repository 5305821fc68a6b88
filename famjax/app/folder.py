"""The folder of an experiment: its sheet, with units in the keys, and the steps of its evaluation.

A step is repeated only if its inputs have changed, so an interrupted run can be resumed.
"""

import dataclasses
import hashlib
import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, NotNegative, Positive, Text, from_entries, read_toml
from fitting.evidence import FORM as SHARED_ERRORS, SharedErrors
from fitting.specimen import Specimen, parse_specimen

SHEET = "characterisation.toml"
"""File name of the sheet."""
RESULTS = "results"
"""Folder for computed files."""


@dataclasses.dataclass(frozen=True)
class Records:
    """Force data from the test: a journal and a machine log, or a force map."""

    journal: Text | None = None
    machine_log: Text | None = None
    force_map: Text | None = None
    near: float | None = None
    skip_cycles: Annotated[int, Meta(ge=0, description="a whole number >= 0")] = 0
    zero_displacement: float = 0.0
    shortening_positive: bool = False
    pushing_positive: bool = False
    columns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        given = tuple(one is not None for one in (self.journal, self.machine_log, self.force_map))
        if given not in {(True, True, False), (False, False, True)}:
            raise ValueError(
                "set journal and machine_log, from the same test, or set only force_map"
            )


@dataclasses.dataclass(frozen=True)
class Photographs:
    """Pictures from the test, with the options for `famjax measure`."""

    pictures: Text
    ruler: Text | None = None
    scale: Text | None = None
    distance: Positive | None = None
    pitch: Positive | None = None
    ruler_placement: NotNegative | None = None
    k1: float | None = None
    tone: Literal["srgb"] | None = None
    log_offset: float | None = None


@dataclasses.dataclass(frozen=True)
class Fit:
    """Options for the identification."""

    law: Text = "polynomial"
    order: int | None = None
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker"
    starts: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        if ":" in self.law:
            raise InputError(
                f"the law must be one that famjax provides, got {self.law!r}: a sheet cannot import a "
                "module. To fit your own law, use famjax fit DATASET --law module:Class"
            )


@dataclasses.dataclass(frozen=True)
class Shown:
    """Units for tables, figures and the report."""

    system: Literal["si", "metric", "us"] = "metric"


ASSUMED = SharedErrors(rest_length=0.5e-3, shortening=0.003, force_reading=0.02)
"""Standard errors assumed in the cross-checks by default: rest length, machine displacement including
frame compliance, and each load cell."""


@dataclasses.dataclass(frozen=True)
class Sheet:
    """Contents of the sheet.

    Attributes:
        folder: folder that contains the sheet.
        specimen: data about the muscle.
        entries: entries in [specimen] as written, without `turns`.
        turns: turns of one thread; None if they are to be identified.
        records: force data.
        photographs: pictures, or None.
        fit: options for the identification.
        errors: standard errors shared by all readings.
        units: unit system for the report.
    """

    folder: Path
    specimen: Specimen
    entries: Mapping[str, object]
    turns: float | None
    records: Records
    photographs: Photographs | None
    fit: Fit
    errors: SharedErrors
    units: str = "metric"

    @property
    def results(self) -> Path:
        """Folder for the files that the steps write."""
        return self.folder / RESULTS

    def path(self, name: str) -> Path:
        """Return the path of a file in the folder.

        Raises:
            InputError: the file is missing.
        """
        path = self.folder / name
        if not Path(os.path.abspath(path)).is_relative_to(os.path.abspath(self.folder)):
            raise InputError(
                f"{self.folder / SHEET} refers to {name}, outside its folder: copy the file into the folder"
            )
        if not path.exists():
            raise InputError(
                f"{self.folder / SHEET} refers to {name}, which is not in {self.folder}"
            )
        return path


_LENGTHS = dict.fromkeys(("zero_displacement", "distance", "pitch", "ruler_placement"), "length")
_FORM = Form({**SHARED_ERRORS.kinds, **_LENGTHS, "near": "time", "log_offset": "time"})
_TABLES: dict[str, Any] = {
    "records": Records, "photographs": Photographs, "fit": Fit, "errors": SharedErrors, "units": Shown,
}  # fmt: skip


def read_sheet(folder: Path) -> Sheet:
    """Read the sheet in a folder.

    Raises:
        InputError: the sheet is missing or invalid; the message states where.
    """
    path = folder / SHEET
    if not path.exists():
        raise InputError(
            f"{folder} has no {SHEET}: run `famjax new {folder}` to create one, and fill it in"
        )
    content = read_toml(path, "sheet")
    plain = [table for table in content.values() if not isinstance(table, dict)]
    missing = {"specimen", "records"} - content.keys()
    if plain or missing or content.keys() - {"specimen", *_TABLES}:
        raise InputError(
            f"{path}: a sheet must have the tables [specimen] and [records], and may have "
            f"[photographs], [fit], [errors] and [units]; got {', '.join(content) or 'none'}"
        )
    tables = {
        name: from_entries(kind, content[name], _FORM, where=f"{path}: [{name}]: ")
        for name, kind in _TABLES.items()
        if name in content
    }
    entries = dict(content["specimen"])
    turns = entries.pop("turns", None)
    if turns is not None and not (isinstance(turns, int | float) and turns > 0):
        raise InputError(f"{path}: [specimen]: turns must be a number > 0, got {turns!r}")
    try:
        known = parse_specimen(
            f"{key}={str(value).lower() if isinstance(value, bool) else value}"
            for key, value in entries.items()
        )
        known.pop("force_limit", None)  # applies to readings, and is in the header of the map
        specimen = Specimen(**known)
    except InputError as error:
        raise InputError(f"{path}: [specimen]: {error}") from None
    except TypeError:
        raise InputError(
            f"{path}: [specimen]: name, rest_length_<unit> and wall_thickness_<unit> are required"
        ) from None
    return Sheet(
        folder, specimen, entries, None if turns is None else float(turns), tables["records"],
        tables.get("photographs"), tables.get("fit", Fit()), tables.get("errors", SharedErrors()),
        tables.get("units", Shown()).system,
    )  # fmt: skip


MARK = "step.json"
"""File in a step's folder with digests of the step's inputs and, once the step is complete, of its
output."""


class Steps:
    """Runs the steps of an evaluation in order, skipping those already completed with the same inputs.

    A step depends on its own files and options, and on all earlier steps. An interrupted step
    continues from the files in its folder.

    Args:
        results: folder for the results, with one folder per step.
        tell: called with one line of text per step.
    """

    def __init__(self, results: Path, tell: Callable[[str], None]) -> None:
        self._results, self._tell, self._key = results, tell, ""

    def run(
        self,
        name: str,
        work: Callable[[Path], None],
        *,
        files: Sequence[Path] = (),
        options: Any = None,
    ) -> None:
        """Run a step.

        Args:
            name: name of the step and of its folder.
            work: function that is called with the step's folder and writes its files there.
            files: files that the step reads, other than those from earlier steps.
            options: all other values that the step depends on.
        """
        read = [[path.name, digest(path)] for path in files]
        content = json.dumps([self._key, name, read, options], sort_keys=True)
        self._key = hashlib.sha256(content.encode()).hexdigest()
        place = self._results / name
        mark, known = place / MARK, _mark_of(place)
        if known == {"key": self._key, "files": _digests(place)}:
            self._tell(f"{name}: unchanged")
            return
        self._tell(f"{name} ...")
        if known.get("key") != self._key and place.exists():
            if place.is_symlink() or (not known and any(place.iterdir())):
                raise InputError(
                    f"{place} has no {MARK}, so this command did not write it: move it elsewhere"
                )
            shutil.rmtree(place)
        place.mkdir(parents=True, exist_ok=True)
        mark.write_text(json.dumps({"key": self._key}), encoding="utf-8")
        work(place)
        done = json.dumps({"key": self._key, "files": _digests(place)}, indent=1)
        mark.write_text(done + "\n", encoding="utf-8")


def digest(path: Path) -> str:
    """Return the SHA-256 digest of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _digests(place: Path) -> dict[str, str]:
    files = sorted(path for path in place.rglob("*") if path.is_file() and path.name != MARK)
    return {path.relative_to(place).as_posix(): digest(path) for path in files}


def _mark_of(place: Path) -> dict[str, Any]:
    try:
        mark = json.loads((place / MARK).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return mark if isinstance(mark, dict) else {}
