"""What most commands begin with: the library in float64, and a force map."""

import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..boundary.errors import InputError
from ..boundary.near import meant

if TYPE_CHECKING:
    from fitting import ForceData

STANDARD_INPUT = "<stdin>"
"""What stands for `-` among the arguments."""


def load_fitting():
    """The fitting package, with JAX in float64; compiled programs are kept on disk."""
    from .. import require
    from .compilation_cache import switch_on

    fitting = require("fitting")
    import jax

    jax.config.update("jax_enable_x64", True)
    switch_on()
    return fitting


def look_here() -> None:
    """Let classes be found that lie in the folder that the user starts from."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)


def schema_of(path: Path) -> str:
    """The schema that a JSON file names; "" of any other file, whose reader says what is wrong."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return ""
    return str(found.get("schema")) if isinstance(found, dict) else ""


def warn_unidentified(name: object, verdict: str | None, reasons: Sequence[str] | None) -> None:
    """Say on standard error that nothing was identified, where that is so."""
    from ..cards import unidentified

    doubt = unidentified(str(name), verdict, reasons)
    if doubt is not None:
        print(f"warning: {doubt}", file=sys.stderr)


def load_map(
    data: str, specimen: dict, *, pressure: str | None = None, length: str | None = None
) -> "ForceData":
    """A force map: a bundled one by its name, a CSV file, or standard input; tolerances with their unit."""
    from fitting import load_bundled, read_csv
    from fitting.data import bundled_map_name, bundled_names

    if bundled_map_name(data) is not None and not Path(data).exists():
        found = load_bundled(data, specimen)
    elif data != STANDARD_INPUT and not Path(data).exists():
        known = bundled_names()
        raise InputError(
            f"no such file: {data}; bundled maps are {' and '.join(known)}{meant(data, known)}"
        )
    else:
        found = read_csv(sys.stdin if data == STANDARD_INPUT else data, specimen)
    return with_tolerances(found, pressure=pressure, length=length)


def with_tolerances(data: "ForceData", *, pressure: str | None, length: str | None) -> "ForceData":
    """The map with readings nearer than these, with their unit, at one pressure or length."""
    from famjax.boundary.units import parse_quantity

    given = {
        f"{kind}_tolerance": parse_quantity(text, kind)
        for kind, text in (("pressure", pressure), ("length", length))
        if text is not None
    }
    return dataclasses.replace(data, **given)
