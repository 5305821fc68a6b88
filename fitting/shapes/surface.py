"""A smooth surface D(z; L, P) through the profiles of many pictures, tested on some held out."""

import dataclasses
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import famjax

from ..data.force_data import Specimen
from ..errors import InputError
from .pictures import Pictures, PictureTable
from .polynomials import SurfaceForm, fit_polynomials, pressure_ends
from .threads import Threads, fit_threads

Array = NDArray[np.floating]

DEGREES = range(1, 11)
"""Of the polynomials in length that are tried."""
MORE = 2
"""Degrees in length above those that predict best."""
KNOTS = 17
"""Lengths at which the surface is handed on; a spline through them repeats it to 1e-5 of itself."""
HELD_OUT = 5
"""Every fifth picture, in the order of the lengths, is held out of the test's fit."""
OUTLIER = 6.0
"""Robust standard deviations by which a picture may lie off the surface."""
MOST_OUTLIERS = 0.1
"""Share of the pictures that may lie off it before there is no surface."""
MOST_SCATTER = 0.01
"""Of the pictures about the surface, as part of the diameter, beyond which there is none."""
_CORRELATED = 0.02  # of the length, over which neighbouring diameters of a picture err alike
_FINEST = 1e-5  # of the diameter, below any photograph's error


@dataclasses.dataclass(frozen=True)
class HeldOut:
    """A surface without some pictures against them.

    Attributes:
        pictures: that were held out.
        rms: root mean square of D measured less D predicted, all positions [m].
        mean: of the same [m]: what does not average out.
        standardised: rms of the same over its predicted standard deviation: 1 where that is right.
    """

    pictures: int
    rms: float
    mean: float
    standardised: float


