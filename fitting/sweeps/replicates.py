"""Bootstrap replicates of every fit of a sweep: readings drawn anew enter as weights.

The weights of a replicate change the Gram matrix of each pressure's compressed readings, [Q r] with
Q orthonormal, and nothing else. So a replicate is a few small matrices, and its fit one quadratic
programme that shares its rows with all others of the same form: those at the stations, and those at
the points where the fit to all readings, which the host has found, touches the constraint.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..convex import Status, cholesky, inverse_lower, nearest_points
from .arrays import AnyArray
from .design import STATIONS, Design
from .fits import solved
from .forms import Forms
from .unknowns import Unknowns, coupled, free


def draw(
    there: Bool[np.ndarray, "pressures readings"], count: int, seed: tuple[int, ...]
) -> Float[np.ndarray, "replicates pressures readings"]:
    """How often each reading is drawn: with replacement, at each pressure as many as there are.

    Args:
        there: which of the padded readings are readings.
        count: number of replicates.
        seed: the same seed gives the same draws.
    """
    rng = np.random.default_rng(seed)
    drawn = np.zeros((count, *there.shape))
    for p, here in enumerate(there):
        n = int(here.sum())
        drawn[:, p, here] = rng.multinomial(n, np.full(n, 1 / n), size=count)
    return drawn


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Programmes:
    """The fits to all readings by sum of squares, each of one problem or of one per pressure.

    Leading axes, `*fits`: (constraints, dependences, orders, problems).

    Attributes:
        W: of the compressed readings, whose residuals are W y - c, shape (*fits, paths, rows, n).
        c: shape (*fits, paths, rows).
        G: rows of unit length or zero, shape (*fits, m, n).
        y: the optimum, shape (*fits, n).
        rows: indices of those that are active there, and which of them are used, (*fits, n).
        on_y: coefficients [Pa] of each path per unknown, shape (*fits, paths, order, n).
        known: whether there is an optimum, shape (*fits,).
        paths: indices of the pressures, shape (*fits, paths).
    """

    W: Float[AnyArray, "*fits paths rows n"]
    c: Float[AnyArray, "*fits paths rows"]
    G: Float[AnyArray, "*fits m n"]
    y: Float[AnyArray, "*fits n"]
    rows: tuple[Int[AnyArray, "*fits n"], Bool[AnyArray, "*fits n"]]
    on_y: Float[AnyArray, "*fits paths order n"]
    known: Bool[AnyArray, "*fits"]
    paths: Int[AnyArray, "*fits paths"]

    @classmethod
    def of(cls, of: Design, unknowns: Unknowns, forms: Forms, problems: int) -> "Programmes":
        """Those of laws into how many problems each of them falls."""
        paths, axes = unknowns.paths.shape[1], (len(forms.orders), problems)
        # As many rows as there may be, so that one compilation serves all maps of a shape.
        size, found = (STATIONS + 2) * paths, []
        keep = np.ones((1, paths))
        for batch in solved(of, unknowns, forms.constraints, keep, "sum_of_squares"):
            fits, more = batch.fits, size - batch.fits.normals.shape[1]
            found.append(
                cls(
                    W=batch.objective.W,
                    c=batch.objective.c,
                    G=np.pad(fits.normals, ((0, 0), (0, more), (0, 0))),
                    y=fits.y,
                    rows=fits.rows,
                    on_y=batch.constraint.on_y * of.unit[:, None],
                    known=~unknowns.deficient[batch.form],
                    paths=unknowns.paths[batch.form],
                )
            )

        def whole(*leaves: np.ndarray) -> np.ndarray:
            joined = np.concatenate(leaves)
            return joined.reshape(len(forms.constraints), -1, *axes, *joined.shape[1:])

        return jax.tree.map(whole, *found)


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Some replicates of the fits of a map: arrays alone, so that any process can do them.

    Attributes:
        programmes: fits of laws that are fixed or linear in pressure, and of free ones.
        A, target: of the readings, weighted, shapes (pressures, readings, order) and without order.
        there: which of the padded readings are readings.
        seed: of the draws.
        size: number of replicates that are drawn, the same for all chunks: one compilation serves
            them.
        count: of those, how many are summed.
    """

    programmes: tuple[Programmes, ...]
    A: Float[np.ndarray, "pressures readings order"]
    target: Float[np.ndarray, "pressures readings"]
    there: Bool[np.ndarray, "pressures readings"]
    seed: tuple[int, ...] = (0,)
    size: int = 1
    count: int = 1

    @classmethod
    def of(cls, of: Design, forms: Forms) -> "Chunk":
        """One of a map, from the fits to all its readings."""
        shared, found = [form for form in forms.dependences if form != "free"], []
        if shared:
            found.append(Programmes.of(of, coupled(of, shared, forms.orders), forms, 1))
        if "free" in forms.dependences:
            found.append(Programmes.of(of, free(of, forms.orders), forms, len(of.target)))
        A, target = np.asarray(of.A * of.weight[..., None]), np.asarray(of.target * of.weight)
        return cls(tuple(found), A, target, np.asarray(of.there))


