"""What a muscle can be exported to."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

from ..boundary.errors import InputError
from ..boundary.files import check_output, write_all
from .lookup import csv_files, mat_files
from .mjx_model import mjx_files
from .mujoco_model import mujoco_files
from .opensim import opensim_files
from .sources import c_files, matlab_files
from .stablehlo import jax_files
from .subject import Subject


@dataclasses.dataclass(frozen=True)
class Target:
    """Something that a muscle is exported to.

    Attributes:
        makes: what, in a sentence.
        files: content by the file's name.
    """

    makes: str
    files: Callable[[Subject], dict[str, bytes]]


TARGETS = {
    "c": Target("C99 of force, stiffness and inverse, in double or float", c_files),
    "csv": Target("force, stiffness and area over length and pressure", csv_files),
    "mat": Target("the same as a .mat file, for lookup tables", mat_files),
    "matlab": Target("functions for MATLAB, Octave and Simulink", matlab_files),
    "mujoco": Target("XML of a hanging load, and the callback in Python", mujoco_files),
    "mjx": Target("the model inside MJX's step, to be differentiated", mjx_files),
    "opensim": Target("OpenSim's McKibbenActuator: the ideal braid alone", opensim_files),
    "jax": Target("the model as StableHLO with its derivative", jax_files),
}
"""By the name that `famjax export --to` takes."""


def export(subject: Subject, to: Sequence[str], folder: str | Path) -> list[Path]:
    """Write a muscle for each target; all files or none.

    Args:
        subject: the muscle, see `read_subject` and `Subject.of_card`.
        to: names of `TARGETS`.
        folder: where the files go; it is made if need be.

    Returns:
        The files.

    Raises:
        InputError: no such target, or what cannot be exported to one, and why.
    """
    unknown = [name for name in to if name not in TARGETS]
    if unknown or not to:
        raise InputError(
            f"a muscle is exported to {', '.join(TARGETS)}; got {unknown[0] if unknown else 'none'}"
        )
    folder = Path(folder)
    check_output(folder)
    files: dict[str, bytes] = {}
    for name in dict.fromkeys(to):
        files |= TARGETS[name].files(subject)
    return write_all(folder, files)
