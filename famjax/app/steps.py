"""Steps of a long work, each done once for the same inputs: stopped work goes on, changes redo little."""

import dataclasses
import hashlib
import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from famjax.boundary.errors import InputError

MARK = "step.json"
"""In a step's folder, written last: what it was made of, and what it holds."""


@dataclasses.dataclass(frozen=True)
class FolderStep:
    """A step of a work.

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
    """Carry out the steps in their order, but for those that are done with the same inputs.

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
                _say(step, place, tell)
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
        _clear(place, () if step.name in force else step.resumes)
        step.run(place)
        held = {path.relative_to(place).as_posix(): digest(path) for path in _files(place)}
        mark = json.dumps({"key": key, "files": held}, indent=1, sort_keys=True)
        (place / MARK).write_text(mark + "\n", encoding="utf-8")
        _say(step, place, tell)


def digest(path: Path) -> str:
    """The SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _clear(place: Path, kept: Sequence[str]) -> None:
    """Remove what a step left in its folder, but for the names that are kept."""
    for path in place.iterdir():
        if path.name not in kept:
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def _say(step: FolderStep, place: Path, tell: Callable[[str], None]) -> None:
    for line in step.says(place):
        tell(line)


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
