"""The command `famjax`. Every command is one call of the library, its result printed and saved."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

# jaxlib on few cores can hang when two threads run batched LAPACK at once; this must be set first.
os.environ.setdefault("PJRT_NPROC", "16")

try:
    from cyclopts import App, CycloptsError, Parameter
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table
except ImportError as missing:
    sys.exit(
        f"the famjax command needs its extra 'app' ({missing}); install it with\n"
        '    python -m pip install "famjax[app]"'
    )

from . import __version__

if TYPE_CHECKING:
    from fitting import Identification

app = App(
    name="famjax",
    version=f"famjax {__version__}",
    help="Fluidic artificial muscles: from measured force maps to identified, stable models.",
    help_format="markdown",
)


@app.command
def fit(
    data: str = "DMSP-20-300",
    *,
    order: int = 3,
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker",
    dependence: Literal["fixed", "linear", "free"] = "fixed",
    box: Literal["physical", "open"] = "physical",
    bounds: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    specimen: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    starts: int = 16,
    seed: int = 0,
    output: Path = Path("famjax-fit"),
    units: Literal["si", "metric", "us"] = "metric",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Identify a muscle from a measured force map.

    Writes `fit.json` (everything, SI), `fit.png` and `report.html` into the output folder.

    Parameters
    ----------
    data
        CSV file with columns such as `pressure_psi,length_in,force_lbf`, or the name of a bundled
        map (DMSP-20-300, DMSP-10-250). Lines `# specimen: rest_length_mm = 296` describe the muscle.
    order
        Order of the bladder's stress law, sigma = E_1 eps + E_2 eps|eps| + ...
    constraint
        none; positive: E_n >= 0; slope: stress rises on the strain range; drucker: stable along
        the actuation path.
    dependence
        Of the coefficients on pressure: fixed (none), linear, or free at each pressure.
    box
        physical: the geometry of a buildable muscle (braid diameter from the bore to 3.6 mm above,
        braid angle 60 to 70 deg to the circumference); open: geometry as a fit parameter.
    bounds
        Replace bounds, name_unit=min:max, repeatable: `--bounds braid_diameter_mm=20:23.6`.
        One value holds the parameter: `--bounds deadband_pressure_kPa=40`.
    specimen
        Describe the muscle, key_unit=value, repeatable: `--specimen rest_length_mm=296`. Keys:
        rest_length, wall_thickness, nominal_diameter, bladder_diameter, braid_thickness (with a
        unit), embedded (true or false: threads inside the wall), name.
    starts
        Number of starts of the geometry.
    seed
        Of the starts; the same seed gives the same result.
    output
        Folder for the files, made if need be.
    units
        Of table, picture and report: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = _fitting()
    from fitting._options import parse_bounds, parse_specimen  # noqa: PLC0415
    from fitting._report import check_output, write_fit  # noqa: PLC0415

    check_output(output)
    measured = _load(data, parse_specimen(specimen))
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"identifying {measured.specimen.name}", total=starts)
        result = fitting.identify(
            measured,
            order=order,
            constraint=constraint,
            dependence=dependence,
            box=box,
            bounds=parse_bounds(bounds),
            starts=starts,
            seed=seed,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )
        paths = write_fit(result, output, units)
    if json_:
        print(json.dumps(fitting.summary_as_dict(result, units), allow_nan=False))
    else:
        _print_fit(result, units)
        print("written:", ", ".join(str(path) for path in paths))
    return 0 if result.converged else 1


def _fitting():
    """The fitting package, with JAX in float64."""
    from . import require  # noqa: PLC0415

    fitting = require("fitting")
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    return fitting


def _load(data: str, specimen: dict):
    from fitting import bundled_names, load_bundled, read_csv  # noqa: PLC0415

    if data.upper() in bundled_names() and not Path(data).exists():
        return load_bundled(data.upper(), specimen)
    return read_csv(data, specimen)


def _print_fit(result: "Identification", units: str) -> None:
    from fitting._report import tables, verdict  # noqa: PLC0415

    console = Console(highlight=False)
    console.print(f"[bold]{result.data.specimen.name}[/bold]  ({result.data.source})")
    for title, header, rows in tables(result, units):
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        for column, name in enumerate(header):
            table.add_column(name, justify="left" if column == 0 else "right", overflow="fold")
        for row in rows:
            table.add_row(*row)
        console.print()
        console.print(table)
    console.print()
    for warning in result.warnings:
        console.print(f"note: {warning}", markup=False)
    console.print(verdict(result), style="bold", markup=False)


@app.command
def design(
    require: Annotated[tuple[str, ...], Parameter(negative=())] = ("pressure_psi=100",),
    *,
    catalogue: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    bundled: bool = True,
    rest_length_mm: float = 235.74375,
    output: Path = Path("famjax-design"),
    units: Literal["si", "metric", "us"] = "us",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Search a catalogue of braids, bladders and tubes for a muscle that meets a requirement.

    Writes `design.json` (all rows, also force and diameter over contraction) and `design.png`.

    Parameters
    ----------
    require
        What the muscle must do, key_unit=value, repeatable: pressure_psi=100, force_lbf=900 (at
        force_contraction, else blocked), contraction=0.3, largest_diameter_in=2.2,
        force_contraction=0.1. The pressure is needed.
    catalogue
        Your own catalogue files, repeatable; the bundled one shows the format.
    bundled
        Whether to search the bundled catalogue too.
    rest_length_mm
        Active length at rest, for thread length and turns; that of the reference work's specimen.
    output
        Folder for the files, made if need be.
    units
        Of tables and files: si, metric (mm, kPa, N) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    _fitting()
    from fitting._report import check_output, write_all  # noqa: PLC0415

    from ._design_command import design_document, design_picture, parse_requirement  # noqa: PLC0415

    check_output(output)
    document = design_document(
        parse_requirement(require),
        catalogue,
        bundled=bundled,
        rest_length=rest_length_mm / 1e3,
        system=units,
    )
    content = json.dumps(document, indent=1, allow_nan=False).encode()
    paths = write_all(
        output, {"design.json": content, "design.png": design_picture(document, units)}
    )
    if json_:
        print(json.dumps(document, allow_nan=False))
        return 0
    _print_rows("Braid angle of each braid on each bladder", document["braid_angles"])
    _print_rows("Candidates, the best first", document["candidates"])
    usable = [row for row in document["end_fittings"] if row["feasible"]]
    _print_rows("End-fittings that enter the bladder's bore", usable)
    print("written:", ", ".join(str(path) for path in paths))
    return 0


@app.command
def reproduce(
    *,
    output: Path = Path("famjax-reproduce"),
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Compute the reference work's tables and put them beside its printed figures.

    Needs a clone of the repository, where the code of the benchmarks lies beside the packages.

    Parameters
    ----------
    output
        Folder for the page with tables and figures, made if need be.
    json_
        Print the rows as one JSON list to standard output and nothing else there.
    """
    _fitting()
    from fitting import InputError  # noqa: PLC0415
    from fitting._report import check_output  # noqa: PLC0415

    folder = Path(__file__).resolve().parents[1] / "benchmarks"
    if not (folder / "reproduce.py").exists():
        raise InputError(
            f"'famjax reproduce' runs in a clone of the repository; {folder} has no reproduce.py"
        )
    check_output(output)
    sys.path.insert(0, str(folder))
    from importlib import import_module  # noqa: PLC0415

    benchmark = import_module("reproduce")
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("reproducing", total=None)

        def show(done: int, total: int, name: str) -> None:
            progress.update(task, completed=done, total=total, description=name)

        found = benchmark.reproduce(progress=show)
        paths = benchmark.write_page(output, found)
    rows = [row.as_dict() for row in found]
    if json_:
        print(json.dumps(rows, allow_nan=False))
        return 0
    compared = [row for row in rows if row["within"] is not None]
    out = [row for row in compared if not row["within"]]
    if out:
        _print_rows("Out of tolerance", out)
    print(
        f"{len(compared) - len(out)} of {len(compared)} printed figures within tolerance; "
        f"{len(rows) - len(compared)} more computed that have no printed figure here"
    )
    print("written:", ", ".join(str(path) for path in paths))
    return 0


