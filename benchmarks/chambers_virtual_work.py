"""What virtual work changes: -P dV/dL in place of Gaylord's force, 100 psi."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from chambers_balance import terms
from chambers_reference import Row, elastic_braid, geometries
from jaxtyping import Float

from famjax._elastic_braid import ElasticBraid
from famjax._virtual_work import PressureTerms, pressure_terms

PRESSURE = 100.0
CONTRACTIONS = np.linspace(0, 0.35, 71)
"""The range of the measured profiles."""

TABULATED = (0.0, 0.1, 0.2, 0.3, 0.35)


def _braid(name: str) -> ElasticBraid | None:
    """The elastic braid whose stretch is taken out; the inelastic geometry has none."""
    return None if name == "estimated inelastic" else elastic_braid()


@functools.cache
def over_contraction() -> dict[str, PressureTerms]:
    """Both pressure terms of each geometry at `CONTRACTIONS`."""
    at = eqx.filter_jit(pressure_terms)
    return {
        name: at(geometry, jnp.asarray(CONTRACTIONS), PRESSURE, braid=_braid(name))
        for name, geometry in geometries().items()
    }


def _mean(values: Float[np.ndarray, " n"]) -> float:
    """Mean over the range of contraction."""
    return float(np.trapezoid(values, CONTRACTIONS) / np.ptp(CONTRACTIONS))


def rows() -> list[Row]:
    """Both terms and their means.

    At constant pressure the rate's mean over the range is exact, the difference of two volumes; at
    one contraction the rate is that of the spline between five profiles.
    """
    table, found = "virtual work", []
    for name, both in over_contraction().items():
        columns = {
            "Gaylord force": np.asarray(both.gaylord),
            "-P dV/dL at constant pressure": np.asarray(both.virtual_work),
            "-P dV/dL at constant thread length": np.asarray(both.virtual_work_at_thread_length),
        }
        for quantity, values in columns.items():
            for c in TABULATED:
                force = float(np.interp(c, CONTRACTIONS, values))
                entry = f"{name}, 100 psi, contraction {c:g}, {quantity}"
                found.append(Row(table, entry, force, "lbf"))
        gaylord, work = columns["Gaylord force"], columns["-P dV/dL at constant thread length"]
        blocked = work[0] + terms()[name].at("bladder force", -1, "rest")
        for entry, value in (
            *(
                (f"mean {quantity}, 0 to 35 %", _mean(values))
                for quantity, values in columns.items()
            ),
            ("mean absolute change of the pressure term, 0 to 35 %", _mean(np.abs(work - gaylord))),
            ("blocked force with -P dV/dL at constant thread length", blocked),
        ):
            found.append(Row(table, f"{name}, 100 psi, {entry}", float(value), "lbf"))
    return found
