"""C99 for a microcontroller or a simulator: force, stiffness and the pressure for a force."""

import itertools

from .subject import Subject
from .templated import filled, numbers


def c_files(subject: Subject) -> dict[str, bytes]:
    """Header and source, without allocation or libraries; double unless compiled for float."""
    table, name = subject.table, subject.identifier
    lines = [
        line.replace("/*", "/ *").replace("*/", "* /").replace("\\", "/")
        for line in subject.about_table
    ]
    words = {
        "name": name,
        "NAME": name.upper(),
        "HEADING": "\n".join(f" * {line}" for line in lines),
        "LENGTHS": len(table["length_m"]),
        "PRESSURES": len(table["pressure_Pa"]),
        "LENGTH_NODES": numbers(table["length_m"], "R({})"),
        "PRESSURE_NODES": numbers(table["pressure_Pa"], "R({})"),
        "NODES": numbers(itertools.chain(*itertools.chain(*subject.pull.rows)), "R({})"),
        "SHORTEST": table["length_m"][0],
        "LONGEST": table["length_m"][-1],
        "LOWEST": table["pressure_Pa"][0],
        "HIGHEST": table["pressure_Pa"][-1],
        "LIMIT": table["pressure_limit_Pa"],
        "STOP_SHORT": table["stops_m"][0],
        "STOP_LONG": table["stops_m"][1],
        "STOP_STIFFNESS": table["stop_stiffness_N_per_m"],
        "STOP_ONSET": table["stop_onset_m"],
        "SLACK": table["slack_width_N"],
        **{f"LENGTH_END_{k}": end for k, end in enumerate(table["length_ends_per_m"])},
        **{f"PRESSURE_END_{k}": end for k, end in enumerate(table["pressure_ends_per_Pa"])},
    }
    return {
        f"{name}.h": filled("force.h", words).encode(),
        f"{name}.c": filled("force.c", words).encode(),
    }
