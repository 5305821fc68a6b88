"""The tapes at the ends: their inner edges, and the position of the axis in depth."""

import math
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import map_coordinates, spline_filter

from .camera import (
    LUMA,
    Array,
    Camera,
    Flags,
    Silhouette,
    Tone,
    amount_of_look,
    ring_position,
    turned,
)
from .edge import best_shift, height_and_rest, least_squares, step
from .errors import DistanceContradiction, MissingFitting, ScaleContradiction
from .outline import Outline, bow, correlated_points, find_outline
from .photograph import Photograph
from .recipe import Recipe
from .segment import Segmentation

_LEAST_SEEN = 0.6  # of the lit part of an edge: less than this cannot stand for all of it
_BEYOND = 5.0, 2.5  # px, and times the blur: how far behind an edge its tape is looked at
_ROWS = 6
_ANOTHER = 0.4  # of the way in colour from tape to braid
_NOISE = 0.04  # of chromaticity, which a grey tape on a white braid differs by no more
_SMOOTHED = 1 / 32  # of the tape's width
_BRIGHTEST = 1.6
_BRIGHTER = 1.15  # luma of the braid over the tape's, for an edge in it
_OF_COLOUR = 1.6  # px^2
_IN_COLOUR = 0.25  # px by which an edge that colour alone shows may be off


_WIDTH = 0.85  # part of the diameter that is used: at the limb a ring lies along the ray
_GROUPS = 16
_BLURS = (0.4, 30.0)
_PASSES = 4
_PIECES = 64
_CLEAR_LEAN = 0.08  # that the coarse edge shows, more than a tape wound by hand has
_STRAIGHT = 1.5  # px between the ends of an edge, of which groups of 16 make nothing
_LEVEL_FRONT = 0.3  # px by which the front of an edge that does not lean may lie beside its middle
_RAGGED = 0.6  # px, the scatter from which an edge's blur is that of its pieces
_LEVEL = 0.2  # of the pieces, those whose neighbours lie most nearly beside them
_DEEPEST, _SAME = 10.0, 0.02  # px of a tooth; part of the blur
_SETTLED = 0.1  # px, which the groups' own shifts take in
_DARK_THREAD = 0.22  # of the braid's brightness
# Px inward of an edge, over which threads that dip below a tape come up to their light:
_BEHIND = 7.0
_LEAST_HEIGHT = 0.2  # of the difference between braid and tape
_GUARD = 5  # px at a tape's ends that are left out
_FEWEST_ROWS = 12
_CONTRADICTS = (
    0.005  # of the tapes' diameter; a ruler 7.6 mm off the muscle's plane makes that at 60 in
)
_SOFTER = 1.25  # times the outline's blur, from which a tape's edge is looked at in luma as well


class Ring(NamedTuple):
    """The inner edge of one tape.

    Attributes:
        y: position along the axis, as in `Silhouette` [m].
        stderr: its random standard error [m].
        spread: standard deviation of the edge along the tape [px].
        blur: Gaussian blur of the edge along the axis [px], less what colour adds to it beyond luma
            where it is softer than the outline.
        arc: points u, v of the edge in the picture [px], shape (2, n).
        lateral: positions across the axis over the radius [-], -1 to 1, shape (k,).
        shift: how far the edge lies there beyond y along the axis [m], shape (k,).
    """

    y: float
    stderr: float
    spread: float
    blur: float
    arc: Array
    lateral: Array
    shift: Array


def on_cylinder(
    camera: Camera, body: Silhouette, y: Array, lateral: Array, radius: float,
    plane: tuple[float, float] = (0.0, 0.0),
) -> tuple[Array, Array]:  # fmt: skip
    """Picture positions of a cylinder around the axis [px], shape (lateral, y).

    In a plane that is not square to the axis, y is that of its middle.
    """
    rim = np.maximum(radius**2 - lateral**2, 0.0)  # the rim itself rounds below
    down = y + (_plane_model(lateral, radius)[:, 1:] @ plane)[:, None]
    X, Y = turned((body.x0 + lateral)[:, None] + np.zeros_like(down), down, body.roll)
    return camera.pixels(X, Y, camera.distance - np.sqrt(rim)[:, None])


