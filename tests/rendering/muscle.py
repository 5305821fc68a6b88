"""What stands before the camera: a muscle of known shape with its tapes, and the braid's weave."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.units import factor
from imaging.camera import Array, Flags, Indices

INCH = factor("in", "length")
TAN = (0.72, 0.58, 0.33)  # aramid thread, linear RGB
BLUE_HUE = 222.0  # [deg]

_TEETH = 6, 48  # of a ragged edge around the circumference

Profile = Callable[[Array], ArrayLike]


@dataclasses.dataclass(frozen=True)
class Tape:
    """A coloured tape around one fitting.

    Attributes:
        hue, saturation, value: of the encoded colour; the hue in degrees.
        width: along the axis [m].
        diameter: [m]; None takes the braid's diameter at its end.
        slant: angle of its inner edge to the normal of the axis [rad], `slant_towards` the azimuth
            of the side that lies lower [rad], 0 to the right and pi/2 towards the camera. A slanted
            or ragged tape lies close on the braid, whatever its diameter.
        ragged: standard deviation of its inner edge along the axis [m]; zero in the mean over the
            side that the camera sees.
    """

    hue: float = BLUE_HUE
    saturation: float = 0.85
    value: float = 0.62
    width: float = 0.5 * INCH
    diameter: float | None = None
    slant: float = 0.0
    slant_towards: float = 0.0
    ragged: float = 0.0
    ragged_seed: int = 0

    def edge(self, azimuth: ArrayLike, radius: float) -> Array:
        """How much further down the inner edge lies at some azimuths [rad], on a body [m]."""
        phi = np.asarray(azimuth, float)
        plane = radius * np.tan(self.slant) * np.cos(phi - self.slant_towards)
        if self.ragged == 0:
            return plane
        random = np.random.default_rng(self.ragged_seed)
        fewest, most = _TEETH
        a, b = random.standard_normal((2, most - fewest)) / np.sqrt(most - fewest)
        waves = np.concatenate([np.zeros(fewest), a - 1j * b])

        def teeth(phi: Array) -> Array:
            # A tenth of the time of as many sines and cosines.
            return np.asarray(np.polynomial.polynomial.polyval(np.exp(1j * phi), waves).real, float)

        front = np.arccos(np.linspace(-0.85, 0.85, 201))
        return plane + self.ragged * (teeth(phi) - teeth(front).mean())


@dataclasses.dataclass(frozen=True)
class MuscleScene:
    """A muscle: a body of revolution of woven thread between two taped fittings.

    Attributes:
        profile: D(x) [m], a function of x = z/L in [0, 1], upper tape's edge to lower.
        length: between the inner edges of the tapes along the straight line through their middles
            [m]; the truth's length L of a bowed muscle is its axis' own.
        x0: distance of the axis from the optical axis, positive to the right [m].
        y0: middle of the braid along the axis, from the foot of the optical axis, downwards [m].
        roll: turn of the axis in the picture [rad], positive clockwise.
        bow: largest deviation of the axis from the straight line between its ends [m] to the right
            (half a sine wave); `bow_depth` the same, away from the camera.
        tilt: turn of axis and lamps in depth about the braid's middle [rad], the lower end away from
            the camera.
        strands: of each of the two helix families, a multiple of 4.
        turns: of a strand about the axis over the length [-].
        albedo: reflectance of the threads, linear RGB.
        flecks: part of the crossings that are of black thread [-].
        relief: height of a yarn's crest over the valley beside it [m]. The profile is that of the
            mean outline: between the crests that a calliper touches and the valleys.
        sheen: part of the light that fabric adds at grazing sight, sheen (1 - n_z)^sheen_power [-];
            the power is 3 for cloth, 8 and more for the narrow rim of a glossy thread.
        fray: loose fibres that stand out from the outline.
        weave_seed: of the strands' reflectances, flecks and sparkles, and of the fibres.
        upper, lower: the tapes; None leaves the fitting bare.
        third: a tape that should not be there, with the position x of its middle; a tape without
            a diameter lies close around the braid, or around the rod where x is outside of [0, 1].
    """

    profile: Profile
    length: float
    x0: float = 0.0
    y0: float = 0.0
    roll: float = 0.0
    bow: float = 0.0
    bow_depth: float = 0.0
    tilt: float = 0.0
    strands: int = 36
    turns: float = 1.09
    albedo: tuple[float, float, float] = TAN
    flecks: float = 0.0
    relief: float = 0.002 * INCH
    sheen: float = 0.0
    sheen_power: float = 3.0
    fray: int = 0
    weave_seed: int = 0
    upper: Tape | None = dataclasses.field(default_factory=Tape)
    lower: Tape | None = dataclasses.field(default_factory=Tape)
    third: tuple[Tape, float] | None = None

    def diameter(self, x: ArrayLike) -> Array:
        """Diameter D [m] at x = z/L [-], that of the nearer end outside of [0, 1]."""
        x = np.clip(np.asarray(x, float), 0, 1)
        return np.asarray(self.profile(x), float) + np.zeros_like(x)


REST_LENGTH = 9.28125 * INCH
PUBLISHED_CONTRACTIONS = (0.0, 0.0875, 0.175, 0.2625, 0.35)

# Chambers 2021, table 4.3 with the corrected wave numbers: a0, (a1, a2, a3), (b1, b2, b3) [in], w [-].
_TABLE_4_3 = (
    (1.02, (-0.09, -0.07, -0.01), (0.03, 0.06, 0.02), 5.596),
    (1.37, (-0.35, -0.15, -0.01), (-0.17, -0.19, -0.06), -5.371),
    (1.51, (-0.56, -0.10, 0.04), (0.43, 0.41, 0.10), 4.961),
    (1.27, (-0.83, 0.29, 0.18), (1.20, 0.75, 0.04), 4.347),
    (-32.74, (24.82, 12.82, -3.90), (47.44, -18.47, -0.5), 2.176),
)


@dataclasses.dataclass(frozen=True)
class FourierShape:
    """D(x) = mean + sum over n of cosines_n cos(n w (x - 1/2)) [m], w being the frequency."""

    mean: float
    cosines: tuple[float, ...]
    frequency: float

    def __call__(self, x: ArrayLike) -> Array:
        n = np.arange(1, len(self.cosines) + 1)
        angle = self.frequency * (np.asarray(x, float)[..., None] - 0.5)
        return self.mean + np.cos(n * angle) @ np.array(self.cosines)


def published_shape(contraction: float) -> FourierShape:
    """The muscle's published profile at 100 psi and one of `PUBLISHED_CONTRACTIONS`, symmetrised."""
    mean, a, b, w = _TABLE_4_3[PUBLISHED_CONTRACTIONS.index(contraction)]
    n = np.arange(1, len(a) + 1)
    # a cos(nwx) + b sin(nwx), its part even about x = 1/2.
    even = np.array(a) * np.cos(n * w / 2) + np.array(b) * np.sin(n * w / 2)
    return FourierShape(mean * INCH, tuple(float(c) * INCH for c in even), abs(w))


