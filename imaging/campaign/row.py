"""One picture of a campaign: what was measured, or why it could not be."""

import dataclasses
import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..camera.timestamps import read_timestamp
from ..errors import ImagingError
from ..recipe import Recipe

POSITION = np.linspace(0, 1, 201)
"""Where the profiles of all pictures are given: z/L, from the upper tape edge to the lower one."""

_NONE = (math.nan,) * POSITION.size


@dataclass(frozen=True)
class Row:
    """What a campaign keeps of one picture; all of it has a place in JSON.

    Args:
        path: as it was given.
        error: "ClassName: message"; empty where the picture was measured.
        numbers: in SI, by column; none where the picture could not be measured.
        diameter: at `POSITION`, shape (201,) [m]; nan where the picture could not be measured.
        diameter_stderr: its standard error, shape (201,) [m].
        braid_angle: at `POSITION`, shape (201,) [deg]; nan where it is not resolved or not asked for.
        braid_angle_stderr: its standard error, shape (201,) [deg].
        braid_refusal: why the braid angle is resolved nowhere, empty where it is or was not asked for.
        seconds: when it was taken, by the camera's clock [s since 1970]; nan if it does not say.
        resolution: of the time stamp [s].
        sha256: of the file; empty where it could not be read.
        warnings: of the measurement, on one line; empty where there are none.
        size: of the file [bytes]; -1 where it could not be read.
        modified: when the file was last changed [ns since 1970].
    """

    path: str
    error: str = ""
    numbers: dict[str, float] = field(default_factory=dict)
    diameter: ArrayLike = _NONE
    diameter_stderr: ArrayLike = _NONE
    braid_angle: ArrayLike = _NONE
    braid_angle_stderr: ArrayLike = _NONE
    braid_refusal: str = ""
    seconds: float = math.nan
    resolution: float = math.nan
    sha256: str = ""
    warnings: str = ""
    size: int = -1
    modified: int = -1

    @property
    def ok(self) -> bool:
        """Whether the picture was measured."""
        return not self.error


class WorkerDied(ImagingError):  # noqa: N818 - as all names in `imaging.errors`
    """The process that measured a picture ended abnormally, for lack of memory for example."""


def dead_row(path: str, why: str) -> Row:
    """The row of a picture whose worker died."""
    return Row(path, error=error_text(WorkerDied(why, path=path)), **file_facts(path))


def measured_rows(
    paths: Sequence[str], recipe: Recipe, reader: Callable[..., Any] | None = None
) -> list[Row]:
    """The rows of some pictures; an error of a picture is a row too.

    Args:
        paths: of the pictures.
        recipe: how to measure.
        reader: see `measure`; None for the usual one.
    """
    import cv2  # noqa: PLC0415 -- 0.1 s, and only workers need it

    from ..shape.one_picture import measure  # noqa: PLC0415

    options: dict[str, Any] = {} if reader is None else {"reader": reader}
    rows = []
    for path in paths:
        facts = file_facts(path)
        try:
            found = measure(path, recipe, **options)
        except (ValueError, OSError, ArithmeticError, cv2.error) as error:
            rows.append(Row(path, error=error_text(error), **facts))
            continue
        z = found.z / found.length
        profiles = {
            name: np.interp(POSITION, z, getattr(found, name)).tolist()
            for name in ("diameter", "diameter_stderr")
        }
        if found.braid is not None:
            angles = np.degrees(found.braid.at(POSITION * found.length)).tolist()
            profiles |= dict(zip(("braid_angle", "braid_angle_stderr"), angles, strict=True))
            facts["braid_refusal"] = found.braid.refusal
        warnings = " | ".join(found.warnings)
        numbers = _numbers(found, recipe)
        rows.append(Row(path, numbers=numbers, warnings=warnings, **profiles, **facts))
    return rows


def _numbers(found: Any, recipe: Recipe) -> dict[str, float]:
    """The columns of a measurement in SI, its quality figures after them."""
    names = (
        "length", "length_stderr", "mean_diameter", "mean_diameter_stderr", "maximum_diameter",
        "volume", "volume_stderr", "px_per_m", "roll", "x0", "distance", "distance_stderr", "tilt",
        "bow",
    )  # fmt: skip
    numbers = {name: getattr(found, name) for name in names} | dataclasses.asdict(found.quality)
    columns = {"maximum_diameter": "max_diameter", "roll": "roll_deg", "tilt": "tilt_deg"}
    for angle in ("roll", "tilt"):
        numbers[angle] = math.degrees(numbers[angle])
    if found.braid is not None:
        numbers |= _of_braid(found, recipe.turns)
    return {columns.get(name, name): float(value) for name, value in numbers.items()}


def _of_braid(found: Any, turns: float | None) -> dict[str, float]:
    """The columns of the braid."""
    braid = found.braid
    numbers = {
        "braid_angle_deg": math.degrees(braid.mean),
        "braid_angle_deg_stderr": math.degrees(braid.mean_stderr),
        "braid_angle_resolved": braid.part,
        "yarns": braid.yarns,
        "turns": braid.turns,
    }
    if turns is not None:
        numbers["triangle_angle_deg"] = math.degrees(found.triangle_angle(turns))
    return numbers


def error_text(error: BaseException) -> str:
    """`ClassName: message`, on one line."""
    message = str(error)
    if isinstance(error, ImagingError):
        message = message.removeprefix(f"{error.path}: ")  # which has its own column
    return f"{type(error).__name__}: {' '.join(message.split())}"


def file_facts(path: str) -> dict[str, Any]:
    """Size, time of change, content hash and time stamp of a file, as fields of a `Row`.

    There are none if it cannot be read.
    """
    try:
        status = Path(path).stat()
        with Path(path).open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return {}
    stamp = read_timestamp(path)
    taken = {} if stamp is None else dataclasses.asdict(stamp)
    return {"size": status.st_size, "modified": status.st_mtime_ns, "sha256": digest, **taken}
