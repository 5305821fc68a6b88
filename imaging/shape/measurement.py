"""A muscle's shape in one photograph, each figure with its standard error."""

import dataclasses
import math

import numpy as np

from ..arrays import Array
from ..quality import Quality
from ..weave.angle import BraidAngle, triangle_angle


@dataclasses.dataclass(frozen=True)
class Trace:
    """Where the edges were found in the picture [px], for a check by eye.

    Attributes:
        rows: v, shape (n,).
        left, right: u of the outline, shape (n,).
        upper, lower: u, v of the inner edges of the tapes, shape (2, k).
        turned: the picture was turned a quarter turn clockwise first, and these positions are in
            the turned one.
        yarns: pieces of yarns at the braid angle that was found, u and v, shape (2, k) each.
    """

    rows: Array
    left: Array
    right: Array
    upper: Array
    lower: Array
    turned: bool = False
    yarns: tuple[Array, ...] = ()


@dataclasses.dataclass(frozen=True)
class MeasurementErrors:
    """The parts of the standard error of a diameter and a length.

    Each has its cause in the picture itself. The random part of D is the scatter of the edges that
    passes the smoothing, no less than that of the mid-line, which a body of revolution has smooth,
    and what the smoothing rounds off. The systematic part of an edge is the root of the summed
    squares of the larger of the first two and of the third, with blur s, kappa and misfit m as in
    `Quality`, each coefficient read off rendered pictures of known truth:

    - 0.018 s, s no less than 1: the shade of the outermost threads, within whose width the edge is fitted,
      beyond what the light of the first one says of it (see `EdgeProfile.shifts`);
    - the light of one lamp, where it is the larger: 0.6 of what kappa moves the edges by, on average of
      both, since light falls off as the root of the distance only on a limb that the lamp reaches; and
      0.8 s times the waves (see `EdgeProfile`) beyond the 0.055 of braids that are lit from both sides,
      as threads throw shades on a limb that is lit from the front;
    - 16 m s, of the misfit m beyond the 0.001 s^2, s up to 1.5, that threads leave within the part of the
      edge that is fitted: a lens or a camera program that spreads light otherwise than the model, as
      halo and sharpening do.

    Where black threads hide some of the edge, 0.03 px for each edge are added: dents that both sides have
    in the same rows, and what stands out beside hidden ones.

    A rim brighter than what lies inside of it adds up to 0.13 s, from 0.98 to 1.03, and so does a flank
    that falls, from -0.04 to -0.08: gloss there, or a lamp behind the muscle, looks like more of it.

    The length has the scatter of both edges along their tapes, and for each tape 0.035 px, the shade
    of the threads there, and the same 16 m s.

    A tone curve that was not stated adds 0.09 s to each edge of muscle and tapes, all alike: a third of
    what a gamma of 0.75 or 1.25 does to a step, and an S-curve of 0.8. Axis, distance and bow add
    to the length as `axis_of` says.

    What no picture shows is not in it: a tone curve that was stated and is not the camera's, and
    threads so coarse that their pattern, mirrored on both sides, passes the smoothing whole. Where
    px_per_m is below 4500 (115 px/in), D(z) of rendered braids is off by up to twice its standard
    error; length and mean diameter by 1.3 times theirs at 50 to 110 px/in.

    Attributes:
        edge: systematic part of the diameter, of both edges, common to all of it [m].
        density: of the diameter's random part along the axis, variance times length [m^3].
        ends: of the length, from the tapes' edges [m].
        scale: relative, of the scale.
    """

    edge: float
    density: float
    ends: float
    scale: float


