"""Files of other languages from the templates beside this file."""

import importlib.resources
import re
from collections.abc import Iterable, Mapping

_WIDTH = 6  # numbers in a line


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
