"""Calibration of a rig: its sensors, and the feed-forward output that holds a pressure.

`read_calibration` reads a TOML file with units in every key; `fit_sensor` and `fit_feed_forward` fit the
parts of a calibration.
"""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from famjax.boundary.toml_file import Form, from_entries, read_toml, to_entries, toml_text
from famjax.boundary.units import from_si

from .errors import RigError

READINGS = 5  # converter readings summed in one record
FULL_SCALE = 1023 * READINGS  # largest sum [counts]
FULL_OUTPUT = 255  # largest output [counts of pulse-width modulation], 5 V


def pressure_text(pressure: float, unit: str) -> str:
    """Format a pressure [Pa] in a unit.

    >>> pressure_text(275790.3, "psi")
    '40 psi'
    """
    return f"{from_si(pressure, unit, 'pressure'):.4g} {unit}"


@dataclasses.dataclass(frozen=True)
class Sensor:
    """A linear sensor; nonlinearity is not modelled, so it appears in `scatter`.

    value = gain (counts - zero), where counts is the sum of five 10-bit readings.

    Attributes:
        gain: gain [unit/count], nonzero.
        zero: counts at a value of zero; may lie outside 0..5115.
        gain_std: standard error of the gain [unit/count].
        zero_std: standard error of the zero [counts].
        correlation: correlation of the two errors, in [-1, 1].
        scatter: RMS residual [unit] of the references about the line, with n - 2 degrees of freedom.
    """

    gain: float
    zero: float
    gain_std: float = math.inf
    zero_std: float = math.inf
    correlation: float = 0.0
    scatter: float = math.inf

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain != 0 and math.isfinite(self.zero)):
            raise RigError(
                f"a sensor requires a finite nonzero gain and a finite zero, got {self.gain} "
                f"and {self.zero}"
            )

    def value(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Convert counts to values [unit], any shape."""
        return self.gain * (np.asarray(counts, np.float64) - self.zero)

    def counts(self, value: float) -> float:
        """Convert a value [unit] to unrounded counts."""
        return self.zero + value / self.gain

    def error(self, counts: ArrayLike) -> NDArray[np.float64]:
        """Return the standard error [unit] due to the calibration alone, any shape."""
        if not (math.isfinite(self.gain_std) and math.isfinite(self.zero_std)):
            return np.full(np.shape(counts), math.inf)
        from_zero = np.asarray(counts, np.float64) - self.zero
        a, b = from_zero * self.gain_std, -self.gain * self.zero_std
        return np.sqrt(a * a + b * b + 2 * self.correlation * a * b)


def fit_sensor(counts: ArrayLike, references: ArrayLike) -> Sensor:
    """Fit a sensor to reference readings, neglecting the errors in the references.

    Fits counts = zero + references / gain by least squares, because only the counts are noisy.

    Args:
        counts: mean counts at each reference, shape (n,), n >= 3, strictly between 0 and 5115.
        references: applied values [unit], shape (n,), at least two of them different.

    Returns:
        The sensor, with the standard errors of both parameters and the correlation of these errors.

    Raises:
        RigError: there are too few references or all are equal, counts are at the limit of the converter,
            or the sensor does not respond.

    References:
        Draper & Smith 1998, Applied Regression Analysis, section 1.7 (inverse regression).

    >>> sensor = fit_sensor([500, 1500, 2500, 3500], [0.0, 1e5, 2e5, 3e5])
    >>> round(sensor.gain, 9), round(sensor.zero, 6)
    (100.0, 500.0)
    """
    y, x = _pairs("counts and references", counts, references)
    if y.size < 3:
        raise RigError(f"a calibration requires at least three references, got {y.size}")
    bad = np.flatnonzero((y <= 0) | (y >= FULL_SCALE))
    if bad.size:
        raise RigError(
            f"the reading of {y[bad[0]]:g} counts is at the limit of the converter: omit it"
        )
    if np.ptp(x) == 0:
        raise RigError(f"all references are {x[0]:g}: apply at least two different ones")
    (slope, zero), covariance = np.polyfit(x, y, 1, cov=True)
    slope_std, zero_std = np.sqrt(np.diag(covariance))
    if abs(slope) <= 3 * slope_std or slope == 0:
        raise RigError(
            "the counts do not follow the references: check the wiring and the order of the references"
        )
    # gain = 1/slope reverses the sign of the correlation with the zero
    correlation = -covariance[0, 1] / (slope_std * zero_std) if zero_std else 0.0
    gain, left = 1 / slope, y - zero - slope * x
    scatter = abs(gain) * np.sqrt(left @ left / (y.size - 2))
    found = gain, zero, slope_std * gain * gain, zero_std, correlation, scatter
    return Sensor(*map(float, found))


@dataclasses.dataclass(frozen=True)
class FeedForward:
    """Feed-forward output v = sum c_k (P / P_s)^k, k = 0..3, added to the controller output.

    Attributes:
        coefficients: c_k [counts], shape (4,).
        scale: P_s [Pa], > 0.
        pressure_range: pressures [Pa] between which v is valid.
        scatter: RMS residual [counts] of the steps about the cubic.
    """

    coefficients: tuple[float, ...]
    scale: float = 1.0
    pressure_range: tuple[float, float] = (0.0, math.inf)
    scatter: float = math.inf

    @classmethod
    def bias(cls, output: float = 127.5) -> "FeedForward":
        """Return a constant output, by default 2.5 V, the middle of the proportional valve's range."""
        return cls((output, 0.0, 0.0, 0.0))

    def output(self, pressure: float, unit: str = "kPa") -> float:
        """Return the output [counts, 0..255] that holds a pressure [Pa]; `unit` is used in messages.

        Raises:
            RigError: the pressure lies outside `pressure_range`, or the output outside 0..255.
        """
        low, high = self.pressure_range
        if not low <= pressure <= high:
            said = [pressure_text(x, unit) for x in (low, high, pressure)]
            raise RigError(
                "the feed-forward is valid from {} to {}, not at {}: calibrate the pump again".format(
                    *said
                )
            )
        v = math.fsum(c * (pressure / self.scale) ** k for k, c in enumerate(self.coefficients))
        if not 0 <= v <= FULL_OUTPUT:
            at = pressure_text(pressure, unit)
            raise RigError(f"the feed-forward at {at} is {v:.1f} counts; it must be 0..255")
        return v


def fit_feed_forward(pressures: ArrayLike, outputs: ArrayLike) -> FeedForward:
    """Fit a cubic to output steps, neglecting the noise in the pressures.

    Args:
        pressures: mean pressure [Pa] at each step, shape (n,), n >= 5, at least four of them different.
        outputs: output steps [counts, 0..255], shape (n,).

    Returns:
        v(P), valid between the lowest and the highest pressure.

    Raises:
        RigError: there are too few steps, or the cubic does not rise over the whole range.

    >>> P = np.linspace(0, 7e5, 8)
    >>> v = fit_feed_forward(P, 20 + 180 * (P / 7e5) ** 2 + 30 * P / 7e5)
    >>> round(v.output(3.5e5), 6)
    80.0
    """
    P, u = _pairs("pressures and outputs", pressures, outputs)
    if u.size < 5 or np.unique(u).size < 4 or np.unique(P).size < 4:
        raise RigError(
            "the cubic requires at least five steps, with four different outputs and four pressures; "
            f"got {u.size} steps"
        )
    scale = float(np.abs(P).max())
    A = np.vander(P / scale, 4, increasing=True)
    c = np.linalg.lstsq(A, u)[0]
    scatter = float(np.sqrt(np.sum((A @ c - u) ** 2) / (u.size - 4)))
    x = np.linspace(P.min(), P.max(), 257) / scale
    slope = c[1] + 2 * c[2] * x + 3 * c[3] * x * x
    if (slope <= 0).any():
        raise RigError(
            "the pressure does not rise with the output: check the pump and the needle valve"
        )
    return FeedForward(tuple(c.tolist()), scale, (float(P.min()), float(P.max())), scatter)


def _pairs(
    what: str, first: ArrayLike, second: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Convert two arguments to finite arrays of equal length."""
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    if a.ndim != 1 or a.shape != b.shape:
        raise RigError(f"{what} must have the same shape (n,), got {a.shape} and {b.shape}")
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise RigError(f"{what} must be finite: omit missing readings")
    return a, b


def _sensor_form(unit: str) -> Form:
    keys = {name: f"{name}_{unit}_per_count" for name in ("gain", "gain_std")}
    counts = {"zero": "zero_counts", "zero_std": "zero_std_counts"}
    return Form(keys=keys | counts | {"scatter": f"scatter_{unit}"})


_FORMS = {
    "pressure": _sensor_form("Pa"),
    "force": _sensor_form("N"),
    "feed_forward": Form(
        keys={
            "coefficients": "coefficients_counts",
            "scale": "scale_Pa",
            "pressure_range": "pressure_range_Pa",
            "scatter": "scatter_counts",
        }
    ),
}


@dataclasses.dataclass(frozen=True)
class Calibration:
    """Calibration of a rig: sensors and feed-forward.

    Attributes:
        pressure: transducer, Pa gauge; the device's trip requires a positive gain.
        force: load cell, N, positive when the muscle pulls.
        feed_forward: output that holds a pressure.
        board: number of the board for which the calibration is valid, 0 for none.
    """

    pressure: Sensor
    force: Sensor
    feed_forward: FeedForward = dataclasses.field(default_factory=FeedForward.bias)
    board: int = 0

    def __post_init__(self) -> None:
        if self.pressure.gain <= 0:
            raise RigError(
                f"the transducer's gain must be > 0, got {self.pressure.gain:g}: swap its wires"
            )


def calibration_as_dict(calibration: Calibration) -> dict[str, Any]:
    """Convert a calibration to a dictionary with units in the keys; unknown values are omitted."""
    board = {"board": calibration.board} if calibration.board else {}
    parts = {name: to_entries(getattr(calibration, name), form) for name, form in _FORMS.items()}
    return board | parts


def calibration_from_dict(content: Mapping[str, Any], where: str = "") -> Calibration:
    """Build a calibration from a dictionary made by `calibration_as_dict`.

    Args:
        content: tables of both sensors and, optionally, the feed-forward table and the board.
        where: prefix for messages.

    Raises:
        RigError: a sensor is missing, a key is unknown or a value is not a number.
    """
    tables = from_entries(_Tables, content, where=where, error=RigError)
    kinds: dict[str, Any] = {"pressure": Sensor, "force": Sensor, "feed_forward": FeedForward}
    parts = {
        name: from_entries(kinds[name], table, form, where=f"{where}[{name}]: ", error=RigError)
        for name, form in _FORMS.items()
        if (table := getattr(tables, name)) is not None
    }
    return Calibration(**parts, board=tables.board)


def read_calibration(path: str | Path) -> Calibration:
    """Read a calibration from a TOML file.

    Raises:
        RigError: the file cannot be read or is not a calibration.
    """
    return calibration_from_dict(read_toml(path, "calibration", RigError), where=f"{path}: ")


def write_calibration(path: str | Path, calibration: Calibration) -> None:
    """Write a calibration as TOML that `read_calibration` restores exactly."""
    _write(path, calibration_as_dict(calibration))


def update_calibration(
    path: str | Path, name: str, part: Sensor | FeedForward, board: int = 0
) -> None:
    """Update one part of a calibration file and keep the others; the file is created if missing.

    Args:
        path: calibration file.
        name: pressure, force or feed_forward.
        part: new calibration of this part.
        board: number of the board used; 0 keeps the number in the file.

    Raises:
        RigError: the file cannot be read or belongs to another board, or the calibration is invalid.
    """
    known = read_toml(path, "calibration", RigError) if Path(path).exists() else {}
    if board and known and known.get("board", board) != board:
        raise RigError(
            f"{path} belongs to board {known['board']}, but this is board {board}: use another file"
        )
    content = known | {name: to_entries(part, _FORMS[name])} | ({"board": board} if board else {})
    if {"pressure", "force"} <= content.keys():
        calibration_from_dict(content, where=f"{path}: ")
    _write(path, {name: content[name] for name in ("board", *_FORMS) if name in content})


def _write(path: str | Path, content: dict[str, Any]) -> None:
    heading = "# value = gain (counts - zero), counts: sum of five readings, 0..5115\n"
    Path(path).write_text(heading + toml_text(content), encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class _Tables:
    pressure: dict[str, Any]
    force: dict[str, Any]
    feed_forward: dict[str, Any] | None = None
    board: Annotated[int, Meta(ge=0, le=65534, description="a number from 0 to 65534")] = 0
