"""`famjax shape`: the equilibrium shape of a fitted muscle, as a table and a picture."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.files import as_svg, csv_text
from famjax.boundary.units import from_si, parse_quantity, unit_system
from famjax.compilation_cache import start_jax
from famjax.console import (
    Output,
    Units,
    add_cwd_to_path,
    in_units,
    print_json,
    print_rows,
)

if TYPE_CHECKING:
    import famjax
    from famjax.equilibrium import Shape

_Part = TypeVar("_Part")
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
    other_end_diameter: str | None = None,
    own: tuple[str, ...] = (),
    output: Annotated[Path, Parameter(name=["--output", "-o"])] = Path("famjax-shape"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Compute the equilibrium shape of a fitted muscle: profile, braid angle, strains and force.

    The shape minimises the energy of the fitted braid, bladder and law, with threads pinned at their
    crossings. Writes `shape.csv` and `shape.svg`. Exits with 2 if there is no stable shape.

    Parameters
    ----------
    muscle
        A `fit.json` of `famjax fit`, a card of `famjax card`, or a bundled muscle, DMSP-10 or DMSP-20.
    length
        Active length with its unit, `--length 270mm`.
    pressure
        Gauge pressure with its unit, `--pressure 500kPa`; the fitted deadband is subtracted from it.
    end_diameter
        Braid diameter at the fittings, `--end-diameter 20mm`; default: that of the unloaded braid.
    other_end_diameter
        Braid diameter at the last fitting, if it differs.
    own
        Trust this module of your own that defines classes in the file, repeatable, `--own my_rubber`.
        Modules named only in the file are never imported.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units of the table and the files: si, metric or us.
    json_
        Print one JSON object in SI units on standard output, and nothing else.
    """
    start_jax()
    folder = Output(output)
    made = _equilibrium_muscle(
        _read(muscle, own),
        *(None if one is None else parse_quantity(one, "length")
          for one in (end_diameter, other_end_diameter)),
    )  # fmt: skip
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
    rows = _rows(found, units)
    paths = folder.write({"shape.csv": csv_text(rows).encode(), "shape.svg": _drawn(found, units)})
    if json_:
        print_json(summary | {"files": [str(path) for path in paths]})
        return 0
    print_rows("Shape", in_units([summary], unit_system(units)))
    folder.tell(paths)
    return 0


def _read(muscle: str, own: tuple[str, ...]) -> Any:
    """Read the muscle from a fit or a card, or load a bundled one."""
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


def _equilibrium_muscle(
    muscle: Any, end_diameter: float | None, other: float | None
) -> "famjax.EquilibriumMuscle":
    """Build the equilibrium muscle; keep a muscle that already is one, unless a diameter is given."""
    import jax

    from famjax import Bladder, EquilibriumMuscle
    from famjax.braids import AbstractBraid, diameter_from_length
    from famjax.materials import AbstractMaterial
    from famjax.terms import PressurisedBraid

    if isinstance(muscle, EquilibriumMuscle) and end_diameter is None and other is None:
        return muscle

    def inside(kind: type[_Part]) -> list[_Part]:
        leaves = jax.tree.leaves(muscle, is_leaf=lambda one: isinstance(one, kind))
        return [one for one in leaves if isinstance(one, kind)]

    braids, bladders, laws = inside(AbstractBraid), inside(Bladder), inside(AbstractMaterial)
    if not (braids and bladders and laws):
        raise InputError(
            "the equilibrium shape needs a braid, a bladder and its law, and this muscle lacks one of "
            "them. Models of other authors and measured shapes may have none; fit with a braid"
        )
    braid, bladder, law = braids[0], bladders[0], laws[0]
    if end_diameter is None:
        rest, thread = bladder.rest_length, braid.rest_thread_length
        end_diameter = float(diameter_from_length(rest, thread, braid.turns))
    deadbands = [float(term.deadband_pressure) for term in inside(PressurisedBraid)]
    return EquilibriumMuscle(
        braid, bladder, law, end_diameter=end_diameter, other_end_diameter=other,
        deadband_pressure=max(deadbands, default=0.0),
    )  # fmt: skip


def _rows(found: "Shape", units: str) -> list[dict[str, float]]:
    """Return the points of the shape, with the unit in each column name."""
    columns = {}
    for name, kind in _COLUMNS.items():
        values = 2 * found.radius if name == "diameter" else getattr(found, name)
        unit = "deg" if kind == "angle" else unit_system(units)[kind]
        columns[f"{name}_{unit}" if unit else name] = [
            from_si(float(value), unit, kind) if unit else float(value) for value in values
        ]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _drawn(found: "Shape", units: str) -> bytes:
    """Plot the meridian on both sides of the axis, as SVG."""
    from matplotlib.figure import Figure

    unit = unit_system(units)["length"]
    z, r = (
        [from_si(float(v), unit, "length") for v in one] for one in (found.position, found.radius)
    )
    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    for side in (1, -1):
        axes.plot(z, [side * v for v in r], color="k")
    axes.set(xlabel=f"z [{unit}]", ylabel=f"r [{unit}]", aspect="equal")
    return as_svg(figure).encode()
