"""Force and stability of a muscle of fixed geometry, linear in the coefficients of its law.

One compiled program of the engine gives both at any lengths, pressures and stations of the paths.
Whatever the law's order, its dependence on pressure or its constraint, nothing else is compiled.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.compile_options import as_arrays, quick_jit

from ..convex import AnyArray
from ..families import assembled
from .paths import SAMPLES, PathFunctions

_POINTS = 1024  # readings that one call takes
_ROUNDS = 20  # at most, in which the signs of strains are followed to where they change
_ROUNDED = 1e-14  # strain that is rounding


class FixedGeometry(eqx.Module):
    """Muscles of one geometry, deadband and further terms with a polynomial law.

    Attributes:
        geometry: of all of them.
        deadband: P_d [Pa].
        further: force terms besides braid and bladder, or None.
        order: of the law.
    """

    geometry: famjax.geometries.AbstractGeometry
    deadband: float | Float[np.ndarray, ""]
    further: famjax.terms.SumOfTerms | None
    order: int = eqx.field(static=True)

    def build(self, coefficients: Float[Array, " order"]) -> famjax.Muscle:
        """The muscle of these coefficients [Pa]."""
        law = famjax.PolynomialMaterial(coefficients)
        return assembled(self.geometry, law, self.deadband, self.further)


@quick_jit
def _columns(
    of: FixedGeometry, length: Float[AnyArray, " k"], pressure: Float[AnyArray, " k"]
) -> tuple[Float[Array, " k"], Float[Array, "k order"]]:
    """Force [N] without the bladder, and of it per coefficient [N/Pa]."""
    force, column = jax.linearize(
        lambda E: of.build(E).force(length, pressure), jnp.zeros(of.order)
    )
    return force, jax.vmap(column, out_axes=-1)(jnp.eye(of.order))


@quick_jit
def _along(
    of: FixedGeometry, pressure: Float[AnyArray, " paths"], length: Float[AnyArray, "paths k"]
) -> tuple[Float[Array, "paths k order"], Float[Array, "paths k strains"]]:
    """Modulus [-] of each coefficient at lengths of paths, and axial and hoop strains there."""
    both = famjax.stability.path_strains(of.geometry, length, pressure[:, None])
    modulus = jax.vmap(lambda one: both.modulus(famjax.PolynomialMaterial(one)), out_axes=-1)(
        jnp.eye(of.order)
    )
    return modulus, jnp.concatenate([both.axial[..., :1], both.hoop], axis=-1)


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
        self._paths, self._pressure, self._path_end = pressure.size, pressure, path_end
        self._of = as_arrays(FixedGeometry(geometry, float(deadband), further, order))
        self.shortest_length = float(geometry.length_range()[0])
        ends = self._along(np.tile(np.linspace(0, 1, SAMPLES), (pressure.size, 1)))[1][:, [0, -1]]
        self._largest_strain = np.maximum(
            np.abs(ends[..., 0]).max(axis=1), np.abs(ends[..., 1:]).max(axis=(1, 2))
        )

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
            force, per_coefficient = _columns(self._of, *at)
            braid[here], columns[here] = force[:count], per_coefficient[:count]
        return braid.reshape(shape), columns.reshape(*shape, self.order)

    def path_functions(self) -> PathFunctions:
        """What must not be negative per coefficient [-], as functions of the share of a path.

        First the law's own tangent n eps^(n - 1) over the strains of each path, then the modulus
        along each path.
        """
        n = np.arange(1, self.order + 1)

        def evaluate(s: Float[np.ndarray, "paths k"]) -> Float[np.ndarray, "paths k order"]:
            strain = self._largest_strain[:, None, None] * s[: self._paths, :, None]
            modulus = self._along(s[self._paths :])[0]
            return np.concatenate([n * strain ** (n - 1), modulus])

        rest, end = self.rest_length, self._path_end[:, None]
        breaks = (rest - self._breakpoints) / (rest - end)
        corners = [np.append(*both) for both in zip(self._corners(), breaks, strict=True)]
        return PathFunctions.of(evaluate, [np.zeros(0)] * self._paths + corners)

    def _along(
        self, s: Float[np.ndarray, "paths k"]
    ) -> tuple[Float[np.ndarray, "paths k order"], Float[np.ndarray, "paths k strains"]]:
        """Moduli and strains, see above, at `SAMPLES` shares of each path."""
        length = self.rest_length + s * (self._path_end[:, None] - self.rest_length)
        modulus, strains = _along(self._of, self._pressure, length)
        return np.asarray(modulus), np.asarray(strains)

    def _corners(self) -> list[np.ndarray]:
        """Where along each path a strain changes its sign: the tangents of a law have a corner there.

        Of many on one path the last are not looked for.
        """
        s = np.tile(np.linspace(0, 1, SAMPLES), (self._paths, 1))
        strains = self._along(s)[1]
        path, cell, which = np.nonzero(strains[:, :-1] * strains[:, 1:] < 0)
        place = np.arange(path.size) - np.searchsorted(path, path)
        path, cell, which, place = (v[place < SAMPLES] for v in (path, cell, which, place))
        low, high = s[path, cell], s[path, cell + 1]
        f_low, f_high = strains[path, cell, which], strains[path, cell + 1, which]
        root, before = low, np.full(path.shape, -1)
        for _ in range(_ROUNDS * bool(path.size)):
            root = (low * f_high - high * f_low) / (f_high - f_low)
            s[path, place] = root
            f = self._along(s)[1][path, place, which]
            if np.abs(f).max() <= _ROUNDED:
                break
            # The Illinois method: an end that stays twice counts half.
            beyond = f * f_high > 0
            less = np.where(beyond == before, 0.5, 1.0)
            low, f_low = np.where(beyond, low, root), np.where(beyond, f_low * less, f)
            high, f_high = np.where(beyond, root, high), np.where(beyond, f, f_high * less)
            before = beyond
        return [root[path == k] for k in range(self._paths)]
