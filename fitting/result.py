"""What an identification returns: numbers with their units, errors, certificate and doubts."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import Quantity, Sentence, si_unit
from famjax.slip import CentredSlip

from .arguments import shown
from .covariance import CONDITION_LIMIT
from .data import ForceData, data_frame
from .engine import predict
from .families import Law
from .parameters import standard_table
from .pictured import PictureFit
from .problem import Problem
from .response import Constraint
from .search import End

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


@dataclasses.dataclass(frozen=True)
class Estimate:
    """One identified parameter.

    Attributes:
        name: parameter.
        value: in SI.
        stderr: standard error in SI, with and without the belief in equal noise, whichever is larger;
            nan where there is none (held, at a bound, not identifiable).
        min, max: bounds in SI, infinite where there is none.
        at_bound: the optimum lies on a bound, so the data alone would put it elsewhere.
        fixed: held at a given value.
        kind: kind of unit.
        prior: (mean, standard deviation) in SI of what was said to be known, or None.
        sandwich_stderr: standard error in SI without the belief in equal noise, nan as `stderr`.
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
    sandwich_stderr: float = math.nan


@dataclasses.dataclass(frozen=True)
class Errors:
    """Errors of the model against the loaded readings, in N.

    Attributes:
        rmse, mae, max: root mean square, mean absolute and largest error [N].
        max_force: largest measured force [N], by which percentages are formed.
        n_points: number of loaded readings.
        n_slack: number of slack readings, which are no data.
        slack_violations: slack readings at which the model pulls.
        max_slack_force: largest pull [N] that the model predicts at a slack reading, or 0.
    """

    rmse: float
    mae: float
    max: float
    max_force: float
    n_points: int
    n_slack: int
    slack_violations: int
    max_slack_force: float

    @property
    def rmse_percent(self) -> float:
        """RMSE in % of the largest force."""
        return 100 * self.rmse / self.max_force


@dataclasses.dataclass(frozen=True)
class Certificate:
    """Evidence that the result is what it claims to be.

    Attributes:
        kkt_residual: of the convex fit of the coefficients, relative to the data.
        duality_gap: of the convex fit, relative to its objective: 0 means globally optimal.
        gradient_residual: of the geometry: largest cosine between the residual and a direction in
            which the geometry may still move.
        condition: condition number of the scaled Jacobian of all free parameters.
        stability_margin: smallest modulus along any actuation path [Pa], between stations too;
            Drucker-stable when >= 0.
        slope_margin: smallest tangent modulus of the law on the strain range used [Pa].
        constraint_margin: smallest slack [Pa] of the constraint that was asked for; nan for none.
        between_stations: by how much the margins may be lower than found, in parts of the largest
            modulus: the tail of the interpolant whose minima they are; rounding for polynomials.
        n_starts: descents made.
        n_agreeing: of them, those that ended within 1e-6 of the best objective.
        shape_margin: of a shape from mechanics, its smallest stiffness [N/m] at the loaded readings: each
            shape is stable when > 0. The optimum is local then; nan of all others.
    """

    kkt_residual: float
    duality_gap: float
    gradient_residual: float
    condition: float
    stability_margin: float
    slope_margin: float
    constraint_margin: float
    between_stations: float
    n_starts: int
    n_agreeing: int
    shape_margin: float = math.nan


@dataclasses.dataclass(frozen=True)
class Solved:
    """The problem as it was posed, with its stations placed, and the end of the best descent."""

    problem: Problem
    end: End


