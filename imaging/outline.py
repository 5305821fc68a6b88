"""Locate the muscle's outline to a fraction of a pixel, with a limb model that includes the blur."""

import dataclasses
import functools

import cv2
import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import grey_opening, median_filter, percentile_filter

from .camera import Array, Flags, Image, Indices, Single
from .edge import (
    DEEPEST,
    EdgeProfile,
    best_shift,
    edge_profile,
    limb,
    limb_strength,
    near_edge,
    step,
)
from .errors import NoMuscle

_THIRD = np.array([-1.0, 3.0, -3.0, 1.0])
_REJECT = 4.0  # robust standard deviations above which a row is an outlier
_REFITS = 3
_ABOUT = 0.5  # octaves on either side
_POWER = 5 * np.pi / 18  # integral of 1 / (1 + x^6)^2 over x > 0


def smooth(position: Array, resolution: float, weight: Array | None = None) -> Array:
    """Return the curve q that minimises sum w (p - q)^2 + lambda sum (third difference of q)^2.

    A wave of length `resolution` is reduced to half its amplitude, and a parabola is unchanged. The ends
    of the curve are free.

    Args:
        position: p, shape (n,), n >= 4.
        resolution: wavelength reduced to half its amplitude [rows].
        weight: w >= 0, shape (n,); None for ones.

    Returns:
        q, shape (n,).

    References:
        Whittaker 1923; Eilers 2003, Anal. Chem. 75, equation 6.
    """
    # SciPy's smoothing splines penalise the second derivative and would change a parabola.
    w = np.ones_like(position) if weight is None else weight
    band = penalty(position.size) * _strength(resolution)  # a new array
    band[-1] += w
    return solveh_banded(
        band, w * position, overwrite_ab=True, overwrite_b=True, check_finite=False
    )


def smooth_robustly(
    position: Array, resolution: float, weight: Array | None = None
) -> tuple[Array, Flags]:
    """Apply `smooth`, excluding outliers that deviate by more than four robust standard deviations.

    Returns:
        The curve, shape (n,), and a mask of the rows used, shape (n,).
    """
    weight = np.ones(position.size) if weight is None else weight
    usable = weight > 0
    keep = usable
    curve = smooth(position, resolution, weight)
    for _ in range(_REFITS):
        off = position - curve
        kept = off[keep]
        centre = _median(kept)
        spread = 1.4826 * _median(np.abs(kept - centre))
        now = usable & (np.abs(off - centre) <= _REJECT * max(spread, 1e-3))
        if now.sum() < position.size // 2 or np.array_equal(now, keep):
            break
        keep = now
        curve = smooth(position, resolution, keep * weight)
    return curve, keep


def _median(values: Array) -> float:
    """Return the upper median; this is three times as fast as NumPy's median."""
    half = values.size // 2
    return float(np.partition(values, half)[half])


