"""Locate the inner edges of the tapes at the muscle's ends, and the position of the axis in depth."""

import math
from typing import NamedTuple

import cv2
import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from .camera import LUMA, Array, Camera, Flags, Silhouette, Tone, ring_position, turned
from .edge import best_shift, height_and_rest, least_squares, step
from .errors import DistanceContradiction, MissingFitting, ScaleContradiction
from .outline import Outline, bow, correlated_points, find_outline
from .photograph import Photograph
from .recipe import Recipe
from .segment import Segmentation

_LEAST_SEEN = 0.6  # smallest visible fraction of the lit part of an edge
_BEYOND = 5.0, 2.5  # distance behind an edge at which its tape is sampled: [px], and times the blur
_ROWS = 6
_ANOTHER = 0.4  # of the difference in colour between tape and braid
_NOISE = 0.04  # of chromaticity; a grey tape on a white braid differs by no more than this
_SMOOTHED = 1 / 32  # of the tape's width
_BRIGHTEST = 1.6
_BRIGHTER = 1.15  # ratio of the luma of braid and tape above which the edge is visible in luma
_OF_COLOUR = 1.6  # px^2
_IN_COLOUR = 0.25  # error of an edge that only colour shows [px]


_WIDTH = 0.85  # fraction of the diameter that is used; at the limb a ring is parallel to the ray
_GROUPS = 16
_BLURS = (0.4, 30.0)
_PASSES = 4
_CLEAR_LEAN = 0.08  # lean of the coarse edge that exceeds that of a tape wound by hand
_STRAIGHT = 1.5  # largest distance between the ends of an edge that is averaged in groups [px]
_LEVEL_FRONT = 0.3  # largest shift of the front of an edge that does not lean [px]
_SETTLED = 0.1  # px; the shifts of the groups absorb the rest
_DARK_THREAD = 0.22  # of the braid's brightness
_BEHIND = 7.0  # px inward of an edge over which threads emerge from the shade of the tape
_LEAST_HEIGHT = 0.2  # of the difference between braid and tape
_GUARD = 5  # px omitted at the ends of a tape
_FEWEST_ROWS = 12
_CONTRADICTS = (
    0.005  # of the tapes' diameter, as from a ruler 7.6 mm off the muscle's plane at 60 in
)
_SOFTER = 1.25  # times the outline's blur; a softer edge is corrected for the blur of colour