class _Front:
    """The picture around a tape's edge, unrolled about the body's axis, in the light of braid.

    Args:
        photo: the picture.
        tone: the camera's tone curve.
        coarse: the tapes to within some pixels, and the colours.
        body: whose radius the tape's edge has.
        blur: about that of the edge [px].
        lower: the tape is at the lower end.

    Attributes:
        y: position of the edge along the axis to within some pixels [m].
        plane: in which the edge lies: slope across the axis, and towards the camera.
    """

    def __init__(
        self, photo: Photograph, tone: Tone, coarse: Segmentation, body: Silhouette, blur: float,
        *, lower: bool,
    ) -> None:  # fmt: skip
        self.photo, self.tone, self.body = photo, tone, body
        self.tape, self.braid = map(tone.light, (coarse.tape, coarse.braid))
        camera, self.plane = photo.camera, (0.0, 0.0)
        self.step = (-1 if lower else 1) / camera.px_per_m  # inward [m]
        band = coarse.lower if lower else coarse.upper
        u, radius = band.middle, float(body.radius[-1 if lower else 0])
        v = float(np.polyval(band.inner, u))
        self.y = float(ring_position(camera, u, v, radius, body.x0, body.roll))
        # The arc in the picture is that of perspective, y / d, and of a lean.
        lean = -2 * float(band.inner[0]) * radius * camera.px_per_m - self.y / camera.distance
        self.lean = lean if abs(lean) > _CLEAR_LEAN else 0.0
        radius, reach = float(body.radius_at(self.y)), 2 * len(_window(blur)) * self.step
        self.n = max(4 * _GROUPS, int(2 * _WIDTH * radius * camera.px_per_m))
        edges = on_cylinder(
            camera, body, self.y + np.array([-reach, reach]), np.arange(-1.0, 2.0) * radius, radius
        )
        self.columns, self.rows = (
            slice(max(int(np.floor(x.min())) - 3, 0), int(np.ceil(x.max())) + 4) for x in edges
        )
        self.patch = np.ascontiguousarray(photo.rgb[self.rows, self.columns])
        # Luma less the tape's part in it: tape shows none, nor does a thick tape's dark rim.
        own = LUMA - self.tape * (self.tape @ LUMA) / (self.tape @ self.tape)
        form = np.array([[*(own / (own @ self.braid)), 0.0]])
        self.amounts = self.spline(cv2.transform(cv2.LUT(self.patch, tone.table), form))

    def spline(self, amounts: ArrayLike) -> Callable[[Array, Array], Array]:
        """The amount at picture positions u, v; beyond the patch that of its border."""
        amounts = np.asarray(amounts, float)
        most = _BRIGHTEST * max(1.0, float(np.quantile(amounts, 0.9)))  # of the brighter side's
        clipped = np.clip(amounts, -_BRIGHTEST, most)
        spline = spline_filter(clipped, 3, mode="mirror")
        u0, v0 = self.columns.start, self.rows.start
        return lambda u, v: map_coordinates(
            spline, [v - v0, u - u0], order=3, mode="mirror", prefilter=False
        )

    def around(self, y: float, t: Array) -> tuple[Array, Array, Array]:
        """Lateral positions [m], and u and v at distances t inward of an edge [px]."""
        radius = float(self.body.radius_at(y))
        lateral = np.linspace(-_WIDTH, _WIDTH, self.n) * radius
        at = y + t * self.step
        return lateral, *on_cylinder(self.photo.camera, self.body, at, lateral, radius, self.plane)

    def tape_at(self, y: float, t: Array) -> Flags:
        """Along the edge, where the tape's colour shows at distances t inward of it [px], shape (n,).

        Chromaticity c = (R, G, B) / (R + G + B) in linear light is independent of shading. What is further
        from the tape's than 0.4 of the way to the braid's is another thing, or gloss. A tape that has the
        braid's colour, lighter or darker, cannot be distinguished from what covers it.
        """
        rgb, (_, u, v) = self.photo.rgb, self.around(y, t)
        rows, columns = (
            np.clip(np.rint(at).astype(np.intp), 0, most - 1)
            for at, most in zip((v, u), rgb.shape, strict=False)
        )
        light = self.tone.table[rgb[rows, columns]].sum(axis=1)
        width = max(1, round(_SMOOTHED * light.shape[0]))
        light = np.stack([np.convolve(one, np.ones(width), "same") for one in light.T], axis=1)
        seen, tape, braid = (
            each / np.maximum(each.sum(axis=-1, keepdims=True), 1e-9)
            for each in (light, self.tape, self.braid)
        )
        off = np.linalg.norm(seen - tape, axis=-1)
        return off < max(_ANOTHER * float(np.linalg.norm(braid - tape)), _NOISE)

    def uncovered(self, y: float, s: float) -> Flags:
        """Where the tape shows behind the edge."""
        return self.tape_at(y, -np.arange(_ROWS, dtype=float) - max(_BEYOND[0], _BEYOND[1] * s))

    def unrolled(
        self, y: float, t: Array, shows: Flags, teeth: float = 0.0
    ) -> tuple[Array, Array, float]:
        """Amounts, lateral positions [m], and the part of the lit edge at which the tape shows."""
        lateral, u, v = self.around(y, t)
        grid = self.amounts(u, v)
        bright = _lit(grid, t - teeth)
        shown = bright & shows
        seen = np.count_nonzero(shown) / np.count_nonzero(bright)
        use = shown if seen >= _LEAST_SEEN else bright
        return grid[use], lateral[use], seen


