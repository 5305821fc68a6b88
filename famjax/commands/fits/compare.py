"""`famjax compare`."""

import json
from pathlib import Path

from ..lean_imports import load_matplotlib
from ..loading import load_fitting, load_map, look_here
from ..options.engine import UNNAMED, EngineOptions
from ..options.whole_numbers import Seed, Starts
from ..terminal import Output, print_rows, progress

_COLUMNS = {
    "model": "label",
    "n parameters": "n_parameters",
    "inner lengths out N": "lolo_interior_rmse_N",
    "rmse N": "rmse_N",
    "pressures out N": "lopo_rmse_N",
    "lengths out N": "lolo_rmse_N",
    "max error N": "max_error_N",
}
"""Of the table, and where they are in `compare.json`; "out" is the RMSE on what was left out."""


def compare(
    data: str = "DMSP-20-300",
    *,
    models: tuple[str, ...] = (),
    own: tuple[str, ...] = (),
    specimen: tuple[str, ...] = (),
    pressure_tolerance: str | None = None,
    length_tolerance: str | None = None,
    starts: Starts = 32,
    seed: Seed = 0,
    output: Path = Path("famjax-compare"),
    engine: EngineOptions = UNNAMED,
    json_: bool = False,
) -> int:
    """Fit every published static force model, and famjax's own, to one force map.

    Each is fitted to all loaded readings, and again without each pressure and each length, which it
    then predicts ("pressures out" and "lengths out" in the table; of inner lengths, neither the longest
    nor the shortest). The table is ordered by the error on inner lengths left out. The choice of `famjax
    fit` is made anew without what it predicts. A minute or two for all of them.

    Writes `compare.json` and `compare.png`. Finished rows are kept in the folder `rows`, from which a
    stopped comparison goes on.

    Parameters
    ----------
    data
        CSV file or the name of a bundled map, as for `famjax fit`.
    models
        Names of the models, repeatable; all unless given. An unknown one prints those there are.
    own
        A model of your own beside them, module:Class, repeatable: a whole model, or a law, a geometry
        or a force term that is identified with the rest of a muscle. `--own my_model:Gent`.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    pressure_tolerance
        Readings nearer than this are at one pressure, as for `famjax fit`.
    length_tolerance
        The same of lengths.
    starts
        Of each nonlinear fit.
    seed
        Of the starts; the same seed gives the same table.
    output
        Folder for the files, made if need be.
    engine
        Where the models are fitted.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    load_matplotlib()
    from famjax.boundary.files import as_png, make_output
    from famjax.boundary.origin import Origin
    from famjax.commands.options.fits import parse_specimen
    from fitting.comparison import plot_comparison

    place = Output(output)
    look_here()
    measured = load_map(
        data, parse_specimen(specimen), pressure=pressure_tolerance, length=length_tolerance
    )
    make_output(output)
    kept = output / "rows.jsonl"
    with progress("comparing") as show, engine.executor() as executor:
        table = fitting.compare(
            measured, models or None, own=own, starts=starts, seed=seed, executor=executor, resume=kept,
            progress=show,
        )  # fmt: skip
    document = {
        **table.as_dict(),
        "origin": Origin.of_this_command().as_dict(),
        "starts": starts,
        "seed": seed,
    }
    paths = place.write({"compare.json": document, "compare.png": as_png(plot_comparison(table))})
    kept.unlink()
    if json_:
        print(json.dumps(document, allow_nan=False))
        return 0
    rows = [{name: row[key] for name, key in _COLUMNS.items()} for row in document["models"]]
    print_rows(f"{document['specimen']}, largest force {document['max_force_N']:.5g} N", rows)
    for row in document["models"]:
        remarks = [f"at a bound: {', '.join(row['at_bound'])}"] if row["at_bound"] else []
        remarks += [row["note"]] if row["note"] else []
        if remarks:
            print(f"note: {row['label']}: {'; '.join(remarks)}")
    place.tell(paths)
    return 0
