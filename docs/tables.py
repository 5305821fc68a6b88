"""Write the pages `comparison.md` and `reproduction.md` from the output of famjax commands.

python docs/tables.py               # write both pages to docs
python docs/tables.py FOLDER        # write both pages to FOLDER
"""

import json
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
MAPS = ("DMSP-20-300", "DMSP-10-250")
COMPARE = "famjax compare {} --json"
REPRODUCE = "famjax reproduce --json"
_NONE = "-"
_WRITTEN = "`python docs/tables.py` generates this page from the output of:"
_COMPARED = (
    "These tables compare published static force models with famjax's own models. Each model is fitted "
    "to all loaded readings in one force map. Cross-validation then leaves out each pressure and each "
    "length in turn, and predicts the readings that were left out. Judge a model by its held-out errors: "
    "with many parameters, the in-sample error is always small."
)
_ERRORS_ARE = (
    "All errors are RMSE in N. *Pressures out* and *lengths out* are held-out errors. *Inner lengths "
    "out* excludes the shortest and longest lengths, which are extrapolated. A dash (`-`) means that "
    "the model cannot be fitted, or that the other readings do not determine its prediction. An asterisk "
    "(`*`) means that a parameter is at a bound of its search range."
)
_REPRODUCED = (
    "This page compares the numbers printed in Chambers 2021, mainly in chapters 2, 4, 5 and 6, with "
    "values computed from the inputs that are printed there. Nothing is tuned to match a printed "
    "figure. The table marks every figure that differs by more than its tolerance."
)


def comparison(found: dict[str, dict[str, Any]]) -> str:
    """Return the page with the comparison tables.

    Args:
        found: output of `famjax compare --json`, keyed by the name of the map.
    """
    commands = _fence(COMPARE.format(name) for name in found)
    parts = ["# Comparison of models", _COMPARED, _WRITTEN, commands, _ERRORS_ARE]
    for name, table in found.items():
        parts.append(f"## {name}")
        parts.append(
            f"The largest force is {table['max_force_N']:.5g} N; {table['n_loaded']} readings are loaded."
        )
        rows = [
            (
                row["label"] + (" *" if row["at_bound"] else ""),
                str(row["n_parameters"]),
                *(_number(row[key]) for key in _ERRORS),
            )
            for row in table["models"]
        ]
        parts.append(_table(("model", "parameters", *_ERRORS.values()), rows))
    parts.append("`famjax-compare/compare.json` contains notes on individual models.")
    return "\n\n".join(parts) + "\n"


_ERRORS = {
    "rmse_N": "in sample",
    "lopo_rmse_N": "pressures out",
    "lolo_interior_rmse_N": "inner lengths out",
    "lolo_rmse_N": "lengths out",
}


def reproduction(rows: list[dict[str, Any]]) -> str:
    """Return the page that compares the reference work's printed figures with computed ones.

    Args:
        rows: output of `famjax reproduce --json`.
    """
    compared = [row for row in rows if row["within"] is not None]
    out = [row for row in compared if row["verdict"] == "outside"]
    misprints = [row for row in compared if row["verdict"] == "misprint"]
    right = len(compared) - len(misprints)
    known = f"**{right - len(out)} of {right}** printed figures agree within their"
    more = (
        f"{len(misprints)} more are misprints, as other figures in the work show; "
        f"{len(rows) - len(compared)} computed figures have no printed counterpart."
    )
    parts = [
        "# Reproduction of the reference work",
        _REPRODUCED,
        _WRITTEN,
        _fence([REPRODUCE]),
        "Without `--json`, the command writes a page with all rows and all notes.",
        f"{known} tolerance; {more}",
        "## Out of tolerance",
        _rows(out),
        *_notes(dict.fromkeys(row["table"] for row in out)),
        "## Misprints",
        _rows(misprints),
        "## All printed figures",
        _rows(compared),
    ]
    return "\n\n".join(parts) + "\n"


def _rows(rows: Sequence[dict[str, Any]]) -> str:
    cells = [
        (
            row["table"],
            row["entry"].replace("|", "\\|"),
            f"{row['published']:.6g}",
            f"{row['computed']:.6g}",
            f"{row['tolerance']:.2g}",
            "" if row["unit"] == "1" else row["unit"],
            "**no**" if row["verdict"] == "outside" else row["verdict"],
            row["reason"],
        )
        for row in rows
    ]
    header = ("figure", "published", "computed", "tolerance", "unit", "verdict", "tolerance basis")
    return _table(("table", *header), cells)


def _notes(tables: Iterable[str]) -> list[str]:
    """Return the known reasons for the differences in these tables."""
    script = runpy.run_path(str(ROOT / "examples" / "chambers2021" / "notes.py"))
    of = dict(script["NOTES"])
    return [f"**{table}.** {of[table]}" for table in tables if table in of]


def _table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _fence(commands: Iterable[str]) -> str:
    return "\n".join(["```sh", *(f"{one} > /dev/null" for one in commands), "```"])


def _number(value: float | None) -> str:
    return _NONE if value is None else f"{value:.3g}"


def printed(command: str, folder: Path) -> Any:
    """Run a command in a folder and return the JSON that it prints."""
    run = [sys.executable, "-m", *command.split()]
    done = subprocess.run(run, cwd=folder, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def write(folder: Path) -> list[Path]:
    """Compute and write both pages; return their paths."""
    with tempfile.TemporaryDirectory() as place:
        tables = {name: printed(COMPARE.format(name), Path(place)) for name in MAPS}
        rows = printed(REPRODUCE, Path(place))
    pages = {"comparison.md": comparison(tables), "reproduction.md": reproduction(rows)}
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [folder / name for name in pages]


if __name__ == "__main__":
    print(*write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent))
