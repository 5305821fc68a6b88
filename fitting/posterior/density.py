"""The posterior's density, with the coefficients integrated where they are normal.

Readings y = F(u) + C(u) x + noise, u in a box, x with a flat prior, or a normal one, on the set that
the constraint leaves. For a given u and noise the coefficients are normal but for the constraint:
p(y | u) is the normal's mass, exp(-r^2/2) / det(Q)^1/2 with Q = A^T A of the weighted columns. What
of a constraint is active at the optimum, its faces, has slacks s = N x - h that are sampled, s >= 0,
with the normal density of s in the place of the rest of the mass. Censored readings leave nothing
normal: there the coefficients are sampled themselves.

References:
    Golub & Pereyra 1973 (separable models); Tobin 1958 (censored readings).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Bool, Float, Int

from ..convex import cholesky, inverse_lower
from ..pure_problem import PureProblem
from .box_map import BoxMap


class Layout(eqx.Module):
    """What the sampled vector v holds: geometry, log of the noise, slacks, coefficients.

    Attributes:
        geometry: number of parameters in the unit box.
        noise: whether the noise is sampled.
        slacks: places of the faces among the rows of the constraint.
        held: places of rows that are equations: the bounds of coefficients that are held.
        joint: whether the coefficients are sampled and not integrated.
    """

    geometry: int = eqx.field(static=True)
    noise: bool = eqx.field(static=True)
    slacks: tuple[int, ...] = eqx.field(static=True)
    held: tuple[int, ...] = eqx.field(static=True)
    joint: bool = eqx.field(static=True)


class Coordinates(eqx.Module):
    """Coefficients x = centre + scale c, in which they are about a standard normal.

    Attributes:
        centre: shape (n,).
        scale: shape (n, n).
        face_scale: of the rows of faces and held coefficients [Pa], shape (r,).
        others: rows on c that these leave open at the optimum, shape (n - r, n).
    """

    centre: Float[np.ndarray, " n"]
    scale: Float[np.ndarray, "n n"]
    face_scale: Float[np.ndarray, " r"]
    others: Float[np.ndarray, "o n"]


class Density(eqx.Module):
    """The logarithm of the posterior, of points z of R^d.

    Attributes:
        fit: the problem, its constraint posed at the faces alone.
        force: readings [N]; where one is censored, its limit.
        side: 0 for a reading, 1 where the force is at most the limit, -1 where it is at least.
        layout, coordinates: of the sampled vector.
        noise: standard deviation, in the unit of a weighted residual, where it is known.
        prior_noise: against which the rows of priors were weighed.
        box: of v.
    """

    fit: PureProblem
    force: Float[np.ndarray, " points"]
    side: Int[np.ndarray, " points"]
    layout: Layout
    coordinates: Coordinates
    noise: Float[np.ndarray, ""]
    prior_noise: Float[np.ndarray, ""]
    box: BoxMap

    def __call__(self, z: Float[Array, " d"]) -> Float[Array, ""]:
        """Log p(v | y) + log |dv/dz|, but for a constant."""
        v, log_slope = self.box(z)
        return self.log_posterior(v) + log_slope

    def parts(self, v: Float[Array, " d"]) -> tuple[Array, Array, Array, Array]:
        """Geometry in the unit box, noise, slacks in their scale, other coefficients."""
        p, r = self.layout.geometry, len(self.layout.slacks)
        first = p + self.layout.noise
        sigma = jnp.exp(v[p]) if self.layout.noise else jnp.asarray(self.noise)
        slack = jnp.concatenate([v[first : first + r], jnp.zeros(len(self.layout.held))])
        return v[:p], sigma, slack, v[first + r :]

    def log_posterior(self, v: Float[Array, " d"]) -> Float[Array, ""]:
        """Log p(v | y), but for a constant."""
        u, sigma, slack, rest = self.parts(v)
        p = self.fit.parameters(u)
        A, b, N, offset = self._programme(p, sigma)
        measured = jnp.sum(jnp.asarray(self.side == 0))
        found = -measured * jnp.log(sigma) - jnp.sum(self._prior(p) ** 2) / 2
        if self.layout.joint:
            c, log_volume = self._coefficients(N, offset, slack, rest)
            return found + log_volume + self._log_likelihood(A @ c - b, p, c, sigma)
        lower, inverse, middle = _normal(A, b)
        r = A @ middle - b
        found = found - r @ r / 2 - jnp.sum(jnp.log(jnp.diagonal(lower)))
        if slack.size:
            # The density of the slacks: that of N c - offset, c normal.
            half = N @ inverse.T
            spread = cholesky(half @ half.T)
            away = inverse_lower(spread) @ (slack - (N @ middle - offset))
            found = found - away @ away / 2 - jnp.sum(jnp.log(jnp.diagonal(spread)))
        return found

    def draw(
        self, whole: PureProblem, v: Float[Array, " d"], key: Array
    ) -> tuple[Float[Array, " q"], Float[Array, " n"], Float[Array, ""], Bool[Array, ""]]:
        """One draw of everything: parameters [SI], coefficients, noise, and whether it may be.

        Args:
            whole: the problem, its constraint posed everywhere.
            v: of the sampled vector.
            key: of the draw of the coefficients.
        """
        u, sigma, slack, rest = self.parts(v)
        p = self.fit.parameters(u)
        A, b, N, offset = self._programme(p, sigma)
        if self.layout.joint:
            c, _ = self._coefficients(N, offset, slack, rest)
        else:
            _, inverse, middle = _normal(A, b)
            c = middle + inverse.T @ jax.random.normal(key, middle.shape)
            if slack.size:
                half = N @ inverse.T
                back = jnp.linalg.solve(half @ half.T, slack - (N @ c - offset))
                c = c + inverse.T @ (half.T @ back)
        x = jnp.asarray(self.coordinates.centre + self.coordinates.scale @ c)
        _, _, G, h = self._posed(whole, p)
        rounding = 1e-9 * jnp.max(jnp.abs(x), initial=0.0)
        held = jnp.min(G @ x - h, initial=jnp.inf) >= -rounding
        return p, x, sigma, held & jnp.all(jnp.isfinite(x))

    def _posed(self, of: PureProblem, p: Array) -> tuple[Array, Array, Array, Array]:
        """A, b, G and h about no coefficients, every reading with the weight that it has."""
        force = jnp.asarray(self.force)
        none = jnp.zeros(self.coordinates.centre.shape)
        return of.programme(p, none, force, jnp.ones(force.shape), force)

    def _programme(self, p: Array, sigma: Array) -> tuple[Array, Array, Array, Array]:
        """A, b of the standardised residual A c - b, and N, offset of the slacks N c - offset."""
        of, count = self.coordinates, self.force.shape[0]
        A, b, G, h = self._posed(self.fit, p)
        scale = jnp.where(jnp.arange(A.shape[0]) < count, 1 / sigma, 1 / self.prior_noise)
        at = np.array(self.layout.slacks + self.layout.held, int)
        N, h = (leaf / (of.face_scale[:, None] if leaf.ndim == 2 else of.face_scale)
                for leaf in (G[at], h[at]))  # fmt: skip
        b = scale * (b - A @ of.centre)
        return scale[:, None] * (A @ of.scale), b, jnp.asarray(N @ of.scale), h - N @ of.centre

    def _prior(self, p: Array) -> Array:
        places, means, weights = self.fit.priors
        return jnp.asarray(weights / self.prior_noise * (p[places] - means))

    def _coefficients(
        self, N: Array, offset: Array, slack: Array, rest: Array
    ) -> tuple[Array, Array]:
        """The coefficients of slacks and others, and the logarithm of the volume they stand for."""
        if not slack.size:
            return jnp.asarray(self.coordinates.others.T @ rest), jnp.zeros(())
        rows = jnp.concatenate([N, jnp.asarray(self.coordinates.others)])
        c = jnp.linalg.solve(rows, jnp.concatenate([slack + offset, rest]))
        return c, -jnp.linalg.slogdet(rows)[1]

    def _log_likelihood(self, residual: Array, p: Array, c: Array, sigma: Array) -> Array:
        """Of readings and priors, but for the determinant of the noise."""
        count = self.force.shape[0]
        if self.fit.compliant:
            x = jnp.asarray(self.coordinates.centre + self.coordinates.scale @ c)
            exact, _ = self.fit.exact(p, x, jnp.asarray(self.force), jnp.asarray(self.force))
            residual = jnp.concatenate([exact[:count] / sigma, residual[count:]])
        priors, r, side = residual[count:], residual[:count], jnp.asarray(self.side)
        censored = log_ndtr(jnp.where(side == 0, 0.0, -side * r))
        return jnp.sum(jnp.where(side == 0, -(r**2) / 2, censored)) - priors @ priors / 2


def _normal(A: Array, b: Array) -> tuple[Array, Array, Array]:
    """Lower triangle of A^T A, its inverse, and the coefficients of the least residual."""
    lower = cholesky(A.T @ A)
    inverse = inverse_lower(lower)
    return lower, inverse, inverse.T @ (inverse @ (A.T @ b))
