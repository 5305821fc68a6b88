"""Hocking and Wereley's practice: a known geometry, and a stress law of its own at every pressure."""

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax import peers
from famjax.boundary.errors import InputError
from famjax.compile_options import quick_jit

from ..data import ForceData
from ..families import EstimatedSource
from ..response import AbstractFamily, MapInputs, Values, linear_response
from .cross_validation import Predictor

ORDER = 4
ANGLE = math.radians(90 - 28.6)  # from the circumference: the nominal one of Festo muscles


def hocking_orders(data: ForceData) -> dict[float, int]:
    """Number of coefficients that the loaded readings determine at each pressure [Pa].

    It is the number of lengths at which the bladder is strained there, four at most. Pressures
    with none are left out.
    """
    pressure, length, strained = data.pressures.level, data.lengths.level, data.strained
    return {
        float(level): min(ORDER, np.unique(length[strained & (pressure == level)]).size)
        for level in np.unique(pressure[strained])
    }


def fit_hocking_wereley(train: ForceData) -> Predictor:
    """The force of a polynomial bladder whose coefficients were fitted at each pressure by itself.

    The geometry is not fitted: the braid lies at the bore, or mid-wall where it is embedded, at
    the nominal angle. Where a pressure has fewer strained lengths than coefficients, the lower
    orders are taken. Between pressures the coefficients are interpolated, outside them the nearest
    ones are kept.

    Args:
        train: the force map.

    Returns:
        The force [N] of length [m] and pressure [Pa].

    Raises:
        InputError: the specimen has no nominal diameter, or no reading a strained bladder.

    References:
        Hocking & Wereley 2012; see `famjax.peers.hocking_wereley`.
    """
    specimen = train.specimen
    if specimen.nominal_diameter is None:
        raise InputError(
            "Hocking and Wereley's fit takes the geometry as known: give the specimen's "
            "nominal_diameter (--specimen nominal_diameter_mm=...)"
        )
    orders = hocking_orders(train)
    if not orders:
        raise InputError(
            "Hocking and Wereley's coefficients need loaded readings away from the rest length, "
            f"{specimen.rest_length * 1e3:.5g} mm: there are none"
        )
    inset = specimen.wall_thickness if specimen.embedded else 0.0
    family = _PowerLaw(
        source=EstimatedSource(specimen).as_arrays(),
        braid_diameter=np.asarray(specimen.nominal_diameter + inset),
        nonlinear=(),
        linear=tuple(f"E_{n}" for n in range(1, ORDER + 1)),
    )
    loaded = train.part(train.loaded)
    area, columns = _parts(family, loaded.length)
    coefficients = np.zeros((len(orders), ORDER))
    for row, (level, order) in enumerate(orders.items()):
        at = train.pressures.level[train.loaded] == level
        bladder = loaded.force[at] - level * area[at]
        coefficients[row, :order] = np.linalg.lstsq(columns[at, :order], bladder, rcond=None)[0]

    def force(length: np.ndarray, pressure: np.ndarray) -> Float[np.ndarray, " n"]:
        area, columns = _parts(family, length)
        at = np.stack([np.interp(pressure, list(orders), E_n) for E_n in coefficients.T], axis=-1)
        return pressure * area + np.sum(columns * at, axis=-1)

    return force


class _PowerLaw(AbstractFamily):
    """A muscle of known geometry whose coefficients are those of one pressure.

    Attributes:
        source: of the geometry.
        braid_diameter: [m] at rest.
    """

    source: EstimatedSource
    braid_diameter: Float[np.ndarray, ""]
    nonlinear: tuple[str, ...] = eqx.field(static=True)
    linear: tuple[str, ...] = eqx.field(static=True)

    def build(self, values: Values) -> famjax.Muscle:
        """The muscle of these coefficients [Pa], at pressures up to 2 Pa."""
        geometry = self.source.geometry(
            {"braid_diameter": self.braid_diameter, "braid_angle": ANGLE}
        )
        law = jnp.stack([values[name] for name in self.linear])
        return peers.hocking_wereley(geometry, np.array([0.0, 2.0]), jnp.stack([law, law]))

    def rest_length(self, values: Values) -> Float[Array, ""]:
        """Of no account: nothing is followed along a path."""
        del values
        return jnp.zeros(())


def _parts(
    family: _PowerLaw, length: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n order"]]:
    """Braid force per pressure [m2], and bladder force [N] of each E_n = 1 Pa."""
    lengths, where = np.unique(length, return_inverse=True)
    none, nothing = np.zeros(lengths.size), np.zeros(1)
    at = MapInputs(lengths, none + 1, none, nothing, nothing, np.zeros((1, 0)))
    response = quick_jit(linear_response)
    found = response(family, "none", at, np.zeros(0), np.zeros(ORDER), none)
    return np.asarray(found.force)[where], np.asarray(found.columns)[where]
