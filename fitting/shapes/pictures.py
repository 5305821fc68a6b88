"""The measured pictures of a campaign: what a surface through them needs, in SI."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..arguments import shown
from ..errors import InputError

_SCALE_STDERR = "scale_relative_stderr"
_LEAST = 6
"""Pictures that make a table worth reading as a shape."""


@runtime_checkable
class PictureTable(Protocol):
    """The part of `imaging.Table` that is read here."""

    path: tuple[str, ...]
    columns: Mapping[str, np.ndarray]
    diameter: np.ndarray
    diameter_stderr: np.ndarray
    provenance: Mapping[str, str]

    @property
    def ok(self) -> np.ndarray:
        """Which pictures were measured."""
        ...


@dataclasses.dataclass(frozen=True)
class Pictures:
    """Profiles of n pictures at m common positions.

    Attributes:
        names: of the pictures, n of them.
        length: active length L [m], shape (n,).
        diameter: outside of the braid [m] at evenly spaced z/L from 0 to 1, shape (n, m).
        pressure: gauge [Pa], shape (n,); nan where it is not known.
        scale_std: relative standard error of the scale, common to all lengths and diameters.
        mean_std: standard error of a picture's average diameter [m], which is taken as common to all:
            light, lens and weave are.
        local_std: that of its diameters at the positions [m], shape (m,), or None.
        source: where they are from.

    Raises:
        InputError: shapes that do not match, values that are not positive, or fewer than six
            pictures.
    """

    names: tuple[str, ...]
    length: NDArray[np.floating]
    diameter: NDArray[np.floating]
    pressure: NDArray[np.floating]
    scale_std: float = 0.0
    mean_std: float = 0.0
    local_std: NDArray[np.floating] | None = None
    source: str = ""

    def __post_init__(self) -> None:
        n = len(self.names)
        if self.length.shape != (n,) or self.pressure.shape != (n,) or len(self.diameter) != n:
            raise InputError(
                f"{n} pictures need as many lengths, pressures and profiles, got "
                f"{self.length.shape}, {self.pressure.shape}, {self.diameter.shape}"
            )
        if n < _LEAST:
            raise InputError(
                f"{self.source}: {n} pictures were measured; a surface through shapes needs {_LEAST} "
                "or more: photograph a whole stroke"
            )
        bad = ~((self.length > 0) & np.all(self.diameter > 0, axis=1))
        if bad.any():
            name = self.names[int(np.argmax(bad))]
            raise InputError(f"{self.source}: {name} has a length or a diameter that is not > 0")

    def __len__(self) -> int:
        return len(self.names)

    def part(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> "Pictures":
        """The pictures that are kept."""
        chosen = np.arange(len(self))[keep]
        return dataclasses.replace(
            self, names=tuple(self.names[k] for k in chosen), length=self.length[keep],
            diameter=self.diameter[keep], pressure=self.pressure[keep],
        )  # fmt: skip

    @classmethod
    def of(cls, table: "PictureTable | Pictures | str | Path") -> "Pictures":
        """The measured pictures of a table, or of its NetCDF file."""
        if isinstance(table, Pictures):
            return table
        if isinstance(table, str | Path):
            return read_pictures(table)
        if not isinstance(getattr(table, "columns", None), Mapping):
            raise InputError(
                "the pictures must be a measurements.nc, by its path, or the table of a campaign, got "
                f"{shown(table)}"
            )
        columns = {name: np.asarray(values, float) for name, values in table.columns.items()}
        scale = float(table.provenance.get(_SCALE_STDERR, 0.0))
        return _pictures(
            table.path, table.ok, columns, table.diameter, table.diameter_stderr, scale, "the table"
        )


def read_pictures(path: str | Path) -> Pictures:
    """The measured pictures of a `measurements.nc` that `famjax measure` wrote.

    Raises:
        InputError: the file cannot be read, or holds no profiles.
    """
    from scipy.io import netcdf_file  # noqa: PLC0415 -- 0.1 s, for these files alone

    try:
        with netcdf_file(path, "r", mmap=False) as file:
            held: dict[str, Any] = {name: one[:].copy() for name, one in file.variables.items()}
            scale = float(getattr(file, _SCALE_STDERR, b"0").decode())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (TypeError, ValueError):
        raise InputError(
            f"{path} is not the NetCDF file of `famjax measure`, measurements.nc"
        ) from None
    missing = {"diameter_m", "length_m", "ok", "path"} - held.keys()
    if missing:
        raise InputError(
            f"{path} has no {', '.join(sorted(missing))}: give the measurements.nc of `famjax measure`"
        )
    names = tuple(b"".join(row).decode().rstrip("\0 ") for row in held["path"])
    columns = {"length": np.asarray(held["length_m"], float)}
    for name, stored in (
        ("pressure", "pressure_Pa"),
        ("mean_diameter_stderr", "mean_diameter_stderr_m"),
    ):
        if stored in held:
            columns[name] = np.asarray(held[stored], float)
    stderr = held.get("diameter_stderr_m", np.full(held["diameter_m"].shape, np.nan))
    return _pictures(names, held["ok"] != 0, columns, held["diameter_m"], stderr, scale, str(path))


def _pictures(
    names: tuple[str, ...],
    ok: np.ndarray,
    columns: Mapping[str, np.ndarray],
    diameter: np.ndarray,
    stderr: np.ndarray,
    scale_std: float,
    source: str,
) -> Pictures:
    length = columns["length"]
    use = ok & np.isfinite(length) & np.isfinite(diameter).all(axis=1)
    of_mean = columns.get("mean_diameter_stderr", np.full(len(names), np.nan))
    mean = float(np.median(of_mean[use])) if np.isfinite(of_mean[use]).all() and use.any() else 0.0
    local = np.median(np.asarray(stderr, float)[use], axis=0) if use.any() else np.array([np.nan])
    return Pictures(
        tuple(name for name, keep in zip(names, use, strict=True) if keep),
        length[use],
        np.asarray(diameter, float)[use],
        columns.get("pressure", np.full(len(names), np.nan))[use],
        scale_std,
        mean,
        local if np.isfinite(local).all() else None,
        source,
    )
