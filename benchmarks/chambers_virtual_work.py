"""What virtual work changes: -P dV/dL in place of Gaylord's force, 100 psi."""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from chambers_reference import Row, elastic_braid, geometries, latex

from famjax import Muscle
from famjax._elastic_braid import ElasticBraid
from famjax._virtual_work import PressureTerms, VirtualWorkGeometry, pressure_terms

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


def rows() -> list[Row]:
    """Both terms and their mean difference, and the muscle that works with the new one."""
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
                found.append(Row(table, f"{name}, 100 psi, contraction {c:g}, {quantity}", force, "lbf"))
        gaylord, work = columns["Gaylord force"], columns["-P dV/dL at constant thread length"]
        entry = f"{name}, 100 psi, mean absolute change of the pressure term"
        found.append(Row(table, entry, float(np.abs(work - gaylord).mean()), "lbf"))
        found += _muscle(name)
    return found


def _muscle(name: str) -> list[Row]:
    """Blocked force and free contraction with the pressure term of virtual work."""
    geometry = VirtualWorkGeometry(geometries()[name], _braid(name))
    muscle = Muscle(geometry, latex())
    blocked = float(muscle.blocked_force(PRESSURE))
    return [Row("virtual work", f"{name}, 100 psi, blocked force with it", blocked, "lbf")]
