"""The 48 fits of the reference work's chapter 7 as plain arrays, for every solver the same.

The readings are the SYNTHETIC reconstruction; lengths in inch, pressures in psi, forces in lbf. A
constraint is posed at the stations of the sweep on the path of every pressure.
"""

import dataclasses
import functools
import itertools

import numpy as np
from jaxtyping import Float
from reconstruction import force_map, geometries

from fitting import ForceData
from fitting.sweeps.design import Design
from fitting.sweeps.forms import CONSTRAINTS, DEPENDENCES
from fitting.sweeps.linear_model import LinearModel
from fitting.sweeps.readings import Readings, arrange

ORDERS = (1, 2, 3, 4)
GEOMETRY = "measured"


@dataclasses.dataclass(frozen=True)
class Programme:
    """One problem: residuals A x - y in blocks, one per pressure, under G x >= 0.

    Attributes:
        fit: dependence, order, constraint.
        A: scaled columns, shape (blocks, rows, unknowns).
        y: shape (blocks, rows).
        G: unit rows, shape (constraints, unknowns).
        count: readings of each block, which compressed ones stand for.
    """

    fit: tuple[str, int, str]
    A: Float[np.ndarray, "blocks rows unknowns"]
    y: Float[np.ndarray, "blocks rows"]
    G: Float[np.ndarray, "constraints unknowns"]
    count: Float[np.ndarray, " blocks"]


@functools.cache
def shared(
    n_pressures: int = 10, thin: int = 1, geometry: str = GEOMETRY
) -> tuple[ForceData, Readings, Design]:
    """Readings and linear problem at one of the four geometries."""
    data, shape = force_map(n_pressures, thin), geometries()[geometry]
    readings = arrange(data, float(shape.rest_length), ORDERS[-1])
    model = LinearModel(shape, 0.0, ORDERS[-1], readings.pressure, readings.path_end)
    return data, readings, Design.of(model, readings)


def programmes(of: Design, *, compressed: bool) -> list[Programme]:
    """All problems of the 48 fits, those free in pressure one by one: 192.

    Args:
        of: the linear problem.
        compressed: to five rows per pressure by QR, or the readings themselves.
    """
    A, y = of.A, of.target
    there = of.there
    A, y = A * there[..., None], y * there
    count = there.sum(axis=1).astype(float)
    if compressed:
        factor = of.factor()
        A, y = factor[:, :, :-1], factor[:, :, -1]
    share = of.basis
    found = []
    for dependence, order, constraint in itertools.product(DEPENDENCES, ORDERS, CONSTRAINTS):
        fit = (dependence, order, constraint)
        rows = _rows(of, order, constraint)
        if dependence == "free":
            found += [
                Programme(fit, A[[p], :, :order], y[[p]], rows[p], count[[p]])
                for p in range(len(y))
            ]
            continue
        basis = share if dependence == "linear" else np.ones((len(y), 1))
        columns = np.einsum("pke,pb->pkeb", A[:, :, :order], basis)
        G = np.einsum("pse,pb->pseb", rows, basis).reshape(-1, order * basis.shape[1])
        found.append(
            Programme(fit, columns.reshape(*y.shape, -1), y, G, count),
        )
    return [_scaled(one) for one in found]


def _rows(of: Design, order: int, constraint: str) -> Float[np.ndarray, "paths stations order"]:
    paths = of.basis.shape[0]
    if constraint == "none":
        return np.zeros((paths, 0, order))
    if constraint == "positive":
        return np.broadcast_to(np.eye(order), (paths, order, order))
    # The functions of the slope constraint come first, then those of Drucker's.
    first = 0 if constraint == "slope" else paths
    return of.table.value[first : first + paths, of.stations, :order]


def _scaled(one: Programme) -> Programme:
    """Columns of unit length, and rows of unit length."""
    size = np.linalg.norm(one.A, axis=(0, 1))
    G = one.G / size
    G = G / np.linalg.norm(G, axis=1, keepdims=True)
    return dataclasses.replace(one, A=one.A / size, G=G)