def stroke_shape(
    contraction: float, end_diameter: float = 0.875 * INCH
) -> Callable[[ArrayLike], Array]:
    """A profile at any contraction of the stroke, its ends held by fittings of one diameter.

    Between the published profiles by a monotone cubic in the contraction at every x; what the
    published ends deviate from `end_diameter` is taken off, fading to nothing in the middle.
    """

    def between(x: Array) -> Array:
        from scipy.interpolate import PchipInterpolator

        published = np.stack([published_shape(each)(x) for each in PUBLISHED_CONTRACTIONS])
        return np.asarray(PchipInterpolator(PUBLISHED_CONTRACTIONS, published)(contraction))

    excess = float(between(np.zeros(1))[0]) - end_diameter

    def shape(x: ArrayLike) -> Array:
        x = np.asarray(x, float)
        return between(x) - excess * (1 - 4 * x * (1 - x)) ** 4

    return shape


_YARN_TILT = 0.9  # slope of a round yarn's flank
_SPREAD = 0.12  # relative standard deviation of the reflectance from strand to strand
_SPARKLE = 0.04  # part of the crossings that shine
_VALLEY = 0.45  # light left in the valley between two yarns
_LIMB_WINDOW = 0.2  # [rad] around the tangent point in which a crest can be the outline
_GLINT = 2.0  # light that a sparkling yarn adds on its crest, relative to the thread's
_BLACK_THREAD = 0.08  # reflectance of a fleck, relative to the thread's


