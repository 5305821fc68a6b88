"""What an identification returns: numbers with their units, errors, certificate and doubts."""

import dataclasses
import functools
import hashlib
import math
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import Quantity, Sentence, si_unit

from .arguments import shown
from .covariance import CONDITION_LIMIT
from .data import ForceData, data_frame, data_set, html_table
from .descent import End
from .engine import predict
from .families import Law
from .parameters import standard_table
from .problem import Problem
from .response import Constraint, PressureDependence
from .search import rounding_of

if TYPE_CHECKING:
    import pandas
    import xarray


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


@dataclasses.dataclass(frozen=True, repr=False)
class Identification:
    """An identified muscle.

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
        starts: objective of every start [N^2 or weighted], ascending.
        start_parameters: nonlinear parameters [SI] at the end of each, in the same order.
        law: family of the law.
        constraint, dependence, seed: what was asked for.
        weights: part of its own weight with which each loaded reading counts; 1
            but for the outliers of Huber's objective.
        converged: the best start is stationary, certified and feasible.
        degrees_of_freedom: readings and priors less the directions that stayed free, of all
            specimens together.
        covariance: of the nonlinear parameters of the search and then the coefficients [SI], by
            linear theory; nan for what is held, at a bound or not identifiable.
        problem: as it was posed, for validation and uncertainty.
        end: the end of the best descent; `end.u` are the free nonlinear parameters at the optimum,
            in parts of their bounds.
        place: which of the problem's parts this specimen is.
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
    starts: Float[np.ndarray, " starts"]
    start_parameters: Float[np.ndarray, "starts q"]
    law: Law
    constraint: Constraint
    dependence: PressureDependence
    seed: int
    weights: Float[np.ndarray, " readings"]
    converged: bool
    degrees_of_freedom: int
    covariance: Float[np.ndarray, "k k"]
    problem: Problem
    end: End
    place: int

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
        return doubts(self)

    @property
    def muscle(self) -> famjax.Muscle:
        """The model; a differentiable function of length and pressure."""
        muscle = self.mounted.muscle
        assert isinstance(muscle, famjax.Muscle)
        return muscle

    @property
    def series_compliance(self) -> float:
        """Of the rig [m/N], at 100 N where it has an exponent; 0 where it was taken as rigid."""
        return float(self.mounted.compliance)

    @property
    def series_exponent(self) -> float | None:
        """Of the rig, see `famjax.muscle.give_way`; None where it gives way in proportion."""
        exponent = self.mounted.exponent
        return None if exponent is None else float(exponent)

    @property
    def order(self) -> int:
        """Number of coefficients of the law."""
        return self.law.order

    @property
    def coefficient_names(self) -> tuple[str, ...]:
        """Of all coefficients of the problem; those of several nodes carry its number."""
        names = self.problem.linear
        if len(names) == self.order:
            return names
        return tuple(f"{name}_at_node_{k // self.order + 1}" for k, name in enumerate(names))

    @property
    def fingerprint(self) -> dict[str, Any]:
        """By what an unfinished work on it is known: readings, weights, bounds, priors, law."""
        problem = self.problem
        numbers = [problem.low, problem.high, problem.coefficient_min, problem.coefficient_max]
        for part in problem.parts:
            numbers += [part.force, part.weight, part.side]
            numbers += [part.inputs.length, part.inputs.pressure]
            numbers += filter(eqx.is_array_like, jax.tree.leaves(part.family))
        # Not to the last digit: weights of a robust fit are results, not inputs.
        text = " ".join(f"{value:.9e}" for one in numbers for value in np.ravel(one).tolist())
        known = problem.priors, problem.coefficient_priors, f"{problem.noise:.9e}"
        return {
            "version": famjax.__version__,
            "specimens": [part.name for part in problem.parts],
            "parameters": [*problem.names, *problem.linear],
            "law": self.law.name,
            "constraint": self.constraint,
            "numbers": hashlib.sha256(f"{text} {known}".encode()).hexdigest(),
        }

    @property
    def readings_of_parts(self) -> list[int]:
        """Number of loaded readings of each specimen that was identified together."""
        return [part.force.size for part in self.problem.parts]

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

    def to_xarray(self) -> "xarray.Dataset":
        """Parameters with their covariance, and the loaded readings with their residuals, in SI.

        Raises:
            InputError: xarray is not installed.
        """
        names = [*self.problem.names, *self.coefficient_names]
        values = np.concatenate([self.end.point.parameters, self.end.point.x])
        loaded, N = self.data.loaded, {"units": "N"}
        along = ("parameter", "other_parameter")
        return data_set(
            {
                "value": (("parameter",), values, {}),
                "covariance": (along, self.covariance, {}),
                "length_m": (("reading",), self.data.length[loaded], {"units": "m"}),
                "pressure_Pa": (("reading",), self.data.pressure[loaded], {"units": "Pa"}),
                "force_N": (("reading",), self.data.force[loaded], N),
                "residual_N": (("reading",), self.residuals, N),
            },
            {name: ((name,), np.array(names), {}) for name in along},
            {
                "specimen": self.data.specimen.name, "sha256": self.data.sha256,
                "law": self.law.name, "constraint": self.constraint, "dependence": self.dependence,
                "rmse_N": self.errors.rmse, "converged": int(self.converged),
            },
        )  # fmt: skip

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
        rows = [
            (row["parameter"], row["value"], row["stderr"], row["unit"])
            for row in self._parameter_rows()
        ]
        title = f"{self.data.specimen.name}: RMSE {self.errors.rmse:.4g} N, {self.law.name}"
        return html_table(title, ("parameter", "value", "std. error", "unit"), rows)

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
        raise KeyError(f"no parameter {name!r}; there are {', '.join(names)}")


def check_identified(result: object) -> None:
    """Refuse what is no result of `identify`, such as a force map or a saved fit.

    Raises:
        InputError: it is none.
    """
    if not isinstance(result, Identification):
        raise InputError(
            f"the result of fitting.identify is needed, got {shown(result)}: a force map is identified "
            "first, and a choice has it as its attribute chosen"
        )


_RIDGE = 0.98
_OUTLYING = 0.5  # of the full weight of a reading
_PULLED = 2.0  # standard deviations of a prior
_UNEQUAL = 2.0  # between standard errors with and without the belief in equal noise


def doubts(result: "Identification") -> tuple[str, ...]:
    """Full sentences, the assumptions on the data first."""
    data, condition = result.data, result.certificate.condition
    found = [*data.notes, *(of.note for of in (data.pressures, data.lengths) if of.note)]
    usual = standard_table(data.specimen)
    beyond = [
        e.name for e in result.estimates
        if e.name in ("braid_diameter", "braid_angle")
        and not usual[e.name].min <= e.value <= usual[e.name].max
    ]  # fmt: skip
    if beyond:
        found.append(
            f"{' and '.join(beyond)} describe an equivalent cylinder, which accounts for the rounded "
            "ends and the wall. Do not take them for dimensions of the braid."
        )
    stopped = [e.name for e in result.estimates if e.at_bound]
    if stopped:
        found.append(
            f"{', '.join(stopped)}: at the bound of the search. The data alone would go further, so "
            "there is no standard error; the other errors hold with this value fixed."
        )
    if not np.isfinite(condition) or condition > CONDITION_LIMIT:
        found.append(
            "These data do not determine every parameter separately, so there are no standard "
            "errors. Hold one of them by --bounds, or measure more lengths and pressures."
        )
    found += _pulled(result)
    outliers = result.weights < _OUTLYING
    if outliers.any():
        found.append(
            f"{outliers.sum()} of {outliers.size} readings lie so far off that each counts less than "
            f"{_OUTLYING:g} of an ordinary one (Huber's objective). Look at them."
        )
    names = result.problem.names + result.problem.linear
    plain = dict(zip(names, np.sqrt(np.diag(result.covariance)), strict=True))
    unequal = [
        e.name for e in result.estimates
        if e.stderr > 0 and not 1 / _UNEQUAL < e.sandwich_stderr / plain[e.name] < _UNEQUAL
    ]  # fmt: skip
    if unequal:
        found.append(
            f"The noise differs between readings: robust (sandwich) standard errors of "
            f"{', '.join(unequal)} differ by more than a factor of {_UNEQUAL:g} from the usual ones. "
            "The larger are given."
        )
    found += _ridges(result)
    if result.active_constraints:
        found.append(
            "A constraint on the coefficients is active: their standard errors hold along it only."
        )
    if not result.certificate.stability_margin >= -rounding_of(result.end.point):
        found.append(
            Sentence(
                "The law is NOT Drucker-stable on the actuation path (margin ",
                Quantity(result.certificate.stability_margin, "stress"),
                "). Do not extrapolate or simulate with it; --constraint drucker finds the best stable "
                "law.",
            )
        )
    errors = result.errors
    if errors.max_slack_force > 2 * errors.rmse:
        found.append(
            Sentence(
                f"The model pulls at {errors.slack_violations} of {errors.n_slack} slack readings, by "
                "up to ",
                Quantity(errors.max_slack_force, "force", 3),
                ".",
            )
        )
    if result.certificate.n_agreeing < 2 < result.certificate.n_starts:
        found.append("Only one start reached the best fit: give more (starts=, in Python).")
    if not result.converged:
        found.append("The fit did NOT converge. Do not use its numbers.")
    return tuple(found)


def _pulled(result: "Identification") -> list[str]:
    """Parameters that the data drag far from what was said to be known of them."""
    return [
        f"{e.name} lies {abs(e.value - e.prior[0]) / e.prior[1]:.1f} standard deviations away from its "
        "prior. Either the prior is too narrow, or the parameter makes up for a fault of the model."
        for e in result.estimates
        if e.prior is not None and abs(e.value - e.prior[0]) > _PULLED * e.prior[1]
    ]


def _ridges(result: "Identification") -> list[str]:
    """Pairs of nonlinear parameters that the data determine only together."""
    names, stderr = result.problem.names, np.sqrt(np.diag(result.covariance))
    correlation = result.covariance / np.outer(stderr, stderr)
    return [
        f"Ridge: {first} and {names[j]} have a correlation of {correlation[i, j]:.4f}. The data tell a "
        "combination of the two, not each."
        for i, first in enumerate(names)
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > _RIDGE
    ]