class Chunks(Sequence[Chunk | None]):
    """What each part of a sweep is made of, put together when it is asked for: one map is in memory.

    Args:
        designs: what returns the linear problem of each map.
        forms: of the laws.
        parts: index of the map, and replicates (first, count); those without are fits.
        seed: of the replicates.
        size: of a chunk, see `Chunk`.
    """

    def __init__(
        self,
        designs: Sequence[Callable[[], Design]],
        forms: Forms,
        parts: Sequence[tuple[int, tuple[int, int] | None]],
        seed: int,
        *,
        size: int,
    ) -> None:
        self._designs, self._forms, self._parts, self._seed = designs, forms, parts, seed
        self._size = size
        self._last: tuple[int, Chunk] | None = None

    def __len__(self) -> int:
        return len(self._parts)

    def __getitem__(self, index: Any) -> Any:
        k, part = self._parts[index]
        if part is None:
            return None
        if self._last is None or self._last[0] != k:
            self._last = k, Chunk.of(self._designs[k](), self._forms)
        first, count = part
        return dataclasses.replace(
            self._last[1], seed=(self._seed, k, first), size=self._size, count=count,
        )  # fmt: skip


def chunk_sums(chunk: Chunk) -> dict[str, np.ndarray]:
    """Sums over the replicates of a chunk of their deviations from the fit [Pa], and of the squares.

    Returns:
        "sum", "square" and "count" of those that are known, with the axes of the fits.
    """
    weights = draw(chunk.there, chunk.size, chunk.seed)
    given = chunk.A, chunk.target, weights, np.asarray(chunk.count)
    found = [_sums(programmes, *given) for programmes in chunk.programmes]
    return {
        name: np.concatenate([np.moveaxis(np.asarray(leaf), 0, 2) for leaf in leaves])
        for name, *leaves in zip(("sum", "square", "count"), *found, strict=True)
    }


@jax.jit
def _sums(
    programmes: Programmes,
    A: Float[Array, "pressures k n"],
    y: Float[Array, "pressures k"],
    weights: Float[Array, "replicates pressures k"],
    count: Int[Array, ""],
) -> tuple[Array, Array, Array]:
    axes, grams = programmes.known.shape, _grams(A, y, weights)
    apart = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[4:]), programmes)
    each = jax.lax.map(lambda one: replicated(one, grams), apart)
    each = jnp.moveaxis(each.reshape(*axes, *each.shape[1:]), 3, 4)
    each = each.reshape(*axes[:3], len(weights), -1, each.shape[-1])
    known = jnp.all(jnp.isfinite(each), axis=(-2, -1), keepdims=True)
    known &= (jnp.arange(len(weights)) < count)[:, None, None]
    each = jnp.where(known, each, 0.0)
    return jnp.sum(each, axis=3), jnp.sum(each**2, axis=3), jnp.sum(known, axis=3)


def _grams(
    A: Float[Array, "pressures k n"],
    y: Float[Array, "pressures k"],
    weights: Float[Array, "replicates pressures k"],
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

    return jax.vmap(one, in_axes=(0, 0, 1), out_axes=1)(A, y, weights)


def replicated(
    of: Programmes,
    grams: Float[Array, "replicates pressures rows rows"],
) -> Float[Array, "replicates paths order"]:
    """Coefficients [Pa] of the replicates of one programme, minus those of the fit to all readings.

    Constraints hold at the stations, and at the points where that fit touches them.
    """
    W, c, n = of.W, of.c, of.W.shape[-1]
    flat = grams[:, of.paths].reshape(grams.shape[0], -1)
    hessians = flat @ jnp.einsum("pkn,plm->pklnm", W, W).reshape(-1, n * n)
    right = flat @ jnp.einsum("pkn,pl->pkln", W, c).reshape(-1, n)
    unit = jnp.diag(jnp.where(jnp.any(W != 0, axis=(0, 1)), 0.0, 1.0))
    L = cholesky(hessians.reshape(-1, n, n) + unit)
    J = jnp.swapaxes(inverse_lower(L), 1, 2)
    # Readings that happen to be drawn at too few lengths do not determine the law.
    condition = jnp.sum(L**2, axis=(1, 2)) * jnp.sum(J**2, axis=(1, 2))
    determined = condition * 10 * c.size * jnp.finfo(c.dtype).eps < 1
    centre = jnp.einsum("rnm,rn->rm", J, right)
    h = jnp.where(jnp.any(of.G != 0, axis=1), 0.0, -1.0)
    points = nearest_points(of.G, h, centre, J, of.rows)
    y = jnp.einsum("rnm,rm->rn", J, points.y)
    known = (points.status == int(Status.OPTIMAL)) & determined & of.known
    difference = jnp.einsum("pen,rn->rpe", of.on_y, y - of.y)
    return jnp.where(known[:, None, None], difference, jnp.nan)
