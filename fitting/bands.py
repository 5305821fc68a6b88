"""Compute error bands for predictions, using held-out readings and parameter errors.

The unknown model error is treated as a smooth function of length and of pressure. At measured levels it is
zero to within the noise. Elsewhere, its variance is a scale (see `model_error`) times the error variance of
a natural cubic spline (kriging with the generalised covariance |h|^3 and a linear drift). The scale is
estimated from held-out levels. Three or four levels provide little information, so the estimate is combined
with a prior that is the same for all muscles. Readings at the same length share a common error, so each
length counts as one independent observation. The interval uses Student's t distribution. The disagreement
between models that fit equally well widens the band (see `disagreement`).

Parameter errors are computed by linear theory (the delta method). Let J be the derivatives of the values
stored in the muscle with respect to the identified parameters, and C the covariance of these parameters.
Then J C J^T is the covariance of the stored values (see `muscle_spread`). It is kept as a square root,
whose rows are independent directions, each one standard deviation long.

References:
    Cressie 1993, Statistics for Spatial Data, section 5.4 (splines as kriging).
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.boundary.units import Quantity, Sentence
from famjax.compile_options import as_arrays, quick_jit
from famjax.muscle import flatten

from .data import ForceData
from .engine import report_of
from .result import Identification
from .validation import Bootstrap, LeftOut

Column: TypeAlias = Float[np.ndarray, " n"]
"""Values at any number of states."""

PRIOR_SCALE = 0.08
"""Prior value for the scale of the error over length, relative to the largest force. A law that fits to
within 1 % is typically wrong by a few per cent at lengths outside the measured map."""

PRIOR_FREEDOM = 1.5
"""Number of held-out lengths that together carry the same weight as the prior."""

_MOST_LEVELS = 128  # of a kind, with which an error between levels is estimated
DISAGREEMENT = 1.75
"""Half-width added to the band, divided by the root mean square difference from models that fit equally
well. This ratio exceeds 1 because two such models may err in the same direction."""

FLOOR = 0.002
"""Smallest half-width of a band, relative to the largest force."""


@functools.cache
def student_factor(freedom: float) -> float:
    """Return the half-width of the 95 % interval of Student's t, in standard deviations.

    It agrees with `scipy.special.stdtrit(freedom, 0.975)` to 1e-9 up to 10 000 degrees of freedom, but
    avoids SciPy's import time of 0.2 s. With t = sqrt(n) tan(a), the probability of |t| is proportional to
    the integral of cos(a)^(n - 1) from 0 to a. It is concave in a, so Newton's method converges from below.
    """
    node, weight = np.polynomial.legendre.leggauss(40)
    scale = (
        2 / math.sqrt(math.pi) * math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2))
    )
    angle = math.atan(1.96 / math.sqrt(freedom))
    for _ in range(10):
        density = np.cos(angle / 2 * (1 + node)) ** (freedom - 1)
        covered = scale * angle / 2 * float(weight @ density)
        angle += (0.95 - covered) / (scale * math.cos(angle) ** (freedom - 1))
    return math.sqrt(freedom) * math.tan(angle)


@dataclasses.dataclass(frozen=True)
class Along:
    """Contribution of one coordinate (length or pressure) to the prediction error.

    Attributes:
        levels: measured levels [m or Pa], ascending.
        scale: standard deviation [N] at a point where the standard deviation of the spline is 1.
        freedom: degrees of freedom of the scale: number of held-out levels plus `PRIOR_FREEDOM`.
    """

    levels: Float[np.ndarray, " levels"]
    scale: float
    freedom: float

    def variance(self, at: Column) -> Column:
        """Return the variance [N^2] at the given lengths or pressures."""
        return self.scale**2 * spline_variance(self.levels, np.asarray(at, float))


@dataclasses.dataclass(frozen=True)
class ModelError:
    """Prediction error for single readings.

    Attributes:
        noise: standard deviation [N] at measured states.
        length, pressure: contributions that grow with distance from measured lengths and pressures.
        floor: smallest half-width of a band [N], see `FLOOR`.
    """

    noise: float
    length: Along
    pressure: Along
    floor: float

    def std(self, length: Column, pressure: Column) -> Column:
        """Return the standard deviation [N] of a reading about its prediction by the chosen model."""
        added = self.length.variance(length) + self.pressure.variance(pressure)
        return np.sqrt(self.noise**2 + added)

    def factor(self) -> float:
        """Return the half-width of the 95 % interval of Student's t, in standard deviations."""
        return student_factor(min(self.length.freedom, self.pressure.freedom))

    def half_band(
        self, length: Column, pressure: Column, disagreement: Column | float = 0.0
    ) -> Column:
        """Return the half-width [N] of the 95 % band for single readings.

        Args:
            length: active lengths [m].
            pressure: gauge pressures [Pa].
            disagreement: root mean square difference [N] from models that fit equally well.
        """
        own = self.factor() * self.std(length, pressure)
        return np.hypot(own, DISAGREEMENT * np.asarray(disagreement) + self.floor)

    @property
    def narrowest(self) -> float:
        """Half-width [N] of the 95 % band at measured states, where the model is best known."""
        return math.hypot(self.factor() * self.noise, self.floor)

    @property
    def covers(self) -> str:
        """Description of the errors that the interval covers."""
        along = {"lengths": self.length, "pressures": self.pressure}
        judged = [name for name, one in along.items() if one.freedom > PRIOR_FREEDOM]
        seen = (
            f"estimated from held-out {' and '.join(judged)}"
            if judged
            else "assumed from other muscles"
        )
        few = (
            ""
            if "lengths" in judged
            else ". There are too few lengths to estimate the error between lengths, so a value typical of "
            "other muscles is used"
        )
        grows = "it grows with distance from the measured states"
        included = f"the noise of the readings, the model error {seen} ({grows})"
        alike = "the disagreement between models that fit equally well"
        return f"single readings. They include {included}, and {alike}{few}"

    def as_dict(self) -> dict[str, Any]:
        """Return the error as a JSON-ready dictionary in SI units."""
        document: dict[str, Any] = dataclasses.asdict(self)
        for kind in ("length", "pressure"):
            document[kind]["levels"] = document[kind]["levels"].tolist()
        return document | {"units": "SI", "covers": self.covers, "factor_95": self.factor()}

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "ModelError":
        """Create a `ModelError` from the output of `as_dict`."""
        kinds = ("length", "pressure")
        along = {
            k: Along(**document[k] | {"levels": np.array(document[k]["levels"])}) for k in kinds
        }
        return cls(noise=document["noise"], floor=document["floor"], **along)


