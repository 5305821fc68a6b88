"""Bootstrap replicates of every fit of a sweep: readings drawn anew enter as weights.

The weights of a replicate change the Gram matrix of each pressure's compressed readings, [Q r] with
Q orthonormal, and nothing else. So a replicate is a few small matrices, and its fit one quadratic
programme that shares its rows with all others of the same form.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

import famjax

from .._convex.constraint import posed
from .._convex.convex_fit import minimise
from ..engine.active_set import nearest_points
from ..engine.small_dense import cholesky, inverse_lower
from ..engine.status import Status
from .fits import over_all
from .forms import CONSTRAINTS, DEPENDENCES, Forms
from .padded import (
    Unknowns,
    constraint_of,
    coupled,
    free,
    huber_threshold,
    objective_of,
)
from .problem import Design, Nodes, Readings, design


def draw(
    readings: Readings, count: int, seed: tuple[int, ...]
) -> Float[np.ndarray, "replicates pressures readings"]:
    """How often each reading is drawn: with replacement, at each pressure as many as there are.

    Args:
        readings: of the force map.
        count: number of replicates.
        seed: the same seed gives the same draws.
    """
    rng, there = np.random.default_rng(seed), readings.there
    drawn = np.zeros((count, *there.shape))
    for p, here in enumerate(there):
        n = int(here.sum())
        drawn[:, p, here] = rng.multinomial(n, np.full(n, 1 / n), size=count)
    return drawn


def replicate_all(
    of: Design, forms: Forms, weights: Float[Array, "replicates pressures readings"]
) -> Float[Array, "dependences orders constraints replicates pressures order"]:
    """Coefficients [Pa] of replicates minus those of the fit, of every fit by sum of squares.

    Constraints hold at the stations, and at the points where the fit to all readings touches them.

    Args:
        of: the linear problem.
        forms: of the law.
        weights: of the readings.

    Returns:
        Differences at each pressure; nan where a programme has no certified optimum.
    """
    grams = _grams(of, weights)
    every = jnp.arange(of.target.shape[0])
    degrees = jnp.asarray(forms.orders)
    kinds = jnp.asarray([CONSTRAINTS.index(kind) for kind in forms.constraints])
    shared = [DEPENDENCES.index(form) for form in forms.dependences if form != "free"]

    def together(
        form: Int[Array, ""], order: Int[Array, ""], kind: Int[Array, ""]
    ) -> Float[Array, "replicates pressures order"]:
        return _replicates(of, coupled(of, form, order), kind, grams)

    def apart(
        order: Int[Array, ""], kind: Int[Array, ""], path: Int[Array, ""]
    ) -> Float[Array, "replicates 1 order"]:
        return _replicates(of, free(of, order, path), kind, grams[:, path[None]])

    found = []
    if shared:
        found.append(over_all(together, jnp.asarray(shared), degrees, kinds, one_by_one=True))
    if "free" in forms.dependences:
        single = over_all(apart, degrees, kinds, every, one_by_one=True)
        found.append(jnp.moveaxis(single[..., 0, :], 2, 3)[None])
    return jnp.concatenate(found)


def replicate_sums(
    geometry: famjax.geometries.AbstractGeometry,
    deadband: float,
    readings: Readings,
    nodes: Nodes,
    forms: Forms,
    weights: Float[np.ndarray, "replicates pressures readings"],
    count: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sums over the first replicates of their deviations from the fit [Pa].

    Args:
        geometry: of the fits.
        deadband: P_d [Pa].
        readings: of the force map.
        nodes: of the constraints.
        forms: of the law.
        weights: of the readings.
        count: number of replicates that are summed.

    Returns:
        (sum, sum of squares, number of those that are known), with the axes of the fits.
    """
    given = (jnp.asarray(deadband), jnp.asarray(weights), jnp.asarray(count))
    found = _sums(geometry, readings, nodes, forms, *given)
    total, square, known = jax.tree.map(np.asarray, found)
    return total, square, known


@eqx.filter_jit
def _sums(
    geometry: famjax.geometries.AbstractGeometry,
    readings: Readings,
    nodes: Nodes,
    forms: Forms,
    deadband: Float[Array, ""],
    weights: Float[Array, "replicates pressures readings"],
    count: Int[Array, ""],
) -> tuple[Array, Array, Array]:
    each = replicate_all(design(geometry, deadband, readings, nodes), forms, weights)
    known = jnp.all(jnp.isfinite(each), axis=(-2, -1), keepdims=True)
    known &= (jnp.arange(weights.shape[0]) < count)[:, None, None]
    each = jnp.where(known, each, 0.0)
    return jnp.sum(each, axis=3), jnp.sum(each**2, axis=3), jnp.sum(known, axis=3)


def _grams(
    of: Design, weights: Float[Array, "replicates pressures readings"]
) -> Float[Array, "replicates pressures rows rows"]:
    """Weighted Gram matrices of the orthonormal columns that [A y] is compressed to."""

    def one(
        A: Float[Array, "k n"], y: Float[Array, " k"], weights: Float[Array, "replicates k"]
    ) -> Float[Array, "replicates rows rows"]:
        Q, _ = jnp.linalg.qr(A)
        rest = y - Q @ (Q.T @ y)
        size = jnp.linalg.norm(rest)
        columns = jnp.concatenate([Q, (rest / jnp.where(size > 0, size, 1.0))[:, None]], axis=1)
        products = columns[:, :, None] * columns[:, None, :]
        gram = weights @ products.reshape(y.shape[0], -1)
        return gram.reshape(-1, *products.shape[1:])

    A, y = of.A * of.weight[..., None], of.target * of.weight
    return jax.vmap(one, in_axes=(0, 0, 1), out_axes=1)(A, y, weights)


def _replicates(
    of: Design,
    at: Unknowns,
    kind: Int[Array, ""],
    grams: Float[Array, "replicates paths rows rows"],
) -> Float[Array, "replicates paths order"]:
    """Coefficients of the replicates of one fit, minus those of the fit to all readings."""
    W, c = at.blocks
    n, constraint = W.shape[-1], constraint_of(of, at, kind)
    keep = jnp.ones(at.paths.shape[0])
    aim = objective_of("sum_of_squares", of, at, huber_threshold(of), keep)
    whole = minimise(aim, constraint, at.start)
    rows = constraint.grid_rows(), posed(constraint.exact_rows(whole.dips, whole.y))
    G, h = (jnp.concatenate(both) for both in zip(*rows, strict=True))
    flat = grams.reshape(grams.shape[0], -1)
    hessians = flat @ jnp.einsum("pkn,plm->pklnm", W, W).reshape(-1, n * n)
    right = flat @ jnp.einsum("pkn,pl->pkln", W, c).reshape(-1, n)
    unit = jnp.diag(jnp.where(jnp.any(W != 0, axis=(0, 1)), 0.0, 1.0))
    J = jax.vmap(lambda H: inverse_lower(cholesky(H.reshape(n, n) + unit)).T)(hessians)
    centre = jnp.einsum("rnm,rn->rm", J, right)
    points = nearest_points(G, h, centre, J, whole.rows)
    y = jnp.einsum("rnm,rm->rn", J, points.y)
    known = (points.status == int(Status.OPTIMAL)) & ~at.deficient
    difference = jax.vmap(constraint.coefficients)(y - whole.y) * of.unit
    return jnp.where(known[:, None, None], difference, jnp.nan)
