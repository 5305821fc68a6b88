"""Error bands of predictions, from held-out readings and from the parameter errors.

What a law does not know of a muscle is a smooth function of length (and of pressure), zero to within
the noise where it was measured. Between and beyond the measured lengths its variance is that of the
natural cubic spline's error (kriging with the generalised covariance |h|^3 and a linear drift), times
one number (`model_error`). The lengths that were left out tell it, and before them a prior that is the
same for every muscle: three or four lengths say little of how far a law may be off, and fewer nothing.
Readings of one length are off together, so there are as many independent errors as lengths, and the
interval is Student's. What models that fit the readings alike disagree about (`disagreement`) is added.

The parameters' own part is linear theory (delta method): with J the derivatives of the muscle's numbers
in the identified parameters and C their covariance, J C J^T is that of the numbers (`muscle_spread`). It
is kept as the columns of a root of it: independent directions of one standard deviation each.

References:
    Cressie 1993, Statistics for Spatial Data, section 5.4 (splines as kriging).
"""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.boundary.units import Quantity, Sentence, si_unit
from famjax.compile_options import as_arrays, quick_jit
from famjax.muscle import flatten

from .data import ForceData
from .engine import report_of
from .ladder import in_shared_program
from .result import Identification
from .validation import Bootstrap, LeftOut

PRIOR_SCALE = 0.08
"""Prior of what lengths add, in parts of the largest force: a law that fits a muscle to 1 % misses
the lengths beyond its map by a few per cent of the largest force."""

PRIOR_FREEDOM = 1.5
"""Number of lengths left out that the prior counts as."""

DISAGREEMENT = 1.75
"""Times the root mean square difference to the models that fit alike: half the width of what they add to
the band. Two of them may be off to the same side."""

FLOOR = 0.002
"""Of the largest force: what every band holds on either side, whatever the readings say."""

_WIENER = 12  # |h|^3 is so many times the covariance of white noise that is integrated twice
_NEAR = 1e-6  # variance of the spline one hundredth of the range from what is known


