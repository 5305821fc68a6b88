"""Errors that all readings of a map have in common, carried into parameters and forces.

A transducer's gain, the rest length, the wall, the shape that photographs showed: no scatter of the
readings tells of them, and no repetition. Each moves the readings, or the geometry, and with them the
optimum. To first order the parameters move by

    d theta = -(J^T J)^-1 J^T d r

with d r what the weighted residual changes by where the parameters stay, J its derivative in them, in
the directions that constraints and bounds leave free. Nothing is fitted again.

References:
    JCGM 100:2008 (GUM), section 5: independent sources add in squares.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np
from jaxtyping import Float

from ..covariance import free_root
from ..data.force_data import ForceData, Specimen
from ..data.shared_errors import SharedErrors
from ..engine import Point, predict, report_of
from ..errors import InputError
from ..posing import Geometry, source_of
from ..problem import Part
from ..result import Identification
from ..summary import held_and_active, joint_derivatives
from .spread import numbers_by_parameters

DRAWS = 32
"""Shapes as probable as the measured one: they tell a standard error to an eighth of itself."""


@dataclasses.dataclass(frozen=True)
class Move:
    """A map and its geometry as they would be, were something else true.

    Attributes:
        data: the map, of as many readings; None where it is as it was.
        geometry: as for `identify`.
    """

    data: ForceData | None
    geometry: Geometry | None = None


Moves = Mapping[str, Sequence[Move]]
"""By source of error: one move of a standard error, or several, as probable as what is."""


@dataclasses.dataclass(frozen=True)
class Carried:
    """What errors that all readings share do to an identification.

    Attributes:
        names: of the parameters, the coefficients last.
        sources: of error.
        effects: standard error of each parameter by each source [SI], shape (sources, parameters);
            0 of what is held or at a bound.
        directions: in which the muscle's numbers vary with them, one standard deviation each,
            independent of one another, as `muscle_spread` has those of the scatter.
    """

    names: tuple[str, ...]
    sources: tuple[str, ...]
    effects: Float[np.ndarray, "sources parameters"]
    directions: Float[np.ndarray, "directions numbers"]

    @property
    def std(self) -> dict[str, float]:
        """Standard error of each parameter by all sources together [SI]."""
        total = np.sqrt(np.sum(self.effects**2, axis=0))
        return dict(zip(self.names, total.tolist(), strict=True))

    def by_source(self) -> dict[str, dict[str, float]]:
        """Standard error of each parameter by source [SI]."""
        return {
            source: dict(zip(self.names, row.tolist(), strict=True))
            for source, row in zip(self.sources, self.effects, strict=True)
        }


def moves_of(
    data: ForceData,
    errors: SharedErrors,
    geometry_of: Callable[[Specimen], Geometry | None] = lambda _: None,
) -> dict[str, list[Move]]:
    """The moves that stated errors stand for.

    Args:
        data: the map.
        errors: standard errors.
        geometry_of: from a specimen to the geometry of the fit, as for `identify`.
    """
    return {
        name: [Move(moved := errors.moved(data, name), geometry_of(moved.specimen))]
        for name in errors.stated()
    }


def drawn_moves(geometry_of: Callable[[int], Geometry]) -> list[Move]:
    """The moves of a measured shape's uncertainty.

    Args:
        geometry_of: from the number of a draw, below `DRAWS`, to its geometry.
    """
    return [Move(None, geometry_of(draw)) for draw in range(DRAWS)]


def carry(result: Identification, moves: Moves) -> Carried:
    """What errors that all readings share do to the parameters, and to the forces, of a fit.

    Linear theory, in the errors and in the parameters. It holds where an error moves the parameters
    by less than their own range; active constraints and bounds stay where they are.

    Args:
        result: a fit of one specimen.
        moves: by source of error; each source is one standard error, or draws of it about what was
            fitted.

    Raises:
        InputError: specimens that were identified together, a map of other readings, a geometry of
            another kind, or one that has no force at the optimum.
    """
    problem, point = result.problem, result.end.point
    if len(problem.parts) > 1:
        raise InputError(
            "shared errors are carried through the fit of one specimen, not of several"
        )
    part = problem.parts[result.place]
    _, jacobian, rows = joint_derivatives(point)
    held, rows, bent = held_and_active(problem, result.end, rows)
    root = free_root(np.concatenate([jacobian, bent]), rows, held).root
    readings = jacobian[: part.force.size]
    slopes = numbers_by_parameters(result)
    force, numbers = _at(part, point)
    effects, directions = [], []  # of each source, of each move
    for source, several in moves.items():
        steps, changes = [], []
        for move in several:
            other = _moved(part, result.data, move, source)
            there, others = _at(other, point)
            step = -root @ (root.T @ (readings.T @ (part.weight * (there - force))))
            steps.append(step)
            changes.append(slopes @ step + others - numbers)
        if not np.isfinite(steps).all():
            raise InputError(f"with the error of {source} the muscle has no force at some readings")
        weigh = 1 / np.sqrt(len(several))
        effects.append(np.sqrt(np.mean(np.square(steps), axis=0)))
        directions += [weigh * change for change in changes]
    count = len(problem.names) + len(problem.linear)
    return Carried(
        problem.names + result.coefficient_names,
        tuple(moves),
        np.array(effects).reshape(len(moves), count),
        np.array(directions).reshape(-1, numbers.size),
    )


def _at(part: Part, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Residual [N], not weighted, and the muscle's numbers, the rig's last."""
    problem, inputs = dataclasses.replace(point.problem, parts=(part,)), part.inputs
    given = point.parameters, point.x
    predicted = predict(problem, 0, *given, inputs.length, inputs.pressure)
    numbers = report_of(part, dataclasses.replace(point, reached=predicted), 0).numbers
    rig = point.parameters[list(part.rig)] if part.rig else [0.0]
    return predicted - part.force, np.append(numbers, rig)


def _moved(part: Part, data: ForceData, move: Move, source: str) -> Part:
    """The same part with readings and geometry moved."""
    moved = data if move.data is None else move.data
    if moved.force.shape != data.force.shape:
        raise InputError(
            f"the map moved by the error of {source} must have the {data.force.size} readings of the "
            f"fit's, got {moved.force.size}"
        )
    family = part.family
    geometry = source_of(moved, move.geometry, family.nonlinear).as_arrays()
    family = dataclasses.replace(
        family, source=geometry, rest=np.asarray(moved.specimen.rest_length)
    )
    loaded = np.flatnonzero(data.loaded)
    censored = np.flatnonzero(data.slack | data.saturated)[: part.force.size - loaded.size]
    rows = np.concatenate([loaded, censored])
    inputs = dataclasses.replace(
        part.inputs, length=moved.length[rows], pressure=moved.pressure[rows]
    )
    force = part.force + (moved.force - data.force)[rows] * (part.side == 0)
    if jax.tree.structure(family) != jax.tree.structure(part.family):
        raise InputError(
            f"the geometry moved by the error of {source} must be of the kind that was fitted"
        )
    return dataclasses.replace(part, family=family, inputs=inputs, force=force)
