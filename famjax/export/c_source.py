"""C99 for a microcontroller or a simulator: force, stiffness and the pressure for a force."""

from .subject import Subject
from .templated import filled, table_words


def c_files(subject: Subject) -> dict[str, bytes]:
    """Header and source, without allocation or libraries; double unless compiled for float."""
    words = table_words(subject, " *", "R({})")
    return {
        f"{subject.identifier}.{kind}": filled(f"force.{kind}", words).encode()
        for kind in ("h", "c")
    }
