"""OpenSim's McKibbenActuator: an ideal braid, without bladder, deadband, slack or stops."""

import math
from xml.sax.saxutils import escape

import numpy as np

from ..boundary.errors import InputError
from .subject import Subject
from .templated import filled

_LENGTHS, _PRESSURES = 65, 33
_SHARE = 0.5  # load in the ideal braid's pull at rest length and the highest pressure


def ideal_braid(subject: Subject) -> tuple[float, float]:
    """(thread length B [m], turns N) of the ideal braid whose area is nearest to the muscle's.

    F = P (3 L^2 - B^2)/(4 pi N^2), and dF/dP is fitted over the region by least squares. Of a muscle
    that is an ideal braid they are its own; other braids' also stand for rounded ends.

    Raises:
        InputError: no braid has such an area.
    """
    L, P = _grid(subject)
    area = np.array([[subject.pull.model(one, at)[2] for at in P] for one in L]).mean(axis=1)
    slope, offset = np.linalg.lstsq(np.stack([L**2, -np.ones_like(L)], 1), area, rcond=None)[0]
    if not (slope > 0 and offset > 0):
        raise InputError(
            "the muscle's area dF/dP does not fall with the length as a braid's does: OpenSim's "
            "actuator cannot stand for it"
        )
    turns = math.sqrt(3 / (4 * math.pi * slope))
    return turns * math.sqrt(4 * math.pi * offset), turns


def opensim_files(subject: Subject) -> dict[str, bytes]:
    """`NAME.osim`: a load that hangs on the ideal braid; the control is the gauge pressure [Pa].

    Its head says how far that is from the muscle: the bladder and the deadband are left out.
    """
    B, N = ideal_braid(subject)
    L, P = _grid(subject)
    true = np.array([[subject.pull.force(one, at) for at in P] for one in L])
    ideal = P * (3 * L[:, None] ** 2 - B**2) / (4 * math.pi * N**2)
    off = float(np.abs(ideal - true).max()) / subject.errors.largest_force
    rest = float(subject.muscle.rest_length)
    about = [
        *subject.about,
        "the ideal braid alone, without bladder, deadband, slack or stops: off by up to "
        f"{100 * off:.3g} % of the largest force {subject.errors.largest_force:.6g} N in that region",
    ]
    words = {
        "name": subject.identifier,
        "ABOUT": escape("; ".join(about)),
        "THREAD_LENGTH": B,
        "TURNS": N,
        "LENGTH": rest,
        "MASS": _SHARE * P[-1] * (3 * rest**2 - B**2) / (4 * math.pi * N**2) / 9.81,
    }
    return {f"{subject.identifier}.osim": filled("braid.osim", words).encode()}


def _grid(subject: Subject) -> tuple[np.ndarray, np.ndarray]:
    """Lengths and pressures over the region."""
    pull = subject.pull
    return (
        np.linspace(pull.lengths[0], pull.lengths[-1], _LENGTHS),
        np.linspace(pull.pressures[0], pull.pressures[-1], _PRESSURES),
    )
