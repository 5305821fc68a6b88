"""The folder of an experiment: characterisation.toml with units in its keys, and the evaluation steps.

A step is done once for the same inputs: stopped work resumes, and a change redoes little.
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
"""Name of the file."""
RESULTS = "results"
"""Folder of what is computed."""


def skeleton() -> str:
    """A sheet to fill in, with a comment on every entry."""
    place = importlib.resources.files("famjax.app") / "templates" / SHEET
    return place.read_text(encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class Records:
    """The force of the test: journal and machine's log, or a force map."""

    journal: Text | None = None
    machine_log: Text | None = None
    force_map: Text | None = None
    sync_column: Text | None = None
    near: float | None = None
    skip_cycles: int = 0
    zero_displacement: float = 0.0
    shortening_positive: bool = False
    pushing_positive: bool = False
    columns: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        both = (self.journal is None, self.machine_log is None)
        if self.force_map is None and any(both):
            raise ValueError(
                "the force is in journal and machine_log, both of one test, or in a force_map alone"
            )
        if self.force_map is not None and not all(both):
            raise ValueError("force_map stands in the place of journal and machine_log: keep one")
        if self.skip_cycles < 0:
            raise ValueError(f"skip_cycles must be >= 0, got {self.skip_cycles}")


@dataclasses.dataclass(frozen=True)
class Photographs:
    """The pictures of the test, with the options of `famjax measure`."""

    pictures: Text
    ruler: Text | None = None
    scale: Text | None = None
    distance: Positive | None = None
    pitch: Positive | None = None
    ruler_placement: NotNegative | None = None
    tape_diameter: Positive | None = None
    recipe: Text | None = None
    k1: float | None = None
    tone: Literal["srgb"] | None = None
    orientation: Literal["vertical", "horizontal", "auto"] | None = None
    log_offset: float | None = None


@dataclasses.dataclass(frozen=True)
class Fit:
    """How the law is identified."""

    law: Text = "polynomial"
    order: int | None = None
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker"
    starts: int = 16
    seed: int = 0

    def __post_init__(self) -> None:
        if ":" in self.law:
            raise InputError(
                f"the law must be one of famjax's own, got {self.law!r}: a file imports nothing by itself. "
                "Fit a law of your own by famjax fit DATASET --law module:Class"
            )


@dataclasses.dataclass(frozen=True)
class Shown:
    """Units of tables, pictures and report."""

    system: Literal["si", "metric", "us"] = "metric"


ASSUMED = SharedErrors(rest_length=0.5e-3, shortening=0.003, force_reading=0.02)
"""Standard errors by which sources are compared where the sheet states none: of the rest length, of the
machine's displacement with what its frame gives way, of either load cell."""


@dataclasses.dataclass(frozen=True)
class Sheet:
    """The file as read.

    Attributes:
        folder: where it lies.
        specimen: of the muscle.
        entries: of the specimen as they stand in the file, without the turns.
        turns: of one thread; None where they are identified.
        records: force.
        photographs: shape, or None.
        fit: how.
        errors: that all readings share.
        units: system of the report.
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

    def path(self, name: str) -> Path:
        """A file of the folder.

        Raises:
            InputError: it is not there.
        """
        path = self.folder / name
        if not path.exists():
            raise InputError(f"{self.folder / SHEET} names {name}, which is not in {self.folder}")
        return path


_FORM = Form(
    {
        **SHARED_ERRORS.kinds,
        **dict.fromkeys(("near", "log_offset"), "time"),
        **dict.fromkeys(
            ("zero_displacement", "distance", "pitch", "ruler_placement", "tape_diameter"), "length"
        ),
    }
)
_TABLES: dict[str, Any] = {
    "records": Records, "photographs": Photographs, "fit": Fit, "errors": SharedErrors, "units": Shown,
}  # fmt: skip


def read_sheet(folder: Path) -> Sheet:
    """The sheet of a folder.

    Raises:
        InputError: there is none, or what is wrong with it, with the place.
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
        known.pop("force_limit", None)  # of the map's readings, and in its header
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
"""In a step's folder, written last: what it was made of, and what it holds."""


@dataclasses.dataclass(frozen=True)
class FolderStep:
    """A step of an evaluation.

    Attributes:
        name: and of its folder.
        files: that it reads, besides those of earlier steps.
        options: that it depends on, of types that JSON knows.
        after: names of the steps whose files it reads.
        run: makes its files in the folder that it is given.
        resumes: names in its folder of what it goes on with after it was stopped.
        says: lines on what is in its folder, printed when it is done and when it was done before.
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

    A step is done where its mark names the same content of the same files, the same options, and the
    same steps before it, and its files are as it left them.

    Args:
        steps: each after those it needs.
        folder: of the results; each step has a folder in it.
        only: names of the steps to carry out, where not all; what they need must be done.
        force: names of steps to carry out again.
        tell: called with a line on each step.

    Raises:
        InputError: an unknown name, or a step whose needs are not done.
    """
    known = [step.name for step in steps]
    for name in (*only, *force):
        if name not in known:
            raise InputError(f"there is no step {name!r} here; there are {', '.join(known)}")
    keys: dict[str, str] = {}
    for step in steps:
        chosen = not only or step.name in only
        keys[step.name] = key = _key(step, keys)
        place = folder / step.name
        done = _is_done(place, key)
        if done and step.name not in force:
            if chosen:
                tell(f"{step.name}: as before")
                for line in step.says(place):
                    tell(line)
            continue
        if not chosen:
            needed = any(step.name in other.after for other in steps if other.name in only)
            if needed:
                raise InputError(
                    f"{' and '.join(only)} needs {step.name}, which is not done: run it first"
                )
            continue
        tell(f"{step.name} ...")
        (place / MARK).unlink(missing_ok=True)
        place.mkdir(parents=True, exist_ok=True)
        kept = () if step.name in force else step.resumes
        for path in place.iterdir():
            if path.name not in kept:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
        step.run(place)
        held = {path.relative_to(place).as_posix(): digest(path) for path in _files(place)}
        mark = json.dumps({"key": key, "files": held}, indent=1, sort_keys=True)
        (place / MARK).write_text(mark + "\n", encoding="utf-8")
        for line in step.says(place):
            tell(line)


def digest(path: Path) -> str:
    """The SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _key(step: FolderStep, keys: Mapping[str, str]) -> str:
    """What a step is made of, as one digest."""
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


def _files(place: Path) -> list[Path]:
    return sorted(path for path in place.rglob("*") if path.is_file() and path.name != MARK)