@dataclasses.dataclass(frozen=True)
class Measurement:
    """A muscle's shape in one photograph; perspective, roll and lens are undone.

    The optical edge is the mean outline of the woven threads; a caliper touches their crests.

    Attributes:
        path: of the picture; empty for an array.
        time: when it was taken [s]; nan where that is not known.
        method: of the recipe.
        z: positions from the upper tape's edge, 0 to the length [m], shape (n,).
        diameter: D at z [m], shape (n,).
        diameter_stderr: its standard error, that of the scale included [m], shape (n,).
        length: between the inner edges of the tapes along the axis [m].
        px_per_m: scale in the mid-plane [px/m].
        roll: of the axis, clockwise positive [rad].
        x0: distance of the axis from the optical axis [m].
        errors: the parts of the standard errors.
        quality: the figures by which to judge it.
        distance: of the camera to the axis [m]: the stated one, or that of the tapes' arcs.
        distance_stderr: its standard error, 0 where it was stated [m].
        tilt, tilt_stderr: of the axis in depth, its lower end away from the camera [rad].
        bow: largest deviation of the mid-line from a straight one [m].
        warnings: what the errors do not hold, or hold only in part, in words.
        trace: the edges in the picture.
        braid: the braid angle along it; None where the recipe does not ask for it.
    """

    path: str
    time: float
    method: str
    z: Array
    diameter: Array
    diameter_stderr: Array
    length: float
    px_per_m: float
    roll: float
    x0: float
    errors: MeasurementErrors
    quality: Quality
    trace: Trace
    distance: float = math.nan
    distance_stderr: float = 0.0
    tilt: float = 0.0
    tilt_stderr: float = math.nan
    bow: float = 0.0
    warnings: tuple[str, ...] = ()
    braid: BraidAngle | None = None

    @property
    def length_stderr(self) -> float:
        """Standard error of the length [m]."""
        return math.hypot(self.errors.ends, self.length * self.errors.scale)

    @property
    def mean_diameter(self) -> float:
        """Mean of D over the length [m]."""
        return float(np.trapezoid(self.diameter, self.z) / self.length)

    @property
    def mean_diameter_stderr(self) -> float:
        """Standard error of the mean diameter [m]."""
        mean = self.mean_diameter
        at_ends = float(self.diameter[[0, -1]].mean() - mean) / self.length * self.errors.ends
        random = math.sqrt(self.errors.density / self.length)
        return math.hypot(self.errors.edge, random, at_ends, mean * self.errors.scale)

    @property
    def maximum_diameter(self) -> float:
        """Largest D [m]."""
        return float(self.diameter.max())

    @property
    def volume(self) -> float:
        """Volume within the outline by discs, integral of pi D^2 / 4 [m^3]."""
        return float(np.trapezoid(np.pi / 4 * self.diameter**2, self.z))

    @property
    def volume_stderr(self) -> float:
        """Standard error of the volume [m^3]."""
        by_edge = np.pi / 2 * float(np.trapezoid(self.diameter, self.z)) * self.errors.edge
        squared = float(np.trapezoid((np.pi / 2 * self.diameter) ** 2, self.z))
        at_ends = np.pi / 4 * float(np.mean(self.diameter[[0, -1]] ** 2)) * self.errors.ends
        random = math.sqrt(self.errors.density * squared)
        return math.hypot(by_edge, random, at_ends, 3 * self.volume * self.errors.scale)

    def triangle_angle(self, turns: float) -> float:
        """Braid angle of the cylinder of this length and mean diameter, atan(L / (pi N D)) [rad].

        Args:
            turns: N of a thread about the axis over the length [-].
        """
        return float(triangle_angle(self.length, turns, self.mean_diameter))

    def contraction(self, rest: "float | Measurement") -> tuple[float, float]:
        """Contraction (L0 - L) / L0 and its standard error.

        Args:
            rest: the rest length L0 [m], taken to be exact, or the measurement at rest in the same
                set-up, whose scale error is then common to both and cancels.
        """
        ends, scale = self.errors.ends, float(self.errors.scale)
        if isinstance(rest, Measurement):
            length = rest.length
            at_rest = rest.errors.ends
            scale = 0.0 if rest.px_per_m == self.px_per_m else math.hypot(scale, rest.errors.scale)
        else:
            length, at_rest = float(rest), 0.0
        if not length > 0:
            raise ValueError(f"the rest length must be > 0, got {length} m")
        ratio = self.length / length
        return 1 - ratio, math.hypot(ends / length, ratio * at_rest / length, ratio * scale)

    def arc_length(self) -> float:
        """Length of the outline from tape to tape [m], integral of sqrt(1 + R'^2)."""
        return float(np.hypot(np.diff(self.z), np.diff(self.diameter) / 2).sum())