def find_ring(
    photo: Photograph, tone: Tone, coarse: Segmentation, body: Silhouette, blur: float, *, lower:
    bool,
) -> Ring:  # fmt: skip
    """The inner edge of a tape, from the picture unrolled around it.

    The picture is sampled at the points (x0 + X, y + h, d - sqrt(R^2 - X^2)) of the cylinder, so
    that a ring becomes a straight line, also where the tape was put on slanting or leaning towards
    the camera, in the linear light that the braid has and the tape and its dark rim have not. Groups
    of neighbouring X are averaged and each gives the position of a blurred step; the mean is the
    ring's, their scatter its error. Where the muscle swells right behind the tape, it matters where on
    the slope the ring lies.

    Args:
        photo: the picture.
        tone: the camera's tone curve.
        coarse: the tapes to within some pixels, and the colours.
        body: whose radius the ring has.
        blur: of the outline [px], where the search for the edge's own blur starts.
        lower: the tape is at the lower end.

    Raises:
        MissingFitting: no edge there, or too much of it is covered.
    """
    front, px = _Front(photo, tone, coarse, body, blur, lower=lower), 1 / photo.camera.px_per_m
    y, left = front.y, 2 * _PASSES
    while True:
        t, s, slope = _window(blur), blur, 0.0
        shows = front.uncovered(y, s)
        grid, lateral, seen = front.unrolled(y, t, shows)
        for _ in range(_PASSES):
            try:
                shift, s, slope = _clear_step(grid.mean(axis=0), t, s, seen)
            except MissingFitting:
                if front.lean == 0 or seen < _LEAST_SEEN:
                    raise
                y -= front.lean * float(body.radius_at(y))
                front.plane, front.lean, shift = (0.0, front.lean), 0.0, math.inf
            if abs(shift) < _SETTLED:
                break
            y += shift * front.step if math.isfinite(shift) else 0.0
            t = _window(s)
            if not shows.all():  # else the tape shows everywhere, here as some pixels beside
                shows = front.uncovered(y, s)
            grid, lateral, seen = front.unrolled(y, t, shows)
        radius = float(body.radius_at(y))
        delta, where = _along(grid, lateral / px, t, s, slope)
        (_, across, lean), (*_, error) = plane_through(where, delta, radius / px)
        bent = float(np.ptp(_plane_model(where, radius / px)[:, 1:] @ (across, lean)))
        # A lean that the groups show by three standard errors takes the edge to where the muscle is
        # wider or narrower, which makes it another lean.
        level = abs(lean) < max(3 * error, _LEVEL_FRONT * px / radius)
        left -= 1
        if left == 0 or (level and bent < _STRAIGHT):
            break
        inward = front.step / px
        front.plane = front.plane[0] + inward * across, front.plane[1] + inward * lean
    beside, beyond = (front.tape_at(y, at + np.arange(6.0)) for at in (2.0, 14.0))
    # Tape beside the edge that was found, and braid beyond: the edge is that of what covers another part.
    _check_seen(min(seen, 1 - float(np.mean(beside & ~beyond))))
    delta, where = _along(grid, lateral, t, s, slope)
    (offset, left_over), teeth = _line(where / px, delta), 0.0
    if _scatter(left_over) > _RAGGED:
        t, shows, teeth = _window(_DEEPEST / 3), front.uncovered(y, _DEEPEST / 2), _DEEPEST
        grid, lateral, _ = front.unrolled(y, t, shows, teeth)
        s, delta, where = _pieces(grid, lateral, t, s)
        offset, left_over = _line(where / px, delta)
    seen_in_luma = coarse.braid @ LUMA > _BRIGHTER * (coarse.tape @ LUMA)
    if s > _SOFTER * max(blur, 1.0):
        s = _less_colour(front, y, shows, t, s, teeth) if seen_in_luma else _lens_alone(s)
    spread, radius = _scatter(left_over), float(body.radius_at(y))
    at = np.array([y + offset * front.step])
    u, v = on_cylinder(photo.camera, body, at, lateral, radius, front.plane)
    beyond = delta * front.step + _plane_model(where, radius)[:, 1:] @ front.plane
    place, _ = _line(where, beyond)
    return Ring(
        y=y + place,
        # Groups in the width of one thread are moved together.
        stderr=px
        * math.hypot(
            spread * math.sqrt(correlated_points(left_over) / left_over.size),
            # The light behind the edge, of which a line is the simplest law:
            slope * (_inside(s) - 1),
            0.0 if seen_in_luma else _IN_COLOUR,
        ),
        spread=spread,
        blur=s,
        arc=np.stack([u[:, 0], v[:, 0]]),
        lateral=where / radius,
        shift=beyond - place,
    )


