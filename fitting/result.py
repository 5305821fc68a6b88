"""Result of an identification: parameters with units, errors, certificate and warnings."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import Quantity, Sentence
from famjax.slip import CentredSlip

from .arguments import shown
from .covariance import CONDITION_LIMIT
from .data import ForceData
from .engine import predict
from .families import Law
from .parameters import standard_table
from .pictured import PictureFit
from .problem import Problem
from .response import Constraint
from .search import End

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclasses.dataclass(frozen=True)
class Estimate:
    """One identified parameter.

    Attributes:
        name: name of the parameter.
        value: value in SI.
        stderr: standard error in SI, the larger of the usual and the sandwich estimate; nan if there is
            none (held, at a bound, or not identifiable).
        min, max: bounds in SI; infinite if there are none.
        at_bound: true if the optimum is at a bound, and the data alone would place it beyond the bound.
        fixed: true if held at a given value.
        kind: type of unit, such as "length" or "pressure".
        prior: (mean, standard deviation) of the prior in SI, or None.
    """

    name: str
    value: float
    stderr: float
    min: float
    max: float
    at_bound: bool
    fixed: bool
    kind: str
    prior: tuple[float, float] | None = None


@dataclasses.dataclass(frozen=True)
class Errors:
    """Errors of the model at the loaded readings, in N.

    Attributes:
        rmse, max: root mean square and largest error [N].
        max_force: largest measured force [N], the reference for percentages.
        n_points: number of loaded readings.
        max_slack_force: largest force [N] of the model at a slack reading, or 0.
    """

    rmse: float
    max: float
    max_force: float
    n_points: int
    max_slack_force: float

    @property
    def rmse_percent(self) -> float:
        """RMSE in % of the largest force."""
        return 100 * self.rmse / self.max_force


@dataclasses.dataclass(frozen=True)
class Certificate:
    """Evidence of optimality and stability.

    Attributes:
        kkt_residual: residual of the convex fit of the coefficients, relative to the data.
        duality_gap: duality gap of the convex fit relative to its objective; 0 means globally optimal.
        gradient_residual: largest cosine between the residual and a free direction of the geometry.
        condition: condition number of the scaled Jacobian of all free parameters.
        stability_margin: smallest modulus along any actuation path [Pa], including between stations;
            Drucker-stable when >= 0.
        constraint_margin: smallest slack [Pa] of the requested constraint; nan if none was requested.
        n_starts: number of descents.
        n_agreeing: number of descents within 1e-6 of the best objective.
        shape_margin: smallest stiffness [N/m] of the equilibrium shapes at the loaded readings; all shapes
            are stable if it is > 0, and the optimum is only local. nan for a shape not computed from
            mechanics.
    """

    kkt_residual: float
    duality_gap: float
    gradient_residual: float
    condition: float
    stability_margin: float
    constraint_margin: float
    n_starts: int
    n_agreeing: int
    shape_margin: float = math.nan


@dataclasses.dataclass(frozen=True)
class Solved:
    """The problem with its stations, and the end point of the best descent."""

    problem: Problem
    end: End


@dataclasses.dataclass(frozen=True)
class Outlook:
    """Data needed for predictions, apart from the muscle itself.

    Attributes:
        error: prediction error, a `fitting.bands.ModelError`, or None without held-out readings.
        directions: directions in which the muscle's stored values vary, see `muscle_spread`; None to
            compute them by linear theory.
        bootstrap: true if the directions come from bootstrap replicates.
        shared: directions of errors shared by all readings.
        others: further mounted muscles; a prediction is the weighted mean over the muscle and these.
        weights: weights of the muscle and of the others.
        alike: mounted muscles, keyed by family, that fit the readings equally well; the band includes
            their disagreement.
        other_lengths: mounted muscles, keyed by family, whose mean predicts other lengths; empty if
            other lengths cannot be predicted.
        between: standard deviation [N] of another specimen about that mean.
        hysteresis: hysteresis about the muscle's force, or None.
        branches_error: RMS error [N] of the branches: the largest held-out error or, if there is none, the
            in-sample error.
        series: data on a series from `fit.json`.
    """

    error: Any = None
    directions: Float[np.ndarray, "directions numbers"] | None = None
    bootstrap: bool = False
    shared: Float[np.ndarray, "sources numbers"] | None = None
    others: tuple[famjax.MountedMuscle, ...] = ()
    weights: tuple[float, ...] = (1.0,)
    alike: Mapping[str, famjax.MountedMuscle] = dataclasses.field(default_factory=dict)
    other_lengths: Mapping[str, famjax.MountedMuscle] = dataclasses.field(default_factory=dict)
    between: float = math.nan
    hysteresis: CentredSlip | None = None
    branches_error: float = math.nan
    series: Mapping[str, Any] | None = None


@dataclasses.dataclass(frozen=True, repr=False)
class Identification:
    """An identified muscle, returned by `identify` or read back by `load_fit`.

    Attributes:
        data: the force map.
        mounted: the model in its rig, with compliance 0 for a rigid rig.
        estimates: geometry parameters, then coefficients.
        derived: quantities derived from the geometry (thread length, turns), with errors.
        coefficients: E_n [Pa], shape (1, order).
        strain_range: largest strain magnitude at which the law was evaluated.
        residuals: model minus measurement [N] at the loaded readings.
        errors: summary of the residuals.
        certificate: optimality and stability.
        active_constraints: one phrase for each active constraint.
        law: the bladder law.
        constraint, seed: options of the fit.
        weights: factor applied to the weight of each loaded reading; below 1 only for outliers under the
            Huber objective.
        converged: true if the best descent is stationary, certified and feasible.
        degrees_of_freedom: readings and priors of all specimens minus the free directions.
        names: names of the nonlinear parameters.
        covariance: covariance of the nonlinear parameters and the coefficients [SI], by linear theory; nan
            for a parameter that is held, at a bound, or not identifiable.
        place: index of this specimen among the parts of the problem.
        solved: problem and end point of the best descent, or a function that rebuilds both.
        pictures: photographed and computed profiles, if both were fitted together.
        outlook: data for predictions.
        document: content of the `fit.json` that was read back, in SI; empty otherwise.
    """

    data: ForceData
    mounted: famjax.MountedMuscle
    estimates: tuple[Estimate, ...]
    derived: tuple[Estimate, ...]
    coefficients: Float[np.ndarray, "1 order"]
    strain_range: float
    residuals: Float[np.ndarray, " points"]
    errors: Errors
    certificate: Certificate
    active_constraints: tuple[str, ...]
    law: Law
    constraint: Constraint
    seed: int
    weights: Float[np.ndarray, " readings"]
    converged: bool
    degrees_of_freedom: int
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "k k"]
    place: int
    solved: Solved | Callable[[], Solved]
    pictures: PictureFit | None = None
    outlook: Outlook = Outlook()
    document: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __repr__(self) -> str:
        numbers = ", ".join(f"{one.name}={one.value:.5g}" for one in self.estimates)
        return (
            f"Identification({self.data.specimen.name}: {self.law.name}, RMSE {self.errors.rmse:.4g} N "
            f"over {self.errors.n_points} readings, converged={self.converged}, in SI {numbers})"
        )

    @functools.cached_property
    def warnings(self) -> tuple[str, ...]:
        """Remarks to read before the results are used."""
        return tuple(one.sentence for one in remarks(self))

    @functools.cached_property
    def _solved(self) -> Solved:
        return self.solved if isinstance(self.solved, Solved) else self.solved()

    @property
    def problem(self) -> Problem:
        """The problem that was solved."""
        return self._solved.problem

    @property
    def end(self) -> End:
        """End point of the best descent; `end.u` are the free nonlinear parameters scaled to [0, 1]."""
        return self._solved.end

    @property
    def counted(self) -> Bool[np.ndarray, " readings"]:
        """True for loaded readings, except outliers under the Huber objective."""
        return self.weights >= 0.25  # a lower weight means 5 standard deviations or more

    @property
    def counted_rmse(self) -> float:
        """Root mean square error [N] of the readings in `counted`."""
        return math.sqrt(float(np.mean(self.residuals[self.counted] ** 2)))

    @property
    def deflection(self) -> float:
        """Deflection [m] of a compliant rig at the largest measured force; 0 if the rig is rigid."""
        return float(self.mounted.gives_way(self.errors.max_force))

    @property
    def stopped(self) -> tuple[str, ...]:
        """Names of the parameters at a bound."""
        return tuple(one.name for one in self.estimates if one.at_bound)

    @property
    def muscle(self) -> "famjax.Muscle | famjax.EquilibriumMuscle":
        """The model; a differentiable function of length and pressure."""
        # Types as text: `famjax.EquilibriumMuscle` takes 0.2 s to import.
        return cast("famjax.Muscle | famjax.EquilibriumMuscle", self.mounted.muscle)

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Names of all coefficients of the problem, with the node number if there are several nodes."""
        names, count = tuple(self.law.coefficients), len(self.covariance) - len(self.names)
        if count == len(names):
            return names
        nodes = range(1, 1 + count // len(names))
        return tuple(f"{name}_at_node_{k}" for k in nodes for name in names)

    @property
    def n_parameters(self) -> int:
        """Number of fitted parameters, including coefficients of all nodes."""
        return sum(not one.fixed for one in self.estimates)

    def _repr_html_(self) -> str:
        from .report import Findings  # noqa: PLC0415 -- it draws

        return Findings(self).html()

    def plot(self, axes: "Axes | None" = None, system: str = "metric") -> "Axes":
        """Plot readings and model against contraction; see `plot_isobars`."""
        from .report import plot_isobars  # noqa: PLC0415 -- it draws

        return plot_isobars(self, axes, system)

    def predict(
        self, length: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
    ) -> Float[np.ndarray, "..."]:
        """Return the unclipped force [N] that the rig would measure at lengths [m] and pressures [Pa].

        Pressures are gauge pressures. Lengths and pressures are broadcast against each other.
        """
        point = self.end.point
        L, P = np.broadcast_arrays(np.asarray(length, float), np.asarray(pressure, float))
        force = predict(self.problem, self.place, point.parameters, point.x, L.ravel(), P.ravel())
        return force.reshape(L.shape)

    def estimate(self, name: str) -> Estimate:
        """Return the estimate with this name.

        Raises:
            KeyError: there is no such parameter.
        """
        known = {one.name: one for one in self.estimates + self.derived}
        if name not in known:
            raise KeyError(f"unknown parameter {name!r}; available: {', '.join(known)}")
        return known[name]


def check_identified(result: object) -> None:
    """Reject objects other than results of `identify` or `load_fit`.

    Raises:
        InputError: another object was given.
    """
    if not isinstance(result, Identification):
        needed = "a result of fitting.identify or fitting.load_fit, or the `chosen` attribute of a Choice"
        raise InputError(f"expected {needed}, got {shown(result)}")


_GEOMETRY = ("braid_diameter", "braid_angle", "deadband_pressure", "rest_length", "end_factor")
_SOFT = (
    0.25  # of the stroke; a deflection above it is doubted: test rigs give way by a few per cent
)
_PLAIN_AT = {
    "deadband_pressure": "low", "end_factor": "low", "end_length": "low", "braid_compliance": "low",
    "series_compliance": "low", "series_exponent": "high",
}  # fmt: skip
"""Bounds at which an effect is absent; an estimate at such a bound does not make the fit doubtful."""


class Remark(NamedTuple):
    """A sentence about a fit, and its severity: note (0), warning (1) or serious (2)."""

    level: int
    sentence: str


def equivalent_sizes(result: Identification) -> list[str]:
    """Return the braid dimensions outside the usual range, which describe an equivalent cylinder."""
    usual = standard_table(result.data.specimen)
    return [
        e.name for e in result.estimates
        if e.name in ("braid_diameter", "braid_angle")
        and not usual[e.name].min <= e.value <= usual[e.name].max
    ]  # fmt: skip


def of_parameters(result: Identification) -> list[Remark]:
    """Return remarks about parameters that the data do not determine, and about an unstable law."""
    estimates, certificate = result.estimates, result.certificate
    stuck = [one.name for one in estimates if one.at_bound and not _plain(one)]
    absent = [one.name for one in estimates if one.at_bound and _plain(one)]
    beyond = equivalent_sizes(result)
    found: tuple[tuple[Any, int, str], ...] = (
        (beyond, 0, f"The values of {' and '.join(beyond)} describe an equivalent cylinder, which accounts "
         "for the rounded ends and the wall. They are not dimensions of the braid. The cylinder's volume "
         "differs from the muscle's; only the changes in volume agree."),
        (stuck, 1, f"{', '.join(stuck)}: at a bound. The best fit would lie beyond it, so no standard "
         "error is available there. The other standard errors assume the value at the bound."),
        (absent, 0, f"{', '.join(absent)}: the readings show no such effect. The other standard errors "
         "assume that there is none."),
        (not certificate.condition <= CONDITION_LIMIT, 1, "These data do not determine every parameter "
         "separately, so there are no standard errors. Fix a parameter with --bounds, or measure at more "
         "lengths and pressures."),
        *((abs(e.value - e.prior[0]) > 2.0 * e.prior[1], 0,
           f"{e.name} is {abs(e.value - e.prior[0]) / e.prior[1]:.1f} standard deviations from the mean "
           "of its prior. Either the prior is too narrow, or the parameter compensates for a model error.")
          for e in estimates if e.prior is not None),
        *((True, level, ridge) for level, ridge in _ridges(result)),
        (result.active_constraints, 0, "A constraint on the coefficients is active: their standard errors "
         "are valid only for changes along this constraint."),
        (isinstance(result.muscle, famjax.Muscle) and not certificate.stability_margin
         >= -1e-9 * float(np.abs(result.coefficients).max(initial=0.0)), 1,
         Sentence("The law is NOT Drucker-stable on the actuation path (margin ",
                  Quantity(certificate.stability_margin, "stress"), "). Do not extrapolate or simulate "
                  "with it; --constraint drucker finds the best stable law.")),
    )  # fmt: skip
    return [Remark(level, sentence) for applies, level, sentence in found if applies]


def _plain(one: Estimate) -> bool:
    """Return True if the bound reached means a rigid rig, a cylinder or a zero coefficient."""
    side = "low" if one.value - one.min < one.max - one.value else "high"
    return side == _PLAIN_AT.get(one.name, "low" if one.kind == "stress" else "")


def _ridges(result: Identification) -> list[Remark]:
    """Return remarks on pairs of nonlinear parameters that the data determine only in combination."""
    names, std = result.names, np.sqrt(np.diag(result.covariance))
    width = {one.name: one.max - one.min for one in result.estimates}
    badly = {
        name for name, own in zip(names, std, strict=False)
        if name.partition("[")[0] in _GEOMETRY and own > 0.1 * width.get(name, math.inf)
    }  # fmt: skip
    correlation = result.covariance / np.outer(std, std)
    found = []
    for i, j in itertools.combinations(range(len(names)), 2):
        pair, alike = {names[i], names[j]}, abs(correlation[i, j])
        if alike > 0.98:
            told = (
                f"Ridge: {names[i]} and {names[j]} have a correlation of {correlation[i, j]:.4f}. "
            )
            told += "The data determine only a combination of the two."
            found.append(Remark(int(pair <= badly and alike > 0.995), told))
    return found


def remarks(result: Identification) -> list[Remark]:
    """Return the remarks to read before the results are used, starting with assumptions about the data."""
    data, errors, certificate = result.data, result.errors, result.certificate
    pull, largest = errors.max_slack_force, errors.max_force
    said = (*data.notes, data.pressures.note, data.lengths.note)
    slack = Sentence(
        *("The model predicts a force of up to ", Quantity(pull, "force", 3)),
        " at a slack reading.",
    )
    level = 2 if pull > 0.1 * largest else int(pull > max(2 * errors.rmse, 0.01 * largest))
    outlying, count = int((~result.counted).sum()), result.counted.size
    off = Sentence(
        f"{outlying} of {count} readings are so far from the model that the Huber objective reduces their "
        "weight to less than a quarter; the RMSE of the others is ",
        *(Quantity(result.counted_rmse, "force", 3), "."),
    )
    pictures = result.pictures
    missed = 0.0 if pictures is None else pictures.rmse / float(pictures.measured.mean())
    stroke = float(np.ptp(data.length[data.loaded]))
    soft = Sentence("The compliant rig deflects by ", Quantity(result.deflection, "length", 3),
                    f" at the largest force, {result.deflection / max(stroke, 1e-9):.0%} of the stroke. If "
                    "your rig is stiffer, check the rest length and the measured lengths. "
                    "`--bounds series_compliance_mm/N=0` fits a rigid rig.")  # fmt: skip
    others: tuple[tuple[Any, int, str], ...] = (
        (missed > 0.03, 1, f"The computed profiles differ from the photographed ones by {missed:.0%} RMS. "
         "Check the dimensions of the braid and bladder and their bounds, or use the measured shape."),
        (outlying, 1 + (outlying > 0.25 * count), off),
        (result.deflection > _SOFT * stroke, 1, soft),
        (pull > 2 * errors.rmse or level, level, slack),
        (certificate.n_agreeing < 2 < certificate.n_starts, 0,
         "Only one start reached the best fit: use more starts (starts= in Python)."),
        (not result.converged, 2, "The fit did NOT converge: its parameters are not optimal. Do not use "
         "them; try a law with fewer coefficients (--law), or more starts (starts= in Python)."),
    )  # fmt: skip
    return [
        *(Remark(0, note) for note in said if note),
        *of_parameters(result),
        *(Remark(level, sentence) for applies, level, sentence in others if applies),
    ]