class Ring(NamedTuple):
    """The inner edge of one tape.

    Attributes:
        y: position along the axis, as in `Silhouette` [m].
        stderr: random standard error of y [m].
        spread: standard deviation of the edge about a straight line along the tape [px].
        blur: Gaussian blur of the edge along the axis [px]. If the edge is softer than the outline, the
            additional blur of the colour channels compared with luma is subtracted.
        arc: points u, v of the edge in the picture [px], shape (2, n).
        lateral: positions across the axis relative to the radius [-], -1 to 1, shape (k,).
        shift: position of the edge along the axis relative to y, at `lateral` [m], shape (k,).
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
    """Return the image coordinates [px] of points on a cylinder around the axis, shape (lateral, y).

    If the plane of the edge is not perpendicular to the axis, y is the position of the edge's middle.
    """
    rim = np.maximum(radius**2 - lateral**2, 0.0)  # rounding can make it negative at the rim
    down = y + (_plane_model(lateral, radius)[:, 1:] @ plane)[:, None]
    X, Y = turned((body.x0 + lateral)[:, None] + np.zeros_like(down), down, body.roll)
    return camera.pixels(X, Y, camera.distance - np.sqrt(rim)[:, None])


class _Front:
    """The picture around a tape's edge, unrolled about the body's axis and expressed as amounts of braid.

    Args:
        photo: picture.
        tone: tone curve of the camera.
        coarse: approximate tapes, and the colours.
        body: body of revolution, whose radius at the edge is used.
        blur: approximate blur of the edge [px].
        lower: True for the tape at the lower end.

    Attributes:
        y: approximate position of the edge along the axis [m].
        plane: plane of the edge: slope across the axis, and slope towards the camera.
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
        # The arc in the picture is due to perspective, y / d, and to a lean.
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
        patch = np.ascontiguousarray(photo.rgb[self.rows, self.columns])
        # Luma without the colour of the tape is zero on the tape and on the dark rim of a thick tape.
        own = LUMA - self.tape * (self.tape @ LUMA) / (self.tape @ self.tape)
        form = np.array([[*(own / (own @ self.braid)), 0.0]])
        amounts = np.asarray(cv2.transform(cv2.LUT(patch, tone.table), form), float)
        most = _BRIGHTEST * max(1.0, float(np.quantile(amounts, 0.9)))  # of the brighter side
        self.spline = spline_filter(np.clip(amounts, -_BRIGHTEST, most), 3, mode="mirror")

    def around(self, y: float, t: Array) -> tuple[Array, Array, Array]:
        """Return lateral positions [m], and u and v [px] at distances t inward from an edge [px]."""
        radius = float(self.body.radius_at(y))
        lateral = np.linspace(-_WIDTH, _WIDTH, self.n) * radius
        at = y + t * self.step
        return lateral, *on_cylinder(self.photo.camera, self.body, at, lateral, radius, self.plane)

    def tape_at(self, y: float, t: Array) -> Flags:
        """Return True where the tape's colour is visible at distances t inward from the edge, shape (n,).

        Chromaticity c = (R, G, B) / (R + G + B) in linear light is independent of shading. A point counts
        as tape if its chromaticity differs from the tape's by less than 0.4 times the difference between
        tape and braid. Otherwise the tape must be covered or glossy at that point. A tape with the braid's
        chromaticity cannot be distinguished from an object that covers it.
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
        """Return True where the tape is visible behind the edge."""
        return self.tape_at(y, -np.arange(_ROWS, dtype=float) - max(_BEYOND[0], _BEYOND[1] * s))

    def unrolled(self, y: float, t: Array, shows: Flags) -> tuple[Array, Array, float]:
        """Return amounts of braid, lateral positions [m], and the visible fraction of the lit edge."""
        lateral, u, v = self.around(y, t)
        at = [v - self.rows.start, u - self.columns.start]
        grid = map_coordinates(self.spline, at, order=3, mode="mirror", prefilter=False)
        # A black thread shows no edge: the braid behind the edge must be lit.
        height = grid[:, (t > 1) & (t < 6)].mean(axis=1)
        bright = height > _DARK_THREAD * np.sort(height)[int(0.7 * height.size)]
        shown = bright & shows
        seen = np.count_nonzero(shown) / np.count_nonzero(bright)
        use = shown if seen >= _LEAST_SEEN else bright
        return grid[use], lateral[use], seen


def find_ring(
    photo: Photograph, tone: Tone, coarse: Segmentation, body: Silhouette, blur: float, *, lower:
    bool,
) -> Ring:  # fmt: skip
    """Locate the inner edge of a tape in the picture unrolled around it.

    The picture is sampled at the points (x0 + X, y + h, d - sqrt(R^2 - X^2)) of the cylinder, so that a
    ring becomes a straight line, even if the tape is slanted or leans towards the camera. The quantity
    sampled, the amount of braid, is zero on the tape and its dark rim. Samples at neighbouring X are
    averaged in groups, and a blurred step is fitted to each average. The ring's position is the mean of the
    fitted step positions; its error is computed from their scatter.

    Args:
        photo: picture.
        tone: tone curve of the camera.
        coarse: approximate tapes, and the colours.
        body: body of revolution, whose radius at the ring is used.
        blur: blur of the outline [px], used as the initial value for the blur of the edge.
        lower: True for the tape at the lower end.

    Raises:
        MissingFitting: no edge was found, or too much of it is covered.
    """
    front, px = _Front(photo, tone, coarse, body, blur, lower=lower), 1 / photo.camera.px_per_m
    y, left = front.y, 2 * _PASSES
    while True:
        t, s, slope = _window(blur), blur, 0.0
        shows = front.uncovered(y, s)
        grid, lateral, seen = front.unrolled(y, t, shows)
        for _ in range(_PASSES):
            shift, blur_now, height, slope_now = _step(grid.mean(axis=0), t, s)
            if height > _LEAST_HEIGHT and abs(shift) < t[-1]:
                s, slope = blur_now, slope_now
                if abs(shift) < _SETTLED:
                    break
                y += shift * front.step
            elif front.lean and seen >= _LEAST_SEEN:
                y -= front.lean * float(body.radius_at(y))
                front.plane, front.lean = (0.0, front.lean), 0.0
            else:
                _check_seen(seen)
                raise MissingFitting(
                    "each tape must have a visible edge next to the braid: if the braid is glossy or "
                    "darker than the tapes, dust it with chalk and light it from all sides",
                    step_height=height,
                )
            t = _window(s)
            if (
                not shows.all()
            ):  # a tape that is visible everywhere is so a few pixels further as well
                shows = front.uncovered(y, s)
            grid, lateral, seen = front.unrolled(y, t, shows)
        radius = float(body.radius_at(y))
        delta, where = _along(grid, lateral / px, t, s, slope)
        (_, across, lean), (*_, error) = plane_through(where, delta, radius / px)
        bent = float(np.ptp(_plane_model(where, radius / px)[:, 1:] @ (across, lean)))
        # A lean moves the edge to another radius, which changes the lean: iterate while it exceeds three
        # standard errors.
        level = abs(lean) < max(3 * error, _LEVEL_FRONT * px / radius)
        left -= 1
        if left == 0 or (level and bent < _STRAIGHT):
            break
        inward = front.step / px
        front.plane = front.plane[0] + inward * across, front.plane[1] + inward * lean
    beside, beyond = (front.tape_at(y, at + np.arange(6.0)) for at in (2.0, 14.0))
    # Tape inward of the edge, and braid beyond, mean that the edge is that of an object on the tape.
    _check_seen(min(seen, 1 - float(np.mean(beside & ~beyond))))
    delta, where = _along(grid, lateral, t, s, slope)
    offset, left_over = _line(where / px, delta)
    seen_in_luma = coarse.braid @ LUMA > _BRIGHTER * (coarse.tape @ LUMA)
    # Colour is softer than luma: a camera's mosaic and most JPEG files have it in every second pixel,
    # interpolated linearly (2/3 px^2 of variance each), and JPEG averages over two pixels (1/4 px^2).
    if s > _SOFTER * max(blur, 1.0):
        s = math.sqrt(max(s**2 - _OF_COLOUR, 0.0))
    spread = math.sqrt(float(left_over @ left_over) / max(left_over.size - 2, 1))
    radius = float(body.radius_at(y))
    at = np.array([y + offset * front.step])
    u, v = on_cylinder(photo.camera, body, at, lateral, radius, front.plane)
    beyond = delta * front.step + _plane_model(where, radius)[:, 1:] @ front.plane
    place, _ = _line(where, beyond)
    return Ring(
        y=y + place,
        stderr=px
        * math.hypot(
            # Groups narrower than a thread are correlated.
            spread * math.sqrt(correlated_points(left_over) / left_over.size),
            # The light behind the edge may deviate from a straight line.
            slope * (_inside(s) - 1),
            0.0 if seen_in_luma else _IN_COLOUR,
        ),
        spread=spread,
        blur=s,
        arc=np.stack([u[:, 0], v[:, 0]]),
        lateral=where / radius,
        shift=beyond - place,
    )


def _along(grid: Array, lateral: Array, t: Array, s: float, slope: float) -> tuple[Array, Array]:
    """Return the shifts of groups along the edge [px], excluding outliers, and the groups' positions."""
    groups = np.stack([part.mean(axis=0) for part in np.array_split(grid, _GROUPS)])
    where = np.array([part.mean() for part in np.array_split(lateral, _GROUPS)])
    inside = _inside(s)
    near = (t >= -max(8.0, 3 * s)) & (t <= (inside if slope else max(8.0, 3 * s)))
    groups = (groups - slope * _relief(t, inside))[:, near]
    delta = best_shift(groups, t[near], lambda x: step(x, s), max(3.0, 1.5 * s), 0.1)
    off = np.abs(delta - np.median(delta))
    keep = off <= 4 * max(1.4826 * float(np.median(off)), 0.05)
    return delta[keep], where[keep]


