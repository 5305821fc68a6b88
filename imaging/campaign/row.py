"""One picture of a campaign: what was measured, or why it could not be."""

import dataclasses
import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..camera.timestamps import read_timestamp
from ..errors import ImagingError

POSITION = np.linspace(0, 1, 201)
"""Where the profiles of all pictures are given: z/L, from the upper tape edge to the lower one."""


@dataclass(frozen=True)
class Row:
    """What a campaign keeps of one picture.

    Args:
        path: as it was given.
        error: "ClassName: message"; empty where the picture was measured.
        numbers: in SI, by column; none where the picture could not be measured.
        diameter: at `POSITION`, shape (201,) [m]; nan where the picture could not be measured.
        diameter_stderr: its standard error, shape (201,) [m].
        seconds: when it was taken, by the camera's clock [s since 1970]; nan if it does not say.
        resolution: of the time stamp [s].
        sha256: of the file; empty where it could not be read.
        size: of the file [bytes]; -1 where it could not be read.
        modified: when the file was last changed [ns since 1970].
    """

    path: str
    error: str = ""
    numbers: dict[str, float] = field(default_factory=dict)
    diameter: np.ndarray = field(default_factory=lambda: np.full(POSITION.shape, np.nan))
    diameter_stderr: np.ndarray = field(default_factory=lambda: np.full(POSITION.shape, np.nan))
    seconds: float = math.nan
    resolution: float = math.nan
    sha256: str = ""
    size: int = -1
    modified: int = -1

    @property
    def ok(self) -> bool:
        """Whether the picture was measured."""
        return not self.error


def measured_row(path: str, recipe: Any, reader: Callable[..., Any] | None = None) -> Row:
    """The row of one picture; an error of the picture is a row too.

    Args:
        path: of the picture.
        recipe: a `Recipe`.
        reader: see `measure`.
    """
    import cv2  # noqa: PLC0415 -- 0.1 s, and only workers need it

    from ..shape.one_picture import measure  # noqa: PLC0415

    facts = file_facts(path)
    stamp = read_timestamp(path)
    if stamp is not None:
        facts |= {"seconds": stamp.seconds, "resolution": stamp.resolution}
    try:
        found = measure(path, recipe) if reader is None else measure(path, recipe, reader=reader)
    except (ValueError, OSError, ArithmeticError, cv2.error) as error:
        return Row(path, error=error_text(error), **facts)
    z = found.z / found.length
    return Row(
        path,
        numbers=_numbers(found),
        diameter=np.interp(POSITION, z, found.diameter),
        diameter_stderr=np.interp(POSITION, z, found.diameter_stderr),
        **facts,
    )


def _numbers(found: Any) -> dict[str, float]:
    """The columns of a measurement in SI, its quality figures after them."""
    return {
        "length": found.length,
        "length_stderr": found.length_stderr,
        "mean_diameter": found.mean_diameter,
        "mean_diameter_stderr": found.mean_diameter_stderr,
        "max_diameter": found.maximum_diameter,
        "volume": found.volume,
        "volume_stderr": found.volume_stderr,
        "px_per_m": found.px_per_m,
        "roll_deg": math.degrees(found.roll),
        "x0": found.x0,
    } | {
        name: float(value)
        for name, value in dataclasses.asdict(found.quality).items()
        if isinstance(value, (int, float, np.number))
    }


def error_text(error: BaseException) -> str:
    """`ClassName: message`, on one line."""
    message = str(error)
    if isinstance(error, ImagingError):
        message = message.removeprefix(f"{error.path}: ")  # which stands in its own column
    return f"{type(error).__name__}: {' '.join(message.split())}"


def file_facts(path: str | Path) -> dict[str, Any]:
    """Size, time of change and content hash of a file, as fields of a `Row`; none if unreadable."""
    try:
        status = Path(path).stat()
        with Path(path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return {}
    return {"size": status.st_size, "modified": status.st_mtime_ns, "sha256": digest}
