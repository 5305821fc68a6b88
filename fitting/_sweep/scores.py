"""What the fits of a sweep are judged by: errors in force and stroke, information, stability."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from .padded import DEPENDENCES
from .problem import Design, Readings

_AT_REST = 1e-3  # a reading is blocked whose length is the rest length to this part
_NEARLY_FREE = 0.1  # readings below this part of a pressure's largest force give its free length
_LENGTHS = 129
_BEYOND = 2.0  # lengths are looked at to this multiple of the largest measured contraction


class Scores(eqx.Module):
    """Figures of merit of every fit, with the leading axes of the fits.

    Attributes:
        rmse, mae: of each pressure [N], shape (..., pressures).
        blocked_error: model minus measured blocked force [N] of each pressure, nan where no
            reading was taken at the rest length.
        free_contraction_error: model minus measured free contraction [-] of each pressure.
        aicc, bic: information criteria of independent normal errors, shape (...).
        margin: smallest modulus along the actuation paths [Pa], >= 0 when Drucker-stable.
    """

    rmse: Float[Array, "*fits pressures"]
    mae: Float[Array, "*fits pressures"]
    blocked_error: Float[Array, "*fits pressures"]
    free_contraction_error: Float[Array, "*fits pressures"]
    aicc: Float[Array, "*fits"]
    bic: Float[Array, "*fits"]
    margin: Float[Array, "*fits"]


def measured_ends(
    readings: Readings, rest_length: float
) -> tuple[Float[np.ndarray, " pressures"], Float[np.ndarray, " pressures"]]:
    """Blocked force [N] and free contraction [-] as measured, per pressure.

    The blocked force is the mean of the readings at rest. The free contraction is where a line
    through the readings of less than a tenth of the largest force, or through those at the two
    shortest lengths, reaches zero.
    """
    blocked, free = [], []
    for force, length, there in zip(readings.force, readings.length, readings.there, strict=True):
        F, contraction = force[there], 1 - length[there] / rest_length
        at_rest = np.abs(contraction) < _AT_REST
        blocked.append(F[at_rest].mean() if at_rest.any() else np.nan)
        near = _NEARLY_FREE * F.max() >= F
        if np.unique(contraction[near]).size < 3:
            near = contraction >= np.unique(contraction)[-2:][0]
        if np.unique(F[near]).size < 2:
            free.append(np.nan)
            continue
        slope, at_zero = np.polyfit(F[near], contraction[near], 1)
        free.append(at_zero if slope < 0 else np.nan)
    return np.array(blocked), np.array(free)


def score(
    of: Design,
    geometry: famjax.AbstractGeometry,
    deadband: Float[Array, ""],
    readings: Readings,
    coefficients: Float[Array, "dependences orders constraints pressures order"],
    orders: tuple[int, ...],
    ends: tuple[Float[Array, " pressures"], Float[Array, " pressures"]],
) -> Scores:
    """The scores of all fits.

    Args:
        of: the linear problem.
        geometry: of the fits.
        deadband: P_d [Pa].
        readings: of the force map.
        coefficients: E_n [Pa] of all fits.
        orders: of the law.
        ends: blocked force [N] and free contraction [-] from `measured_ends`.
    """
    blocked, free = ends
    shape = coefficients.shape[:-2]
    flat = coefficients.reshape(-1, *coefficients.shape[-2:])
    there, count = of.weight > 0, jnp.sum(of.weight > 0, axis=1)
    curve = _Curves.of(geometry, deadband, readings)

    def one(E: Float[Array, "pressures order"]) -> tuple[Array, ...]:
        residual = jnp.einsum("pke,pe->pk", of.A, E / of.unit) - of.target
        residual = jnp.where(there, residual, 0.0)
        force = curve.braid + jnp.einsum("ple,pe->pl", curve.bladder, E)
        least, s = of.drucker.minima(E / of.unit)
        paths, cell = jnp.arange(E.shape[0]), jnp.argmin(least, axis=1)
        phi = of.functions[1](paths, s[paths, cell])
        modulus = jnp.sum(phi * E / of.unit, axis=-1)
        return (
            jnp.sqrt(jnp.sum(residual**2, axis=1) / count),
            jnp.sum(jnp.abs(residual), axis=1) / count,
            force[:, 0] - blocked,
            _first_zero(curve.contraction, force) - free,
            jnp.sum((of.weight * residual) ** 2),
            jnp.min(modulus),
        )

    rmse, mae, blocked_error, free_error, square, margin = jax.tree.map(
        lambda leaf: leaf.reshape(*shape, *leaf.shape[1:]), jax.vmap(one)(flat)
    )
    n, k = jnp.sum(count), _n_parameters(orders, len(readings.pressure))[..., None]
    deviance = n * jnp.log(square / n)
    room = n - k - 1
    aicc = deviance + 2 * k + jnp.where(room > 0, 2 * k * (k + 1) / room, jnp.inf)
    return Scores(rmse, mae, blocked_error, free_error, aicc, deviance + k * jnp.log(n), margin)


def n_coefficients(dependence: str, order: int, n_pressures: int) -> int:
    """Number of coefficients of a form of the law."""
    return {"fixed": 1, "linear": min(2, n_pressures), "free": n_pressures}[dependence] * order


def _n_parameters(orders: tuple[int, ...], n_pressures: int) -> Float[Array, "dependences orders"]:
    """Coefficients, and the standard deviation of the errors."""
    counts = [[n_coefficients(d, o, n_pressures) + 1.0 for o in orders] for d in DEPENDENCES]
    return jnp.asarray(counts)


class _Curves(eqx.Module):
    """Forces along the isobars, from rest to beyond the measured contractions.

    Attributes:
        contraction: [-], shape (lengths,).
        braid: force [N], shape (pressures, lengths).
        bladder: force [N] per E_n = 1 Pa, shape (pressures, lengths, order).
    """

    contraction: Float[Array, " lengths"]
    braid: Float[Array, "pressures lengths"]
    bladder: Float[Array, "pressures lengths order"]

    @classmethod
    def of(
        cls, geometry: famjax.AbstractGeometry, deadband: Float[Array, ""], readings: Readings
    ) -> "_Curves":
        """The curves of a geometry."""
        rest = geometry.rest_length
        reached = _BEYOND * (1 - jnp.min(jnp.asarray(readings.path_end)) / rest)
        deepest = jnp.minimum(reached, 1 - geometry.length_range()[0] / rest)
        contraction = deepest * jnp.arange(_LENGTHS) / (_LENGTHS - 1)
        length, P = rest * (1 - contraction), jnp.asarray(readings.pressure)[:, None]

        def bladder(E: Float[Array, " order"]) -> Float[Array, "pressures lengths"]:
            return famjax.Muscle(geometry, famjax.PolynomialMaterial(E)).bladder_force(length, P)

        braid = famjax.Muscle(geometry, famjax.PolynomialMaterial(jnp.zeros(1)), deadband)
        return cls(
            contraction,
            braid.braid_force(length, P),
            jax.vmap(bladder, out_axes=-1)(jnp.eye(readings.order)),
        )


def _first_zero(
    x: Float[Array, " lengths"], force: Float[Array, "pressures lengths"]
) -> Float[Array, " pressures"]:
    """Where the force first falls through zero, nan where it does not."""
    falls = (force[:, :-1] > 0) & (force[:, 1:] <= 0)
    at = jnp.argmax(falls, axis=1)
    rows = jnp.arange(force.shape[0])
    before, after = force[rows, at], force[rows, at + 1]
    drop = jnp.where(before > after, before - after, 1.0)
    zero = x[at] + (x[at + 1] - x[at]) * before / drop
    return jnp.where(jnp.any(falls, axis=1), zero, jnp.nan)