def plane_through(lateral: Array, shift: Array, radius: float) -> tuple[list[float], list[float]]:
    """Fit a plane to an edge; return position, slope and lean, and their standard errors.

    Args:
        lateral: positions across the axis, shape (n,).
        shift: position of the edge along the axis at these positions, shape (n,).
        radius: radius of the cylinder, in the same unit.
    """
    model = _plane_model(lateral, radius)
    inverse = np.linalg.pinv(model)
    found = inverse @ shift
    off = shift - model @ found
    # Groups narrower than a thread are correlated.
    variance = float(off @ off) / max(off.size - model.shape[1], 1) * correlated_points(off)
    stderr = np.sqrt(np.sum(inverse**2, axis=1) * variance)
    return found.tolist(), stderr.tolist()


def _plane_model(lateral: Array, radius: float) -> Array:
    """Return the terms of a plane section of a cylinder: position, slope, lean; shape (n, 3)."""
    front = np.sqrt(np.maximum(radius**2 - lateral**2, 0.0))
    return np.column_stack([np.ones_like(lateral), lateral, front])


def _line(x: Array, y: Array) -> tuple[float, Array]:
    """Fit a straight line; return its value at 0 and the residuals."""
    slope, offset = np.polyfit(x, y, 1)
    return float(offset), y - slope * x - offset


