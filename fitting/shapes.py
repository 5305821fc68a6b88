"""Shape of a muscle as a function of length and pressure, from photographs.

`shape_surface(path)` fits D(z; L, P) to the pictures and tests it on held-out pictures.
`surface.geometry(specimen)` returns the measured geometry of a muscle.
"""

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import famjax
from famjax.boundary.errors import InputError
from famjax.tables import check_size

from .arguments import shown
from .data import Specimen

Array = NDArray[np.floating]

DEGREES = range(1, 11)
"""Degrees of the polynomials in length that are tried."""
MORE = 2
"""Number added to the degree in length that predicts best."""
KNOTS = 17
"""Number of lengths at which the surface is sampled; a spline through them is accurate to 1e-5."""
HELD_OUT = 5
"""Every fifth picture, in order of length, is held out in the test."""
OUTLIER = 6.0
"""Largest distance of a picture from the surface, in robust standard deviations."""
MOST_OUTLIERS = 0.1
"""Largest fraction of pictures that may lie off the surface."""
MOST_SCATTER = 0.01
"""Largest scatter of the pictures about the surface, relative to the diameter."""
WITHIN = 0.15
"""Largest relative error in the turns computed from the triangle relation, which neglects the narrower
ends."""

_SCALE_STDERR = "scale_relative_stderr"
_COLUMNS = {
    "length": "length_m", "diameter": "diameter_m", "diameter_stderr": "diameter_stderr_m",
    "pressure": "pressure_Pa", "mean_diameter_stderr": "mean_diameter_stderr_m",
}  # fmt: skip
_LEAST = 6  # smallest number of pictures
_SPREAD = 0.02  # smallest range of pressures, relative to the largest, that can change the shape
_CORRELATED = 0.02  # correlation length of the diameter errors, relative to the length
_FINEST = 1e-5  # relative to the diameter; smaller than the error of any photograph