@dataclasses.dataclass(frozen=True)
class Outlook:
    """What predictions are made of beside the muscle; an identification alone has its standard errors.

    Attributes:
        error: of predictions, a `fitting.bands.ModelError`, or None where nothing was left out.
        directions: in which the muscle's numbers vary, one standard deviation each, as
            `muscle_spread` has them by linear theory; None where it is to be asked.
        bootstrap: whether these are of bootstrap replicates.
        shared: the same of errors that all readings share.
        others: further muscles, in their rigs; a prediction is the weighted mean of the muscle and them.
        weights: of the muscle and of them.
        alike: by family, the muscles in their rigs that fit the readings alike; what they disagree about
            is in the band.
        other_lengths: by family, muscles in their rigs of whose forces the mean is that of a muscle of
            another length; none where the fit cannot tell.
        between: standard deviation [N] of a specimen of another length about that mean.
        hysteresis: about the muscle's force, or None where it was not identified.
        branches_error: RMS [N] of what the branches add: the largest on what was left out, or in sample.
        series: of several specimens, what `fit.json` says of the series.
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
    """An identified muscle, from `identify`, or from `load_fit`, which reads one back.

    Attributes:
        data: the force map.
        mounted: the model in its rig, of compliance 0 where it was taken as rigid.
        estimates: geometry, then the coefficients where they do not depend on pressure.
        node_estimates: the coefficients at each node where they depend on pressure, else empty.
        derived: quantities that follow from the geometry (thread length, turns), with errors.
        coefficients: E_n [Pa], shape (nodes, order); one node where fixed in pressure.
        coefficients_stderr: [Pa], the same shape.
        node_pressures: [Pa], shape (nodes,), or None where fixed in pressure.
        strain_range: largest strain magnitude that the law was used at.
        residuals: model minus measurement [N] at the loaded readings.
        errors: their summary.
        certificate: optimality and stability.
        active_constraints: one sentence each.
        law: family of the law.
        constraint, dependence, seed: what was asked for.
        weights: part of its own weight with which each loaded reading counts; 1
            but for the outliers of Huber's objective.
        converged: the best start is stationary, certified and feasible.
        degrees_of_freedom: readings and priors less the directions that stayed free, of all
            specimens together.
        names: of the nonlinear parameters of the search.
        covariance: of these and then the coefficients [SI], by linear theory; nan for what is held, at a
            bound or not identifiable.
        place: which of the problem's parts this specimen is.
        solved: the problem and the end of the best descent; of a fit that was read back, what makes both
            anew from its readings.
        pictures: photographed and computed profiles, if both were fitted together.
        outlook: what predictions are made of.
        document: the whole `fit.json` of a fit that was read back, as plain data in SI; empty otherwise.
    """

    data: ForceData
    mounted: famjax.MountedMuscle
    estimates: tuple[Estimate, ...]
    node_estimates: tuple[tuple[Estimate, ...], ...]
    derived: tuple[Estimate, ...]
    coefficients: Float[np.ndarray, "nodes order"]
    coefficients_stderr: Float[np.ndarray, "nodes order"]
    node_pressures: Float[np.ndarray, " nodes"] | None
    strain_range: float
    residuals: Float[np.ndarray, " points"]
    errors: Errors
    certificate: Certificate
    active_constraints: tuple[str, ...]
    law: Law
    constraint: Constraint
    dependence: str
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
            f"Identification({self.data.specimen.name}: {self.law.name} of order {self.order}, "
            f"constraint {self.constraint}, {self.dependence} in pressure; RMSE "
            f"{self.errors.rmse:.4g} N over {self.errors.n_points} readings; "
            f"{'converged' if self.converged else 'NOT converged'}; in SI {numbers})"
        )

    @functools.cached_property
    def warnings(self) -> tuple[str, ...]:
        """What a reader must know before using the numbers."""
        return tuple(one.sentence for one in remarks(self))

    @functools.cached_property
    def _solved(self) -> Solved:
        return self.solved if isinstance(self.solved, Solved) else self.solved()

    @property
    def problem(self) -> Problem:
        """As it was posed, for validation and uncertainty."""
        return self._solved.problem

    @property
    def end(self) -> End:
        """Of the best descent; `end.u` are the free nonlinear parameters in parts of their bounds."""
        return self._solved.end

    @property
    def counted(self) -> Bool[np.ndarray, " readings"]:
        """The loaded readings that are no outliers of Huber's objective; all of them without it."""
        return self.weights >= _COUNTED

    @property
    def counted_rmse(self) -> float:
        """Root mean square error [N] of these."""
        return math.sqrt(float(np.mean(self.residuals[self.counted] ** 2)))

    @property
    def stopped(self) -> tuple[str, ...]:
        """Names of the parameters that are at a bound."""
        return tuple(one.name for one in self.estimates if one.at_bound)

    @property
    def muscle(self) -> famjax.Muscle | famjax.EquilibriumMuscle:
        """The model; a differentiable function of length and pressure."""
        muscle = self.mounted.muscle
        assert isinstance(muscle, famjax.Muscle | famjax.EquilibriumMuscle)
        return muscle

    @property
    def geometry(self) -> famjax.geometries.AbstractGeometry:
        """What the muscle's dimensions follow from.

        Raises:
            InputError: the shape is from mechanics: `muscle.profile` has it.
        """
        if not isinstance(self.muscle, famjax.Muscle):
            raise InputError("the shape is from mechanics and has no geometry: ask muscle.profile")
        return self.muscle.geometry

    @property
    def has_shape(self) -> bool:
        """Whether the shape is from mechanics, so that there is no certificate of a global optimum."""
        return isinstance(self.mounted.muscle, famjax.EquilibriumMuscle)

    @property
    def order(self) -> int:
        """Number of coefficients of the law."""
        return self.law.order

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Of all coefficients of the problem; those of several nodes carry its number."""
        names, nodes = tuple(self.law.coefficients), len(self.covariance) - len(self.names)
        if nodes == len(names):
            return names
        return tuple(
            f"{name}_at_node_{k + 1}" for k in range(nodes // len(names)) for name in names
        )

    @property
    def n_parameters(self) -> int:
        """Number of parameters that the data had to determine, coefficients of all nodes included."""
        nodes = (e for of_node in self.node_estimates for e in of_node)
        return sum(not e.fixed for e in (*self.estimates, *nodes))

    @property
    def all_estimates(self) -> tuple[Estimate, ...]:
        """Every identified parameter; coefficients that depend on pressure carry it in their name."""
        if self.node_pressures is None:
            return self.estimates
        return self.estimates + tuple(
            dataclasses.replace(estimate, name=f"{estimate.name}_at_{pressure / 1e3:.6g}kPa")
            for pressure, of_node in zip(self.node_pressures, self.node_estimates, strict=True)
            for estimate in of_node
        )

    def to_pandas(self) -> "pandas.DataFrame":
        """The parameters in SI, by name: value, standard error, unit, bounds, what is held or stopped.

        Raises:
            InputError: pandas is not installed.
        """
        return data_frame(self._parameter_rows(), "parameter")

    def _parameter_rows(self) -> list[dict[str, Any]]:
        return [
            {
                "parameter": one.name, "value": one.value, "stderr": one.stderr,
                "unit": si_unit(one.kind), "min": one.min, "max": one.max, "at_bound": one.at_bound,
                "fixed": one.fixed,
            }
            for one in (*self.all_estimates, *self.derived)
        ]  # fmt: skip

    def _repr_html_(self) -> str:
        from .report import Findings  # noqa: PLC0415 -- it draws

        return Findings(self).html()

    def plot(self, axes: "Axes | None" = None, system: str = "metric") -> "Axes":
        """Readings and model, force against contraction; arguments and result of `plot_isobars`."""
        from .report import plot_isobars  # noqa: PLC0415 -- it draws

        return plot_isobars(self, axes, system)

    def predict(
        self, length: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
    ) -> Float[np.ndarray, "..."]:
        """What the rig would measure [N] at lengths [m] and gauge pressures [Pa]; not clipped.

        Lengths and pressures are broadcast against each other.
        """
        point = self.end.point
        shape = np.broadcast_shapes(np.shape(length), np.shape(pressure))
        L, P = (np.broadcast_to(np.asarray(v, float), shape).ravel() for v in (length, pressure))
        found = predict(self.problem, self.place, point.parameters, point.x, L, P)
        return found.reshape(shape)

    def model_force(self) -> Float[np.ndarray, " n"]:
        """The model's force [N] at every reading, slack ones included."""
        return self.predict(self.data.length, self.data.pressure)

    def estimate(self, name: str) -> Estimate:
        """The estimate of that name.

        Raises:
            KeyError: no such parameter, with those there are.
        """
        for estimate in self.estimates + self.derived:
            if estimate.name == name:
                return estimate
        names: list[Any] = [e.name for e in self.estimates + self.derived]
        raise KeyError(f"unknown parameter {name!r}; available: {', '.join(names)}")