@dataclasses.dataclass(frozen=True)
class Crossings:
    """What the braid shows at n places.

    Attributes:
        first, second: the strands of the two families (i, j).
        on_top: the first family's strand is the upper one.
        across: place across the upper yarn, -1/2 to 1/2.
        along: place along its float over two others, 0 to 1.
    """

    first: Indices
    second: Indices
    on_top: Flags
    across: Array
    along: Array

    @functools.cached_property
    def height(self) -> Array:
        """Height of the surface between valley (0) and crest (1)."""
        return np.cos(np.pi * self.across) * (0.6 + 0.4 * np.sin(np.pi * self.along))


class Weave:
    """A regular two-over-two braid on a body of revolution.

    Strands of both families turn by the angle `twist`(y), one to the right and one to the left:
    with the local braid angle theta to the circumference, d twist / ds = 1 / (R tan(theta)). The
    radius R and its slope are those at the uniform positions y along the axis [m].
    """

    def __init__(self, muscle: MuscleScene, y: Array, R: Array, slope: Array) -> None:
        step = np.hypot(1, slope) * (y[1] - y[0])
        thread = np.hypot(np.sum(step), 2 * np.pi * muscle.turns * np.mean(R))
        cos_theta = np.clip(2 * np.pi * muscle.turns * R / thread, 0, 0.98)
        self.y = y
        self.cotangent = cos_theta / np.sqrt(1 - cos_theta**2)
        self.twist = np.cumsum(self.cotangent / R * step)
        self.n = muscle.strands
        random = np.random.default_rng(muscle.weave_seed)
        spread = 1 + _SPREAD * random.standard_normal((2, self.n))
        self.strand_albedo = np.clip(spread, 0.4, 1.6)
        shape = (self.n, self.n)
        self.glint = np.where(random.random(shape) < _SPARKLE, _GLINT, 0.0)
        self.thread = np.where(random.random(shape) < muscle.flecks, _BLACK_THREAD, 1.0)
        self.relief = muscle.relief

    def crossings(self, azimuth: Array, y: Array) -> Crossings:
        """What lies on top at these azimuths [rad] and positions [m], shape (n,) each."""
        twist = np.interp(y, self.y, self.twist)
        p = (azimuth + twist) * (self.n / (2 * np.pi))
        q = (azimuth - twist) * (self.n / (2 * np.pi))
        i, j = np.floor(p), np.floor(q)
        p, q = p - i, q - j
        i, j = i.astype(np.int64), j.astype(np.int64)
        phase = (i + j) % 4
        on_top = phase < 2
        across = np.where(on_top, p, q) - 0.5
        along = (np.where(on_top, q, p) + phase % 2) / 2
        return Crossings(i % self.n, j % self.n, on_top, across, along)

    def reflectance(self, at: Crossings) -> Array:
        """Reflectance relative to the threads' mean, sparkles, flecks and valleys included."""
        strand = np.where(
            at.on_top, self.strand_albedo[0][at.first], self.strand_albedo[1][at.second]
        )
        at_cell = at.first, at.second
        shade = _VALLEY + (1 - _VALLEY) * at.height
        return strand * (self.thread[at_cell] * shade + self.glint[at_cell] * at.height**6)

    def directions(self, at: Crossings, azimuth: Array, y: Array) -> tuple[Array, Array]:
        """Lean of the yarn's own surface, and direction of its fibres, in the world, (n, 3) each."""
        cot = np.interp(y, self.y, self.cotangent)
        sine = 1 / np.hypot(1, cot)
        cosine = np.where(at.on_top, 1, -1) * cot * sine
        x, z = -np.sin(azimuth), -np.cos(azimuth)  # around the axis
        steep = _YARN_TILT * np.sin(np.pi * at.across)
        lean = np.stack([steep * (sine * x), steep * cosine, steep * (sine * z)], axis=1)
        return lean, np.stack([-cosine * x, sine, -cosine * z], axis=1)

    def outline_offset(self, azimuth: Array, R: Array) -> Array:
        """How far the crests and valleys at the limb move the outline outwards [m], mean zero.

        The largest of (R + h) cos(delta) over the directions delta around the tangent points, with
        these azimuths and radii at self.y.
        """
        if self.relief == 0:
            return np.zeros_like(R)
        outermost = np.full(R.shape, -np.inf)
        for delta in np.linspace(-_LIMB_WINDOW, _LIMB_WINDOW, 41):
            h = self.relief * self.crossings(azimuth + delta, self.y).height
            outermost = np.maximum(outermost, (R + h) * np.cos(delta) - R)
        return outermost - outermost.mean()
