"""MATLAB functions, also for Simulink's MATLAB Function block and for Octave: no toolbox is needed."""

from .subject import Subject
from .templated import filled, table_words


def matlab_files(subject: Subject) -> dict[str, bytes]:
    """`NAME_force.m`, `NAME_pressure.m`, and `NAME_uncut.m` with the table, which both call."""
    words = table_words(subject, "%  ", "{}", end=" ...")
    return {
        f"{subject.identifier}_{of}.m": filled(f"{of}.m", words).encode()
        for of in ("force", "pressure", "uncut")
    }
