"""The outline of the muscle to a fraction of a pixel: limb model, with the blur of the picture."""

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
_REJECT = 4.0  # robust standard deviations at which a row counts as stray
_REFITS_OF_STRAY = 3
_ABOUT = 0.5  # octaves on either side
_POWER = 5 * np.pi / 18  # integral of 1 / (1 + x^6)^2 over x > 0


def smooth(position: Array, resolution: float, weight: Array | None = None) -> Array:
    """The curve that minimises sum w (p - q)^2 + lambda sum (third difference of q)^2.

    A wave of length `resolution` passes at half its height, a parabola unchanged; the ends are
    free. 0.3 ms for 2000 rows.

    Args:
        position: p, shape (n,), n >= 4.
        resolution: wavelength of the half response [rows].
        weight: w >= 0, shape (n,); None for ones.

    Returns:
        q, shape (n,).

    References:
        Whittaker 1923; Eilers 2003, Anal. Chem. 75, equation 6.
    """
    # SciPy's smoothing splines penalise the second derivative: a parabola would not pass unchanged.
    w = np.ones_like(position) if weight is None else weight
    band = penalty(position.size) * _strength(resolution)  # a new array
    band[-1] += w
    return solveh_banded(
        band, w * position, overwrite_ab=True, overwrite_b=True, check_finite=False
    )


def smooth_robustly(
    position: Array, resolution: float, weight: Array | None = None
) -> tuple[Array, Flags]:
    """`smooth` without the rows that are off by more than four robust standard deviations.

    Returns:
        The curve, shape (n,), and the rows that count, shape (n,).
    """
    weight = np.ones(position.size) if weight is None else weight
    usable = weight > 0
    keep = usable
    curve = smooth(position, resolution, weight)
    for _ in range(_REFITS_OF_STRAY):
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
    """The upper median, thrice as fast as numpy's."""
    half = values.size // 2
    return float(np.partition(values, half)[half])