def _less_colour(front: _Front, y: float, shows: Flags, t: Array, s: float, teeth: float) -> float:
    """Blur of an edge less what colour adds to it [px], from its blur and that in luma.

    Colour is softer than luma: a camera's mosaic has it in every second pixel, and most JPEG files
    once more, each joined by straight lines (2/3 px^2 of variance), JPEG's a mean over two pixels
    (1/4 px^2). More than that is the lens', or motion.
    """
    lateral, u, v = front.around(y, t)
    luma = np.asarray(cv2.cvtColor(front.patch, cv2.COLOR_RGB2GRAY), np.uint8)
    amounts = amount_of_look(front.tone, front.tape, front.braid, LUMA)  # outlines are found in it
    grid = front.spline(amounts[luma])(u, v)
    use, in_luma = _lit(grid, t - teeth) & shows, s
    if np.count_nonzero(use) >= max(_PIECES, _LEAST_SEEN * use.size):
        ragged = teeth and _pieces(grid[use], lateral[use], t, s)[0]
        in_luma = ragged or _step(grid[use].mean(axis=0), t, s, sloped=False)[1]
    return min(s, max(in_luma, _lens_alone(s)))


def _lens_alone(s: float) -> float:
    return math.sqrt(max(s**2 - _OF_COLOUR, 0.0))


def _lit(grid: Array, t: Array) -> Flags:
    """Lateral positions where the braid behind the edge is lit; a black thread shows no edge."""
    height = grid[:, (t > 1) & (t < 6)].mean(axis=1)
    return height > _DARK_THREAD * np.sort(height)[int(0.7 * height.size)]


def _along(grid: Array, lateral: Array, t: Array, s: float, slope: float) -> tuple[Array, Array]:
    """Shifts of those groups of neighbours along the edge [px] that agree, and where they lie."""
    groups, where = _means(grid, lateral, _GROUPS)
    inside = _inside(s)
    near = (t >= -max(8.0, 3 * s)) & (t <= (inside if slope else max(8.0, 3 * s)))
    groups = (groups - slope * _relief(t, inside))[:, near]
    delta = best_shift(groups, t[near], lambda x: step(x, s), max(3.0, 1.5 * s), 0.1)
    keep = _near_most(delta)
    return delta[keep], where[keep]


def _means(grid: Array, lateral: Array, parts: int) -> tuple[Array, Array]:
    """Means of neighbours along the edge, shape (parts, k), and of where they lie."""
    means = [part.mean(axis=0) for part in np.array_split(grid, parts)]
    return np.stack(means), np.array([part.mean() for part in np.array_split(lateral, parts)])


def plane_through(lateral: Array, shift: Array, radius: float) -> tuple[list[float], list[float]]:
    """Position, slope and lean of the plane that fits an edge best, and their standard errors.

    Args:
        lateral: positions across the axis, shape (n,).
        shift: of the edge along the axis there, shape (n,).
        radius: of the cylinder, in the same unit.
    """
    model = _plane_model(lateral, radius)
    inverse = np.linalg.pinv(model)
    found = inverse @ shift
    off = shift - model @ found
    # Groups in the width of one thread are moved together.
    variance = float(off @ off) / max(off.size - model.shape[1], 1) * correlated_points(off)
    stderr = np.sqrt(np.sum(inverse**2, axis=1) * variance)
    return found.tolist(), stderr.tolist()


def _plane_model(lateral: Array, radius: float) -> Array:
    """What the edge in a plane through a cylinder is made of: place, slope across, lean; shape (n, 3)."""
    front = np.sqrt(np.maximum(radius**2 - lateral**2, 0.0))
    return np.column_stack([np.ones_like(lateral), lateral, front])


def _line(x: Array, y: Array) -> tuple[float, Array]:
    """A straight line's value at 0, and what it leaves over."""
    slope, offset = np.polyfit(x, y, 1)
    return float(offset), y - slope * x - offset