def _window(blur: float) -> Array:
    half = round(max(12.0, 5 * blur))
    return np.arange(-half, half + 1.0)


def _check_seen(seen: float) -> None:
    if seen < _LEAST_SEEN:
        raise MissingFitting(
            f"at least {_LEAST_SEEN:.0%} of each tape's edge must be visible: remove anything that covers "
            "it, and avoid reflections on the tape or braid",
            seen=seen,
        )


def _inside(s: float) -> float:
    """Return the distance inward from an edge up to which light is used [px]."""
    return max(_BEHIND, 6 * s)


def _relief(x: Array, inside: float) -> Array:
    """Return the model of the light's rise inward from a tape [px], where threads emerge from its shade."""
    return np.clip(x, 0, inside - 1)


def _step(profile: Array, t: Array, start: float) -> tuple[float, float, float, float]:
    """Fit a blurred step with a rise behind it; return shift, blur, height and slope."""
    inside = _inside(start)

    def blur_of(unknown: Array) -> float:
        return min(max(math.exp(unknown[1]), _BLURS[0]), _BLURS[1])

    def plain(unknown: Array) -> tuple[Array, Array]:
        return height_and_rest(profile, step(t - unknown[0], blur_of(unknown)))

    def fitted(unknown: Array) -> tuple[Array, Array]:
        # The factor of one of two regressors follows from the residuals of regression on the other.
        x = t[near] - unknown[0]
        relief = _relief(x, inside)
        return height_and_rest(
            height_and_rest(profile[near], relief)[1],
            height_and_rest(step(x, blur_of(unknown)), relief)[1],
        )

    steepest = float(t[np.argmax(np.convolve(np.gradient(profile), np.ones(3), "same"))])
    near = t <= inside
    best = least_squares(lambda unknown: plain(unknown)[1], [steepest, math.log(start)], 1e-5)
    height, slope = float(plain(best)[0][0]), 0.0
    risen = least_squares(lambda unknown: fitted(unknown)[1], best, 1e-5)
    high, x = float(fitted(risen)[0][0]), t[near] - risen[0]
    left = profile[near] - high * step(x, blur_of(risen))
    rise = float(height_and_rest(left, _relief(x, inside))[0][0])
    if rise > 0:  # the shade of the tape cannot make the light fall inward
        best, height, slope = risen, high, rise
    return float(best[0]), blur_of(best), height, slope


