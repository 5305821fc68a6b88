"""`famjax doctor` checks the installation; `famjax reproduce` checks the reference work's tables."""

import importlib
import importlib.metadata
import os
import platform
import re
import sys
from pathlib import Path

from famjax import __version__
from famjax.compilation_cache import VARIABLE, start_jax, switch_on
from famjax.console import print_json, print_rows, progress

from .cli import clashes


def doctor() -> int:
    """Print versions, devices, precision and name clashes. Exits with code 1 if it finds a problem."""
    print(f"famjax {__version__}\n  python {platform.python_version()}")
    needed = [re.split(r"[^\w.-]", one)[0] for one in importlib.metadata.requires("famjax") or ()]
    for name in dict.fromkeys(["jaxlib", *(one for one in needed if one != "famjax")]):
        try:
            print(f"  {name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            print(f"  {name} not installed")
    import jax

    found = clashes()
    try:
        print("devices:", ", ".join(str(device) for device in jax.devices()))
    except (AssertionError, RuntimeError):
        found.append(
            f"JAX found no device: JAX_PLATFORMS is {os.environ.get('JAX_PLATFORMS', '')!r}. "
            "Set JAX_PLATFORMS=cpu, or unset it"
        )
    print("float64: off by default in JAX; famjax commands that fit models switch it on")
    off = f"off, so every command recompiles. Set {VARIABLE} to a folder that only you can write to"
    print("compilation cache:", switch_on() or off)
    print("\n".join(f"problem: {problem}" for problem in found) or "no problems found")
    return 1 if found else 0


def reproduce(*, output: Path = Path("famjax-reproduce"), json_: bool = False) -> int:
    """Recompute the tables in the reference work and compare the results with the printed values.

    Runs only in a clone of the repository that was installed from its own folder with
    `python -m pip install -e ".[app]"`, because the code is in the `benchmarks` folder.

    Parameters
    ----------
    output
        Write a page with tables and figures to this folder; it is created if missing.
    json_
        Print the rows as one JSON list on standard output, and nothing else. The list omits the fits to
        the synthetic data in chapter 7, which have no verdict.
    """
    start_jax()
    from famjax.boundary.errors import InputError
    from famjax.boundary.files import check_output

    folder = Path(__file__).resolve().parents[2] / "benchmarks"
    if not (folder / "reproduce.py").exists():
        raise InputError(
            f"{folder} has no reproduce.py: run 'famjax reproduce' in a clone of the repository that was "
            'installed from its own folder with python -m pip install -e ".[app]"'
        )
    check_output(output)
    sys.path.insert(0, str(folder))
    benchmark = importlib.import_module("reproduce")
    with progress("reproducing") as show:
        found = benchmark.reproduce(output, show, synthetic=not json_)
    rows = [row.as_dict() for row in found]
    if json_:
        print_json(rows)
        return 0
    by = {
        verdict: [row for row in rows if row["verdict"] == verdict]
        for verdict in ("outside", "misprint", "within", "not published")
    }
    print_rows("Out of tolerance", by["outside"])
    print_rows("Misprints in the reference work", by["misprint"])
    print(
        f"{len(by['within'])} of {len(by['within'] + by['outside'])} printed values are within tolerance; "
        f"{len(by['misprint'])} more are misprints. {len(by['not published'])} computed values have no "
        f"printed counterpart\nwritten: {output / benchmark.PAGE}"
    )
    return 0