def _scatter(left_over: Array) -> float:
    """Standard deviation about a line."""
    return math.sqrt(float(left_over @ left_over) / max(left_over.size - 2, 1))


def _pieces(grid: Array, lateral: Array, t: Array, s: float) -> tuple[float, Array, Array]:
    """Blur of a ragged edge [px], and shifts of small pieces as `_along` gives them of groups.

    The blur is that of the level pieces, each put in its place: a lens smears the flanks of teeth
    more than that, and motion smears all.
    """
    pieces, where = _means(grid, lateral, _PIECES)
    reach, own, delta = _DEEPEST, s, np.zeros(_PIECES)
    keep = np.ones(_PIECES, bool)
    for _ in range(_PASSES):
        delta = best_shift(pieces, t, lambda x, blur=s: step(x, blur), reach, 0.1)
        steep = np.abs(np.gradient(delta))
        keep = (np.abs(delta) < reach - 1) & _near_most(delta)
        level = keep & (steep <= np.quantile(steep, _LEVEL))
        aligned = [np.interp(t + d, t, piece) for d, piece in zip(delta, pieces, strict=True)]
        near = np.abs(t) <= _DEEPEST
        own = _clear_step(np.mean(np.array(aligned)[level], axis=0)[near], t[near], s)[1]
        if abs(own / s - 1) < _SAME:
            break
        s = own
    return own, delta[keep], where[keep]


def _near_most(delta: Array) -> Flags:
    """Which shifts are within four standard deviations of the median, by the median deviation."""
    off = np.abs(delta - np.median(delta))
    return off <= 4 * max(1.4826 * float(np.median(off)), 0.05)


def _window(blur: float) -> Array:
    half = round(max(12.0, 5 * blur))
    return np.arange(-half, half + 1.0)


def _clear_step(
    profile: Array, t: Array, start: float, seen: float = 1.0
) -> tuple[float, float, float]:
    """Shift, blur and slope of the step in the mean profile of an edge [px].

    Raises:
        MissingFitting: none, or one that is too faint.
    """
    shift, blur, height, slope = _step(profile, t, start)
    if height > _LEAST_HEIGHT and abs(shift) < t[-1]:
        return shift, blur, slope
    _check_seen(seen)
    raise MissingFitting(
        "a tape must end in a visible edge at the braid: if the braid is glossy or darker than its tapes, "
        "apply chalk and light it from all sides",
        step_height=height,
    )


def _check_seen(seen: float) -> None:
    if seen < _LEAST_SEEN:
        raise MissingFitting(
            f"at least {_LEAST_SEEN:.0%} of a tape's edge must be visible: remove anything that covers "
            "it, and reflections on tape or braid",
            seen=seen,
        )


def _inside(s: float) -> float:
    """How far inward of an edge of this blur its light is looked at [px]."""
    return max(_BEHIND, 6 * s)


def _relief(x: Array, inside: float) -> Array:
    """The rise of the threads' light from the edge of a tape, in whose shade they dip below it [px]."""
    return np.clip(x, 0, inside - 1)


def _step(
    profile: Array, t: Array, start: float, *, sloped: bool = True
) -> tuple[float, float, float, float]:
    """Shift, blur and height of the step with a slope behind it that fits a profile best, and the slope."""
    inside = _inside(start)

    def blur_of(unknown: Array) -> Array:
        return np.minimum(np.maximum(np.exp(unknown[..., 1:]), _BLURS[0]), _BLURS[1])

    def plain(unknown: Array) -> tuple[Array, Array]:
        return height_and_rest(profile, step(t - unknown[..., :1], blur_of(unknown)))

    def fitted(unknown: Array) -> tuple[Array, Array]:
        # Of two regressors the one's factor is that of what the other leaves of it and of the samples.
        x = t[near] - unknown[..., :1]
        relief = _relief(x, inside)
        return height_and_rest(
            height_and_rest(np.broadcast_to(profile[near], x.shape), relief)[1],
            height_and_rest(step(x, blur_of(unknown)), relief)[1],
        )

    steepest = float(t[np.argmax(np.convolve(np.gradient(profile), np.ones(3), "same"))])
    near = t <= inside
    best = least_squares(
        lambda unknown: plain(unknown)[1], np.array([steepest, np.log(start)]), 1e-5
    )
    height, slope = float(plain(best)[0][0]), 0.0
    if sloped:
        risen = least_squares(lambda unknown: fitted(unknown)[1], best, 1e-5)
        high, x = float(fitted(risen)[0][0]), t[near] - risen[0]
        left = profile[near] - high * step(x, blur_of(risen))
        rise = float(height_and_rest(left, _relief(x, inside))[0][0])
        if rise > 0:  # light that falls inward is no relief's
            best, height, slope = risen, high, rise
    return float(best[0]), float(blur_of(best)[0]), height, slope