def model_error(
    data: ForceData,
    residual: Float[np.ndarray, " points"],
    left_out: Mapping[str, LeftOut],
    unknowns: int,
) -> ModelError:
    """Estimate the prediction error from held-out readings.

    Args:
        data: the map.
        residual: in-sample prediction minus reading [N] at the loaded readings.
        left_out: held-out errors, under the keys "length" and "pressure"; either key may be missing.
        unknowns: number of fitted parameters.
    """
    freedom = max(residual.size - unknowns, 1)
    noise = math.sqrt(float(residual @ residual) / freedom)
    scale = PRIOR_SCALE * data.max_force
    length, pressure = (
        _along(np.unique(data.levels(kind)[data.loaded]), left_out.get(kind), noise, scale)
        for kind in ("length", "pressure")
    )
    return ModelError(noise, length, pressure, FLOOR * data.max_force)


def _along(levels: np.ndarray, left_out: LeftOut | None, noise: float, prior: float) -> Along:
    """Estimate the scale at which the spline's variance matches the errors of held-out groups.

    A level close to another carries little information. Where the expected error is below the noise, the
    excess is mostly chance, so the expected variance is bounded below by the noise.
    """
    if levels.size > _MOST_LEVELS:
        levels = levels[np.linspace(0, levels.size - 1, _MOST_LEVELS).round().astype(int)]
    ratios, least = [], max(1e-6, (noise / prior) ** 2)
    if left_out is None:
        return Along(levels, prior, PRIOR_FREEDOM)
    for group in np.unique(left_out.group):
        mine = left_out.group == group
        own = np.unique(left_out.level[mine])
        others = levels[(levels < own[0]) | (levels > own[-1])]
        expected = max(float(np.mean(spline_variance(others, own))), least)
        excess = max(float(np.mean(left_out.error[mine] ** 2)) - noise**2, 0.0)
        ratios.append(excess / expected)
    freedom = PRIOR_FREEDOM + len(ratios)
    return Along(levels, math.sqrt((PRIOR_FREEDOM * prior**2 + sum(ratios)) / freedom), freedom)


