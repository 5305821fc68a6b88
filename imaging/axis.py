"""Where the muscle's axis lies in depth, how far it is bowed, and what that does to the figures."""

import dataclasses
import math

import numpy as np

from .arrays import Array
from .camera import Camera, Silhouette
from .ends import Lean, Ring
from .errors import DistanceContradiction
from .outline import Outline, bow

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


@dataclasses.dataclass(frozen=True)
class Depth:
    """The axis in depth, by the arcs of both tapes' edges.

    The front of a tape's edge lies lower than its middle by p_i = tilt + y_i (1/d - 1/d0) over the
    radius, seen by a camera at d and unrolled for one at d0.

    Attributes:
        tilt: of the axis, its lower end away from the camera [rad].
        tilt_stderr: its standard error [rad].
        nearer: 1/d - 1/d0 [1/m].
        nearer_stderr: its standard error [1/m].
        against: lean of both tapes against each other that this is, p of one end [-].
    """

    tilt: float
    tilt_stderr: float
    nearer: float
    nearer_stderr: float
    against: float


@dataclasses.dataclass(frozen=True)
class Axis:
    """What is made of the axis.

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


def depth_of_axis(body: Silhouette, upper: Ring, lower: Ring) -> tuple[Depth, tuple[Lean, Lean]]:
    """Tilt and distance by the leans of both tapes' edges, and these."""
    up, low = (Lean.of(ring, float(body.radius_at(ring.y))) for ring in (upper, lower))
    span = lower.y - upper.y
    nearer, nearer_stderr = (low.slope - up.slope) / span, math.hypot(low.stderr, up.stderr) / span
    weight = np.array([up.stderr, low.stderr]) ** -2.0
    weight /= weight.sum()
    tilt = float(weight @ [up.slope, low.slope])
    against = nearer * span / 2
    if abs(nearer) > _SEEN * nearer_stderr:
        tilt = up.slope - upper.y * nearer
    return Depth(tilt, float((weight**2 @ [up.stderr**2, low.stderr**2]) ** 0.5), nearer,
                 nearer_stderr, against), (up, low)  # fmt: skip


def axis_of(
    camera: Camera, outline: Outline, body: Silhouette, upper: Ring, lower: Ring, *, stated: bool
) -> Axis:
    """What tilt, distance and bow do to length and diameter.

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
    depth, (up, low) = depth_of_axis(body, upper, lower)
    length, d = lower.y - upper.y, camera.distance
    warnings = []
    parts, wide = [], 0.0
    nearer_stderr = math.hypot(depth.nearer_stderr, math.sqrt(2) * _WOUND / length)
    radius = float(np.mean(body.radius))
    ends = (0.0, 0.0)
    shown = math.hypot(up.slope / up.stderr, low.slope / low.stderr)
    if stated and _MAY_LEAN < shown <= _LEANS:
        wound = _LEAST * math.hypot(*(float(body.radius_at(ring.y)) for ring in (upper, lower)))
        parts.append(min(abs(low.middle - up.middle), wound))
    if shown > _LEANS:
        for ring, lean in ((upper, up), (lower, low)):
            wider = float(body.radius_at(ring.y + lean.middle) - body.radius_at(ring.y))
            parts.append(_OF_RADIUS * ring.y / d * wider)
        if stated:
            ends = up.middle, low.middle
            parts += [up.middle_stderr, low.middle_stderr]
    if not stated:
        front = float(np.mean(np.sqrt(np.maximum(1 - upper.lateral**2, 0))))  # over the radius
        front = 0.5 * float(body.radius_at(upper.y) + body.radius_at(lower.y)) * front
        parts.append(front * math.hypot(up.stderr, low.stderr, low.slope - up.slope))
        wide = (body.x0**2 + radius**2) / d * nearer_stderr
    elif abs(depth.nearer) > _SURE * depth.nearer_stderr and abs(depth.against) > _LEAST:
        parts.append(depth.against**2 * length / 4)  # of a bow in depth that leans the tapes so
        wide = abs(depth.against) * length / math.pi * _WAVE / d
        warnings.append(_contradiction(depth, d))
    tilt, aside = depth.tilt, (upper.y + lower.y) / 2 / d
    turned = 1 / (math.cos(tilt) - math.sin(tilt) * aside) - 1  # what it takes off the length
    factor = 1.0
    if abs(tilt) > max(_SEEN * depth.tilt_stderr, _LEAST):
        factor = 1 + turned / 2
        parts.append(length * abs(turned) / 2)
        parts.append(length * (abs(tilt) + abs(aside)) * depth.tilt_stderr)
        warnings.append(
            f"the axis, or both tapes, lean in depth by {math.degrees(tilt):.1f} deg, "
            f"+-{math.degrees(depth.tilt_stderr):.1f}: half of the {abs(turned):.2%} that this does to "
            "the length is undone, and half is in its error; set the axis upright, the tapes square"
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
        tilt_stderr=depth.tilt_stderr, bow=deviation, ends=ends,
        length_factor=factor * (1 + longer), length_stderr=math.hypot(*parts),
        cosine=1 / np.hypot(1, slope),
        diameter_stderr=math.hypot(wide, _ASIDE * deviation * _WAVE / d), warnings=tuple(warnings),
    )  # fmt: skip


def distance_by_tapes(
    body: Silhouette, upper: Ring, lower: Ring, assumed: float, *, found: bool = False
) -> float:
    """The camera's distance [m] by the tapes' arcs; the assumed one where they agree with it.

    Args:
        body: the body of revolution, seen from the assumed distance.
        upper: the upper tape's edge.
        lower: the lower one's.
        assumed: distance [m].
        found: the assumed one is of the arcs themselves, and is only made better.

    Raises:
        DistanceContradiction: the arcs are those of no camera.
    """
    depth, _ = depth_of_axis(body, upper, lower)
    if not found and abs(depth.nearer) < 2 * depth.nearer_stderr:
        return assumed
    inverse = 1 / assumed + depth.nearer
    if not _NEAREST > inverse > _FARTHEST:
        raise DistanceContradiction(
            "the tapes' edges must be arcs as a camera sees them at some distance; these lean against "
            "each other more than that: say --distance, wind the tapes square to the axis, and hang "
            "the muscle straight",
            lean=depth.against,
        )
    return 1 / inverse


_NEAREST, _FARTHEST = 1 / 0.15, 1 / 15.0  # of cameras [1/m]


def _contradiction(depth: Depth, d: float) -> str:
    inverse = 1 / d + depth.nearer
    seen = f"{1 / inverse / _INCH:.0f} in" if inverse > _FARTHEST else "no distance"
    if abs(depth.against) > _MOST:
        raise DistanceContradiction(
            "the tapes' edges must be arcs as a camera sees them at the stated distance; these belong "
            f"to {seen}: correct --distance, or leave it out; if it is right, wind the tapes square to "
            "the axis, and hang the muscle so that it is not bowed towards the camera",
            stated=d, lean=depth.against,
        )  # fmt: skip
    return (
        f"the tapes' edges are arcs of a camera at {seen}, and {d / _INCH:.0f} in are stated: correct "
        "--distance; if it is right, the tapes are not square to the axis, or the muscle is bowed in "
        "depth, and the errors are wider for it: wind the tapes square, and hang the muscle straight"
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
