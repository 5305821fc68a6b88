"""Files of other languages from the templates beside this file."""

import importlib.resources
import itertools
import re
from collections.abc import Iterable, Mapping

from .subject import Subject

_WIDTH = 6  # numbers in a line

_NODES = ("length_m", "pressure_Pa")


def table_words(subject: Subject, comment: str, number: str, *, end: str = "") -> dict[str, object]:
    """Values of the words that templates of a table share.

    Args:
        subject: the muscle.
        comment: that a line of the heading begins with.
        number: form of a number of the table, such as `R({})`.
        end: of each line of numbers but the last.
    """
    table, name = subject.table, subject.identifier
    lengths, pressures = (table[of] for of in _NODES)
    nodes = itertools.chain(*itertools.chain(*subject.pull.rows))
    return {
        "name": name,
        "NAME": name.upper(),
        "HEADING": "\n".join(f"{comment} {_harmless(line)}" for line in subject.about_table),
        "LENGTHS": len(lengths),
        "PRESSURES": len(pressures),
        "LENGTH_NODES": numbers(lengths, number, end=end),
        "PRESSURE_NODES": numbers(pressures, number, end=end),
        "NODES": numbers(nodes, number, end=end),
        "SHORTEST": lengths[0],
        "LONGEST": lengths[-1],
        "LOWEST": pressures[0],
        "HIGHEST": pressures[-1],
        "LIMIT": table["pressure_limit_Pa"],
        "STOP_SHORT": table["stops_m"][0],
        "STOP_LONG": table["stops_m"][1],
        "STOP_STIFFNESS": table["stop_stiffness_N_per_m"],
        "STOP_ONSET": table["stop_onset_m"],
        "SLACK": table["slack_width_N"],
        **{f"LENGTH_END_{k}": end for k, end in enumerate(table["length_ends_per_m"])},
        **{f"PRESSURE_END_{k}": end for k, end in enumerate(table["pressure_ends_per_Pa"])},
    }


def docstring(lines: Iterable[str]) -> str:
    """Lines that do not end a docstring of Python."""
    return "\n".join(lines).replace("\\", "/").replace('"', "'")


def _harmless(line: str) -> str:
    """A line that no comment of C ends or begins in."""
    return line.replace("/*", "/ *").replace("*/", "* /").replace("\\", "/")


def filled(template: str, values: Mapping[str, object]) -> str:
    """A template with its `@WORDS@` replaced.

    Raises:
        KeyError: a word that there is no value for.
    """
    room = importlib.resources.files(__name__.rpartition(".")[0]) / "templates"
    text = (room / template).read_text(encoding="utf-8")
    return re.sub(r"@(\w+)@", lambda found: str(values[found[1]]), text)


def numbers(values: Iterable[float], form: str, *, end: str = "") -> str:
    """Numbers, exact to the last digit, in lines.

    Args:
        values: the numbers.
        form: of one, such as `R({})`.
        end: of each line but the last, behind its comma.
    """
    words = [form.format(repr(float(value))) for value in values]
    rows = [", ".join(words[k : k + _WIDTH]) for k in range(0, len(words), _WIDTH)]
    return f",{end}\n".join(f"    {row}" for row in rows)