def _print_rows(title: str, rows: list[dict]) -> None:
    """A table of rows that share their keys; lists are left to the JSON file."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    keys = [key for key, value in rows[0].items() if not isinstance(value, list)] if rows else []
    for key in keys:
        table.add_column(key.replace("_", " "), overflow="fold")
    for row in rows:
        cells = [row[key] for key in keys]
        table.add_row(*(f"{v:.4g}" if isinstance(v, float) else str(v) for v in cells))
    console = Console(highlight=False)
    console.width = max(console.width, 130)  # folded cells are harder to read than long lines
    console.print()
    console.print(table if rows else f"{title}: none", markup=False)


@app.command
def doctor() -> int:
    """Report versions, devices, precision and name clashes; exit code 1 if something is wrong."""
    from ._doctor import problems, versions  # noqa: PLC0415

    print(f"famjax {__version__}")
    for name, version in versions().items():
        print(f"  {name} {version}")
    import jax  # noqa: PLC0415

    print("devices:", ", ".join(str(device) for device in jax.devices()))
    print(
        "float64:",
        "on" if jax.config.read("jax_enable_x64") else "off in this process (JAX's default)",
        "- the famjax commands that identify switch it on themselves",
    )
    found = problems()
    for problem in found:
        print("problem:", problem)
    if not found:
        print("no problems found")
    return 1 if found else 0


def main(arguments: list[str] | None = None) -> None:
    """Run the command line: exit code 0 done, 1 no certified result, 2 bad input, 130 stopped."""
    from fitting import InputError  # noqa: PLC0415

    from .design import CatalogueError  # noqa: PLC0415

    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        print(f"famjax: {error}\nTry 'famjax --help'.", file=sys.stderr)
        sys.exit(2)
    except (InputError, CatalogueError) as error:
        print(f"famjax: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("famjax: stopped; nothing was written", file=sys.stderr)
        sys.exit(130)
    sys.exit(code or 0)


if __name__ == "__main__":
    main()
