"""Where a tape's inner edge lies along the muscle's axis: the edge of a ring, seen as an arc."""

import dataclasses
import math

import numpy as np

from ..arrays import Array, Flags, Image
from ..camera.pinhole import Camera, turned
from ..camera.silhouette import Silhouette
from ..camera.tone import Tone
from ..errors import MissingFitting
from ..outline.edge_fit import best_shift, height_and_rest, least_squares
from ..outline.edge_model import step
from ..outline.smoother import correlated_points
from .cover import LEAST_SEEN, behind, check_cover, tape_shows
from .light import Amounts, Part, amounts_of, blur_of_lens, differ_in_luma, lumas

_WIDTH = 0.85  # part of the diameter that is used: at the limb a ring lies along the ray
_GROUPS = 16
_BLURS = (0.4, 30.0)
_PASSES = 4
_PIECES = 64
_STRAIGHT = 1.5  # px between the ends of an edge, of which groups of 16 make nothing
_LEVEL_FRONT = 0.3  # px by which the front of an edge that does not lean may lie beside its middle
_RAGGED = 0.6  # px, the scatter from which an edge's blur is that of its pieces
_LEVEL = 0.2  # of the pieces, those whose neighbours lie most nearly beside them
_DEEPEST, _SAME = 10.0, 0.02  # px of a tooth; part of the blur
_SETTLED = 0.1  # px, which the groups' own shifts take in
_DARK_THREAD = 0.22  # of the braid's brightness
_LEAST_HEIGHT = 0.2  # of the difference between braid and tape
_SOFTER = 1.25  # times the outline's blur, from which a tape's edge is looked at in luma as well


@dataclasses.dataclass(frozen=True)
class Ring:
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


def find_ring(
    rgb: Image,
    tone: Tone,
    camera: Camera,
    colours: tuple[Array, Array],
    body: Silhouette,
    *,
    y: float,
    lower: bool,
    blur: float,
) -> Ring:
    """The inner edge of a tape, from the picture unrolled around it.

    The picture is sampled at the points (x0 + X, y + h, d - sqrt(R^2 - X^2)) of the cylinder, so
    that a ring becomes a straight line, also where the tape was put on slanting or leaning towards
    the camera, in the linear light that the braid has and the tape and its dark rim have not. Groups
    of neighbouring X are averaged and each gives the position of a blurred step; the mean is the
    ring's, their scatter its error.

    Args:
        rgb: picture, shape (h, w, 3).
        tone: the camera's tone curve.
        camera: the camera.
        colours: of tape and braid, encoded values 0 to 255, each of shape (3,).
        body: whose radius the ring has; where the muscle swells right behind the tape, it matters
            where on the slope the ring lies.
        y: position to within some pixels [m].
        lower: the tape is at the lower end.
        blur: of the outline [px], where the search for the edge's own blur starts.

    Raises:
        MissingFitting: no edge there, or too much of it is covered.
    """
    px, inward = 1 / camera.px_per_m, -1 if lower else 1
    n = max(4 * _GROUPS, int(2 * _WIDTH * float(body.radius_at(y)) / px))
    part = _part(camera, body, y, 2 * len(_window(blur)))
    amounts = amounts_of(rgb, tone, colours, part)

    plane, left = (0.0, 0.0), 2 * _PASSES

    def around(y: float, t: Array) -> tuple[Array, Array, Array]:
        radius = float(body.radius_at(y))
        lateral = np.linspace(-_WIDTH, _WIDTH, n) * radius
        at = y + inward * t * px
        return lateral, *_seen(camera, body, at, lateral, radius, plane)

    def uncovered(y: float, s: float) -> Flags:
        return tape_shows(rgb, tone, colours, *around(y, behind(s))[1:])

    def unrolled(
        y: float, t: Array, shows: Flags, *, teeth: float = 0.0
    ) -> tuple[Array, Array, float]:
        lateral, u, v = around(y, t)
        grid = amounts.at(u, v)
        lit = _lit(grid, t - teeth)
        shown = lit & shows
        seen = np.count_nonzero(shown) / np.count_nonzero(lit)
        use = shown if seen >= LEAST_SEEN else lit
        return grid[use], lateral[use], seen

    while True:
        t, s = _window(blur), blur
        shows = uncovered(y, s)
        grid, lateral, seen = unrolled(y, t, shows)
        for _ in range(_PASSES):
            shift, s = _blurred_step(grid.mean(axis=0), t, s)
            if abs(shift) < _SETTLED:
                break
            y += inward * shift * px
            t = _window(s)
            if not shows.all():  # else the tape shows everywhere, here as some pixels beside
                shows = uncovered(y, s)
            grid, lateral, seen = unrolled(y, t, shows)
        more, straight = _plane(grid, lateral / px, t, s, float(body.radius_at(y)) / px)
        left -= 1
        if straight or not left:
            break
        plane = plane[0] + inward * more[0], plane[1] + inward * more[1]
    check_cover(seen)
    delta, where = _along(grid, lateral, t, s)
    (offset, left_over), teeth = _line(where / px, delta), 0.0
    if _scatter(left_over) > _RAGGED:
        t, shows, teeth = _window(_DEEPEST / 3), uncovered(y, _DEEPEST / 2), _DEEPEST
        grid, lateral, _ = unrolled(y, t, shows, teeth=teeth)
        s, delta, where = _pieces(grid, lateral, t, s)
        offset, left_over = _line(where / px, delta)
    if s > _SOFTER * max(blur, 1.0) and differ_in_luma(colours):
        luma = lumas(rgb, tone, colours, part)
        s = blur_of_lens(s, _blur_in(luma, around(y, t), shows, t, s, teeth=teeth))
    spread, radius = _scatter(left_over), float(body.radius_at(y))
    u, v = _seen(camera, body, np.array([y + inward * offset * px]), lateral, radius, plane)
    beyond = inward * delta * px + _on_plane(plane, where, radius)
    place, _ = _line(where, beyond)
    return Ring(
        y=y + place,
        # Groups in the width of one thread are moved together.
        stderr=spread * np.sqrt(correlated_points(left_over) / left_over.size) * px,
        spread=spread,
        blur=s,
        arc=np.stack([u[:, 0], v[:, 0]]),
        lateral=where / radius,
        shift=beyond - place,
    )


