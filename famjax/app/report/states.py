"""What a model says over contraction and pressure, by one program, blocked and free states among it.

No equilibrium is solved: the free contraction is where a spline through the forces falls to zero.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.compile_options import quick_jit
from famjax.terms import BladderAxial, BladderHoop, BladderWall

PRESSURE = "pressure on the braid"
"""Name of the part of the force that is the braid's, the first of all."""
_RANGE = 129
"""Lengths over the whole range of a geometry: a cubic spline through them repeats a force to 1e-7."""


@dataclasses.dataclass(frozen=True)
class States:
    """A muscle over its stroke at several pressures; nan where its geometry is not known.

    Attributes:
        contraction: from rest to the end of the measured stroke, shape (c,).
        force: F [N] of the model, below zero where the muscle is slack; shape (p, c), as all that
            follow.
        diameter: of the braid, D [m]: the average one.
        braid_angle: theta [rad].
        thickness: of the wall [m].
        volume: within the outline [m3].
        axial_strain: eps_z.
        mean_hoop_strain: axial mean of eps_c.
        most_hoop_strain: largest eps_c along the axis.
        axial_stress, hoop_stress: axial means [Pa].
        terms: parts of the force [N] by name.
        rest_length: L0 [m].
        lengths: over the whole range of the geometry [m], falling, shape (r,).
        forces: there [N], shape (p, r).
    """

    contraction: np.ndarray
    force: np.ndarray
    diameter: np.ndarray
    braid_angle: np.ndarray
    thickness: np.ndarray
    volume: np.ndarray
    axial_strain: np.ndarray
    mean_hoop_strain: np.ndarray
    most_hoop_strain: np.ndarray
    axial_stress: np.ndarray
    hoop_stress: np.ndarray
    terms: dict[str, np.ndarray]
    rest_length: float
    lengths: np.ndarray
    forces: np.ndarray

    @property
    def blocked_force(self) -> np.ndarray:
        """Force [N] at zero contraction by pressure, 0 where slack; nan where it is not known."""
        return np.maximum(self.force[:, 0], 0.0)

    def free_contraction(self) -> np.ndarray:
        """Contraction at which the force first falls to zero, by pressure; nan where it does not."""
        return np.array([_first_zero(self.lengths, row, self.rest_length) for row in self.forces])


def states_of(muscle: famjax.Muscle, pressures: np.ndarray, shortest: float, count: int) -> States:
    """The states of a muscle, by one compiled program.

    Args:
        muscle: with a geometry and terms.
        pressures: gauge pressures [Pa], shape (p,).
        shortest: length at the end of the stroke [m].
        count: of lengths over the stroke.
    """
    rest = float(muscle.rest_length)
    ends = [float(end) for end in muscle.length_range()]
    stroke = np.linspace(rest, shortest, count)
    whole = np.linspace(min(rest, ends[1]), ends[0], _RANGE)
    found = {
        name: np.asarray(values)
        for name, values in _states(
            muscle, np.concatenate([stroke, whole]), pressures[:, None]
        ).items()
    }
    within = {name: values[..., :count] for name, values in found.items()}
    terms = {name[6:]: within.pop(name) for name in [*within] if name.startswith("term: ")}
    terms = dict(sorted(terms.items(), key=lambda one: one[0] != PRESSURE))
    return States(
        contraction=1 - stroke / rest, terms=terms, rest_length=rest, lengths=whole,
        forces=found["force"][:, count:], **within,
    )  # fmt: skip


@quick_jit
def _states(
    muscle: famjax.Muscle, lengths: famjax.Real, pressures: famjax.Real
) -> dict[str, Float[Array, "..."]]:
    L, P = jnp.broadcast_arrays(jnp.asarray(lengths), jnp.asarray(pressures))
    rated = any(term.uses_rates for term in muscle.terms.terms)
    geometry = muscle.geometry
    at = (geometry.dimensions_with_rates if rated else geometry.dimensions)(L, P)
    parts = _parts(muscle, at, P)
    weights, hoop = at.station_weights, at.hoop_strain
    content = {
        "force": jnp.asarray(sum(parts.values())),
        "diameter": 2 * at.radius,
        "braid_angle": at.braid_angle,
        "thickness": at.thickness,
        "volume": at.volume,
        "axial_strain": at.axial_strain,
        "mean_hoop_strain": jnp.sum(weights * hoop, axis=-1),
        "most_hoop_strain": jnp.max(hoop, axis=-1),
        **_stresses(muscle, at, P),
        **{f"term: {name}": part for name, part in parts.items()},
    }
    return jax.tree.map(lambda values: jnp.where(at.reached, values, jnp.nan), content)


def _parts(
    muscle: famjax.Muscle, at: famjax.geometries.Dimensions, pressure: Array
) -> dict[str, Array]:
    """Each term's part of the force [N]; the wall's in its two."""
    parts = {}
    for term in muscle.terms.terms:
        material = term.material if isinstance(term, BladderWall) else None
        if material is not None:
            parts["bladder, axial stress"] = BladderAxial(material).force(at, pressure)
            parts["bladder, hoop stress"] = BladderHoop(material).force(at, pressure)
        else:
            held = hasattr(term, "deadband_pressure")
            parts[PRESSURE if held else type(term).__name__] = term.force(at, pressure)
    return parts


def _stresses(
    muscle: famjax.Muscle, at: famjax.geometries.Dimensions, pressure: Array
) -> dict[str, Array]:
    axial, hoop = muscle.material.stresses(
        at.axial_strain[..., None], at.hoop_strain, pressure[..., None]
    )
    weights = at.station_weights
    return {
        "axial_stress": jnp.sum(weights * axial, axis=-1),
        "hoop_stress": jnp.sum(weights * hoop, axis=-1),
    }


def _first_zero(lengths: np.ndarray, force: np.ndarray, rest: float) -> float:
    """Contraction at the longest length at which a cubic spline of the force falls to zero."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(force)
    contraction = 1 - lengths[known] / rest
    if known.sum() < 4 or force[known][0] <= 0:
        return np.nan
    spline = CubicSpline(contraction, force[known])
    roots = np.sort(spline.roots(extrapolate=False))
    falling = roots[spline(roots, 1) < 0]
    return float(falling[0]) if falling.size else np.nan
