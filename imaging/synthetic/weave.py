"""The woven braid: which yarn lies on top at a place, how it is turned and how bright it is."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from .muscle import MuscleScene

Array = NDArray[np.float64]
_YARN_TILT = 0.9  # slope of a round yarn's flank
_VALLEY = 0.45  # light left in the valley between two yarns
_LIMB_WINDOW = 0.2  # [rad] around the tangent point in which a crest can be the outline
_GLINT = 2.0  # light that a sparkling yarn adds on its crest, relative to the thread's
_BLACK_THREAD = 0.08  # reflectance of a fleck, relative to the thread's


@dataclasses.dataclass(frozen=True)
class Crossings:
    """What the braid shows at n places.

    Attributes:
        first: the strand of the first family (i), `second`: of the other (j), shape (n,).
        on_top: the first family's strand is the upper one, shape (n,).
        across: place across the upper yarn, -1/2 to 1/2, shape (n,).
        along: place along its float over two others, 0 to 1, shape (n,).
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    on_top: NDArray[np.bool_]
    across: Array
    along: Array

    @property
    def height(self) -> Array:
        """Height of the surface between valley (0) and crest (1)."""
        return np.cos(np.pi * self.across) * (0.6 + 0.4 * np.sin(np.pi * self.along))


class Weave:
    """A regular two-over-two braid on a body of revolution.

    Strands of both families turn by the angle `twist`(y), one to the right and one to the left:
    with the local braid angle theta to the circumference, d twist / ds = 1 / (R tan(theta)).

    Args:
        muscle: the muscle.
        y: positions along the axis [m], uniform, shape (m,).
        R: radius at y [m], shape (m,).
        slope: dR/dy, shape (m,).
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
        spread = 1 + muscle.albedo_spread * random.standard_normal((2, self.n))
        self.strand_albedo = np.clip(spread, 0.4, 1.6)
        shape = (self.n, self.n)
        self.glint = np.where(random.random(shape) < muscle.sparkle, _GLINT, 0.0)
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
        around = np.stack([-np.sin(azimuth), np.zeros_like(azimuth), -np.cos(azimuth)], axis=1)
        axial = np.array([0.0, 1.0, 0.0])
        lean = sine[:, None] * around + cosine[:, None] * axial
        fibre = -cosine[:, None] * around + sine[:, None] * axial
        return _YARN_TILT * np.sin(np.pi * at.across)[:, None] * lean, fibre

    def outline_offset(self, azimuth: Array, R: Array) -> Array:
        """How far the crests and valleys at the limb move the outline outwards [m], mean zero.

        The largest of (R + h) cos(delta) over the directions delta around the tangent point.

        Args:
            azimuth: of the tangent point at self.y, shape (m,).
            R: radius at self.y [m], shape (m,).
        """
        if self.relief == 0:
            return np.zeros_like(R)
        outermost = np.full(R.shape, -np.inf)
        for delta in np.linspace(-_LIMB_WINDOW, _LIMB_WINDOW, 41):
            h = self.relief * self.crossings(azimuth + delta, self.y).height
            outermost = np.maximum(outermost, (R + h) * np.cos(delta) - R)
        return outermost - outermost.mean()