@dataclasses.dataclass(frozen=True)
class Along:
    """Contribution of one coordinate, length or pressure, to the error.

    Attributes:
        levels: measured [m or Pa], ascending.
        scale: standard deviation [N] where the spline's is 1.
        freedom: of the scale: levels that were left out, and how many the prior stands for.
    """

    levels: Float[np.ndarray, " levels"]
    scale: float
    freedom: float

    def variance(self, at: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Variance [N^2] at lengths or pressures."""
        return self.scale**2 * spline_variance(self.levels, np.asarray(at, float))

    def as_dict(self, kind: str) -> dict[str, Any]:
        """JSON-ready, SI; of "length" or "pressure"."""
        levels = {f"levels_{si_unit(kind)}": self.levels.tolist()}
        return levels | {"scale_N": self.scale, "freedom": self.freedom}


@dataclasses.dataclass(frozen=True)
class ModelError:
    """Prediction errors of single readings.

    Attributes:
        noise: standard deviation [N] at what was measured.
        length, pressure: what they add.
        floor: half the width of the narrowest band [N], see `FLOOR`.
    """

    noise: float
    length: Along
    pressure: Along
    floor: float

    def std(
        self, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, " n"]:
        """Standard deviation [N] of a reading about its prediction, disagreement of models apart."""
        added = self.length.variance(length) + self.pressure.variance(pressure)
        return np.sqrt(self.noise**2 + added)

    def factor(self) -> float:
        """Standard deviations on either side of an interval of 95 %, by Student."""
        from scipy.special import stdtrit  # noqa: PLC0415 -- SciPy takes 0.2 s to import

        return float(stdtrit(min(self.length.freedom, self.pressure.freedom), 0.975))

    def half_band(
        self,
        length: Float[np.ndarray, " n"],
        pressure: Float[np.ndarray, " n"],
        disagreement: Float[np.ndarray, " n"] | float = 0.0,
    ) -> Float[np.ndarray, " n"]:
        """Half the width [N] of the 95 % band of single readings.

        Args:
            length: [m].
            pressure: gauge [Pa].
            disagreement: root mean square difference [N] to the models that fit alike.
        """
        own = self.factor() * self.std(length, pressure)
        return np.hypot(own, DISAGREEMENT * np.asarray(disagreement) + self.floor)

    @property
    def narrowest(self) -> float:
        """Half the width [N] of the 95 % band where the model is known best, at what was measured."""
        return math.hypot(self.factor() * self.noise, self.floor)

    @property
    def covers(self) -> str:
        """One sentence about what the interval covers."""
        along = {"lengths": self.length, "pressures": self.pressure}
        judged = [name for name, one in along.items() if one.freedom > PRIOR_FREEDOM]
        seen = "assumed from other muscles"
        if judged:
            seen = f"seen on {' and '.join(judged)} left out"
        few = ". With too few lengths to leave one out, the error in length is assumed from other muscles"
        return (
            f"single readings. They include the noise of the readings, the model error {seen} (it grows "
            "with the distance from the measured states), and the disagreement of models that fit "
            f"equally well{'' if 'lengths' in judged else few}"
        )

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready, SI."""
        return {
            "noise_N": self.noise,
            "floor_N": self.floor,
            "factor_95": self.factor(),
            "length": self.length.as_dict("length"),
            "pressure": self.pressure.as_dict("pressure"),
            "covers": self.covers,
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> "ModelError":
        """Back from `as_dict`."""
        length, pressure = (
            Along(
                np.array(document[name][f"levels_{si_unit(name)}"]),
                document[name]["scale_N"],
                document[name]["freedom"],
            )
            for name in ("length", "pressure")
        )
        return cls(document["noise_N"], length, pressure, document["floor_N"])


def model_error(
    data: ForceData,
    residual: Float[np.ndarray, " points"],
    left_out: Mapping[str, LeftOut],
    unknowns: int,
) -> ModelError:
    """Prediction error model, from the errors on held-out readings.

    Args:
        data: the map.
        residual: prediction less reading [N] at the loaded readings, in sample.
        left_out: errors by "length" and "pressure", where there are any.
        unknowns: numbers that the readings determined.
    """
    freedom = max(residual.size - unknowns, 1)
    noise = math.sqrt(float(residual @ residual) / freedom)
    lengths, pressures = (
        np.unique(levels.level[data.loaded]) for levels in (data.lengths, data.pressures)
    )
    scale = PRIOR_SCALE * data.max_force
    return ModelError(
        noise,
        _along(lengths, left_out.get("length"), noise, scale),
        _along(pressures, left_out.get("pressure"), noise, scale),
        FLOOR * data.max_force,
    )


def _along(levels: np.ndarray, left_out: LeftOut | None, noise: float, prior: float) -> Along:
    """The scale at which the spline's variance gives the errors of the groups left out.

    A level beside another tells next to nothing of it: of what is left of its error without the noise,
    chance is more than its share where the prior would have it below the noise, and it counts as one
    where the two are equal.
    """
    ratios, least = [], max(_NEAR, (noise / prior) ** 2)
    if left_out is None:
        return Along(levels, prior, PRIOR_FREEDOM)
    for group in np.unique(left_out.group):
        mine = left_out.group == group
        own = np.unique(left_out.level[mine])
        others = levels[~np.isin(levels, own)]
        expected = max(float(np.mean(spline_variance(others, own))), least)
        excess = max(float(np.mean(left_out.error[mine] ** 2)) - noise**2, 0.0)
        ratios.append(excess / expected)
    freedom = PRIOR_FREEDOM + len(ratios)
    return Along(levels, math.sqrt((PRIOR_FREEDOM * prior**2 + sum(ratios)) / freedom), freedom)


def spline_variance(
    known: Float[np.ndarray, " levels"], at: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """Variance of a natural cubic spline's error, of covariance |h|^3 in parts of the range.

    Args:
        known: where the function is known, ascending.
        at: where it is wanted.

    Returns:
        Zero at what is known, growing between and, more, beyond.
    """
    span = float(np.ptp(known)) or float(known[0]) or 1.0
    x, t = (known - known[0]) / span, (np.asarray(at, float) - known[0]) / span
    if x.size == 1:  # one level tells no drift: the function is as uncertain as it is far
        return np.abs(t - x[0]) ** 3
    gap = np.diff(x)
    own, shared = _slopes(gap)
    i = np.clip(np.searchsorted(x, t, side="right") - 1, 0, gap.size - 1)
    beyond = np.maximum(np.maximum(x[0] - t, t - x[-1]), 0.0)
    h, u = gap[i], np.clip((t - x[i]) / gap[i], 0.0, 1.0)
    left, right = h * u * (1 - u) ** 2, -h * u**2 * (1 - u)  # of the slopes, as Hermite has them
    between = left**2 * own[i] + 2 * left * right * shared[i] + right**2 * own[i + 1]
    pinned = (h * u * (1 - u)) ** 3 / 3
    ends = beyond**2 * np.where(t < x[0], own[0], own[-1]) + beyond**3 / 3
    return _WIENER * (between + pinned + ends)


def _slopes(gap: Float[np.ndarray, " gaps"]) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the slope at each level, and covariance of the slopes at neighbours.

    A function whose second derivative is white noise is, between two levels, Hermite's cubic of values
    and slopes and a noise of its own. So the slopes have a tridiagonal precision, that of the cubic's
    bending energy, and a sweep from either end gives what is wanted of its inverse.
    """
    diagonal = 4 * (np.append(1 / gap, 0.0) + np.append(0.0, 1 / gap))
    beside = 2 / gap
    down, up = diagonal.copy(), diagonal.copy()
    for i in range(gap.size):
        down[i + 1] -= beside[i] ** 2 / down[i]
        up[-i - 2] -= beside[-i - 1] ** 2 / up[-i - 1]
    own = 1 / (down + up - diagonal)
    return own, -beside / down[:-1] * own[1:]


ROWS = 512
"""Rows that one call computes; fewer are filled up, more computed in parts."""


@dataclasses.dataclass(frozen=True)
class Pull:
    """Forces at lengths and pressures.

    Attributes:
        force: what the rig measures [N].
        muscle_force: of the muscle alone, were it of that length itself [N].
        std: standard deviation of `force` [N], from the parameters and from the lengths.
    """

    force: Float[np.ndarray, " n"]
    muscle_force: Float[np.ndarray, " n"]
    std: Float[np.ndarray, " n"]


def _in_rows(
    function: Callable[..., Any], length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
) -> list[np.ndarray]:
    """What a compiled function of `ROWS` lengths and pressures returns for any number of them."""
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
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    *,
    rest_length: float | None = None,
    length_std: float = 0.0,
) -> Pull:
    """Forces of a muscle, with standard errors by linear theory.

    Args:
        mounted: the identified muscle in its rig.
        spread: from `muscle_spread`; None where nothing is known of the errors.
        length: active lengths [m] as the rig measures them.
        pressure: gauge pressures [Pa].
        rest_length: L0 [m] of another muscle, which `famjax.cut_to_length` makes of it.
        length_std: standard deviation of the lengths [m].

    Returns:
        The forces, nan where the muscle has none.

    Raises:
        ValueError: the muscle cannot be cut to another length.
    """
    if spread is None:
        numbers = jax.tree.leaves(eqx.filter(mounted, eqx.is_inexact_array))
        spread = np.zeros((0, sum(np.size(one) for one in numbers)))
    rig = "gives way" if np.asarray(mounted.compliance).any() else "rigid"
    of = None if rest_length is None else np.asarray(rest_length)
    arrays, std = as_arrays(mounted), np.asarray(length_std)
    return Pull(*_in_rows(lambda L, P: _pull(arrays, of, spread, std, L, P, rig), length, pressure))


def force_of(
    mounted: famjax.MountedMuscle,
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """What the rig measures [N] at lengths [m] and pressures [Pa]; nan where there is no force."""
    whole = in_shared_program(mounted)
    rigid = whole is mounted and not np.asarray(mounted.compliance).any()
    muscle = as_arrays(mounted.muscle if rigid else whole)
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
    spread: Array | np.ndarray,
    length_std: Array | np.ndarray,
    length: Array | np.ndarray,
    pressure: Array | np.ndarray,
    rig: str,
) -> tuple[Array, Array, Array]:
    flat, unflat = flatten(mounted)

    def alone(mounted: famjax.MountedMuscle) -> famjax.AbstractMuscle:
        if rest_length is None:
            return mounted.muscle
        return famjax.cut_to_length(mounted.muscle, rest_length)

    def force(flat: Array, length: Array) -> Array:
        changed = unflat(flat)
        one = alone(changed)
        if rig == "gives way":
            return changed.with_muscle(one).force(length, pressure)
        return one.force(length, pressure)

    def along(direction: Array, lengths: Array) -> tuple[Array, Array]:
        return jax.jvp(force, (flat, jnp.asarray(length)), (direction, lengths))

    # One direction more: all lengths together by their standard deviation.
    directions = jnp.concatenate([spread, jnp.zeros((1, flat.size))])
    last = jnp.broadcast_to(length_std, (1, len(length)))
    lengths = jnp.concatenate([jnp.zeros((len(spread), len(length))), last])
    found, slopes = jax.vmap(along, out_axes=(None, 0))(directions, lengths)
    std = jnp.sqrt(jnp.sum(slopes**2, axis=0))
    muscle_force = alone(mounted).force(length, pressure) if rig == "gives way" else found
    return found, muscle_force, std


_NEGLIGIBLE = 1e-12  # of the largest variance of independent directions: rounding


def muscle_spread(
    result: Identification, drawn: Bootstrap | None = None
) -> Float[np.ndarray, "directions numbers"]:
    """Directions in which the numbers of the mounted muscle vary, one standard deviation each.

    Args:
        result: an identification. What is held or at a bound does not vary.
        drawn: its bootstrap, whose covariance then takes the place of that of linear theory.

    Returns:
        One row for each independent direction, of the arrays of `result.mounted` one after another; no
        rows where there are no standard errors.
    """
    covariance = result.covariance
    if drawn is not None:
        problem = result.problem
        moving = [*problem.free, *range(len(problem.names), len(covariance))]
        covariance = np.full_like(covariance, np.nan)
        covariance[np.ix_(moving, moving)] = np.cov(drawn.samples.T)
    return (numbers_by_parameters(result) @ _root(covariance)).T


def numbers_by_parameters(result: Identification) -> Float[np.ndarray, "numbers p"]:
    """Derivatives of the mounted muscle's numbers, the rig's last, in parameters and coefficients."""
    problem, point = result.problem, result.end.point
    part, q = problem.parts[result.place], len(problem.names)
    slope = report_of(part, point, result.place).d_numbers
    own = len(slope)
    # A rigid rig has a compliance too, which does not vary.
    slopes = np.zeros((own + max(len(part.rig), 1), q + point.x.size))
    np.add.at(slopes[:own].T, part.at, slope[:, : part.at.size].T)
    slopes[:own, q + part.coefficients] = slope[:, part.at.size :]
    for place, of_rig in enumerate(part.rig, own):
        slopes[place, of_rig] = 1.0
    return slopes


def _root(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p directions"]:
    """R with R R^T = C; rows of what has no variance are zero."""
    std = np.sqrt(np.diag(covariance))
    std = np.where(std > 0, std, 0.0)
    scale = np.outer(std, std)
    correlation = np.where(scale > 0, covariance / np.where(scale > 0, scale, 1.0), 0.0)
    variance, directions = np.linalg.eigh(correlation)
    kept = variance > _NEGLIGIBLE * max(variance.max(initial=0.0), _NEGLIGIBLE)
    return std[:, None] * directions[:, kept] * np.sqrt(variance[kept])


TELLING = 0.03
"""Of the largest force: a disagreement of so much is worth a reading that settles it."""
_STATES = 9  # in each gap between lengths


def disagreement(
    force: Float[np.ndarray, " n"],
    alike: Collection[famjax.MountedMuscle],
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    """Root mean square difference [N] of muscles from a force; 0 where there are none.

    Args:
        force: of the model that predicts [N].
        alike: muscles, in their rigs, that fit the readings as well.
        length: [m].
        pressure: gauge [Pa].
    """
    if not alike:
        return np.zeros_like(force)
    # A muscle that has no force at a state says nothing of it.
    others = np.stack([force_of(one, length, pressure) for one in alike])
    squares = np.where(np.isfinite(others), (others - force) ** 2, 0.0)
    return np.sqrt(squares.sum(axis=0) / np.maximum(np.isfinite(others).sum(axis=0), 1))


def where_they_differ(
    data: ForceData, chosen: famjax.MountedMuscle, alike: Collection[famjax.MountedMuscle]
) -> Sentence | str:
    """Where models that fit equally well differ most between the measured lengths, if they differ much.

    Args:
        data: the map.
        chosen: the model that predicts.
        alike: see `disagreement`.

    Returns:
        A sentence that names the readings that would settle it; "" where they agree to 3 % of the
        largest force.
    """
    lengths = np.unique(data.lengths.level[data.loaded])
    if not alike or lengths.size < 2:
        return ""
    part = np.arange(1, _STATES) / _STATES
    L = (lengths[:-1, None] + part * np.diff(lengths)[:, None]).ravel()
    P = np.full(L.size, data.pressure[data.loaded].max())
    force = force_of(chosen, L, P)
    differ = np.where(force > 0, disagreement(force, alike, L, P), 0.0)
    worst = int(np.argmax(differ))
    if not differ[worst] > TELLING * data.max_force:
        return ""
    gap = worst // part.size
    low, high = lengths[gap], lengths[gap + 1]
    return Sentence(
        "Models that fit the readings alike differ by ",
        Quantity(float(differ[worst]), "force", 2),
        f" ({100 * differ[worst] / data.max_force:.2g} % of the largest force) between the lengths ",
        Quantity(float(low), "length"),
        " and ",
        Quantity(float(high), "length"),
        ", most at ",
        Quantity(float(L[worst]), "length", 4),
        ": readings at one more length there would settle it; until then trust the band, not the curve.",
    )