def check_identified(result: object) -> None:
    """Refuse what is no result of `identify` or `load_fit`, such as a force map.

    Raises:
        InputError: it is none.
    """
    if not isinstance(result, Identification):
        raise InputError(
            f"the result of fitting.identify or fitting.load_fit is needed, got {shown(result)}: a force "
            "map is identified first, and a choice has it as its attribute chosen"
        )


_RIDGE, _NARROW_RIDGE = 0.98, 0.995  # correlations: a note, and a doubt where both are known badly
_BADLY = 0.1  # standard error in parts of what the bounds leave
_PULLED = 2.0  # standard deviations of a prior
_UNEQUAL = 2.0  # between standard errors with and without the belief in equal noise
_COUNTED = 0.25  # of its weight: a reading that counts less lies 5 standard deviations off
_MOST_OUTLIERS = 0.25  # of the readings
_PULL = 0.1  # of the largest force, pulled where the readings are slack
_TOLD = 0.01  # likewise: below, a model that is wrong by more than the noise is still a good one
_GEOMETRY = ("braid_diameter", "braid_angle", "deadband_pressure", "rest_length", "end_factor")
_PLAIN_AT = {
    "deadband_pressure": "low", "end_factor": "low", "end_length": "low", "braid_compliance": "low",
    "series_compliance": "low", "series_exponent": "high",
}  # fmt: skip
"""Bounds at which a parameter says that something is not there, which is no doubt."""


