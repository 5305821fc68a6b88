"""One force map within an identification: its readings, its actuation paths, its parameters."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

import famjax

from .geometry_source import AbstractGeometrySource, KnownSource

_NEWTON_STEPS = 8  # c dF/dL is well below one in a rig that measures anything


class Reach(eqx.Module):
    """Force and stiffness at each reading, about which a compliant rig is made linear.

    Attributes:
        force: [N], shape (points,).
        stiffness: dF/dL [N/m] of the muscle, shape (points,).
    """

    force: Float[Array, " points"]
    stiffness: Float[Array, " points"]


class Part(eqx.Module):
    """A force map as a problem sees it.

    Attributes:
        force, pressure, length: loaded readings [N, Pa, m], shape (points,).
        weights: of the readings in each block, 1/std or 1, 0 where not in it: (blocks, points).
        basis: of the coefficients at the readings, shape (points, basis).
        pressure_level, length_level: levels [Pa, m] that the readings are on, shape (points,).
        length_index: number of the reading's length level among all, shape (points,).
        path_pressure: pressures [Pa] of the paths on which the constraint holds, (blocks, paths).
        path_basis: basis there, shape (blocks, paths, basis).
        path_end: shortest length [m] of each path, shape (blocks, paths); all start at rest.
        stations: parts of the path in [0, 1], shape (blocks, paths, stations).
        source: makes the geometry of the parameters.
        rest_length: L0 [m] of the specimen, where every path starts.
        where: names of the parameters and their places in the problem's vector.
        offsets: places of the offsets of the distinct lengths; empty where there are none.
        readings_at: dimensions at the readings, if the geometry is known beforehand.
        path_at: strains along the paths, if the geometry is known beforehand.
    """

    force: Float[Array, " points"]
    pressure: Float[Array, " points"]
    length: Float[Array, " points"]
    weights: Float[Array, "blocks points"]
    basis: Float[Array, "points basis"]
    pressure_level: Float[Array, " points"]
    length_level: Float[Array, " points"]
    length_index: Int[Array, " points"]
    path_pressure: Float[Array, "blocks paths"]
    path_basis: Float[Array, "blocks paths basis"]
    path_end: Float[Array, "blocks paths"]
    stations: Float[Array, "blocks paths stations"]
    source: AbstractGeometrySource
    rest_length: float = eqx.field(static=True)
    where: tuple[tuple[str, int], ...] = eqx.field(static=True)
    offsets: tuple[int, ...] = eqx.field(static=True)
    readings_at: famjax.Dimensions | None = None
    path_at: famjax.PathStrains | None = None

    def tabulated(self) -> "Part":
        """The same part, its dimensions computed once and for all if nothing can change them."""
        if not isinstance(self.source, KnownSource):
            return self
        fresh = dataclasses.replace(self, readings_at=None, path_at=None)
        readings_at, path_at = _tables(fresh)
        return dataclasses.replace(self, readings_at=readings_at, path_at=path_at)

    def values(self, parameters: Float[Array, " q"]) -> dict[str, Float[Array, ""]]:
        """This specimen's parameters by name."""
        return {name: parameters[place] for name, place in self.where}

    @property
    def compliant(self) -> bool:
        """Whether the rig gives way."""
        return any(name == "series_compliance" for name, _ in self.where)

    def compliance(self, parameters: Float[Array, " q"]) -> Float[Array, ""]:
        """Series compliance c [m/N] of the rig, zero where it is none of the parameters."""
        return self.values(parameters).get("series_compliance", jnp.zeros(()))

    def muscle(
        self, parameters: Float[Array, " q"], material: famjax.AbstractMaterial
    ) -> famjax.Muscle:
        """The muscle with these parameters and this material."""
        values = self.values(parameters)
        return famjax.Muscle(self.source.geometry(values), material, values["deadband_pressure"])

    def muscle_length(
        self, parameters: Float[Array, " q"], force: Float[Array, " points"]
    ) -> Float[Array, " points"]:
        """Active length [m] at the readings: as measured, with its offset, less what the rig gives."""
        length = self.length
        if self.offsets:
            length = length + parameters[jnp.asarray(self.offsets)][self.length_index]
        if self.compliant:
            length = length - self.compliance(parameters) * force
        return length

    def dimensions(self, parameters: Float[Array, " q"], reach: Reach | None) -> famjax.Dimensions:
        """The muscle's dimensions at the readings."""
        if self.readings_at is not None:
            return self.readings_at
        force = self.force if reach is None else reach.force
        geometry = self.source.geometry(self.values(parameters))
        return geometry.dimensions(self.muscle_length(parameters, force), self.pressure)

    def path_ends(
        self, parameters: Float[Array, " q"]
    ) -> tuple[Float[Array, ""], Float[Array, "blocks paths"]]:
        """Where the paths start, at rest, and end [m]: as short as the muscle was at any reading."""
        values, end = self.values(parameters), self.path_end
        if self.compliant:
            end = jnp.minimum(end, jnp.min(self.muscle_length(parameters, self.force)))
        return jnp.asarray(values.get("rest_length", self.rest_length)), end

    def path_lengths(self, parameters: Float[Array, " q"]) -> Float[Array, "blocks paths stations"]:
        """Active lengths [m] of the stations."""
        rest, end = self.path_ends(parameters)
        return rest + self.stations * (end - rest)[..., None]

    def path_strains(self, parameters: Float[Array, " q"]) -> famjax.PathStrains:
        """The strains at the stations."""
        if self.path_at is not None:
            return self.path_at
        geometry = self.source.geometry(self.values(parameters))
        lengths = self.path_lengths(parameters)
        return famjax.path_strains(geometry, lengths, self.path_pressure[..., None])

    def largest_strain(self, parameters: Float[Array, " q"]) -> Float[Array, "blocks paths"]:
        """Largest strain magnitude [-] that the material sees along each path."""
        rest, end = self.path_ends(parameters)
        ends = jnp.stack([jnp.full_like(end, rest), end], axis=-1)
        geometry = self.source.geometry(self.values(parameters))
        at = geometry.dimensions(ends, self.path_pressure[..., None])
        hoop = jnp.max(jnp.abs(at.hoop_strain), axis=-1)
        return jnp.max(jnp.maximum(hoop, jnp.abs(at.axial_strain)), axis=-1)

    def reach(self, parameters: Float[Array, " q"], material: famjax.AbstractMaterial) -> Reach:
        """Force in the compliant rig, by Newton's method, and the stiffness there; no derivatives."""
        muscle = self.muscle(parameters, material)
        compliance = self.compliance(parameters)
        pull = jax.vmap(jax.value_and_grad(muscle.force))

        def step(_: Int[Array, ""], force: Float[Array, " points"]) -> Float[Array, " points"]:
            model, stiffness = pull(self.muscle_length(parameters, force), self.pressure)
            return force - (force - model) / (1 + compliance * stiffness)

        force = jax.lax.fori_loop(0, _NEWTON_STEPS, step, self.force)
        stiffness = pull(self.muscle_length(parameters, force), self.pressure)[1]
        return jax.lax.stop_gradient(Reach(force, stiffness))


@eqx.filter_jit
def _tables(part: Part) -> tuple[famjax.Dimensions, famjax.PathStrains]:
    nothing = jnp.zeros(len(part.where))  # a known geometry reads no parameter
    return part.dimensions(nothing, None), part.path_strains(nothing)