@dataclasses.dataclass(frozen=True)
class ShapeSurface:
    """The diameter over position, length and pressure, with its uncertainty.

    Attributes:
        form: polynomials that were chosen, by leaving out each picture.
        lengths: at which the surface is handed on [m], falling, shape (k,).
        pressures: lowest and highest of the pictures [Pa]; nan where the shape does not depend on them.
        diameters: D [m] at both pressures, shape (2, k, m); equal where it does not.
        draws: as `diameters`, of surfaces as probable as this one, shape (d, 2, k, m): from the
            scatter of the pictures, the errors that they have in common, and that of the scale.
        draw_scales: factor of the lengths of each draw, shape (d,).
        held_out: the test.
        threads: turns and length of the braid's threads that the pictures show.
        used: names of the pictures that it goes through.
        left_out: names of those that lie off it.
        notes: what a reader must know.
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
        """What a reader of a fit with this shape must know, in sentences."""
        test, (short, long) = self.held_out, (self.lengths[-1], self.lengths[0])
        return (
            f"The shape is measured: {len(self.used)} pictures from {short * 1e3:.4g} to "
            f"{long * 1e3:.4g} mm; {test.pictures} held out are predicted within "
            f"{test.rms * 1e6:.3g} um RMS, {test.standardised:.2g} of what was expected.",
            *self.notes,
        )

    def diameter_std(self) -> Array:
        """Standard error of `diameters` [m], shape (2, k, m)."""
        return self.draws.std(axis=0, ddof=1)

    def family(
        self, braid: famjax.braids.AbstractBraid, *, draw: int | None = None
    ) -> famjax.surfaces.SampledSurface:
        """The surface in a braid; of a draw, if its number is given."""
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
        """The measured geometry of a muscle.

        The pictures' triangle neglects the ends, whose diameters are smaller: its turns are some
        percent off, as far as the force. Count them, or identify them with the fit.

        Args:
            specimen: rest length, wall, braid thickness, and the bladder's diameter, or None where it
                fills the braid at rest.
            braid: gives the turns; that of the pictures' triangle unless given.
            draw: number of a draw, for the uncertainty of the shape.

        Raises:
            InputError: the threads lie inside the wall, where photographs do not show them.
        """
        if specimen.embedded:
            raise InputError(
                "photographs show the outside of a wall, and not the threads inside it: a measured "
                "shape is for a bladder under its braid, specimen embedded = false"
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
                f"the pictures end at {self.lengths[0] * 1e3:.4g} mm, short of the rest length "
                f"{specimen.rest_length * 1e3:.4g} mm: give the bladder's diameter at rest, specimen "
                "bladder_diameter_mm = ..., or photograph the muscle at rest"
            )
        bladder = famjax.Bladder(specimen.rest_length, outer, specimen.wall_thickness)
        return famjax.MeasuredGeometry(self.family(braid, draw=draw), bladder)


def shape_surface(
    table: PictureTable | Pictures | str | Path, *, draws: int = 64, seed: int = 0
) -> ShapeSurface:
    """The shape of a muscle over length and pressure, from the pictures of a campaign.

    At every position z/L the diameter is a polynomial in the length, the same degree everywhere,
    with or without terms times the pressure; least squares over the pictures. The degrees are
    those that predict each picture best from the others, and two more in the length, lest the band
    miss a bias. Pictures far off the surface are left out and named.

    Args:
        table: of the pictures, or its NetCDF file; pressures are used where it has them.
        draws: of the uncertainty.
        seed: of the draws.

    Returns:
        The surface, with a test on pictures held out.

    Raises:
        InputError: too few pictures or lengths, or pictures that lie on no smooth surface.

    References:
        Chambers 2021, section 4.3, fits each profile by itself; Wu 1986 for the draws, with
        the residuals of each picture left out.
    """
    pictures = Pictures.of(table)
    pictures = pictures.part(np.argsort(-pictures.length, kind="stable"))
    keep, notes = _on_a_surface(pictures)
    used = pictures.part(keep)
    form = _choose(used)
    found = fit_polynomials(used, form)
    lengths = np.linspace(used.length.max(), used.length.min(), KNOTS)
    low, high = pressure_ends(used)
    if form.with_pressure < 0:
        if np.isfinite(low):
            notes.append(
                "The shape at a length does not change with the pressure beyond its scatter."
            )
        low = high = np.nan
    else:
        notes.append(f"The shape at a length changes with the pressure: {form}.")
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
        fit_threads(used.length, used.diameter.mean(axis=1), used.pressure),
        used.names,
        tuple(name for name, kept in zip(pictures.names, keep, strict=True) if not kept),
        tuple(notes),
    )


def _common(pictures: Pictures, draws: int, rng: np.random.Generator) -> Array:
    """Errors of the diameter that all pictures have in common [m], shape (draws, m).

    That of the average diameter, and along the axis what the positions' own errors exceed it by,
    correlated as the outline is smoothed.
    """
    x = np.linspace(0, 1, pictures.diameter.shape[1])
    whole = pictures.mean_std * rng.standard_normal((draws, 1))
    if pictures.local_std is None:
        return np.broadcast_to(whole, (draws, x.size))
    along = np.exp(-0.5 * ((x[:, None] - x) / _CORRELATED) ** 2) + 1e-9 * np.eye(x.size)
    wave = rng.standard_normal((draws, x.size)) @ np.linalg.cholesky(along).T
    return whole + np.sqrt(np.maximum(pictures.local_std**2 - pictures.mean_std**2, 0)) * wave


def _forms(pictures: Pictures) -> list[SurfaceForm]:
    """Those that the pictures can carry, the plainest first."""
    span = float(np.ptp(pictures.length))
    lengths = 1 + int(np.sum(np.diff(np.sort(pictures.length)) > 1e-3 * span)) if span else 1
    if lengths < 4:
        raise InputError(
            f"{pictures.source}: the pictures are of {lengths} different lengths; a surface needs four "
            "or more: photograph a whole stroke"
        )
    dependent = [-1, 0, 1, 2, 3] if np.isfinite(pressure_ends(pictures)[0]) else [-1]
    forms = [
        SurfaceForm(degree, more)
        for degree in DEGREES
        for more in dependent
        if more <= degree < lengths - 1 and 2 * (degree + more + 2) <= len(pictures)
    ]
    return sorted(forms, key=lambda form: form.degree + form.with_pressure)


def _choose(pictures: Pictures) -> SurfaceForm:
    """The form that predicts best a picture that is left out, and more of it.

    What predicts best still errs as much by its bias as by its scatter, and no band covers a bias.
    """
    forms = _forms(pictures)
    best = min(
        forms, key=lambda form: float(np.mean(fit_polynomials(pictures, form).left_out ** 2))
    )
    more = best._replace(degree=best.degree + MORE)
    return more if more in forms else best


def _on_a_surface(pictures: Pictures) -> tuple[NDArray[np.bool_], list[str]]:
    """Which pictures lie on one surface, and a sentence on those that do not."""
    keep = np.ones(len(pictures), bool)
    while True:
        used = pictures.part(keep)
        found = fit_polynomials(used, _choose(used))
        size = np.sqrt(np.mean(found.residuals**2, axis=1) / np.maximum(1 - found.leverage, 1e-9))
        middle = np.median(size)
        spread = 1.4826 * np.median(np.abs(size - middle))
        off = size > middle + OUTLIER * max(spread, 0.1 * middle, _FINEST * used.diameter.mean())
        if not off.any():
            break
        keep[np.flatnonzero(keep)[int(np.argmax(size))]] = False
        if np.mean(~keep) > MOST_OUTLIERS:
            names = ", ".join(_names(pictures, ~keep)[:5])
            raise InputError(
                f"{pictures.source}: more than a tenth of the pictures lie on no smooth surface with "
                f"the others ({names}): look at their overlays, and that all show one muscle"
            )
    scatter = float(np.sqrt(np.mean(size**2)) / used.diameter.mean())
    if scatter > MOST_SCATTER:
        raise InputError(
            f"{pictures.source}: the pictures scatter by {scatter:.1%} of the diameter about any smooth "
            "surface, photographs of one muscle by 0.1 %: check that lengths, pressures and pictures "
            "belong together"
        )
    if keep.all():
        return keep, []
    names = ", ".join(_names(pictures, ~keep))
    count = int(np.sum(~keep))
    said = "1 picture lies" if count == 1 else f"{count} pictures lie"
    return keep, [f"{said} off the surface, left out: {names}."]


def _names(pictures: Pictures, which: NDArray[np.bool_]) -> list[str]:
    return [name for name, chosen in zip(pictures.names, which, strict=True) if chosen]


def _held_out(pictures: Pictures, form: SurfaceForm) -> HeldOut:
    """Every fifth picture predicted from the others, the longest and the shortest kept."""
    place = np.arange(len(pictures))
    out = (place % HELD_OUT == HELD_OUT // 2) & (place > 0) & (place < len(pictures) - 1)
    kept, tested = pictures.part(~out), place[out]
    found = fit_polynomials(kept, form)
    length, pressure = pictures.length[tested], pictures.pressure[tested]
    error = pictures.diameter[tested] - found.basis(length, pressure) @ found.coefficients
    predicted = found.variance(length, pressure)
    return HeldOut(
        len(tested),
        float(np.sqrt(np.mean(error**2))),
        float(error.mean()),
        float(np.sqrt(np.mean(error**2 / predicted))),
    )