def check_tape_diameter(
    photo: Photograph, coarse: Segmentation, body: Silhouette, recipe: Recipe, known: float
) -> None:
    """Check the scale against the known diameter of the tapes.

    A tape is a cylinder about the muscle's axis: R = rho sin(beta), where beta is half the angle between
    its two tangent planes, by the limb model.

    Raises:
        ScaleContradiction: the mean diameter differs from the known one by more than 0.5 %, or a tape
            shows too few rows.
    """
    camera, tone = photo.camera, recipe.tone_curve
    # Luma hardly sees blue: the colour in which the tape is brightest does.
    colour = int(np.argmax(coarse.tape))
    dark, bright = tone.light(np.array([coarse.cloth[colour], coarse.tape[colour]]))
    amount = ((tone.table - dark) / (bright - dark)).astype(np.float32)
    angles = []
    for tape, first, last in (
        (coarse.upper, coarse.upper.box[0], min(coarse.upper.limbs)),
        (coarse.lower, max(coarse.lower.limbs), coarse.lower.box[1]),
    ):
        rows = np.arange(int(first) + _GUARD, int(last) - _GUARD)
        if rows.size < _FEWEST_ROWS:
            raise ScaleContradiction(
                f"a tape must show at least {_FEWEST_ROWS} rows to check the scale: use a wider "
                "tape, or omit the tape diameter",
                rows=rows.size,
            )
        y = (rows - camera.centre[1]) / camera.px_per_m
        X, Y = turned(np.full(rows.size, body.x0), y, body.roll)
        middle, half = camera.pixels(X, Y, camera.distance)[0], (tape.box[3] - tape.box[2]) / 2
        outline = find_outline(
            photo.rgb[..., colour], amount, rows, middle - half, middle + half,
            resolution=2.0 * rows.size,
        )  # fmt: skip
        left, right = np.arctan(turned(*camera.rays(outline.columns, rows), -body.roll)[0])
        angles.append(float(np.median(right - left)) / 2)
    mean = 2 * float(np.hypot(body.x0, camera.distance)) * float(np.mean(np.sin(angles)))
    if abs(mean / known - 1) > _CONTRADICTS:
        raise ScaleContradiction(
            "the measured tape diameter must equal the known one; their ratio is "
            f"{mean / known:.4f}: check that the ruler was in the plane of the muscle's axis, and the "
            "stated distance",
            diameter=mean, known_diameter=known, px_per_m=camera.px_per_m,
            limit=_CONTRADICTS,
        )  # fmt: skip


_INCH = 0.0254  # [m]
_SURE = 4.0  # standard errors at which tapes say another distance than the stated one
_SEEN = 4.0  # the same of a tilt
_LEANS = 3.25  # the same of both tapes' leans together
_MAY_LEAN = 2.5  # the same where they may lean, which is in the length's error
_OF_RADIUS = 3.5  # of y / d: what a radius off by 1 does to the middle of an edge's arc
_WOUND = 0.02  # rad, the lean of a tape wound by hand: 2 or 3 deg are seen
_LEAST = 0.01  # lean below which a tape is square, as far as hands wind it
_MOST = 0.12  # lean of both tapes against each other that no winding by hand explains, 7 deg
_UPRIGHT = 0.0015  # rad, 0.1 deg: how well an axis is set upright in depth
_ASIDE = 0.6  # of the bow in the picture: the bow in depth that goes with it
_WAVE = 2 / math.pi  # mean of half a sine wave


class Depth(NamedTuple):
    """The axis in depth, from the arcs of both tapes' edges.

    The front of a tape's edge lies lower than its middle by p_i = tilt + y_i (1/d - 1/d0) over the
    radius, seen by a camera at d and unrolled for one at d0.

    Attributes:
        lean: p of the upper and the lower ring, shape (2,) [-].
        lean_stderr: its standard error.
        middle: how far the rings' middles lie beyond `Ring.y` along the axis, shape (2,) [m].
        middle_stderr: its standard error.
        tilt: of the axis, its lower end away from the camera [rad].
        tilt_stderr: its standard error [rad].
        nearer: 1/d - 1/d0 [1/m].
        nearer_stderr: its standard error [1/m].
        against: lean of both tapes against each other that this is, p of one end [-].
    """

    lean: Array
    lean_stderr: Array
    middle: Array
    middle_stderr: Array
    tilt: float
    tilt_stderr: float
    nearer: float
    nearer_stderr: float
    against: float