class Remark(NamedTuple):
    """A sentence about a fit, and its severity: note (0), warning (1) or serious (2)."""

    level: int
    sentence: str


def equivalent_sizes(result: Identification) -> list[str]:
    """Dimensions of the braid that are those of an equivalent cylinder, and not the muscle's."""
    usual = standard_table(result.data.specimen)
    return [
        e.name for e in result.estimates
        if e.name in ("braid_diameter", "braid_angle")
        and not usual[e.name].min <= e.value <= usual[e.name].max
    ]  # fmt: skip


def of_parameters(result: Identification) -> list[Remark]:
    """Parameters that the data do not tell, and a law that is not stable."""
    estimates, certificate = result.estimates, result.certificate
    doubtful = any(one.at_bound and not _plain(one) for one in estimates)
    beyond = equivalent_sizes(result)
    plain = dict(
        zip(
            result.names + result.coefficient_names,
            np.sqrt(np.diag(result.covariance)),
            strict=True,
        )
    )
    unequal = [
        e.name for e in estimates
        if e.stderr > 0 and not 1 / _UNEQUAL < e.sandwich_stderr / plain[e.name] < _UNEQUAL
    ]  # fmt: skip
    found: tuple[tuple[Any, int, str], ...] = (
        (beyond, 0, f"{' and '.join(beyond)} describe an equivalent cylinder, which accounts for the "
         "rounded ends and the wall. Do not take them for dimensions of the braid, or its volume for the "
         "muscle's; changes of volume hold."),
        (result.stopped, int(doubtful), f"{', '.join(result.stopped)}: at the bound of the search. The "
         "data alone would go further, so there is no standard error; the other errors hold with this "
         "value fixed."),
        (not certificate.condition <= CONDITION_LIMIT, 1, "These data do not determine every parameter "
         "separately, so there are no standard errors. Hold one of them by --bounds, or measure more "
         "lengths and pressures."),
        *((abs(e.value - e.prior[0]) > _PULLED * e.prior[1], 0,
           f"{e.name} lies {abs(e.value - e.prior[0]) / e.prior[1]:.1f} standard deviations away from its "
           "prior. Either the prior is too narrow, or the parameter makes up for a fault of the model.")
          for e in estimates if e.prior is not None),
        (unequal, 0, "The noise differs between readings: robust (sandwich) standard errors of "
         f"{', '.join(unequal)} differ by more than a factor of {_UNEQUAL:g} from the usual ones. The "
         "larger are given."),
        *((True, level, ridge) for level, ridge in _ridges(result)),
        (result.active_constraints, 0, "A constraint on the coefficients is active: their standard errors "
         "hold along it only."),
        (not result.has_shape and not certificate.stability_margin
         >= -1e-9 * float(np.abs(result.coefficients).max(initial=0.0)), 1,
         Sentence("The law is NOT Drucker-stable on the actuation path (margin ",
                  Quantity(certificate.stability_margin, "stress"), "). Do not extrapolate or simulate "
                  "with it; --constraint drucker finds the best stable law.")),
    )  # fmt: skip
    return [Remark(level, sentence) for applies, level, sentence in found if applies]


