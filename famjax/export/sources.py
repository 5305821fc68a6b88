"""Sources that hold the table: C99, and functions for MATLAB, Simulink and Octave."""

from .subject import Subject
from .templated import filled, table_words


def c_files(subject: Subject) -> dict[str, bytes]:
    """Header and source, without allocation or libraries; double unless compiled for float."""
    words = table_words(subject, " *", "R({})")
    return {
        f"{subject.identifier}.{kind}": filled(f"force.{kind}", words).encode()
        for kind in ("h", "c")
    }


def matlab_files(subject: Subject) -> dict[str, bytes]:
    """`NAME_force.m`, `NAME_pressure.m`, and `NAME_model_force.m` with the table, which both call.

    No toolbox is needed, and they may stand in Simulink's MATLAB Function block.
    """
    words = table_words(subject, "%  ", "{}", end=" ...")
    return {
        f"{subject.identifier}_{of}.m": filled(f"{of}.m", words).encode()
        for of in ("force", "pressure", "model_force")
    }