class Axis(NamedTuple):
    """Result for the axis.

    Attributes:
        distance: of the camera [m].
        distance_stderr: its standard error, 0 where it was stated [m]; that of tapes wound by hand.
        tilt, tilt_stderr: see `Depth` [rad].
        bow: largest deviation of the mid-line from a straight one [m].
        ends: how far the middles of the upper and the lower ring lie beyond `Ring.y` [m].
        length_factor: of the length between the rings' middles.
        length_stderr: what the axis adds to the length's standard error [m].
        cosine: of the axis' angle in the picture in every row, shape (n,).
        diameter_stderr: what the axis adds to the diameter's standard error, relative.
        warnings: what the user has to know.
    """

    distance: float
    distance_stderr: float
    tilt: float
    tilt_stderr: float
    bow: float
    ends: tuple[float, float]
    length_factor: float
    length_stderr: float
    cosine: Array
    diameter_stderr: float
    warnings: tuple[str, ...]


def depth_of_axis(body: Silhouette, upper: Ring, lower: Ring) -> Depth:
    """Tilt and distance from the leans of both tapes' edges.

    Unrolled about an upright cylinder at the camera's distance, a ring square to it is straight.
    The front of one that leans lies lower by p sqrt(R^2 - X^2) at X across the axis, as does that
    of a square one around a tilted axis, or seen from another distance.
    """
    radii = [float(body.radius_at(ring.y)) for ring in (upper, lower)]
    fits = [
        plane_through(radius * ring.lateral, ring.shift, radius)
        for radius, ring in zip(radii, (upper, lower), strict=True)
    ]
    (middle, _, lean), (middle_stderr, _, stderr) = np.transpose(fits, (1, 2, 0))
    span = lower.y - upper.y
    nearer, nearer_stderr = float(np.diff(lean)[0]) / span, math.hypot(*stderr) / span
    weight = stderr**-2.0
    weight /= weight.sum()
    tilt = float(weight @ lean)
    if abs(nearer) > _SEEN * nearer_stderr:
        tilt = float(lean[0]) - upper.y * nearer
    tilt_stderr = float((weight**2 @ stderr**2) ** 0.5)
    return Depth(lean, stderr, middle, middle_stderr, tilt, tilt_stderr, nearer, nearer_stderr,
                 nearer * span / 2)  # fmt: skip


