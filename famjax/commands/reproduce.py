"""`famjax reproduce`."""

import json
import sys
from pathlib import Path

from .loading import load_fitting
from .terminal import print_rows, progress


def reproduce(
    *,
    output: Path = Path("famjax-reproduce"),
    json_: bool = False,
) -> int:
    """Compute the reference work's tables and put them beside its printed figures.

    Needs a clone of the repository, where the code of the benchmarks lies beside the packages.

    Parameters
    ----------
    output
        Folder for the page with the tables, created if missing.
    json_
        Print the rows as one JSON list to standard output and nothing else there; chapter 7's fits
        of a synthetic reconstruction, which have no verdict, are on the page without this option.
    """
    load_fitting()
    from famjax.boundary.files import check_output
    from fitting import InputError

    folder = Path(__file__).resolve().parents[2] / "benchmarks"
    if not (folder / "reproduce.py").exists():
        raise InputError(
            f"'famjax reproduce' runs in a clone of the repository; {folder} has no reproduce.py"
        )
    check_output(output)
    sys.path.insert(0, str(folder))
    from importlib import import_module

    benchmark = import_module("reproduce")
    with progress("reproducing", every=0.0) as show:
        found = benchmark.reproduce(output, show, synthetic=not json_)
    rows = [row.as_dict() for row in found]
    if json_:
        print(json.dumps(rows, allow_nan=False))
        return 0
    of = {
        verdict: [row for row in rows if row["verdict"] == verdict]
        for verdict in ("within", "outside", "misprint", "not published")
    }
    for title, verdict in (
        ("Out of tolerance", "outside"),
        ("Misprints of the reference work", "misprint"),
    ):
        if of[verdict]:
            print_rows(title, of[verdict])
    compared = len(of["within"]) + len(of["outside"])
    print(
        f"{len(of['within'])} of {compared} printed figures within tolerance, beside "
        f"{len(of['misprint'])} that the work misprints; {len(of['not published'])} more computed "
        "that have no printed figure here"
    )
    print(f"written: {output / benchmark.PAGE}")
    return 0
