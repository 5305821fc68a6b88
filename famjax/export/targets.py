"""What a muscle can be exported to."""

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

TARGETS: dict[str, Callable[[Subject], dict[str, bytes]]] = {
    "c": c_files,
    "csv": csv_files,
    "mat": mat_files,
    "matlab": matlab_files,
    "mujoco": mujoco_files,
    "mjx": mjx_files,
    "opensim": opensim_files,
    "jax": jax_files,
}
"""What makes the files, content by name, by the name that `famjax export --to` takes."""


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
        files |= TARGETS[name](subject)
    return write_all(folder, files)
