"""What stands before the camera: a muscle of known shape with its tapes, and the braid's weave."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from famjax.units import INCH
from imaging.camera import Array, Flags, Indices

TAN = (0.72, 0.58, 0.33)  # aramid thread, linear RGB
BLUE_HUE = 222.0  # [deg]

_TEETH = 6, 48  # of a ragged edge around the circumference

Profile = Callable[[Array], ArrayLike]


@dataclasses.dataclass(frozen=True)
class Tape:
    """A coloured tape around one fitting; slanted or ragged, it lies close on the braid."""

    hue: float = BLUE_HUE  # of the encoded colour [deg]
    saturation: float = 0.85
    value: float = 0.62
    width: float = 0.5 * INCH  # along the axis
    diameter: float | None = None  # [m]; None: the braid's at its end
    slant: float = 0.0  # angle of the inner edge to the normal of the axis [rad]
    slant_towards: float = 0.0  # azimuth of its lower side [rad], pi/2 is towards the camera
    ragged: float = 0.0  # standard deviation of the inner edge [m], mean zero as the camera sees it
    ragged_seed: int = 0

    def edge(self, azimuth: ArrayLike, radius: float) -> Array:
        """How much further down [m] the inner edge lies at some azimuths [rad]."""
        phi = np.asarray(azimuth, float)
        plane = radius * np.tan(self.slant) * np.cos(phi - self.slant_towards)
        if self.ragged == 0:
            return plane
        random = np.random.default_rng(self.ragged_seed)
        fewest, most = _TEETH
        a, b = random.standard_normal((2, most - fewest)) / np.sqrt(most - fewest)
        waves = np.concatenate([np.zeros(fewest), a - 1j * b])

        def teeth(phi: Array) -> Array:
            return np.asarray(np.polynomial.polynomial.polyval(np.exp(1j * phi), waves).real, float)

        front = np.arccos(np.linspace(-0.85, 0.85, 201))
        return plane + self.ragged * (teeth(phi) - teeth(front).mean())


@dataclasses.dataclass(frozen=True)
class MuscleScene:
    """A muscle: a body of revolution of woven thread between two taped fittings; SI."""

    profile: Profile  # mean outline D(x), x = z/L from the upper tape's edge to the lower
    length: float  # straight, between the tapes' inner edges; the truth's follows a bowed axis
    x0: float = 0.0  # of the axis, to the right of the optical axis
    y0: float = 0.0  # of the braid's middle along the axis, downwards
    roll: float = 0.0  # turn of the axis in the picture, clockwise
    bow: float = 0.0  # largest deviation of the axis to the right (half a sine wave)
    bow_depth: float = 0.0  # the same, away from the camera
    tilt: float = 0.0  # turn of axis and lamps in depth, the lower end away from the camera
    strands: int = 36  # of each helix family, a multiple of 4
    turns: float = 1.09  # of a strand about the axis over the length
    albedo: tuple[float, float, float] = TAN  # of the threads, linear RGB
    flecks: float = 0.0  # part of the crossings that are of black thread
    relief: float = 0.002 * INCH  # height of a yarn's crest over the valley beside it
    sheen: float = 0.0  # light added at grazing sight, sheen (1 - n_z)^sheen_power
    sheen_power: float = 3.0  # 3 for cloth, 8 and more for a glossy thread
    fray: int = 0  # loose fibres
    weave_seed: int = 0  # of reflectances, flecks, sparkles and fibres
    upper: Tape | None = dataclasses.field(default_factory=Tape)  # None leaves the fitting bare
    lower: Tape | None = dataclasses.field(default_factory=Tape)
    third: tuple[Tape, float] | None = None  # a tape too many, and the position x of its middle

    def diameter(self, x: ArrayLike) -> Array:
        """D at x = z/L, that of the nearer end outside of [0, 1]."""
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


@functools.cache
def published_shape(contraction: float) -> Callable[[ArrayLike], Array]:
    """The muscle's published profile at 100 psi and one of `PUBLISHED_CONTRACTIONS`, symmetrised."""
    mean, a, b, w = _TABLE_4_3[PUBLISHED_CONTRACTIONS.index(contraction)]
    n = np.arange(1, len(a) + 1)
    # a cos(nwx) + b sin(nwx), its part even about x = 1/2.
    even = INCH * (np.array(a) * np.cos(n * w / 2) + np.array(b) * np.sin(n * w / 2))

    def shape(x: ArrayLike) -> Array:
        angle = abs(w) * (np.asarray(x, float)[..., None] - 0.5)
        return mean * INCH + np.cos(n * angle) @ even

    return shape


def stroke_shape(
    contraction: float, end_diameter: float = 0.875 * INCH
) -> Callable[[ArrayLike], Array]:
    """A profile between the published ones by a monotone cubic, its ends brought to one diameter."""

    def between(x: Array) -> Array:
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
    """What the braid shows at n places."""

    first: Indices  # strands of the two families
    second: Indices
    on_top: Flags  # the first family's strand is the upper one
    across: Array  # place across the upper yarn, -1/2 to 1/2
    along: Array  # place along its float over two others, 0 to 1

    @functools.cached_property
    def height(self) -> Array:
        """Height of the surface between valley (0) and crest (1)."""
        return np.cos(np.pi * self.across) * (0.6 + 0.4 * np.sin(np.pi * self.along))


class Weave:
    """A regular two-over-two braid: d twist / ds = 1 / (R tan(theta)), R at uniform positions y [m]."""

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
        """How far yarns at the limb move the outline outwards [m], mean zero: max (R + h) cos(delta)."""
        if self.relief == 0:
            return np.zeros_like(R)
        outermost = np.full(R.shape, -np.inf)
        for delta in np.linspace(-_LIMB_WINDOW, _LIMB_WINDOW, 41):
            h = self.relief * self.crossings(azimuth + delta, self.y).height
            outermost = np.maximum(outermost, (R + h) * np.cos(delta) - R)
        return outermost - outermost.mean()