@dataclasses.dataclass(frozen=True)
class Pictures:
    """Profiles of n pictures at m common positions.

    Attributes:
        names: names of the pictures.
        length: active length L [m], shape (n,).
        diameter: outer diameter of the braid [m] at evenly spaced z/L from 0 to 1, shape (n, m).
        pressure: gauge pressure [Pa], shape (n,); nan if unknown.
        scale_std: relative standard error of the scale, common to all lengths and diameters.
        mean_std: standard error of a picture's average diameter [m]. The same error is assumed in
            all pictures, because lighting, lens and weave are the same.
        local_std: standard error of the diameters at each position [m], shape (m,), or None.
        source: origin of the pictures.

    Raises:
        InputError: a value is not positive, or there are fewer than six pictures.
    """

    names: tuple[str, ...]
    length: Array
    diameter: Array
    pressure: Array
    scale_std: float = 0.0
    mean_std: float = 0.0
    local_std: Array | None = None
    source: str = ""

    def __post_init__(self) -> None:
        n = len(self.names)
        if n < _LEAST:
            raise InputError(
                f"{self.source}: {n} pictures were measured, but a shape surface needs at least "
                f"{_LEAST}: photograph a whole stroke"
            )
        if not (self.length.min() > 0 and self.diameter.min() > 0):
            raise InputError(f"{self.source}: lengths and diameters must be > 0 in all pictures")

    def __len__(self) -> int:
        return len(self.names)

    def part(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> "Pictures":
        """Return the selected pictures."""
        names = tuple(self.names[k] for k in np.arange(len(self))[keep])
        kept = {name: getattr(self, name)[keep] for name in ("length", "diameter", "pressure")}
        return dataclasses.replace(self, names=names, **kept)

    def pressure_ends(self) -> tuple[float, float]:
        """Return the lowest and highest pressure [Pa]; nan if the pressures are unknown or all equal."""
        P = self.pressure
        if not np.isfinite(P).all() or np.ptp(P) <= _SPREAD * np.abs(P).max():
            return np.nan, np.nan
        return float(P.min()), float(P.max())

    @classmethod
    def of(cls, pictures: "str | Path | Pictures") -> "Pictures":
        """Read the measured pictures from a `measurements.nc`.

        Raises:
            InputError: the file cannot be read, or contains no profiles.
        """
        if isinstance(pictures, Pictures):
            return pictures
        if not isinstance(pictures, str | Path):
            raise InputError(
                f"pictures must be the path to a measurements.nc, got {shown(pictures)}"
            )
        names, ok, columns, scale = _read(pictures)
        held = {name: np.asarray(values, float) for name, values in columns.items()}
        use = ok & np.isfinite(held["length"]) & np.isfinite(held["diameter"]).all(axis=1)
        held = {name: values[use] for name, values in held.items()}
        unknown = np.full(int(use.sum()), np.nan)
        mean = held.get("mean_diameter_stderr", unknown)
        local = held.get("diameter_stderr", unknown[:, None])
        known = len(unknown) and np.isfinite(np.median(local, axis=0)).all()
        return cls(
            tuple(name for name, keep in zip(names, use, strict=True) if keep),
            held["length"],
            held["diameter"],
            held.get("pressure", unknown),
            scale,
            float(np.median(mean)) if len(unknown) and np.isfinite(mean).all() else 0.0,
            np.median(local, axis=0) if known else None,
            str(pictures),
        )


def _read(path: str | Path) -> tuple[tuple[str, ...], np.ndarray, dict[str, np.ndarray], float]:
    """Read names, success flags, columns and the relative error of the scale from a NetCDF file."""
    from scipy.io import netcdf_file  # noqa: PLC0415 -- 0.1 s, for these files alone

    check_size(path)
    try:
        with netcdf_file(path, "r", mmap=False) as file:
            held = {name: one[:].copy() for name, one in file.variables.items()}
            scale = float(getattr(file, _SCALE_STDERR, b"0").decode())
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (TypeError, ValueError, LookupError, MemoryError, ArithmeticError, AttributeError):
        raise InputError(
            f"{path} is not a measurements.nc file (NetCDF) written by `famjax measure`"
        ) from None
    missing = {"diameter_m", "length_m", "ok", "path"} - held.keys()
    if missing:
        raise InputError(
            f"{path} has no {', '.join(sorted(missing))}: use the measurements.nc from `famjax measure`"
        )
    names = tuple(b"".join(row).decode().rstrip("\0 ") for row in held["path"])
    columns = {name: held[stored] for name, stored in _COLUMNS.items() if stored in held}
    return names, held["ok"] != 0, columns, scale


class SurfaceForm(NamedTuple):
    """Degrees of a surface's polynomials.

    Attributes:
        degree: degree of the polynomial in length.
        with_pressure: degree of the polynomial in length that multiplies the pressure; -1 for none.
    """

    degree: int
    with_pressure: int


class _Polynomials:
    """Least-squares fit of the polynomials at every position, with equal weights for all pictures.

    Attributes:
        coefficients: coefficients [m], shape (terms, m).
        residuals: residuals of each picture [m], shape (n, m).
        leverage: leverage of each picture, shape (n,).
        left_out: residual of each picture from the surface without it [m], shape (n, m).
    """

    def __init__(self, pictures: Pictures, form: SurfaceForm) -> None:
        self.form = form
        self.ends = float(pictures.length.min()), float(pictures.length.max())
        self.pressures = pictures.pressure_ends()
        X = self.basis(pictures.length, pictures.pressure)
        self.solve = np.linalg.pinv(X)
        self.coefficients = self.solve @ pictures.diameter
        self.residuals = pictures.diameter - X @ self.coefficients
        self.leverage = np.sum(X * self.solve.T, axis=1)
        self.left_out = self.residuals / np.maximum(1 - self.leverage, 1e-9)[:, None]

    def basis(self, length: Array, pressure: Array) -> Array:
        """Return Chebyshev polynomials in the length, then the same times the pressure, each in [-1, 1]."""
        low, high = self.ends
        x = (2 * length - low - high) / (high - low)
        terms = np.polynomial.chebyshev.chebvander(x, self.form.degree)
        if self.form.with_pressure < 0:
            return terms
        low, high = self.pressures
        share = (2 * pressure - low - high) / (high - low)
        return np.hstack([terms, share[:, None] * terms[:, : self.form.with_pressure + 1]])

    def varied(self, rng: np.random.Generator) -> Array:
        """Sample equally probable coefficients, with each picture's residual scaled by a random factor."""
        sizes = rng.standard_normal(len(self.leverage))[:, None]
        return self.coefficients + self.solve @ (sizes * self.left_out)

    def variance(self, length: Array, pressure: Array) -> Array:
        """Return the variance of the diameters in a new picture [m2], shape (n, m)."""
        terms = self.basis(length, pressure) @ self.solve
        scatter = np.sum(self.residuals**2, axis=0) / max(len(self.leverage) - len(self.solve), 1)
        return (1 + np.sum(terms**2, axis=1))[:, None] * scatter


@dataclasses.dataclass(frozen=True)
class Threads:
    """Fit of the triangle relation B^2 = L^2 + (pi N D)^2 to pictures.

    Attributes:
        length: thread length B [m]; at zero pressure if it depends on the pressure.
        turns: number of turns N [-].
        length_std, turns_std: standard errors.
    """

    length: float
    turns: float
    length_std: float
    turns_std: float

    def turns_range(self) -> tuple[float, float]:
        """Return the smallest and largest number of turns to allow in a fit to the force."""
        return self.turns * (1 - WITHIN), self.turns * (1 + WITHIN)


def _fit_threads(pictures: Pictures) -> Threads:
    """Fit the triangle relation to lengths and average diameters, neglecting the shape of the ends.

    Least squares of L^2 = B^2 (1 + c P) - (pi N)^2 D^2; c = 0 if the pressure is unknown or constant.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    length, pressure = pictures.length, pictures.pressure
    diameter = pictures.diameter.mean(axis=1)
    scale = float(np.mean(length**2))
    columns = [np.ones_like(length), -(diameter**2) / np.mean(diameter**2)]
    known = np.isfinite(pictures.pressure_ends()[0])
    if known:
        columns.append(pressure / np.abs(pressure).max())
    X, y = np.stack(columns, axis=1), length**2 / scale
    solve = np.linalg.pinv(X)
    found = solve @ y
    rest = y - X @ found
    covariance = solve @ solve.T * float(rest @ rest) / max(len(y) - X.shape[1], 1)
    std = np.sqrt(np.diag(covariance))
    if found[0] <= 0 or found[1] <= 0:
        raise InputError(
            "the muscle does not thicken as it shortens: check that the pictures show one muscle over "
            "a whole stroke"
        )
    thread = np.sqrt(found[0] * scale)
    turns = np.sqrt(found[1] * scale / np.mean(diameter**2)) / np.pi
    errors = thread * std[0] / found[0] / 2, turns * std[1] / found[1] / 2
    return Threads(*map(float, (thread, turns, *errors)))


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """Errors of a surface for held-out pictures.

    Attributes:
        pictures: number of held-out pictures.
        rms: root mean square of measured minus predicted diameters at all positions [m].
        standardised: the same for errors divided by the predicted standard deviation; 1 if that is correct.
    """

    pictures: int
    rms: float
    standardised: float


@dataclasses.dataclass(frozen=True)
class ShapeSurface:
    """Diameter as a function of position, length and pressure, with its uncertainty.

    Attributes:
        form: degrees of the polynomials, chosen by cross-validation.
        lengths: lengths at which the surface is sampled [m], decreasing, shape (k,).
        pressures: lowest and highest pressure of the pictures [Pa]; nan if the shape is independent of it.
        diameters: D [m] at both pressures, shape (2, k, m); equal if the shape is independent of pressure.
        draws: diameters of equally probable surfaces, shape (d, 2, k, m). The surfaces differ because of
            the scatter of the pictures, errors common to all pictures, and the error of the scale.
        draw_scales: factor applied to the lengths in each draw, shape (d,).
        held_out: errors for held-out pictures.
        threads: turns and length of the threads, from the pictures.
        used: names of the pictures that determine the surface.
        left_out: names of the pictures that lie off the surface.
        notes: sentences for the report.
    """

    form: SurfaceForm
    lengths: Array
    pressures: tuple[float, float]
    diameters: Array
    draws: Array
    draw_scales: Array
    held_out: HeldOut
    threads: Threads
    used: tuple[str, ...]
    left_out: tuple[str, ...]
    notes: tuple[str, ...]

    def summary(self) -> tuple[str, ...]:
        """Return notes for the report on a fit that uses this shape."""
        test, (short, long) = self.held_out, (self.lengths[-1], self.lengths[0])
        return (
            f"The shape was measured in {len(self.used)} pictures at lengths from {short * 1e3:.4g} to "
            f"{long * 1e3:.4g} mm; {test.pictures} held-out pictures are predicted with an error of "
            f"{test.rms * 1e6:.3g} um RMS, {test.standardised:.2g} times the expected error.",
            *self.notes,
        )

    def family(
        self, braid: famjax.braids.AbstractBraid, *, draw: int | None = None
    ) -> famjax.surfaces.SampledSurface:
        """Return the surface with a braid: the fitted surface, or draw number `draw`."""
        both = self.diameters if draw is None else self.draws[draw]
        lengths = self.lengths * (1.0 if draw is None else self.draw_scales[draw])
        known = np.isfinite(self.pressures).all()
        pressures = np.array(self.pressures) if known else np.zeros(1)
        return famjax.surfaces.SampledSurface(
            lengths=lengths, pressures=pressures, diameters=both[: len(pressures)], braid=braid
        )

    def geometry(
        self,
        specimen: Specimen,
        *,
        braid: famjax.braids.AbstractBraid | None = None,
        draw: int | None = None,
    ) -> famjax.MeasuredGeometry:
        """Return the measured geometry of a muscle.

        The triangle relation neglects the ends, where the diameter is smaller, so the number of turns
        and hence the force are wrong by a few per cent. Count the turns, or identify them in the fit.

        Args:
            specimen: specimen with rest length, wall and braid thickness, and bladder diameter, which is
                None if the bladder fills the braid at rest.
            braid: braid with the turns of the threads; from the triangle relation if omitted.
            draw: number of a draw, for the uncertainty of the shape.

        Raises:
            InputError: the threads lie inside the wall, where photographs do not show them, or the bladder
                diameter at rest is neither given nor photographed.
        """
        if specimen.embedded:
            raise InputError(
                "photographs do not show threads inside the wall: a measured shape requires the "
                "bladder to be under the braid (specimen embedded = false)"
            )
        braid = braid or famjax.Braid(
            self.threads.length, self.threads.turns, specimen.braid_thickness
        )
        outer = specimen.bladder_diameter
        if outer is None:
            at_rest = self.family(braid).diameter(
                0.5, specimen.rest_length, np.nanmin([0.0, *self.pressures])
            )
            outer = float(at_rest) - 2 * specimen.braid_thickness
        if not np.isfinite(outer):
            raise InputError(
                f"the longest photographed length, {self.lengths[0] * 1e3:.4g} mm, is below the rest "
                f"length, {specimen.rest_length * 1e3:.4g} mm: add the bladder diameter at rest (specimen "
                "bladder_diameter_mm = ...), or photograph the muscle at rest"
            )
        bladder = famjax.Bladder(specimen.rest_length, outer, specimen.wall_thickness)
        return famjax.MeasuredGeometry(self.family(braid, draw=draw), bladder)


def shape_surface(
    pictures: str | Path | Pictures, *, draws: int = 64, seed: int = 0
) -> ShapeSurface:
    """Fit the shape of a muscle, as a function of length and pressure, to pictures from a test campaign.

    At each position z/L the diameter is a polynomial in length, with or without terms proportional to
    pressure, fitted by least squares. The degrees are the same at all positions and chosen by
    cross-validation; the degree in length is then raised by two, so that the band covers the bias. Pictures
    far off the surface are left out and listed.

    Args:
        pictures: `measurements.nc` from `famjax measure`, with or without pressures.
        draws: number of draws for the uncertainty.
        seed: random seed of the draws.

    Returns:
        The surface, tested on held-out pictures.

    Raises:
        InputError: there are too few pictures or lengths, or the pictures do not lie on a smooth surface.

    References:
        Chambers 2021, section 4.3 (fits each profile separately). Wu 1986 (draws; here with held-out
        residuals).
    """
    pictures = Pictures.of(pictures)
    pictures = pictures.part(np.argsort(-pictures.length, kind="stable"))
    keep, notes = _on_a_surface(pictures)
    used = pictures.part(keep)
    form = _choose(used)
    found = _Polynomials(used, form)
    lengths = np.linspace(used.length.max(), used.length.min(), KNOTS)
    low, high = used.pressure_ends()
    if form.with_pressure >= 0:
        notes.append(
            "At a given length, the shape changes with pressure: it is a polynomial of degree "
            f"{form.degree} in length, plus pressure times one of degree {form.with_pressure} in length."
        )
    elif np.isfinite(low):
        notes.append(
            "At a given length, the shape does not change with pressure by more than the scatter."
        )
        low = high = np.nan
    at = np.stack([found.basis(lengths, np.full(KNOTS, P)) for P in (low, high)])
    rng = np.random.default_rng(seed)
    varied = np.stack([at @ found.varied(rng) for _ in range(draws)])
    varied += _common(used, draws, rng)[:, None, None, :]
    scales = 1 + used.scale_std * rng.standard_normal(draws)
    return ShapeSurface(
        form,
        lengths,
        (low, high),
        at @ found.coefficients,
        varied * scales[:, None, None, None],
        scales,
        _held_out(used, form),
        _fit_threads(used),
        used.names,
        tuple(np.array(pictures.names)[~keep].tolist()),
        tuple(notes),
    )


def _common(pictures: Pictures, draws: int, rng: np.random.Generator) -> Array:
    """Sample the diameter errors [m] shared by all pictures, shape (draws, m).

    They are the error of the average diameter plus an error that varies along the axis. The latter is
    the part of the error at each position that exceeds the former, correlated over the smoothing length
    of the outline.
    """
    x = np.linspace(0, 1, pictures.diameter.shape[1])
    whole = pictures.mean_std * rng.standard_normal((draws, 1))
    if pictures.local_std is None:
        return np.broadcast_to(whole, (draws, x.size))
    along = np.exp(-0.5 * ((x[:, None] - x) / _CORRELATED) ** 2) + 1e-9 * np.eye(x.size)
    wave = rng.standard_normal((draws, x.size)) @ np.linalg.cholesky(along).T
    return whole + np.sqrt(np.maximum(pictures.local_std**2 - pictures.mean_std**2, 0)) * wave


def _forms(pictures: Pictures) -> list[SurfaceForm]:
    """List the forms that the pictures can determine, simplest first."""
    span = float(np.ptp(pictures.length))
    lengths = 1 + int(np.sum(np.diff(np.sort(pictures.length)) > 1e-3 * span)) if span else 1
    if lengths < 4:
        raise InputError(
            f"{pictures.source}: the pictures show {lengths} different lengths, but a surface needs "
            "at least four: photograph a whole stroke"
        )
    dependent = [-1, 0, 1, 2, 3] if np.isfinite(pictures.pressure_ends()[0]) else [-1]
    forms = [
        SurfaceForm(degree, more)
        for degree in DEGREES
        for more in dependent
        if more <= degree < lengths - 1 and 2 * (degree + more + 2) <= len(pictures)
    ]
    return sorted(forms, key=lambda form: form.degree + form.with_pressure)


def _choose(pictures: Pictures) -> SurfaceForm:
    """Choose the form with the smallest held-out error, and add two degrees in length.

    The form that predicts best has as much bias as scatter, and a band does not cover bias. Pressure terms
    must reduce the error by more than its standard error (Breiman et al. 1984).
    """
    forms = _forms(pictures)
    errors = {form: np.mean(_Polynomials(pictures, form).left_out ** 2, axis=1) for form in forms}
    best, *other = (
        min(group, key=lambda form: np.mean(errors[form]))
        for dependent in (False, True)
        if (group := [form for form in forms if (form.with_pressure >= 0) == dependent])
    )
    for form in other:
        gain = errors[best] - errors[form]
        if gain.mean() > gain.std(ddof=1) / np.sqrt(gain.size):
            best = form
    more = best._replace(degree=best.degree + MORE)
    return more if more in forms else best


def _on_a_surface(pictures: Pictures) -> tuple[NDArray[np.bool_], list[str]]:
    """Find the pictures that lie on one surface, and describe the others in a sentence."""
    keep = np.ones(len(pictures), bool)
    while True:
        used = pictures.part(keep)
        found = _Polynomials(used, _choose(used))
        size = np.sqrt(np.mean(found.residuals**2, axis=1) / np.maximum(1 - found.leverage, 1e-9))
        middle = np.median(size)
        spread = 1.4826 * np.median(np.abs(size - middle))
        off = size > middle + OUTLIER * max(spread, 0.1 * middle, _FINEST * used.diameter.mean())
        if not off.any():
            break
        keep[np.flatnonzero(keep)[int(np.argmax(size))]] = False
        if np.mean(~keep) > MOST_OUTLIERS:
            names = ", ".join(np.array(pictures.names)[~keep][:5])
            raise InputError(
                f"{pictures.source}: more than a tenth of the pictures lie off the smooth surface through "
                f"the others ({names}): check their overlays, and that all pictures show the same muscle"
            )
    scatter = float(np.sqrt(np.mean(size**2)) / used.diameter.mean())
    if scatter > MOST_SCATTER:
        raise InputError(
            f"{pictures.source}: the pictures scatter by {scatter:.1%} of the diameter about any smooth "
            "surface, whereas photographs of one muscle scatter by about 0.1 %: check that each "
            "picture has the right length and pressure"
        )
    if keep.all():
        return keep, []
    out = np.array(pictures.names)[~keep]
    said = "1 picture lies" if len(out) == 1 else f"{len(out)} pictures lie"
    return keep, [f"{said} off the surface; not used: {', '.join(out)}."]


def _held_out(pictures: Pictures, form: SurfaceForm) -> HeldOut:
    """Predict every fifth picture from the others; the longest and the shortest are never held out."""
    place = np.arange(len(pictures))
    out = (place % HELD_OUT == HELD_OUT // 2) & (place > 0) & (place < len(pictures) - 1)
    kept, tested = pictures.part(~out), place[out]
    found = _Polynomials(kept, form)
    length, pressure = pictures.length[tested], pictures.pressure[tested]
    error = pictures.diameter[tested] - found.basis(length, pressure) @ found.coefficients
    predicted = found.variance(length, pressure)
    return HeldOut(
        len(tested),
        float(np.sqrt(np.mean(error**2))),
        float(np.sqrt(np.mean(error**2 / predicted))),
    )