def axis_of(
    camera: Camera, outline: Outline, body: Silhouette, upper: Ring, lower: Ring, *, stated: bool
) -> Axis:
    """Effect of tilt, distance and bow on length and diameter.

    A bow in the picture is undone: the length is that along the axis. A tilt that is seen is undone
    by half, with the other half as standard error, since two tapes that lean alike look the same; one
    that is not seen adds to the error, by what it may be. A tape whose edge leans in depth, for
    whatever reason, lies where the middle of its ring does, which is as high as the limb, at any
    lean and distance; its front lies p R lower. Where the tapes show no lean, by 3.25 standard errors
    of both together, they are taken to be square: a front's place is found three times as well. From 2.5
    on, what the middles say otherwise is in the error, up to what hands wind.

    Args:
        camera: the camera.
        outline: the outline.
        body: the body of revolution behind it.
        upper: the upper tape's edge.
        lower: the lower one's.
        stated: the distance was stated; else it is the tapes' own and has their error.

    Raises:
        DistanceContradiction: both tapes lean against each other too much for tapes.
    """
    depth = depth_of_axis(body, upper, lower)
    length, d = lower.y - upper.y, camera.distance
    warnings, parts, wide = [], [], 0.0
    nearer_stderr = math.hypot(depth.nearer_stderr, math.sqrt(2) * _WOUND / length)
    radius = float(np.mean(body.radius))
    ends, y = np.zeros(2), np.array([upper.y, lower.y])
    shown = math.hypot(*(depth.lean / depth.lean_stderr))
    if stated and _MAY_LEAN < shown <= _LEANS:
        wound = _LEAST * math.hypot(*body.radius_at(y))
        parts.append(min(abs(float(np.diff(depth.middle)[0])), wound))
    if shown > _LEANS:
        wider = body.radius_at(y + depth.middle) - body.radius_at(y)
        parts += (_OF_RADIUS * y / d * wider).tolist()
        if stated:
            ends = depth.middle
            parts += depth.middle_stderr.tolist()
    if not stated:
        front = float(np.mean(np.sqrt(np.maximum(1 - upper.lateral**2, 0))))  # over the radius
        front *= float(body.radius_at(y).mean())
        parts.append(front * math.hypot(*depth.lean_stderr, depth.lean[1] - depth.lean[0]))
        wide = (body.x0**2 + radius**2) / d * nearer_stderr
    elif abs(depth.nearer) > _SURE * depth.nearer_stderr and abs(depth.against) > _LEAST:
        parts.append(depth.against**2 * length / 4)  # of a bow in depth that leans the tapes so
        wide = abs(depth.against) * length / math.pi * _WAVE / d
        seen = f"{1 / max(1 / d + depth.nearer, _FARTHEST) / _INCH:.0f} in"
        text = (
            f"{_ARCS}; they indicate {seen}, but {d / _INCH:.0f} in is stated: correct --distance"
        )
        if abs(depth.against) > _MOST:
            raise DistanceContradiction(f"{text}, or omit it", stated=d, lean=depth.against)
        warnings.append(f"{text}; the errors were increased")
    tilt, aside = depth.tilt, (upper.y + lower.y) / 2 / d
    turned = 1 / (math.cos(tilt) - math.sin(tilt) * aside) - 1  # what it takes off the length
    factor = 1.0
    if abs(tilt) > max(_SEEN * depth.tilt_stderr, _LEAST):
        factor = 1 + turned / 2
        parts += [length * abs(turned) / 2, length * (abs(tilt) + abs(aside)) * depth.tilt_stderr]
        warnings.append(
            f"the axis, or both tapes, lean in depth by {math.degrees(tilt):.1f} "
            f"+- {math.degrees(depth.tilt_stderr):.1f} deg, which changes the length by {abs(turned):.2%}: "
            "half is corrected and half included in the error; set the axis upright and the tapes square"
        )
    else:
        unseen = math.sqrt(max(_UPRIGHT**2, tilt**2 - depth.tilt_stderr**2))
        parts.append(length * (unseen**2 / 2 + abs(aside) * unseen))
    off, at = _mid_line(camera, outline)
    deviation, slope = float(np.abs(off).max()) / camera.px_per_m, np.gradient(off, at)
    longer = float(np.mean(slope**2)) / 2
    parts.append(length * longer * _ASIDE)
    return Axis(
        distance=d, distance_stderr=0.0 if stated else d**2 * nearer_stderr, tilt=tilt,
        tilt_stderr=depth.tilt_stderr, bow=deviation, ends=(float(ends[0]), float(ends[1])),
        length_factor=factor * (1 + longer), length_stderr=math.hypot(*parts),
        cosine=1 / np.hypot(1, slope),
        diameter_stderr=math.hypot(wide, _ASIDE * deviation * _WAVE / d), warnings=tuple(warnings),
    )  # fmt: skip


def distance_by_tapes(
    body: Silhouette, upper: Ring, lower: Ring, assumed: float, *, found: bool = False
) -> float:
    """The camera's distance [m] from the tapes' arcs; the assumed one if they agree with it.

    Args:
        body: the body of revolution, seen from the assumed distance.
        upper: the upper tape's edge.
        lower: the lower one's.
        assumed: distance [m].
        found: the assumed one is of the arcs themselves, and is only made better.

    Raises:
        DistanceContradiction: the arcs are those of no camera.
    """
    depth = depth_of_axis(body, upper, lower)
    if not found and abs(depth.nearer) < 2 * depth.nearer_stderr:
        return assumed
    inverse = 1 / assumed + depth.nearer
    if not _NEAREST > inverse > _FARTHEST:
        raise DistanceContradiction(f"{_ARCS}; or state --distance", lean=depth.against)
    return 1 / inverse


_NEAREST, _FARTHEST = 1 / 0.15, 1 / 15.0  # of cameras [1/m]
_ARCS = (
    "the tape edges must appear as arcs of square rings: wind the tapes square to the axis, and hang the "
    "muscle straight"
)


def ends_aside(camera: Camera, outline: Outline) -> tuple[float, float]:
    """How far a bowed axis lies to the right of the straight one at its upper and lower end [m]."""
    off, y = _mid_line(camera, outline)
    line = np.polynomial.Polynomial.fit(y, off, 1)(y)
    first, last = ((off - line)[[0, -1]] / camera.px_per_m).tolist()
    return first, last


def _mid_line(camera: Camera, outline: Outline) -> tuple[Array, Array]:
    """`bow` of the outline without the lens' distortion, and rows [px]."""
    u, v = camera.rays(outline.columns, np.stack([outline.rows, outline.rows]))
    return bow(*(u * camera.focal_px)), v[0] * camera.focal_px