def _plain(one: Estimate) -> bool:
    """Whether it is at a bound where a rigid rig, a cylinder or a vanishing coefficient lies."""
    side = "low" if one.value - one.min < one.max - one.value else "high"
    return side == _PLAIN_AT.get(one.name, "low" if one.kind == "stress" else "")


def _ridges(result: Identification) -> list[Remark]:
    """Pairs of nonlinear parameters that the data determine only together."""
    names, std = result.names, np.sqrt(np.diag(result.covariance))
    width = {one.name: one.max - one.min for one in result.estimates}
    badly = [
        name.partition("[")[0] in _GEOMETRY and own > _BADLY * width.get(name, math.inf)
        for name, own in zip(names, std, strict=False)
    ]
    correlation = result.covariance / np.outer(std, std)
    return [
        Remark(
            int(badly[i] and badly[j] and abs(correlation[i, j]) > _NARROW_RIDGE),
            f"Ridge: {names[i]} and {names[j]} have a correlation of {correlation[i, j]:.4f}. The data "
            "tell a combination of the two, not each.",
        )
        for i, j in itertools.combinations(range(len(names)), 2)
        if abs(correlation[i, j]) > _RIDGE
    ]


def remarks(result: Identification) -> list[Remark]:
    """What a reader must know before using the numbers, the assumptions on the data first."""
    data, errors, certificate = result.data, result.errors, result.certificate
    pull, largest = errors.max_slack_force, errors.max_force
    said = (*data.notes, data.pressures.note, data.lengths.note)
    slack = Sentence(
        *(
            "The model pulls with up to ",
            Quantity(pull, "force", 3),
            f" at {errors.slack_violations} ",
        ),
        f"of {errors.n_slack} readings that are slack.",
    )
    level = 2 if pull > _PULL * largest else int(pull > max(2 * errors.rmse, _TOLD * largest))
    outlying, count = int((~result.counted).sum()), result.counted.size
    off = Sentence(
        f"{outlying} of {count} readings lie so far off that Huber's objective counts them for less than "
        "a quarter; the RMSE of the others is ",
        *(Quantity(result.counted_rmse, "force", 3), "."),
    )
    others: tuple[tuple[Any, int, str], ...] = (
        (outlying, 1 + (outlying > _MOST_OUTLIERS * count), off),
        (pull > 2 * errors.rmse or level, level, slack),
        (certificate.n_agreeing < 2 < certificate.n_starts, 0,
         "Only one start reached the best fit: give more (starts=, in Python)."),
        (not result.converged, 2, "The fit did NOT converge: its numbers are not an optimum. Do not use "
         "them; try a law of fewer coefficients (--law), or more starts (starts=, in Python)."),
    )  # fmt: skip
    return [
        *(Remark(0, note) for note in said if note),
        *of_parameters(result),
        *(Remark(level, sentence) for applies, level, sentence in others if applies),
    ]