def variance_of_smooth(n: int, resolution: float) -> Array:
    """Return the variance of the smoothed curve at each of n rows for independent errors of unit variance.

    The variance is 5 pi / 18 * 2 / resolution away from the ends, and several times larger near the free
    ends. The values within one resolution of an end are exact.
    """
    edge, out = _end_variance(round(resolution * 1000)), np.full(n, _POWER * 2 / resolution)
    k = min(edge.size, n // 2)
    out[:k] = edge[:k]
    out[n - k :] = edge[:k][::-1]
    return out


def density_left_over(off: Array, resolution: float) -> float:
    """Return the spectral density of the scatter before smoothing, from the residuals of one picture.

    The density (variance times rows) is the mean of the periodogram near the wavelength `resolution`,
    corrected for the response of the smoothing. The smoothing removes shorter waves, such as those of the
    weave.

    Args:
        off: positions minus the smooth curve, shape (n,).
        resolution: resolution of the smoothing [rows].
    """
    taper = np.hanning(off.size)
    size = 2 ** int(np.ceil(np.log2(off.size)))
    first, last = (round(size / resolution * 2**octaves) for octaves in (-_ABOUT, _ABOUT))
    wave = np.arange(max(first, 1), max(last, 1) + 1)
    power = np.abs(np.fft.rfft(off * taper, size)[wave]) ** 2 / np.sum(taper**2)
    bent = _strength(resolution) * (2 - 2 * np.cos(2 * np.pi * wave / size)) ** 3
    return float(np.mean(power * (1 + 1 / bent) ** 2))


@functools.lru_cache(maxsize=16)
def _end_variance(thousandths: int) -> Array:
    resolution = thousandths / 1000
    n = int(4 * resolution) + 8
    band = penalty(n) * _strength(resolution)
    band[-1] += 1
    return np.sum(solveh_banded(band, np.eye(n, int(resolution))) ** 2, axis=0)


def _strength(resolution: float) -> float:
    return float((2 - 2 * np.cos(2 * np.pi / resolution)) ** -3)


@functools.lru_cache(maxsize=16)
def penalty(n: int) -> Array:
    """Return the matrix D'D of third differences in LAPACK's upper band form, shape (4, n)."""
    band = np.zeros((4, n), order="F")
    for i, a in enumerate(_THIRD):
        for j, b in enumerate(_THIRD[i:], start=i):
            band[3 - (j - i), j : n - 3 + j] += a * b
    band.setflags(write=False)
    return band


def correlated_points(off: Array) -> float:
    """Return the correlation length of residuals: 1 + 2 x sum of autocorrelations up to the first zero."""
    power = float(off @ off)
    if power == 0:
        return 1.0
    size = 2 ** int(np.ceil(np.log2(2 * off.size)))
    spectrum = np.abs(np.fft.rfft(off, size)) ** 2
    lags = np.fft.irfft(spectrum, size)[1 : off.size // 2] / power
    stop = int(np.argmax(lags <= 0)) if np.any(lags <= 0) else lags.size
    return float(1 + 2 * lags[:stop].sum())


_QUARTIC = 5  # coefficients of a bow; fits half a sine wave to 1 %
_CUBIC = 4  # coefficients of the axis, which may be bowed or S-shaped


def bow(left: Array, right: Array) -> Array:
    """Return the deviation of the smooth mid-line from the straight line through its ends [px].

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: column of the right edge, shape (n,).
    """
    model, fit, _ = _smooth_midline(left, right, _QUARTIC)
    curve, x = model[:, :_QUARTIC] @ fit[:_QUARTIC], model[:, _QUARTIC - 2]
    return curve - np.interp(x, x[[0, -1]], curve[[0, -1]])


def off_smooth_midline(left: Array, right: Array) -> Array:
    """Return the deviation of the mid-line from a cubic [px], shape (n,); arguments as for `bow`."""
    return _smooth_midline(left, right, _CUBIC)[2]


def _smooth_midline(left: Array, right: Array, n: int) -> tuple[Array, Array, Array]:
    """Fit a smooth mid-line; return the columns of the model, their coefficients, and the residuals [px].

    If the muscle is rolled, the two edges in a row are not opposite each other, which shifts their middle
    by roll R R'.
    """
    middle, half = (left + right) / 2, (right - left) / 2
    x = np.linspace(-1, 1, middle.size)
    model = np.column_stack([np.vander(x, n), half * np.gradient(half)])
    fit = np.asarray(np.linalg.lstsq(model, middle, rcond=None)[0], float)
    return model, fit, middle - model @ fit


_AVERAGED_ROWS = 21  # rows averaged along the edge before an edge is fitted
_FIRST_BLUR = 1.2  # blur of the step for the first curve [px]
_FIRST_REACH = 10  # largest error of the coarse outline [px]
_COARSE_MEDIAN = 15  # rows
_DENT = 0.6  # length of the longest dent due to dark threads, relative to the radius
_DARK_THREAD = 0.22  # of the brightness nearby; the edge of a darker thread is not visible
_AROUND = 1.5  # length over which that brightness is taken, relative to the radius
_SHADOW = 0.05  # of the limb's light; a side with darker cloth than this lies in a shadow
_LEAST_SEEN = 0.2  # smallest fraction of the averaged rows that gives an edge


@dataclasses.dataclass(frozen=True)
class Samples:
    """Windows across one side of the outline, aligned to a curve, and averages of neighbouring windows.

    Attributes:
        inward: +1 on the left side, -1 on the right side.
        curve: columns to which the windows are aligned, shape (n,).
        stretch: columns per pixel along the normal, shape (n,).
        mean: windows averaged along the edge, shape (n, k).
        weight: fraction of the averaged rows in which the edge is visible, shape (n,).
        height: brightness just inside the edge, by which `mean` is divided, shape (n,).
        profile: mean of all windows, shape (k,).
    """

    inward: int
    curve: Array
    stretch: Array
    mean: Single
    weight: Single
    height: Single
    profile: Array

    @property
    def light(self) -> Array:
        """Mean of all windows, not divided by their brightness, shape (k,)."""
        total = max(float(self.weight.sum()), 1.0)
        return (self.weight * self.height @ self.mean / total).astype(np.float64)


def first_curve(luma: Image, coarse: Array, inward: int, resolution: float, radius: float) -> Array:
    """Locate the outline to within half a pixel in the encoded values, which show even a dark limb."""
    start = np.round(_without_dents(coarse, inward, radius)).astype(np.int64)
    reach = min(_FIRST_REACH, round(0.3 * radius))
    offset = np.arange(-reach - 6, reach + 5)
    n, width = luma.shape
    column = np.clip(start[:, None] + inward * offset, 0, width - 1)
    windows = luma.ravel().take(column + width * np.arange(n)[:, None]).astype(np.float32)
    windows = _along_edge(windows, 5)
    shift = best_shift(windows, offset.astype(float), lambda t: step(t, _FIRST_BLUR), reach, 0.5)
    curve, keep = smooth_robustly(start + inward * shift, resolution)
    if keep.mean() < 0.5:
        raise NoMuscle(
            "the edge must be visible along the whole muscle", rows_found=float(keep.mean())
        )
    return curve


def _without_dents(coarse: Array, inward: int, radius: float) -> Array:
    """Remove dents due to dark threads, and single specks, from the coarse outline."""
    size = max(5, round(_DENT * radius))
    smooth = median_filter(coarse, _COARSE_MEDIAN, mode="nearest")
    # With point reflection at the ends, an end that slopes inward does not count as a dent.
    pad = min(size, smooth.size - 1)
    longer = np.pad(inward * smooth, pad, mode="reflect", reflect_type="odd")
    return inward * np.asarray(grey_opening(longer, size), float)[pad:-pad]


def aligned_windows(
    light: Single, curve: Array, inward: int, t: Array, radius: float, spacing: int = 1
) -> Samples:
    """Sample windows along the normal by Catmull-Rom interpolation in each row of the picture `light`.

    The rows of `light` are `spacing` px apart.
    """
    stretch = np.hypot(1, np.gradient(curve, spacing))
    n, width = light.shape
    at = curve.astype(np.float32)[:, None] + np.outer(stretch, inward * t).astype(np.float32)
    whole = at.astype(np.intp)
    f = at - whole.astype(np.float32)
    first = np.clip(whole - 1, 0, width - 4) + width * np.arange(n)[:, None]
    flat = light.ravel()
    before, here, after, last = (flat[k:].take(first) for k in range(4))
    # Catmull-Rom interpolation is exact for parabolas, unlike OpenCV's bicubic.
    rise, drop = after - before, here - after
    windows = 3 * drop + last - before
    windows = ((windows * (f - 1) - 2 * drop - rise) * f + rise) * (0.5 * f) + here
    beside = float(np.mean(windows[:, t < t[0] / 2]))
    if -beside > _SHADOW * float(np.median(windows[:, (t > 1) & (t < 5)])):
        windows -= beside  # this side lies in a shadow
    seen = _seen(windows[:, (t > 1) & (t < 5)].mean(axis=1), radius / spacing)
    averaged = _AVERAGED_ROWS // spacing | 1
    weight = _along_edge(seen[:, None], averaged)[:, 0]
    windows *= seen[:, None]
    windows = _along_edge(windows, averaged)
    windows /= np.maximum(weight, 1e-3)[:, None]
    weight[weight < _LEAST_SEEN] = 0
    # Faint threads count as much as bright ones; otherwise the mean edge would be that of the bright ones.
    height = windows[:, (t > 1) & (t < 5)].mean(axis=1)
    height = np.maximum(height, 0.3 * np.median(height))
    windows /= height[:, None]
    profile = (weight @ windows / max(float(weight.sum()), 1.0)).astype(np.float64)
    return Samples(inward, curve, stretch, windows, weight, height, profile)


def _along_edge(windows: Single, rows: int) -> Single:
    """Return the means over `rows` neighbouring rows, shape (n, k)."""
    means = cv2.blur(windows, (1, rows), borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(means, np.float32).reshape(windows.shape)


def _seen(height: Single, radius: float) -> Single:
    """Return 1 for rows in which the limb is lit, 0 where a black thread hides it; shape (n,)."""
    every = 8
    around = max(3, round(_AROUND * radius / every))
    level = percentile_filter(height[::every], 70, around, mode="nearest")
    level = np.interp(np.arange(height.size), np.arange(0, height.size, every), level)
    return (height > _DARK_THREAD * level).astype(np.float32)


_WIDEST_START = (
    3.0  # px; with a smaller initial blur, the flank of a defocused edge looks like an edge
)
_EVERY = 4  # spacing of the rows in the first pass
_ALIGNED = 2  # spacing of the rows in the second pass
_PASSES = 4
_SETTLED = (
    0.15,
    0.05,
)  # largest change of the edge [px] and relative change of the blur at the end
_BROAD = 45.0  # px inside the edge over which the fall of light towards the limb is measured
_INWARD = np.array([1, -1])  # of the left and right side
_LEAST_STEP = 0.3  # smallest fraction of a step that overshoots
_LARGEST_PART = 0.35  # largest depth of the windows, relative to the radius
_MARGIN = 64  # px next to the coarse outline: its error, and five times the widest blur


@dataclasses.dataclass(frozen=True)
class Side:
    """One side of the outline.

    Attributes:
        column: u of the edge in each row [px], shape (n,).
        stderr: random standard error of u [px], shape (n,).
        residual: RMS deviation of the individual fits from the curve [px].
        outliers: fraction of the rows rejected as outliers.
        kappa: ratio of the square-root term to the step in the limb model [px^-0.5].
        hidden: fraction of the edge hidden by black threads.
    """

    column: Array
    stderr: Array
    residual: float
    outliers: float
    kappa: float
    hidden: float


@dataclasses.dataclass(frozen=True)
class Outline:
    """Both sides of a muscle's outline.

    Attributes:
        rows: v, shape (n,).
        left, right: the two sides.
        edge: results of the fit to the mean edge.
        resolution: wavelength reduced to half its amplitude by the smoothing [px].
    """

    rows: Indices
    left: Side
    right: Side
    edge: EdgeProfile
    resolution: float

    @property
    def columns(self) -> Array:
        """Columns u of both sides [px], shape (2, n)."""
        return np.array([self.left.column, self.right.column])

    def moved(self, by: Array | float) -> "Outline":
        """Return the outline with its sides shifted right by `by` [px], broadcast to (2, n)."""
        left, right = self.columns + by
        return dataclasses.replace(
            self,
            left=dataclasses.replace(self.left, column=left),
            right=dataclasses.replace(self.right, column=right),
        )


def find_outline(
    image: Image, amount: Single, rows: Indices, left: Array, right: Array, *, resolution: float
) -> Outline:  # fmt: skip
    """Locate both edges of an upright muscle in each row, starting from a coarse outline.

    The model along the normal is I(t) = B + s0 [Phi(t/s) + kappa (sqrt(t) * G_s)]. A first curve is fitted
    to individual rows. Windows aligned to this curve are averaged over 21 rows along the edge. The blur s
    and kappa are fitted to the mean of all windows. The position of the edge is then fitted to each
    averaged window, and the positions are smoothed.

    Args:
        image: luma, shape (h, w), or RGB, shape (h, w, 3), of which the luma is used.
        amount: linear amount of braid for each value of luma, shape (256,).
        rows: v, consecutive, shape (n,).
        left: columns of the left side, accurate to 10 px, shape (n,).
        right: columns of the right side, shape (n,).
        resolution: wavelength reduced to half its amplitude by the smoothing [px].

    Raises:
        NoMuscle: there is no edge near the coarse outline.
    """
    radius = float(np.median(right - left)) / 2
    u0 = max(int(left.min()) - _MARGIN, 0)
    box = image[rows[0] : rows[-1] + 1, u0 : int(right.max()) + _MARGIN]
    luma = cv2.cvtColor(box, cv2.COLOR_RGB2GRAY) if box.ndim == 3 else np.ascontiguousarray(box)
    luma, sides = np.asarray(luma, np.uint8), ((left, 1), (right, -1))
    curves = np.array([first_curve(luma, u - u0, way, resolution, radius) for u, way in sides])
    light = np.asarray(cv2.LUT(luma, amount), np.float32)

    def windows(curves: Array, t: Array, spacing: int) -> list[Samples]:
        return [
            aligned_windows(light[::spacing], curve[::spacing], inward, t, radius, spacing)
            for curve, inward in zip(curves, (1, -1), strict=True)
        ]

    def improved(
        curves: Array, before: EdgeProfile, kappas: tuple[float, ...], spacing: int = 1
    ) -> Outline:
        """Locate the edges in windows aligned to curves, in rows that are `spacing` px apart."""
        t = _window(before.blur, radius, DEEPEST * max(1.0, before.blur))
        aligned = windows(curves, t, spacing)
        profiles = [side.profile for side in aligned]
        fit = edge_profile(profiles, t, before.blur, radius, kappas, before.disk)
        left, right = (
            _side(one, t, fit, shift, kappa, radius, resolution / spacing)
            for one, kappa, shift in zip(aligned, kappas, fit.shifts, strict=True)
        )
        return Outline(rows[::spacing], left, right, fit, resolution)

    # Over a third of the radius, threads average out. These windows are not realigned: kappa would
    # diverge, because a kappa that is too large moves the edge outward, where the next kappa is larger.
    t = _window(_WIDEST_START, radius, _BROAD)
    far = windows(curves, t, _EVERY)

    def kappas(inside: Array, s: float) -> tuple[float, ...]:
        return tuple(
            limb_strength(side.light, t - shift, s, radius)
            for side, shift in zip(far, inside, strict=True)
        )

    profiles = [side.profile for side in far]
    first = edge_profile(profiles, t, _WIDEST_START, radius, kappas(np.zeros(2), _WIDEST_START))
    inside = np.array(first.shifts)
    curves = curves + (_INWARD * inside)[:, None]
    outline = improved(curves, first, kappas(inside, first.blur), _ALIGNED)
    thin = np.column_stack([outline.columns, 2 * outline.columns[:, -1] - outline.columns[:, -2]])
    at = _ALIGNED * np.arange(thin.shape[1])
    found = np.array([np.interp(np.arange(rows.size), at, column) for column in thin])
    steps = (found - curves).mean(axis=1)
    for _ in range(_PASSES):
        curves, before, last = found, outline.edge, steps
        inside = inside + _INWARD * steps
        outline = improved(curves, before, kappas(inside, before.blur))
        steps = (outline.columns - curves).mean(axis=1)
        part = part_to_keep(steps, last)
        outline, steps = outline.moved(((part - 1) * steps)[:, None]), part * steps
        found = outline.columns
        if (
            np.abs(found - curves).max() < _SETTLED[0]
            and abs(outline.edge.blur / before.blur - 1) < _SETTLED[1]
        ):
            break
    return outline.moved(u0)


def part_to_keep(steps: Array, last: Array) -> Array:
    """Return the fraction of each side's step to keep, shape (2,).

    The position, height and blur of an edge are fitted together to a flank whose extent depends on the
    curve. Steps can therefore overshoot and alternate in sign. The fraction is computed by the secant
    method from two such steps.
    """
    back = last * steps < 0
    return np.where(back, last / np.where(back, last - steps, 1.0), 1.0).clip(_LEAST_STEP, 1.0)


def _window(blur: float, radius: float, deepest: float) -> Array:
    outside = round(max(8.0, 5 * blur))
    inside = round(min(deepest, _LARGEST_PART * radius))
    return np.arange(-outside, inside + 1.0)


def _side(
    side: Samples, t: Array, fit: EdgeProfile, mean: float, kappa: float, radius: float,
    resolution: float,
) -> Side:  # fmt: skip
    """Fit a smooth edge to the shifts of all windows, given the mean shift."""
    s, near = fit.blur, near_edge(t, fit.blur)
    shift = best_shift(
        side.mean[:, near], t[near], lambda x: limb(x, s, kappa, radius, fit.disk),
        max(2.0, 1.5 * s), 0.1,
    )  # fmt: skip
    # The mean profile is almost free of noise, and its fit gives the mean position without bias.
    shift += mean - np.average(shift, weights=side.weight)
    position = side.curve + side.inward * side.stretch * shift
    curve, keep = smooth_robustly(position, resolution, side.weight.astype(float))
    off = np.where(keep, position - curve, 0.0)
    density = density_left_over(off, resolution)
    return Side(
        column=curve, stderr=np.sqrt(density * variance_of_smooth(curve.size, resolution)),
        residual=float(np.sqrt(np.mean(off[keep] ** 2))), outliers=1 - float(keep.mean()),
        kappa=kappa, hidden=1 - float(side.weight.mean()),
    )  # fmt: skip