def _along(grid: Array, lateral: Array, t: Array, s: float) -> tuple[Array, Array]:
    """Shifts of those groups of neighbours along the edge [px] that agree, and where they lie."""
    groups = np.stack([part.mean(axis=0) for part in np.array_split(grid, _GROUPS)])
    where = np.array([part.mean() for part in np.array_split(lateral, _GROUPS)])
    delta, keep = _group_shifts(groups, t, s)
    return delta[keep], where[keep]


def _plane(
    grid: Array, lateral: Array, t: Array, s: float, radius: float
) -> tuple[tuple[float, float], bool]:
    """Slope and lean of the edge as it is unrolled so far [-], and whether it is straight.

    Lengths are in px. A lean that the groups show by three standard errors takes the edge to where the
    muscle is wider or narrower, which makes it another lean.
    """
    delta, where = _along(grid, lateral, t, s)
    (_, slope, lean), (*_, error) = plane_through(where, delta, radius)
    shown = max(3 * error, _LEVEL_FRONT / radius)
    straight = float(np.ptp(_on_plane((slope, lean), where, radius))) < _STRAIGHT
    return (slope, lean), straight and abs(lean) < shown


def plane_through(lateral: Array, shift: Array, radius: float) -> tuple[list[float], list[float]]:
    """Place, slope across and lean of the plane in which an edge lies best, and their standard errors.

    Args:
        lateral: positions across the axis, shape (n,).
        shift: of the edge along the axis there, shape (n,).
        radius: of the cylinder, in the same unit.
    """
    model = _plane_model(lateral, radius)
    inverse = np.linalg.pinv(model)
    found = inverse @ shift
    off = shift - model @ found
    variance = float(off @ off) / max(off.size - model.shape[1], 1)
    # Groups in the width of one thread are moved together.
    stderr = np.sqrt(np.sum(inverse**2, axis=1) * variance * correlated_points(off))
    return found.tolist(), stderr.tolist()


def _plane_model(lateral: Array, radius: float) -> Array:
    """What the edge in a plane through a cylinder is made of: place, slope across, lean; shape (n, 3)."""
    front = np.sqrt(np.maximum(radius**2 - lateral**2, 0.0))
    return np.column_stack([np.ones_like(lateral), lateral, front])


def _on_plane(plane: tuple[float, float], lateral: Array, radius: float) -> Array:
    """How much further down a plane through a cylinder lies there than in its middle, in their unit.

    Args:
        plane: its slope across the axis, and its lean: slope towards the camera.
        lateral: positions across the axis.
        radius: of the cylinder.
    """
    return np.asarray(_plane_model(lateral, radius)[:, 1:] @ plane)


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
    where = np.array([part.mean() for part in np.array_split(lateral, _PIECES)])
    pieces = np.stack([part.mean(axis=0) for part in np.array_split(grid, _PIECES)])
    reach, own, delta = _DEEPEST, s, np.zeros(_PIECES)
    keep = np.ones(_PIECES, bool)
    for _ in range(_PASSES):
        delta = best_shift(pieces, t, lambda x, blur=s: step(x, blur), reach, 0.1)
        steep = np.abs(np.gradient(delta))
        keep = (np.abs(delta) < reach - 1) & _near_most(delta)
        level = keep & (steep <= np.quantile(steep, _LEVEL))
        aligned = [np.interp(t + d, t, piece) for d, piece in zip(delta, pieces, strict=True)]
        near = np.abs(t) <= _DEEPEST
        own = _blurred_step(np.mean(np.array(aligned)[level], axis=0)[near], t[near], s)[1]
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