def spline_variance(known: Float[np.ndarray, " levels"], at: Column) -> Column:
    """Return the error variance of a natural cubic spline (kriging with covariance |h|^3).

    Args:
        known: levels at which the function is known, ascending; their range serves as the unit.
        at: levels at which the variance is evaluated.

    Returns:
        The variance: zero at the known levels, larger between them, and largest outside their range.
    """
    span = float(np.ptp(known)) or float(known[0]) or 1.0
    x, t = (known - known[0]) / span, (np.asarray(at, float) - known[0]) / span
    if x.size == 1:  # one level does not determine a drift
        return np.abs(t - x[0]) ** 3
    drift = np.vander(x, 2)
    system = np.block([[np.abs(x[:, None] - x) ** 3, drift], [drift.T, np.zeros((2, 2))]])
    right = np.vstack([np.abs(x[:, None] - t) ** 3, np.vander(t, 2).T])
    return np.maximum(-np.sum(right * np.linalg.solve(system, right), axis=0), 0.0)


ROWS = 512
"""Number of rows in each compiled call; fewer rows are padded, and more are split into several calls."""


def _in_rows(function: Callable[..., Any], length: Column, pressure: Column) -> list[np.ndarray]:
    """Evaluate a function, compiled for `ROWS` states, at any number of lengths and pressures."""
    parts = []
    for start in range(0, len(length), ROWS):
        rows = [values[start : start + ROWS] for values in (length, pressure)]
        count = len(rows[0])
        found = function(*(np.pad(values, (0, ROWS - count), "edge") for values in rows))
        parts.append([np.asarray(column)[:count] for column in found])
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]


def pull(
    mounted: famjax.MountedMuscle,
    spread: Float[np.ndarray, "directions numbers"] | None,
    length: Column,
    pressure: Column,
    *,
    rest_length: float | None = None,
) -> tuple[Column, Column]:
    """Predict the forces [N] that the rig measures, and their standard errors [N]; nan where undefined.

    The standard errors are computed by linear theory.

    Args:
        mounted: the identified muscle in its rig.
        spread: output of `muscle_spread`; None if the errors are unknown.
        length: active lengths [m] as measured by the rig.
        pressure: gauge pressures [Pa].
        rest_length: rest length L0 [m] if the muscle is cut to a different length, see
            `famjax.cut_to_length`.

    Raises:
        ValueError: the muscle cannot be cut to a different length.
    """
    rig = "compliant" if np.asarray(mounted.compliance).any() else "rigid"
    of = None if rest_length is None else np.asarray(rest_length)
    arrays = as_arrays(mounted)
    force, std = _in_rows(lambda L, P: _pull(arrays, of, spread, L, P, rig), length, pressure)
    return force, std


def force_of(mounted: famjax.MountedMuscle, length: Column, pressure: Column) -> Column:
    """Predict the force [N] measured by the rig at lengths [m] and pressures [Pa]; nan where undefined."""
    muscle = as_arrays(mounted if np.asarray(mounted.compliance).any() else mounted.muscle)
    found = _in_rows(lambda L, P: [_force(muscle, L, P)], length, pressure)
    return found[0] if found else np.zeros(0)


@quick_jit
def _force(
    muscle: famjax.AbstractMuscle, length: Array | np.ndarray, pressure: Array | np.ndarray
) -> Array:
    return muscle.force(length, pressure)


@quick_jit
def _pull(
    mounted: famjax.MountedMuscle,
    rest_length: Array | np.ndarray | None,
    spread: Array | np.ndarray | None,
    length: Array | np.ndarray,
    pressure: Array | np.ndarray,
    rig: str,
) -> tuple[Array, Array]:
    flat, unflat = flatten(mounted)

    def force(flat: Array) -> Array:
        changed = unflat(flat)
        one = changed.muscle
        if rest_length is not None:
            one = famjax.cut_to_length(one, rest_length)
        whole = changed.with_muscle(one) if rig == "compliant" else one
        return whole.force(length, pressure)

    if spread is None:
        return force(flat), jnp.zeros(len(length))
    found, along = jax.linearize(force, flat)
    return found, jnp.sqrt(jnp.sum(jax.vmap(along)(jnp.asarray(spread)) ** 2, axis=0))