def check_tape_diameter(
    photo: Photograph, coarse: Segmentation, body: Silhouette, recipe: Recipe, known: float
) -> None:
    """Check the scale against the known diameter of the tapes.

    A tape is a cylinder about the muscle's axis: R = rho sin(beta). Here beta is half the angle between
    its two tangent planes, which are located with the limb model.

    Raises:
        ScaleContradiction: the mean diameter differs from the known one by more than 0.5 %, or a tape
            spans too few rows.
    """
    camera, tone = photo.camera, recipe.tone_curve
    # A blue tape is dark in luma: use the colour in which the tape is brightest.
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
                f"each tape must span at least {_FEWEST_ROWS} pixel rows to check the scale: use "
                "wider tape, or omit the tape diameter",
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
            "the measured tape diameter must equal the known one, but their ratio is "
            f"{mean / known:.4f}: check that the ruler was in the plane of the muscle's axis, and that "
            "the stated distance is correct",
            diameter=mean, known_diameter=known, px_per_m=camera.px_per_m,
            limit=_CONTRADICTS,
        )  # fmt: skip


_SURE = 4.0  # standard errors above which the tapes contradict the stated distance
_SEEN = 4.0  # the same for a tilt
_LEANS = 3.25  # the same for the leans of both tapes together
_MAY_LEAN = 2.5  # the same above which a possible lean is included in the error of the length
_OF_RADIUS = 3.5  # of y / d: change of the middle of an edge's arc per error of the radius
_WOUND = 0.02  # standard deviation of the lean of a tape wound by hand [rad]
_LEAST = 0.01  # a tape wound by hand with a smaller lean counts as square [rad]
_MOST = 0.12  # largest relative lean of both tapes if wound by hand, 7 deg
_UPRIGHT = 0.0015  # accuracy to which an axis is set upright in depth [rad], 0.1 deg
_ASIDE = 0.6  # bow in depth, relative to the bow in the picture
_WAVE = 2 / math.pi  # mean of half a sine wave