def _seen(
    camera: Camera,
    body: Silhouette,
    y: Array,
    lateral: Array,
    radius: float,
    plane: tuple[float, float] = (0.0, 0.0),
) -> tuple[Array, Array]:
    """Picture positions of a cylinder about the body's axis, at each lateral position and y.

    In a plane that is not square to the axis, y is that of its middle.
    """
    rim = np.maximum(radius**2 - lateral**2, 0.0)  # the rim itself rounds below
    down = y[None, :] + _on_plane(plane, lateral, radius)[:, None]
    X, Y = turned((body.x0 + lateral)[:, None] + np.zeros_like(down), down, body.roll)
    return camera.pixels(X, Y, camera.distance - np.sqrt(rim)[:, None])


def _part(camera: Camera, body: Silhouette, y: float, reach: int) -> Part:
    """Rows and columns of the picture around a ring, to `reach` px above and below."""
    radius = float(body.radius_at(y))
    around = y + np.array([-reach, reach]) / camera.px_per_m
    u, v = _seen(camera, body, around, np.array([-1.0, 0.0, 1.0]) * radius, radius)
    rows, columns = (
        slice(max(int(np.floor(x.min())) - 3, 0), int(np.ceil(x.max())) + 4) for x in (v, u)
    )
    return rows, columns


def _blur_in(
    light: Amounts,
    seen: tuple[Array, Array, Array],
    shows: Flags,
    t: Array,
    s: float,
    *,
    teeth: float,
) -> float:
    """Blur of the edge in another light [px], its place being known; as it is, where too little shows.

    Args:
        light: the amount of braid.
        seen: lateral positions, columns and rows of what is unrolled.
        shows: where along it the tape shows.
        t: distance inward, shape (k,) [px].
        s: blur, about [px].
        teeth: of a ragged edge [px].
    """
    lateral, u, v = seen
    grid = light.at(u, v)
    use = _lit(grid, t - teeth) & shows
    if np.count_nonzero(use) < max(_PIECES, LEAST_SEEN * use.size):
        return s
    if teeth:
        return _pieces(grid[use], lateral[use], t, s)[0]
    return _step(grid[use].mean(axis=0), t, s)[1]


def _lit(grid: Array, t: Array) -> Flags:
    """Lateral positions where the braid behind the edge is lit; a black thread shows no edge."""
    height = grid[:, (t > 1) & (t < 6)].mean(axis=1)
    return height > _DARK_THREAD * np.sort(height)[int(0.7 * height.size)]


def _blurred_step(profile: Array, t: Array, start: float) -> tuple[float, float]:
    """Shift and blur of the step in the mean profile."""
    shift, blur, height = _step(profile, t, start)
    if not (height > _LEAST_HEIGHT and abs(shift) < t[-1]):
        raise MissingFitting(
            "a tape must end in an edge towards the braid; none is seen where its colour ends",
            step_height=height,
        )
    return shift, blur


def _step(profile: Array, t: Array, start: float) -> tuple[float, float, float]:
    """Shift, blur and height of the step that fits a profile best, whatever it is worth."""

    def blur_of(unknown: Array) -> Array:
        return np.minimum(np.maximum(np.exp(unknown[..., 1:]), _BLURS[0]), _BLURS[1])

    def fitted(unknown: Array) -> tuple[Array, Array]:
        return height_and_rest(profile, step(t - unknown[..., :1], blur_of(unknown)))

    steepest = float(t[np.argmax(np.convolve(np.gradient(profile), np.ones(3), "same"))])
    first = np.array([steepest, np.log(start)])
    best = least_squares(lambda unknown: fitted(unknown)[1], first, 1e-5)
    return float(best[0]), float(blur_of(best)[0]), float(fitted(best)[0][0])


def _group_shifts(groups: Array, t: Array, s: float) -> tuple[Array, Flags]:
    near = np.abs(t) <= max(8.0, 3 * s)
    delta = best_shift(groups[:, near], t[near], lambda x: step(x, s), max(3.0, 1.5 * s), 0.1)
    return delta, _near_most(delta)