def variance_of_smooth(n: int, resolution: float) -> Array:
    """Variance of `smooth` at each of n rows for independent errors of unit variance.

    5 pi / 18 * 2 / resolution inside; near the ends, which are free, several times as much. The
    rows of one resolution at each end are exact, what lies between has the value of the inside.
    """
    edge, out = _end_variance(round(resolution * 1000)), np.full(n, _POWER * 2 / resolution)
    k = min(edge.size, n // 2)
    out[:k] = edge[:k]
    out[n - k :] = edge[:k][::-1]
    return out


def density_left_over(off: Array, resolution: float) -> float:
    """Variance times rows of the scatter before `smooth`, from the residuals of one picture.

    The mean of the periodogram about the wavelength that passes at half its height, each value
    over the part that was left of it. Shorter waves, a weave's own, say little about what passes.

    Args:
        off: positions less the smooth curve, shape (n,).
        resolution: of the smoothing [rows].
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
    n, k = int(4 * resolution) + 8, int(resolution)
    every = max(1, k // 32)
    at = np.arange(0, k, every)
    unit = np.zeros((n, at.size))
    unit[at, np.arange(at.size)] = 1
    band = penalty(n) * _strength(resolution)
    band[-1] += 1
    response = solveh_banded(band, unit)
    return np.interp(np.arange(k), at, np.sum(response**2, axis=0))


def _strength(resolution: float) -> float:
    return float((2 - 2 * np.cos(2 * np.pi / resolution)) ** -3)


@functools.lru_cache(maxsize=16)
def penalty(n: int) -> Array:
    """The matrix D'D of third differences as the upper band that LAPACK takes, shape (4, n)."""
    band = np.zeros((4, n), order="F")
    for i, a in enumerate(_THIRD):
        for j, b in enumerate(_THIRD[i:], start=i):
            band[3 - (j - i), j : n - 3 + j] += a * b
    band.setflags(write=False)
    return band


def correlated_points(off: Array) -> float:
    """Points over which residuals are correlated, 1 + 2 sum of their autocorrelations while > 0."""
    power = float(off @ off)
    if power == 0:
        return 1.0
    size = 2 ** int(np.ceil(np.log2(2 * off.size)))
    spectrum = np.abs(np.fft.rfft(off, size)) ** 2
    lags = np.fft.irfft(spectrum, size)[1 : off.size // 2] / power
    stop = int(np.argmax(lags <= 0)) if np.any(lags <= 0) else lags.size
    return float(1 + 2 * lags[:stop].sum())


_QUARTIC = 5  # coefficients of a bow, which half a sine wave has to a hundredth
_CUBIC = 4  # coefficients of the axis: a muscle may be bowed, or hang in an S
_REFITS, _STRAY = 6, 2.0  # fits without what strays, by so many robust standard deviations


def axis_deviation(left: Array, right: Array) -> float:
    """Root mean square deviation of the mid-line from a straight line, over the mean radius.

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
    """
    middle = (left + right) / 2
    x = np.linspace(-1, 1, middle.size)
    off = middle - np.polynomial.Polynomial.fit(x, middle, 1)(x)
    return float(np.sqrt(np.mean(off**2)) / np.mean((right - left) / 2))


def bow(left: Array, right: Array) -> Array:
    """Deviation of the smooth mid-line from the straight line through its ends [px], shape (n,).

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
    """
    x, smooth, fit = _smooth_midline(left, right, _QUARTIC)
    curve = smooth[:, :_QUARTIC] @ fit[:_QUARTIC]
    return curve - np.interp(x, x[[0, -1]], curve[[0, -1]])


def axis_kink(left: Array, right: Array) -> float:
    """Largest deviation of the mid-line from a smooth one, over the mean radius.

    Rendered muscles stay below 0.025; something that covers a sixth of the radius on one side makes
    0.07 or more.

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
    """
    off = off_smooth_midline(left, right)
    return float(np.abs(off).max() / np.mean((right - left) / 2))


def off_smooth_midline(
    left: Array, right: Array, n: int = _CUBIC, *, robust: bool = False
) -> Array:
    """Deviation of the mid-line from a smooth one [px], shape (n,).

    An axis bends as a cubic at most, and pairs of one row lie askew on a rolled muscle, which
    moves their middle by roll R R'.

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
        n: coefficients of the axis, more than those of a cubic where it may be bowed by much.
        robust: rows that stray do not pull the smooth mid-line towards them.
    """
    _, smooth, fit = _smooth_midline(left, right, n)
    middle = (left + right) / 2
    off = middle - smooth @ fit
    for _ in range(_REFITS if robust else 0):
        keep = np.abs(off) <= _STRAY * 1.4826 * np.median(np.abs(off))
        off = middle - smooth @ np.linalg.lstsq(smooth[keep], middle[keep], rcond=None)[0]
    return off


def _smooth_midline(left: Array, right: Array, n: int) -> tuple[Array, Array, Array]:
    """Positions -1 to 1, the columns of a smooth mid-line's model, and their factors."""
    middle, half = (left + right) / 2, (right - left) / 2
    x = np.linspace(-1, 1, middle.size)
    smooth = np.column_stack([np.vander(x, n), half * np.gradient(half)])
    return x, smooth, np.asarray(np.linalg.lstsq(smooth, middle, rcond=None)[0], float)


_AVERAGED_ROWS = 21  # along the edge, before an edge is fitted
_FIRST_BLUR = 1.2  # px, of the step that gives the first curve
_FIRST_REACH = 10  # px by which the coarse outline may be off
_COARSE_MEDIAN = 15  # rows
_DENT = 0.6  # of the radius, along the axis: the longest dent that dark threads make
_DARK_THREAD = 0.22  # of the brightness around, below which a thread's edge is not seen
_AROUND = 1.5  # of the radius, along the axis, over which that brightness is taken
_SHADOW = 0.05  # of the limb's light, by which the cloth beside it is darker than most of it
_LEAST_SEEN = 0.2  # of the averaged rows, below which they give no edge


@dataclasses.dataclass(frozen=True)
class Samples:
    """Windows across one side, aligned to a curve, and the mean of neighbouring ones.

    Attributes:
        inward: +1 on the left side, -1 on the right.
        curve: columns to which they are aligned, shape (n,).
        stretch: columns per pixel along the normal, shape (n,).
        mean: windows averaged along the edge, shape (n, k).
        weight: part of the averaged rows in which the edge shows, shape (n,).
        height: brightness of each just inside the edge, by which `mean` is divided, shape (n,).
        profile: mean of all, shape (k,).
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
        """Mean of all windows at their own brightness, shape (k,)."""
        total = max(float(self.weight.sum()), 1.0)
        return (self.weight * self.height @ self.mean / total).astype(np.float64)


def first_curve(luma: Image, coarse: Array, inward: int, resolution: float, radius: float) -> Array:
    """The outline to half a pixel: a step in the encoded values, where even a dark limb is visible."""
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
    """The coarse outline without the dents that dark threads make, and without single specks."""
    size = max(5, round(_DENT * radius))
    smooth = median_filter(coarse, _COARSE_MEDIAN, mode="nearest")
    # Continued by its own point reflection, an end that slopes inward is not taken for a dent.
    pad = min(size, smooth.size - 1)
    longer = np.pad(inward * smooth, pad, mode="reflect", reflect_type="odd")
    return inward * np.asarray(grey_opening(longer, size), float)[pad:-pad]


def aligned_windows(
    light: Single, curve: Array, inward: int, t: Array, radius: float, spacing: int = 1
) -> Samples:
    """Windows along the normal by Catmull-Rom interpolation in each row of the picture `light`.

    Its rows may be thinned out, `spacing` px apart.
    """
    stretch = np.hypot(1, np.gradient(curve, spacing))
    n, width = light.shape
    at = curve.astype(np.float32)[:, None] + np.outer(stretch, inward * t).astype(np.float32)
    whole = at.astype(np.intp)
    f = at - whole.astype(np.float32)
    first = np.clip(whole - 1, 0, width - 4) + width * np.arange(n)[:, None]
    flat = light.ravel()
    before, here, after, last = (flat[k:].take(first) for k in range(4))
    # Catmull-Rom: exact for parabolas, unlike OpenCV's bicubic.
    rise, drop = after - before, here - after
    windows = 3 * drop + last - before
    windows = ((windows * (f - 1) - 2 * drop - rise) * f + rise) * (0.5 * f) + here
    beside = float(np.mean(windows[:, t < t[0] / 2]))
    if -beside > _SHADOW * float(np.median(windows[:, (t > 1) & (t < 5)])):
        windows -= beside  # one side may lie in a shadow
    seen = _seen(windows[:, (t > 1) & (t < 5)].mean(axis=1), radius / spacing)
    averaged = _AVERAGED_ROWS // spacing | 1
    weight = _along_edge(seen[:, None], averaged)[:, 0]
    windows *= seen[:, None]
    windows = _along_edge(windows, averaged)
    windows /= np.maximum(weight, 1e-3)[:, None]
    weight[weight < _LEAST_SEEN] = 0
    # Faint threads at the limb count as much as bright ones, or the mean edge would be the bright's.
    height = windows[:, (t > 1) & (t < 5)].mean(axis=1)
    height = np.maximum(height, 0.3 * np.median(height))
    windows /= height[:, None]
    profile = (weight @ windows / max(float(weight.sum()), 1.0)).astype(np.float64)
    return Samples(inward, curve, stretch, windows, weight, height, profile)


def _along_edge(windows: Single, rows: int) -> Single:
    """Means of so many neighbouring rows; shape (n, k)."""
    means = cv2.blur(windows, (1, rows), borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(means, np.float32).reshape(windows.shape)


def _seen(height: Single, radius: float) -> Single:
    """1 in rows whose limb is lit, 0 where a black thread hides it; shape (n,)."""
    every = 8
    around = max(3, round(_AROUND * radius / every))
    level = percentile_filter(height[::every], 70, around, mode="nearest")
    level = np.interp(np.arange(height.size), np.arange(0, height.size, every), level)
    return (height > _DARK_THREAD * level).astype(np.float32)


"""How an edge is found in linear light: the limb model, the steepest point, half the local step."""

_WIDEST_START = 3.0  # px: from too small a blur the flank of a defocused edge looks like an edge
_EVERY = 4  # rows of which one is looked at first
_ALIGNED = 2  # rows of which one is enough to align windows to
_PASSES = 4
_SETTLED = (0.15, 0.05)  # px, of which the next pass would leave a fifth; part of the blur
_BROAD = 45.0  # px inside the edge over which the light is read that falls towards the limb
_INWARD = np.array([1, -1])  # of the left side, of the right one
_LEAST_STEP = 0.3  # of a step that overshoots
_LARGEST_PART = 0.35  # of the radius up to which the windows may reach
_MARGIN = 64  # px beside the coarse outline: its own error, and five times the widest blur


@dataclasses.dataclass(frozen=True)
class Side:
    """One side of the outline.

    Attributes:
        column: u of the edge in every row [px], shape (n,).
        stderr: its random standard error [px], shape (n,).
        residual: root mean square of the single fits about the curve [px].
        outliers: part of the rows that were thrown out.
        kappa: strength of the limb's root against its step [px^-0.5].
        hidden: part of the edge that black threads hide.
    """

    column: Array
    stderr: Array
    residual: float
    outliers: float
    kappa: float
    hidden: float


@dataclasses.dataclass(frozen=True)
class Outline:
    """Both sides of a muscle.

    Attributes:
        rows: v, shape (n,).
        left, right: the sides.
        edge: blur, light and misfit of the mean edge.
        resolution: wavelength that passed the smoothing at half its height [px].
    """

    rows: Indices
    left: Side
    right: Side
    edge: EdgeProfile
    resolution: float

    @property
    def columns(self) -> Array:
        """U of both sides [px], shape (2, n)."""
        return np.array([self.left.column, self.right.column])

    def moved(self, by: Array | float) -> "Outline":
        """The outline with its sides moved to the right [px], by an array that broadcasts to (2, n)."""
        left, right = self.columns + by
        return dataclasses.replace(
            self,
            left=dataclasses.replace(self.left, column=left),
            right=dataclasses.replace(self.right, column=right),
        )


def find_outline(
    image: Image, amount: Single, rows: Indices, left: Array, right: Array, *, resolution: float
) -> Outline:  # fmt: skip
    """Both edges of an upright muscle in every row, from a coarse outline.

    I(t) = B + s0 [Phi(t/s) + kappa (sqrt(t) * G_s)] along the normal. Single rows give a first
    curve; then windows aligned to it are averaged over 21 rows along the edge, the mean of all
    gives blur s and kappa, and every averaged window a position, which is smoothed.

    Args:
        image: luma, shape (h, w), or RGB of which luma is taken, shape (h, w, 3).
        amount: linear amount of braid for each value of luma, shape (256,).
        rows: v, consecutive, shape (n,).
        left: columns of the left side to within 10 px, shape (n,).
        right: the same of the right side.
        resolution: wavelength that passes at half its height [px].

    Raises:
        NoMuscle: no edge where the coarse outline has one.
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
        """From windows aligned to curves; rows `spacing` px apart do for the next pass' windows."""
        t = _window(before.blur, radius, DEEPEST * max(1.0, before.blur))
        aligned = windows(curves, t, spacing)
        profiles = [side.profile for side in aligned]
        fit = edge_profile(profiles, t, before.blur, radius, kappas, before.disk)
        left, right = (
            _side(one, t, fit, shift, kappa, radius, resolution / spacing)
            for one, kappa, shift in zip(aligned, kappas, fit.shifts, strict=True)
        )
        return Outline(rows[::spacing], left, right, fit, resolution)

    # Over a third of the radius threads average out. These windows stay where they are: a kappa of
    # windows about the last pass's curve would feed on itself, as one that is too large puts the edge
    # too far out, and there the next one is larger still.
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
    """The fraction of both sides' steps after which they need not come back, shape (2,).

    An edge's place, height and blur are found together, from a flank that ends where the curve puts
    it: beside the edge a step may be twice too long, and passes go to and fro about their middle. Two
    steps of opposite sign say by how much, by the secant through them.
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
    """The smooth edge through the shifts of all windows, whose mean is known."""
    s, near = fit.blur, near_edge(t, fit.blur)
    shift = best_shift(
        side.mean[:, near], t[near], lambda x: limb(x, s, kappa, radius, fit.disk),
        max(2.0, 1.5 * s), 0.1,
    )  # fmt: skip
    # The mean profile has no noise to bias its fit: it says where the edges are on average.
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


_ANY_BOW = 5  # coefficients of a mid-line that may be bowed: half a sine wave to a thousandth
_LONGER = 3.0  # times the outline's resolution: waves that no thread makes
_DEEPEST = 2.0  # px of the mid-line, beyond which no thread is what covers an end
_SEEN = 2.0  # robust standard deviations of the mid-line that make a dent
_SEEN_AT_END = 8.0  # the same at an end, which scatters more than twice as much


def without_dents(outline: Outline) -> Outline:
    """The outline with its dented parts replaced by the mirrored other side.

    A black thread at the limb is as dark as the cloth: the edge is found where it ends, or where the
    thread beside it begins. That happens to one side at a time, and a body of revolution has a smooth
    mid-line. Where that leaves a smooth one by more than two standard deviations, the side that leaves
    its own smoother curve further is replaced by the other one's mirror image, between the rows in
    which the mid-line crosses the smooth one. At an end, where that curve is free to follow a dent, it
    is the side that lies further in, as far as threads reach, and only where that is clear: of two
    sides that scatter the inner one would be moved out. An outline of which no thread is hidden has no
    dents.
    """
    if outline.left.hidden == outline.right.hidden == 0:
        return outline
    far = np.abs([u - smooth(u, _LONGER * outline.resolution) for u in outline.columns])
    off = off_smooth_midline(outline.left.column, outline.right.column, _ANY_BOW, robust=True)
    run = np.cumsum(np.append(0, np.diff(np.sign(off)) != 0)).astype(np.intp)
    furthest = np.zeros(run[-1] + 1)
    np.maximum.at(furthest, run, np.abs(off))
    spread = 1.4826 * float(np.median(np.abs(off)))
    dented = furthest > _SEEN * spread
    on_left = np.bincount(run, far[0]) > np.bincount(run, far[1])
    for end in (0, -1):
        dented[end] = furthest[end] > _SEEN_AT_END * spread
        if furthest[end] < _DEEPEST:
            on_left[end] = off[end] > 0
    wrong = np.array([dented & on_left, dented & ~on_left])
    return outline.moved(-2 * off * wrong[:, run])
