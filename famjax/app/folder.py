"""The folder of an experiment: its sheet with units in the keys, and the evaluation steps.

A step runs again only if its inputs change, so an interrupted run resumes.
"""

import dataclasses
import hashlib
import importlib.resources
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, NotNegative, Positive, Text, from_entries, read_toml
from fitting.evidence import FORM as SHARED_ERRORS, SharedErrors
from fitting.specimen import Specimen, parse_specimen

SHEET = "characterisation.toml"
"""Name of the sheet."""
RESULTS = "results"
"""Folder for computed files."""


def skeleton() -> str:
    """Return a sheet to fill in, with a comment on every entry."""
    place = importlib.resources.files("famjax.app") / "templates" / SHEET
    return place.read_text(encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class Records:
    """Force data of the test: journal and machine log, or a force map."""

    journal: Text | None = None
    machine_log: Text | None = None
    force_map: Text | None = None
    near: float | None = None
    skip_cycles: int = 0
    zero_displacement: float = 0.0
    shortening_positive: bool = False
    pushing_positive: bool = False
    columns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        both = (self.journal is None, self.machine_log is None)
        if self.force_map is None and any(both):
            raise ValueError("give journal and machine_log of one test, or a force_map alone")
        if self.force_map is not None and not all(both):
            raise ValueError("force_map replaces journal and machine_log: keep one of them")
        if self.skip_cycles < 0:
            raise ValueError(f"skip_cycles must be >= 0, got {self.skip_cycles}")


@dataclasses.dataclass(frozen=True)
class Photographs:
    """Pictures of the test, with the options of `famjax measure`."""

    pictures: Text
    ruler: Text | None = None
    scale: Text | None = None
    distance: Positive | None = None
    pitch: Positive | None = None
    ruler_placement: NotNegative | None = None
    tape_diameter: Positive | None = None
    k1: float | None = None
    tone: Literal["srgb"] | None = None
    orientation: Literal["vertical", "horizontal", "auto"] | None = None
    log_offset: float | None = None


@dataclasses.dataclass(frozen=True)
class Fit:
    """Options of the identification."""

    law: Text = "polynomial"
    order: int | None = None
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker"
    starts: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        if ":" in self.law:
            raise InputError(
                f"the law must be one of famjax's own, got {self.law!r}: files never import modules by "
                "themselves. Fit your own law by famjax fit DATASET --law module:Class"
            )


@dataclasses.dataclass(frozen=True)
class Shown:
    """Units of tables, pictures and report."""

    system: Literal["si", "metric", "us"] = "metric"


ASSUMED = SharedErrors(rest_length=0.5e-3, shortening=0.003, force_reading=0.02)
"""Default standard errors for cross-checks: of the rest length, of the machine's displacement including
frame compliance, and of each load cell."""


@dataclasses.dataclass(frozen=True)
class Sheet:
    """Contents of the sheet.

    Attributes:
        folder: folder of the sheet.
        specimen: data of the muscle.
        entries: entries of the specimen as written, without the turns.
        turns: turns of one thread; None if they are to be identified.
        records: force data.
        photographs: pictures, or None.
        fit: options of the identification.
        errors: standard errors shared by all readings.
        units: unit system of the report.
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
        """Folder of the steps."""
        return self.folder / RESULTS

    def path(self, name: str) -> Path:
        """Return the path of a file in the folder.

        Raises:
            InputError: the file is missing.
        """
        path = self.folder / name
        if not path.exists():
            raise InputError(f"{self.folder / SHEET} names {name}, which is not in {self.folder}")
        return path


_LENGTHS = ("zero_displacement", "distance", "pitch", "ruler_placement", "tape_diameter")
_FORM = Form(
    {
        **SHARED_ERRORS.kinds,
        "near": "time",
        "log_offset": "time",
        **dict.fromkeys(_LENGTHS, "length"),
    }
)
_TABLES: dict[str, Any] = {
    "records": Records, "photographs": Photographs, "fit": Fit, "errors": SharedErrors, "units": Shown,
}  # fmt: skip


def read_sheet(folder: Path) -> Sheet:
    """Read the sheet of a folder.

    Raises:
        InputError: the sheet is missing or invalid; the message gives the location.
    """
    path = folder / SHEET
    if not path.exists():
        raise InputError(f"{folder} has no {SHEET}: `famjax new {folder}` writes one to fill in")
    content = read_toml(path, "sheet")
    unknown = content.keys() - {"specimen", *_TABLES}
    missing = {"specimen", "records"} - content.keys()
    if unknown or missing or not all(isinstance(table, dict) for table in content.values()):
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
        needed = "name, rest_length_<unit> and wall_thickness_<unit> are needed"
        raise InputError(f"{path}: [specimen]: {needed}") from None
    return Sheet(
        folder, specimen, entries, None if turns is None else float(turns), tables["records"],
        tables.get("photographs"), tables.get("fit", Fit()), tables.get("errors", SharedErrors()),
        tables.get("units", Shown()).system,
    )  # fmt: skip


MARK = "step.json"
"""File in a step's folder, written last, with digests of its inputs and files."""


@dataclasses.dataclass(frozen=True)
class FolderStep:
    """A step of an evaluation.

    Attributes:
        name: name of the step and of its folder.
        files: input files, in addition to those of earlier steps.
        options: options that the step depends on, as JSON types.
        after: names of the steps whose files it reads.
        run: function that writes the files of the step into the given folder.
        resumes: names of files in its folder from which an interrupted step resumes.
        says: lines that describe the files of the step, printed after each run, even if it is skipped.
    """

    name: str
    files: Sequence[Path]
    options: Mapping[str, object]
    after: Sequence[str]
    run: Callable[[Path], None]
    resumes: Sequence[str] = ()
    says: Callable[[Path], Sequence[str]] = lambda _: ()


def run_steps(
    steps: Sequence[FolderStep],
    folder: Path,
    *,
    only: Sequence[str] = (),
    force: Sequence[str] = (),
    tell: Callable[[str], None],
) -> None:
    """Run the steps in order, except those already done with the same inputs.

    A step is done if its mark lists the same inputs, options and earlier steps, and its own files are
    unchanged.

    Args:
        steps: steps in order of their dependencies.
        folder: folder of the results, with one folder per step.
        only: names of the steps to run, if not all; the steps they need must be done.
        force: names of steps to run again.
        tell: called with one line per step.

    Raises:
        InputError: a name is unknown, or a required step is not done.
    """
    known = [step.name for step in steps]
    for name in (*only, *force):
        if name not in known:
            raise InputError(f"there is no step {name!r} here; the steps are {', '.join(known)}")
    keys: dict[str, str] = {}
    for step in steps:
        chosen = not only or step.name in only
        keys[step.name] = key = _key(step, keys)
        place = folder / step.name
        done = step.name not in force and _is_done(place, key)
        if not chosen and not done and any(
            step.name in other.after for other in steps if other.name in only
        ):  # fmt: skip
            raise InputError(
                f"{' and '.join(only)} needs {step.name}, which is not done: run it first"
            )
        if not chosen:
            continue
        if done:
            tell(f"{step.name}: unchanged")
        else:
            tell(f"{step.name} ...")
            _run(step, place, key, () if step.name in force else step.resumes)
        for line in step.says(place):
            tell(line)


def _run(step: FolderStep, place: Path, key: str, kept: Sequence[str]) -> None:
    (place / MARK).unlink(missing_ok=True)
    place.mkdir(parents=True, exist_ok=True)
    for path in place.iterdir():
        if path.name not in kept:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    step.run(place)
    files = sorted(path for path in place.rglob("*") if path.is_file() and path.name != MARK)
    held = {path.relative_to(place).as_posix(): digest(path) for path in files}
    mark = json.dumps({"key": key, "files": held}, indent=1, sort_keys=True)
    (place / MARK).write_text(mark + "\n", encoding="utf-8")


def digest(path: Path) -> str:
    """Return the SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _key(step: FolderStep, keys: Mapping[str, str]) -> str:
    """Return one digest of all inputs of a step."""
    content = {
        "name": step.name,
        "files": [[path.name, digest(path)] for path in sorted(step.files)],
        "options": step.options,
        "after": [keys[name] for name in step.after],
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _is_done(place: Path, key: str) -> bool:
    try:
        mark = json.loads((place / MARK).read_text(encoding="utf-8"))
        return mark["key"] == key and all(
            digest(place / name) == known for name, known in mark["files"].items()
        )
    except (OSError, ValueError, KeyError, TypeError):
        return False