def muscle_spread(
    result: Identification, drawn: Bootstrap | None = None
) -> Float[np.ndarray, "directions numbers"]:
    """Return directions in which the mounted muscle's stored values vary, each one standard deviation long.

    Args:
        result: an identification. Parameters that are held fixed or at a bound do not vary.
        drawn: bootstrap of this identification. If given, its covariance replaces that of linear theory.

    Returns:
        One row for each independent direction. Its columns correspond to the concatenated arrays in
        `result.mounted`. Without standard errors, there are no rows.
    """
    covariance = result.covariance
    if drawn is not None:
        problem = result.problem
        moving = [*problem.free, *range(len(problem.names), len(covariance))]
        covariance = np.full_like(covariance, np.nan)
        covariance[np.ix_(moving, moving)] = np.cov(drawn.samples.T)
    return (numbers_by_parameters(result) @ _root(covariance)).T


def numbers_by_parameters(result: Identification) -> Float[np.ndarray, "numbers p"]:
    """Return the derivatives of the mounted muscle's values (the rig's last) with respect to unknowns."""
    problem, point = result.problem, result.end.point
    part, q = problem.parts[result.place], len(problem.names)
    slope = report_of(part, point, result.place).d_numbers
    own = len(slope)
    # A rigid rig has a fixed compliance.
    slopes = np.zeros((own + max(len(part.rig), 1), q + point.x.size))
    np.add.at(slopes[:own].T, part.at, slope[:, : part.at.size].T)
    slopes[:own, q + part.coefficients] = slope[:, part.at.size :]
    for place, of_rig in enumerate(part.rig, own):
        slopes[place, of_rig] = 1.0
    return slopes


def _root(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p directions"]:
    """Return R with R R^T = C; rows without variance are zero."""
    std = np.nan_to_num(np.sqrt(np.diag(covariance)))
    scale = np.outer(std, std)
    correlation = np.where(scale > 0, covariance / np.where(scale > 0, scale, 1.0), 0.0)
    variance, directions = np.linalg.eigh(correlation)
    kept = variance > 1e-12 * max(variance.max(initial=0.0), 1e-12)
    return std[:, None] * directions[:, kept] * np.sqrt(variance[kept])


TELLING = 0.03
"""Disagreement, relative to the largest force, above which another reading is worthwhile."""


def disagreement(
    force: Column, alike: Collection[famjax.MountedMuscle], length: Column, pressure: Column
) -> Column:
    """Return the RMS difference [N] between a force and those of other muscles; 0 if there are none.

    Args:
        force: force [N] from the model used for predictions.
        alike: mounted muscles that fit the readings equally well.
        length: active lengths [m].
        pressure: gauge pressures [Pa].
    """
    if not alike:
        return np.zeros_like(force)
    # Muscles without a force at a state are ignored there.
    others = np.stack([force_of(one, length, pressure) for one in alike])
    squares = np.where(np.isfinite(others), (others - force) ** 2, 0.0)
    return np.sqrt(squares.sum(axis=0) / np.maximum(np.isfinite(others).sum(axis=0), 1))


def where_they_differ(
    data: ForceData, chosen: famjax.MountedMuscle, alike: Collection[famjax.MountedMuscle]
) -> Sentence | str:
    """Find where models that fit equally well differ most between the measured lengths.

    Args:
        data: the map.
        chosen: the model used for predictions.
        alike: see `disagreement`.

    Returns:
        A sentence that says where to measure; "" if the models agree to within 3 % of the largest force.
    """
    lengths = np.unique(data.lengths.level[data.loaded])
    if not alike or lengths.size < 2:
        return ""
    part = np.arange(1, 9) / 9
    L = (lengths[:-1, None] + part * np.diff(lengths)[:, None]).ravel()
    P = np.full(L.size, data.pressure[data.loaded].max())
    force = force_of(chosen, L, P)
    differ = np.where(force > 0, disagreement(force, alike, L, P), 0.0)
    worst = int(np.argmax(differ))
    if not differ[worst] > TELLING * data.max_force:
        return ""
    gap = worst // part.size
    return Sentence(
        *(
            "Models that fit equally well differ by up to ",
            Quantity(float(differ[worst]), "force", 2),
        ),
        f" ({100 * differ[worst] / data.max_force:.2g} % of the largest force) between the lengths ",
        *(Quantity(float(lengths[gap]), "length"), " and "),
        *(Quantity(float(lengths[gap + 1]), "length"), ", most at "),
        Quantity(float(L[worst]), "length", 4),
        ". Take readings at one more length in this interval. Until then, rely on the error band "
        "rather than on the predicted curve.",
    )
