"""Force and stability of a muscle of fixed geometry, linear in the coefficients of its law.

One compiled program of the engine gives both at any lengths, pressures and stations of the paths.
Whatever the law's order, its dependence on pressure or its constraint, nothing else is compiled.
"""

import dataclasses
from collections.abc import Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from ..convex.paths import SAMPLES, PathFunctions
from ..engine.family import AbstractFamily, Values
from ..engine.program import Program
from ..engine.response import MapInputs
from ..families.muscle_family import assembled

_POINTS = 1024  # readings that one call takes
_ROUNDS = 20  # at most, in which the signs of strains are followed to where they change
_ROUNDED = 1e-14  # strain that is rounding


class FixedGeometry(AbstractFamily):
    """Muscles of one geometry, deadband and further terms with a polynomial law.

    Attributes:
        nonlinear, linear: no parameters but the coefficients.
        geometry: of all of them.
        deadband: P_d [Pa].
        further: force terms besides braid and bladder, or None.
    """

    nonlinear: tuple[str, ...] = eqx.field(static=True)
    linear: tuple[str, ...] = eqx.field(static=True)
    geometry: famjax.geometries.AbstractGeometry
    deadband: Float[np.ndarray, ""]
    further: famjax.terms.SumOfTerms | None

    @classmethod
    def of(
        cls,
        geometry: famjax.geometries.AbstractGeometry,
        deadband: float,
        order: int,
        further: famjax.terms.SumOfTerms | None,
    ) -> "FixedGeometry":
        """Those with a law of that order."""
        names = tuple(f"E_{n}" for n in range(1, order + 1))
        return cls((), names, geometry, np.asarray(deadband, float), further)

    def build(self, values: Values) -> famjax.Muscle:
        """The muscle of these coefficients."""
        law = famjax.PolynomialMaterial(jnp.stack([values[name] for name in self.linear]))
        return assembled(self.geometry, law, self.deadband, self.further)

    def rest_length(self, values: Values) -> Float[Array, ""]:
        """L0 [m] at which every path starts."""
        del values
        return self.geometry.rest_length

    @property
    def derived_names(self) -> tuple[str, ...]:
        """The shortest length that the geometry knows."""
        return ("shortest_length",)

    def derived(self, values: Mapping[str, Array]) -> tuple[Float[Array, ""], ...]:
        """The shortest length [m] that the geometry knows."""
        del values
        return (jnp.asarray(self.geometry.length_range()[0], float),)