class Depth(NamedTuple):
    """Position of the axis in depth, from the arcs of both tapes' edges.

    If the camera is at distance d and the picture was unrolled for distance d0, the front of a tape's edge
    is lower than its middle by p_i = tilt + y_i (1/d - 1/d0), relative to the radius.

    Attributes:
        lean, lean_stderr: p of the upper and lower ring and its standard error, shape (2,) [-].
        middle, middle_stderr: position of the rings' middles relative to `Ring.y`, and its standard
            error, shape (2,) [m].
        tilt, tilt_stderr: tilt of the axis, positive with its lower end away from the camera, and its
            standard error [rad].
        nearer, nearer_stderr: 1/d - 1/d0 and its standard error [1/m].
        against: half the difference between the leans of the two tapes [-].
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
    """Effects of the axis's tilt, distance and bow on length and diameter.

    Attributes:
        distance: camera distance [m].
        distance_stderr: standard error of the distance for tapes wound by hand [m]; 0 if the distance was
            stated.
        tilt, tilt_stderr: see `Depth` [rad].
        bow: largest deviation of the mid-line from a straight line [m].
        ends: positions of the middles of the upper and lower rings relative to `Ring.y` [m].
        length_factor: correction factor for the length between the rings' middles.
        length_stderr: contribution of the axis to the standard error of the length [m].
        cosine: cosine of the axis's angle in the picture, for each row, shape (n,).
        diameter_stderr: relative contribution of the axis to the standard error of the diameter.
        warnings: warnings for the user.
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
    """Compute the tilt and the distance from the inclinations of both tapes' edges.

    If the picture is unrolled about an upright cylinder at the correct distance, a ring square to the axis
    becomes a straight line. The front of a leaning ring is lower by p sqrt(R^2 - X^2) at X across the axis.
    A tilted axis or a wrong distance has the same effect.
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
    """Return the effects of tilt, distance and bow on length and diameter.

    A bow in the picture is corrected: the length is measured along the axis. Half the effect of a
    significant tilt is corrected, and the other half is the standard error, because a tilted axis looks
    the same as two tapes with the same lean. An insignificant tilt only contributes to the error. The
    position of a leaning tape is the middle of its ring; the front of the ring is lower by p R. If the
    combined lean of both tapes is below 3.25 standard errors, the tapes are assumed to be square to the
    axis, because the front of a ring is located three times more accurately than its middle. Between 2.5
    and 3.25 standard errors, the length difference that the lean would cause contributes to the error, up
    to the value for tapes wound by hand.

    Args:
        camera: camera.
        outline: outline.
        body: body of revolution with this outline.
        upper: edge of the upper tape.
        lower: edge of the lower tape.
        stated: True if the distance was stated; otherwise its error is computed from the tapes.

    Raises:
        DistanceContradiction: the tapes' arcs contradict the stated distance.
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
        front = float(
            np.mean(np.sqrt(np.maximum(1 - upper.lateral**2, 0)))
        )  # relative to the radius
        front *= float(body.radius_at(y).mean())
        parts.append(front * math.hypot(*depth.lean_stderr, depth.lean[1] - depth.lean[0]))
        wide = (body.x0**2 + radius**2) / d * nearer_stderr
    elif abs(depth.nearer) > _SURE * depth.nearer_stderr and abs(depth.against) > _LEAST:
        parts.append(depth.against**2 * length / 4)  # for a bow in depth with these leans
        wide = abs(depth.against) * length / math.pi * _WAVE / d
        seen = f"{1e3 / max(1 / d + depth.nearer, _FARTHEST):.0f} mm"
        text = (
            f"the curvature of the tapes' edges indicates a camera distance of {seen}, but "
            f"{1e3 * d:.0f} mm was stated. If that is wrong, correct --distance. Otherwise the muscle is "
            "bowed or leans towards the camera, or the tapes are crooked: correct this, and retake the "
            "picture"
        )
        if abs(depth.against) > _MOST:
            raise DistanceContradiction(text, stated=d, lean=depth.against)
        warnings.append(f"{text}; the standard errors were increased")
    tilt, aside = depth.tilt, (upper.y + lower.y) / 2 / d
    turned = 1 / (math.cos(tilt) - math.sin(tilt) * aside) - 1  # relative effect on the length
    factor = 1.0
    if abs(tilt) > max(_SEEN * depth.tilt_stderr, _LEAST):
        factor = 1 + turned / 2
        parts += [length * abs(turned) / 2, length * (abs(tilt) + abs(aside)) * depth.tilt_stderr]
        warnings.append(
            f"the axis, or both tapes, lean towards or away from the camera by {math.degrees(tilt):.1f} "
            f"+- {math.degrees(depth.tilt_stderr):.1f} deg, which changes the length by {abs(turned):.2%}: "
            "half of this has been corrected for, and half is included in the error; set the axis upright "
            "and wind the tapes square to it"
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
    """Return the camera distance [m] indicated by the tapes' arcs, or `assumed` if they agree with it.

    Args:
        body: body of revolution, computed for the assumed distance.
        upper: edge of the upper tape.
        lower: edge of the lower tape.
        assumed: assumed camera distance [m].
        found: True if the assumed distance was itself estimated from the arcs.

    Raises:
        DistanceContradiction: no camera distance explains the arcs.
    """
    depth = depth_of_axis(body, upper, lower)
    if not found and abs(depth.nearer) < 2 * depth.nearer_stderr:
        return assumed
    inverse = 1 / assumed + depth.nearer
    if not _NEAREST > inverse > _FARTHEST:
        raise DistanceContradiction(
            "no camera distance explains the curvature of the tapes' edges: wind the tapes square to the "
            "axis and hang the muscle straight, or state the distance with --distance",
            lean=depth.against,
        )
    return 1 / inverse


_NEAREST, _FARTHEST = 1 / 0.15, 1 / 15.0  # inverse distances [1/m]


def ends_aside(camera: Camera, outline: Outline) -> tuple[float, float]:
    """Return how far a bowed axis is displaced to the right at its upper and lower ends [m]."""
    off, y = _mid_line(camera, outline)
    line = np.polynomial.Polynomial.fit(y, off, 1)(y)
    first, last = ((off - line)[[0, -1]] / camera.px_per_m).tolist()
    return first, last


def _mid_line(camera: Camera, outline: Outline) -> tuple[Array, Array]:
    """Return the `bow` of the outline, corrected for lens distortion, and the rows [px]."""
    u, v = camera.rays(outline.columns, np.stack([outline.rows, outline.rows]))
    return bow(*(u * camera.focal_px)), v[0] * camera.focal_px
