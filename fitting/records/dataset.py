"""A characterisation as the table that `famjax fit` reads."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError

from .characterisation import Characterisation


def dataset_text(
    found: Characterisation,
    *,
    specimen: Mapping[str, object] | None = None,
    branch: str = "mean",
    points: int = 40,
) -> str:
    """A table of pressure, length and force in SI, with the specimen in comment lines.

    The pressure is the measured mean at each set pressure. Forces that are not positive stay in:
    they say where the muscle is slack.

    Args:
        found: the characterisation.
        specimen: further entries, unit in the key, such as {"wall_thickness_mm": 1.6}.
        branch: the mean of both, or one of them.
        points: lengths at each pressure.

    Returns:
        The text of the file.

    Raises:
        InputError: an unknown branch, or fewer than two points.
    """
    curves = {"mean": "force", "shortening": "shortening", "lengthening": "lengthening"}
    if branch not in curves or points < 2:
        raise InputError(
            f"branch must be one of {', '.join(curves)} and points >= 2, got {branch!r}, {points}"
        )
    entries = {"rest_length_m": repr(found.rest_length)}
    for key, value in (specimen or {}).items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        if key.rpartition("_")[0] == "rest_length":
            raise InputError(
                f"the specimen's {key} = {text} stands beside the {found.rest_length} m of the record: "
                "give it once"
            )
        if "\n" in f"{key}{text}":
            raise InputError(f"the specimen's {key!r} holds a line end")
        entries[key] = text
    lines = [f"# note: {note}" for note in found.notes]
    lines += [f"# specimen: {key} = {value}" for key, value in entries.items()]
    lines.append("pressure_Pa,length_m,force_N")
    for bar in found.isobars:
        at = np.linspace(bar.length[0], bar.length[-1], points)
        force = np.interp(at, bar.length[::-1], getattr(bar, curves[branch])[::-1])
        lines += [
            f"{bar.pressure!r},{L!r},{F!r}"
            for L, F in zip(at.tolist(), force.tolist(), strict=True)
        ]
    return "\n".join(lines) + "\n"


def write_dataset(
    found: Characterisation,
    path: str | Path,
    *,
    specimen: Mapping[str, object] | None = None,
    branch: str = "mean",
    points: int = 40,
) -> Path:
    """Write `dataset_text` to a file; one that is there is replaced.

    Returns:
        The path.

    Raises:
        InputError: as `dataset_text`, or the file cannot be written.
    """
    text = dataset_text(found, specimen=specimen, branch=branch, points=points)
    path = Path(path)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    return path
