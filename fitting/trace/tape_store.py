"""Tapes on disk: a second process need not trace what a first one has traced.

Switched on by the command line, with a folder. A tape is kept under a digest of all that it follows
from: the family's classes and whatever is static in it, the shapes of its arrays, the constraint,
the sources of famjax and fitting, and the versions of the libraries that trace. A family with a
class or function from elsewhere is never kept. A file that cannot be read or written is as good as
none: the tape is recorded anew.
"""

import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import os
import tempfile
import types
from pathlib import Path
from typing import Any

import numpy as np

from .numpy_rules import RULES
from .tape import OperationTape, Step

_PACKAGES = ("famjax", "fitting")
_LIBRARIES = ("jax", "jaxlib", "equinox", "lineax", "numpy", "optimistix")
_KEPT = 512  # files; the oldest go first

_folders: list[Path] = []


def keep_tapes(folder: Path | None) -> None:
    """Tapes are kept in this folder from now on, or nowhere; only the owner may write there."""
    _folders[:] = [] if folder is None else [folder]


def kept_in() -> Path | None:
    """The folder in which tapes are kept."""
    return _folders[0] if _folders else None


def identity(*parts: Any) -> str | None:
    """A digest of what a tape follows from; None where it is not kept."""
    if not _folders:
        return None
    try:
        text = json.dumps([_described(part) for part in parts])
    except _UnknownError:
        return None
    return hashlib.sha256(f"{_sources()} {text}".encode()).hexdigest()


def load(key: str | None) -> OperationTape | None:
    """The tape of this identity, if it is there."""
    if not _folders or key is None:
        return None
    try:
        head, _, body = (_folders[0] / f"{key}.json").read_text().partition("\n")
        return _tape(json.loads(body)) if head == _head(key, body) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _head(key: str, body: str) -> str:
    """The first line of a file: what the tape is of, and a digest of it, by which damage is seen."""
    return f"{key} {hashlib.sha256(body.encode()).hexdigest()}"


def save(key: str | None, tape: OperationTape) -> None:
    """Keep a tape; where the folder cannot be written it is not kept."""
    if not _folders or key is None:
        return
    folder = _folders[0]
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        body = json.dumps(_document(tape))
        with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".part", delete=False) as file:
            file.write(f"{_head(key, body)}\n{body}")
        try:
            os.replace(file.name, folder / f"{key}.json")
        finally:
            Path(file.name).unlink(missing_ok=True)
        files = sorted(folder.glob("*.json"), key=lambda path: path.stat().st_mtime)
        for path in files[:-_KEPT]:
            path.unlink(missing_ok=True)
    except OSError:
        return


class _UnknownError(Exception):
    """Something that no digest tells apart from others."""


def _described(value: Any) -> Any:
    """A value as plain data that differs where the tape may."""
    if value is None or isinstance(value, bool | int | float | str):
        return [type(value).__name__, repr(value)]
    if isinstance(value, np.generic | np.ndarray) or hasattr(value, "weak_type"):
        return ["array", list(value.shape), str(value.dtype)]
    if isinstance(value, tuple | list):
        return [type(value).__name__, *(_described(part) for part in value)]
    if isinstance(value, dict):
        return ["dict", *([_described(key), _described(part)] for key, part in value.items())]
    named = value if isinstance(value, type | types.FunctionType) else type(value)
    name = f"{named.__module__}.{named.__qualname__}"
    if named.__module__.split(".")[0] not in _PACKAGES or "<locals>" in name:
        raise _UnknownError(name)
    if named is value:
        return name
    if not dataclasses.is_dataclass(value):
        raise _UnknownError(name)
    fields = {f.name: getattr(value, f.name, None) for f in dataclasses.fields(value)}
    return [name, _described(fields)]


@functools.cache
def _sources() -> str:
    """A digest of the code that is traced and of what traces it.

    Of a file its size and time, by which Python itself knows whether what it has compiled is of it.
    """
    digest = hashlib.sha256()
    root = Path(__file__).parents[2]
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            known = path.stat()
            digest.update(f"{path.relative_to(root)} {known.st_size} {known.st_mtime_ns}".encode())
    for name in _LIBRARIES:
        digest.update(f"{name} {importlib.metadata.version(name)}".encode())
    return digest.hexdigest()


def _document(tape: OperationTape) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        return {"tape": _document(value)} if isinstance(value, OperationTape) else value

    return {
        "inputs": tape.inputs,
        "outputs": tape.outputs,
        "shapes": tape.shapes,
        "constants": [
            [slot, value.dtype.str, value.shape, value.ravel().tolist()]
            for slot, value in tape.constants.items()
        ],
        "steps": [
            [
                step.name, step.inputs, step.outputs,
                {
                    key: [plain(part) for part in value] if key == "branches" else plain(value)
                    for key, value in step.params.items()
                },
            ]
            for step in tape.steps
        ],
    }  # fmt: skip


def _tape(document: dict[str, Any]) -> OperationTape:
    def read(value: Any) -> Any:
        if isinstance(value, list):
            return tuple(read(part) for part in value)
        return _tape(value["tape"]) if isinstance(value, dict) else value

    steps = tuple(
        Step(name, tuple(inputs), tuple(outputs), {key: read(v) for key, v in params.items()})
        for name, inputs, outputs, params in document["steps"]
    )
    if not RULES.keys() >= {step.name for step in steps}:
        raise ValueError("a tape of other rules")
    return OperationTape(
        inputs=tuple(document["inputs"]),
        outputs=tuple(document["outputs"]),
        shapes=tuple(tuple(shape) for shape in document["shapes"]),
        constants={
            slot: np.array(values, dtype).reshape(shape)
            for slot, dtype, shape, values in document["constants"]
        },
        steps=steps,
    )
