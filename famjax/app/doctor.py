"""Self-checks: `famjax doctor` of the installation, `famjax reproduce` of printed figures."""

import importlib.metadata
import os
import platform
import re
import sys
from pathlib import Path

from famjax import __version__
from famjax._require import clashes
from famjax.compilation_cache import VARIABLE, cache_root, contents, start_jax, switch_on
from famjax.console import print_json, print_rows, progress


def versions() -> dict[str, str]:
    """The interpreter and every package that famjax asks for, with its version or "not installed"."""
    found = {"python": platform.python_version()}
    for needed in ("jaxlib", *(importlib.metadata.requires("famjax") or ())):
        name = re.split(r"[^\w.-]", needed)[0]
        if name == "famjax":
            continue
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def doctor() -> int:
    """Report versions, devices, precision and name clashes; exit code 1 if something is wrong."""
    print(f"famjax {__version__}")
    for name, version in versions().items():
        print(f"  {name} {version}")
    import jax

    found = clashes()
    try:
        print("devices:", ", ".join(str(device) for device in jax.devices()))
    except (AssertionError, RuntimeError):
        found.append(
            f"JAX finds no device: JAX_PLATFORMS is {os.environ.get('JAX_PLATFORMS', '')!r}. Set "
            "JAX_PLATFORMS=cpu, or unset it"
        )
    print(
        "float64:",
        "on" if jax.config.read("jax_enable_x64") else "off in this process (JAX's default)",
        "- the famjax commands that identify switch it on themselves",
    )
    print("compilation cache:", _cache_sentence())
    for problem in found:
        print("problem:", problem)
    if not found:
        print("no problems found")
    return 1 if found else 0


def _cache_sentence() -> str:
    """Where compiled programs are kept, and how many."""
    if folder := switch_on():
        number, size = contents(folder)
        return f"{folder}, {number} programs, {size / 1e6:.3g} MB"
    root = cache_root()
    why = f"{VARIABLE} says so, or there is no home" if root is None else (
        f"no folder of this user alone can be written below {root}; name another in {VARIABLE}"
    )  # fmt: skip
    return f"off ({why}); every command compiles anew"


def reproduce(
    *,
    output: Path = Path("famjax-reproduce"),
    json_: bool = False,
) -> int:
    """Compute the reference work's tables and put them beside its printed figures.

    Works in a clone of the repository, installed by `python -m pip install -e ".[app]"` from its
    folder: the code is in `benchmarks`, which no other installation has.

    Parameters
    ----------
    output
        Folder for the page with tables and figures, created if missing.
    json_
        Print the rows as one JSON list to standard output and nothing else there; chapter 7's fits
        of a synthetic reconstruction, which have no verdict, are on the page without this option.
    """
    start_jax()
    from famjax.boundary.errors import InputError
    from famjax.boundary.files import check_output

    folder = Path(__file__).resolve().parents[2] / "benchmarks"
    if not (folder / "reproduce.py").exists():
        raise InputError(
            f"{folder} has no reproduce.py: run 'famjax reproduce' in a clone of the repository, "
            'installed from its folder by python -m pip install -e ".[app]"'
        )
    check_output(output)
    sys.path.insert(0, str(folder))
    from importlib import import_module

    benchmark = import_module("reproduce")
    with progress("reproducing") as show:
        found = benchmark.reproduce(output, show, synthetic=not json_)
    rows = [row.as_dict() for row in found]
    if json_:
        print_json(rows)
        return 0
    outside, misprints, inside, new = (
        [row for row in rows if row["verdict"] == verdict]
        for verdict in ("outside", "misprint", "within", "not published")
    )
    print_rows("Out of tolerance", outside)
    print_rows("Misprints of the reference work", misprints)
    print(
        f"{len(inside)} of {len(inside) + len(outside)} printed figures within tolerance, beside "
        f"{len(misprints)} that the work misprints; {len(new)} more computed that have no printed "
        "figure here"
    )
    print(f"written: {output / benchmark.PAGE}")
    return 0