class LinearModel:
    """F = force without the bladder + sum_n E_n column_n, and what must not become negative.

    Args:
        geometry: of the muscle.
        deadband: P_d [Pa].
        order: highest of the law.
        pressure: of the actuation paths [Pa], shape (paths,).
        path_end: shortest length [m] of each path, shape (paths,).
        further: force terms besides braid and bladder.
    """

    def __init__(
        self,
        geometry: famjax.geometries.AbstractGeometry,
        deadband: float,
        order: int,
        pressure: Float[np.ndarray, " paths"],
        path_end: Float[np.ndarray, " paths"],
        further: famjax.terms.SumOfTerms | None = None,
    ) -> None:
        self.order, self.rest_length = order, float(geometry.rest_length)
        self._breakpoints = np.asarray(geometry.breakpoints)
        self._paths, at = pressure.size, np.full(_POINTS, self.rest_length)
        self._inputs = MapInputs(
            length=at,
            pressure=np.full(_POINTS, pressure[-1]),
            force=np.zeros(_POINTS),
            length_index=np.zeros(_POINTS, int),
            path_pressure=pressure,
            path_end=path_end,
            stations=np.tile(np.linspace(0, 1, SAMPLES), (pressure.size, 1)),
        )
        family = FixedGeometry.of(geometry, deadband, order, further)
        self._program = Program(family, "drucker", self._inputs)
        value, _, aside = self._call(self._inputs, "derived", "largest_strain")
        self.shortest_length = float(value.derived[0])
        self._largest_strain = aside.largest_strain[: self._paths]

    def _call(self, inputs: MapInputs, *fields: str) -> tuple:
        none = np.zeros(0), np.zeros(self.order), np.zeros(_POINTS)
        return self._program.at(inputs)(*none, *fields)

    def columns(
        self, length: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
    ) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "... order"]]:
        """Force [N] without the bladder, and of it per coefficient [N/Pa], broadcast shape."""
        shape = np.broadcast_shapes(np.shape(length), np.shape(pressure))
        L, P = (np.broadcast_to(np.asarray(v, float), shape).ravel() for v in (length, pressure))
        braid, columns = np.empty(L.size), np.empty((L.size, self.order))
        for first in range(0, L.size, _POINTS):
            here = slice(first, first + _POINTS)
            count = L[here].size
            at = [np.pad(v[here], (0, _POINTS - count), mode="edge") for v in (L, P)]
            inputs = dataclasses.replace(self._inputs, length=at[0], pressure=at[1])
            value = self._call(inputs, "force", "columns")[0]
            braid[here], columns[here] = value.force[:count], value.columns[:count]
        return braid.reshape(shape), columns.reshape(*shape, self.order)

    def path_functions(self) -> PathFunctions:
        """What must not be negative per coefficient [-], as functions of the share of a path.

        First the law's own tangent n eps^(n - 1) over the strains of each path, then the modulus
        along each path.
        """
        n = np.arange(1, self.order + 1)

        def evaluate(s: Float[np.ndarray, "paths k"]) -> Float[np.ndarray, "paths k order"]:
            strain = self._largest_strain[:, None, None] * s[: self._paths, :, None]
            modulus = self._along(s[self._paths :], "rows")
            return np.concatenate([n * strain ** (n - 1), modulus])

        rest, end = self.rest_length, self._inputs.path_end[:, None]
        breaks = (rest - self._breakpoints) / (rest - end)
        corners = [np.append(*both) for both in zip(self._corners(), breaks, strict=True)]
        return PathFunctions.of(evaluate, [np.zeros(0)] * self._paths + corners)

    def _along(self, s: Float[np.ndarray, "paths k"], field: str) -> Float[np.ndarray, "paths k f"]:
        """A field of the results at `SAMPLES` shares of each path."""
        value, _, aside = self._call(dataclasses.replace(self._inputs, stations=s), field)
        found = value.rows if field == "rows" else aside.strains
        return found[: self._paths]

    def _corners(self) -> list[np.ndarray]:
        """Where along each path a strain changes its sign: the tangents of a law have a corner there.

        Of many on one path the last are not looked for.
        """
        s = np.tile(np.linspace(0, 1, SAMPLES), (self._paths, 1))
        strains = self._along(s, "strains")
        path, cell, which = np.nonzero(strains[:, :-1] * strains[:, 1:] < 0)
        place = np.arange(path.size) - np.searchsorted(path, path)
        path, cell, which, place = (v[place < SAMPLES] for v in (path, cell, which, place))
        low, high = s[path, cell], s[path, cell + 1]
        f_low, f_high = strains[path, cell, which], strains[path, cell + 1, which]
        root, before = low, np.full(path.shape, -1)
        for _ in range(_ROUNDS * bool(path.size)):
            root = (low * f_high - high * f_low) / (f_high - f_low)
            s[path, place] = root
            f = self._along(s, "strains")[path, place, which]
            if np.abs(f).max() <= _ROUNDED:
                break
            # The Illinois method: an end that stays twice counts half.
            beyond = f * f_high > 0
            less = np.where(beyond == before, 0.5, 1.0)
            low, f_low = np.where(beyond, low, root), np.where(beyond, f_low * less, f)
            high, f_high = np.where(beyond, root, high), np.where(beyond, f, f_high * less)
            before = beyond
        return [root[path == k] for k in range(self._paths)]
