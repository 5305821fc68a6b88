"""`famjax shape`: compute the equilibrium shape of a fitted muscle as a table and a plot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.files import as_svg, csv_text
from famjax.boundary.units import factor, parse_quantity, unit_system
from famjax.compilation_cache import start_jax
from famjax.console import Output, Units, add_cwd_to_path, in_units, print_json, print_rows

if TYPE_CHECKING:
    import famjax
    from famjax.equilibrium import Shape

_COLUMNS = {
    "position": "length", "diameter": "length", "thickness": "length", "thread_tension": "force",
    "braid_angle": "angle", "axial_strain": "number", "hoop_strain": "number",
}  # fmt: skip


def shape(
    muscle: str,
    *,
    length: str,
    pressure: str,
    end_diameter: str | None = None,
    own: tuple[str, ...] = (),
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("famjax-shape"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Compute the equilibrium shape of a fitted muscle: profile, braid angle, strains and force.

    The shape minimises the energy of the fitted braid and bladder, with the threads pinned where they
    cross. Writes `shape.csv` and `shape.svg`. Exits with code 2 if there is no stable shape.

    Parameters
    ----------
    muscle
        A `fit.json` from `famjax fit`, a card from `famjax card`, or the name of a bundled muscle
        (DMSP-10 or DMSP-20).
    length
        Set the active length with its unit, for example `--length 270mm`.
    pressure
        Set the gauge pressure with its unit, for example `--pressure 500kPa`; the fitted deadband is
        subtracted from it.
    end_diameter
        Set the braid diameter at the end-fittings, for example `--end-diameter 20mm`; default: the
        diameter of the unloaded braid.
    own
        Trust and import your own module, which defines classes named in the file, for example
        `--own my_rubber`; repeatable. Other modules named in the file are never imported.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units for the table and the files: si, metric or us.
    json_
        Print one JSON object in SI units on standard output, and nothing else.
    """
    start_jax()
    folder = Output(output)
    ends = None if end_diameter is None else parse_quantity(end_diameter, "length")
    made = _equilibrium_muscle(_read(muscle, own), ends)
    at = parse_quantity(length, "length"), parse_quantity(pressure, "pressure")
    if why := made.reason(*at):
        raise InputError(f"there is no stable shape at this length and pressure: {why}")
    state, found = made.state(*at), made.profile(*at)
    summary = {
        "force_N": float(state.force),
        "volume_m3": float(state.volume),
        "largest_diameter_m": 2 * float(found.radius.max()),
        "margin_N_per_m": float(state.margin),
    }
    files = _files(found, units)
    paths = folder.write({name: text.encode() for name, text in files.items()})
    if json_:
        print_json(summary | {"files": [str(path) for path in paths]})
        return 0
    print_rows("Shape", in_units([summary], unit_system(units)))
    folder.tell(paths)
    return 0


def _read(muscle: str, own: tuple[str, ...]) -> Any:
    """Read the muscle from a fit or a card, or load a bundled muscle."""
    from famjax.muscles import open_card
    from fitting.cli.muscle import is_fit, warn_unidentified

    if own:
        add_cwd_to_path()
    if is_fit(muscle):
        from fitting import load_fit

        saved = load_fit(muscle, own=own)
        warn_unidentified(muscle, saved.document.get("verdict"), saved.document.get("reasons"))
        return saved.muscle
    return open_card(muscle, own=own).muscle


def _equilibrium_muscle(muscle: Any, end_diameter: float | None) -> "famjax.EquilibriumMuscle":
    """Build the equilibrium muscle. If `muscle` already is one and no diameter is given, return it."""
    import jax

    from famjax import Bladder, EquilibriumMuscle
    from famjax.braids import AbstractBraid, diameter_from_length
    from famjax.materials import AbstractMaterial
    from famjax.terms import PressurisedBraid

    if isinstance(muscle, EquilibriumMuscle) and end_diameter is None:
        return muscle
    kinds = (AbstractBraid, Bladder, AbstractMaterial, PressurisedBraid)
    parts: list[Any] = [
        [one for one in jax.tree.leaves(muscle, is_leaf=lambda one, kind=kind: isinstance(one, kind))
         if isinstance(one, kind)] for kind in kinds
    ]  # fmt: skip
    if not all(parts[:3]):
        raise InputError(
            "the equilibrium shape requires a braid, a bladder and a bladder law, but this muscle lacks "
            "at least one of them, as do some models by other authors and some measured shapes: fit a "
            "model with a braid"
        )
    braid, bladder, law = (found[0] for found in parts[:3])
    if end_diameter is None:
        rest, thread = bladder.rest_length, braid.rest_thread_length
        end_diameter = float(diameter_from_length(rest, thread, braid.turns))
    deadband = max((float(term.deadband_pressure) for term in parts[3]), default=0.0)
    return EquilibriumMuscle(
        braid, bladder, law, end_diameter=end_diameter, deadband_pressure=deadband
    )


def _files(found: "Shape", units: str) -> dict[str, str]:
    """Return the points on the shape as CSV, and a plot of its outline on both sides of the axis as SVG."""
    from matplotlib.figure import Figure

    columns, unit = {}, unit_system(units)
    for name, kind in _COLUMNS.items():
        values = 2 * found.radius if name == "diameter" else getattr(found, name)
        columns[f"{name}_{unit[kind]}".rstrip("_")] = values / factor(unit[kind], kind)
    rows = [
        dict(zip(columns, row, strict=True))
        for row in zip(*map(list, columns.values()), strict=True)
    ]
    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    z, diameter, *_ = columns.values()
    for side in (0.5, -0.5):
        axes.plot(z, side * diameter, color="k")
    axes.set(xlabel=f"z [{unit['length']}]", ylabel=f"r [{unit['length']}]", aspect="equal")
    return {"shape.csv": csv_text(rows), "shape.svg": as_svg(figure)}
