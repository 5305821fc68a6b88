"""A fit of a muscle that nobody identified: what predictions need, and nothing else."""

import numpy as np

import famjax
from fitting import ForceData, Identification, Specimen
from fitting.result import Outlook


def bare_fit(
    muscle: famjax.Muscle,
    length: np.ndarray,
    pressure: np.ndarray,
    force: np.ndarray,
    outlook: Outlook | None = None,
) -> Identification:
    """The fit; without standard errors unless an outlook says some."""
    specimen = Specimen("bare", float(muscle.geometry.rest_length), 1.8e-3)
    fit = object.__new__(Identification)
    for name, value in {
        "data": ForceData(force, pressure, length, specimen),
        "mounted": famjax.MountedMuscle(muscle, 0.0),
        "outlook": outlook or Outlook(directions=np.zeros((0, 0))),
    }.items():
        object.__setattr__(fit, name, value)
    return fit
