"""`famjax sweep`."""

import json
from pathlib import Path
from typing import Literal

from ..lean_imports import load_matplotlib
from ..loading import load_fitting, load_map, look_here
from ..options.engine import UNNAMED, EngineOptions
from ..options.whole_numbers import Replicates, Seed, SweptOrders
from ..terminal import Output, print_rows, progress


def sweep(
    data: str = "DMSP-20-300",
    *,
    braid_diameter: str | None = None,
    braid_angle: str | None = None,
    deadband: str | None = None,
    geometry: str | None = None,
    term: tuple[str, ...] = (),
    order: SweptOrders = (1, 2, 3, 4),
    dependence: tuple[Literal["fixed", "linear", "free"], ...] = ("fixed", "linear", "free"),
    constraint: tuple[Literal["none", "positive", "slope", "drucker"], ...] = (
        "none",
        "positive",
        "slope",
        "drucker",
    ),
    objective: Literal["sum_of_squares", "mean_rmse", "huber"] = "sum_of_squares",
    bootstrap: Replicates = 0,
    seed: Seed = 0,
    specimen: tuple[str, ...] = (),
    output: Path = Path("famjax-sweep"),
    units: Literal["si", "metric", "us"] = "metric",
    engine: EngineOptions = UNNAMED,
    json_: bool = False,
) -> int:
    """Fit every permutation of order, pressure dependence and constraint at one geometry.

    Writes `sweep.json` with all fits in SI, and pictures of errors and force curves. The parts of a
    bootstrap are kept in the folder `replicates`, from which a stopped sweep goes on. Without a
    geometry the one that `famjax fit` identifies with its standard law is taken.

    Parameters
    ----------
    data
        CSV file or the name of a bundled map, as for `famjax fit`.
    braid_diameter
        D0 at rest with its unit, `21.6mm`.
    braid_angle
        Braid angle at rest from the circumference with its unit, `63deg`.
    deadband
        Pressure before the muscle acts with its unit, `43kPa`.
    geometry
        A geometry of your own around the cylinder, module:Class, as for `famjax fit`; its numbers are
        identified with the standard law.
    term
        A force term of your own beside braid and bladder, module:Class, repeatable; as --geometry.
    order
        Orders of the law, repeatable, 1 to 4.
    dependence
        Of the coefficients on pressure, repeatable: fixed, linear, free.
    constraint
        On the coefficients, repeatable: none, positive, slope, drucker.
    objective
        sum_of_squares; mean_rmse: mean over pressures of the RMSE, as the reference work; huber.
    bootstrap
        Number of replicates for standard deviations of the coefficients.
    seed
        Of the replicates; the same seed writes the same bytes.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    output
        Folder for the files, made if need be.
    units
        Of tables and pictures: si, metric or us.
    engine
        Where the replicates are done.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    load_matplotlib()

    from famjax.boundary.units import parse_quantity
    from famjax.commands.options.fits import parse_specimen
    from fitting.search.own_parts import own_parts, taking_part
    from fitting.sweeps import check_options, sweep_command

    place = Output(output)
    check_options(objective, bootstrap, seed)
    measured = load_map(data, parse_specimen(specimen))
    look_here()
    parts, declared = own_parts([measured], geometry, term)
    given = {"braid_diameter": braid_diameter, "braid_angle": braid_angle, "deadband": deadband}
    missing = [name for name, text in given.items() if text is None]
    if len(missing) < len(given) and (missing or parts):
        raise fitting.InputError(
            f"the geometry needs {', '.join(given)} together, or none of them to identify it"
            + (f"; missing: {', '.join(missing)}" if missing else ", as with --geometry and --term")
        )
    with progress("identifying the geometry") as show, engine.executor() as executor:
        if missing:
            found = fitting.identify(
                measured, **parts, parameters=taking_part(declared, {}), seed=seed
            )
            shape, terms = found.muscle.geometry, parts.get("terms")
            dead = found.estimate("deadband_pressure").value
            if terms is not None:
                terms = terms.with_parameters(
                    {name: found.estimate(name).value for name in terms.declared()}
                )
        else:
            terms = None
            shape = fitting.families.EstimatedSource(measured.specimen).geometry(
                {
                    "braid_diameter": parse_quantity(str(braid_diameter), "length"),
                    "braid_angle": parse_quantity(str(braid_angle), "angle"),
                }
            )
            dead = parse_quantity(str(deadband), "pressure")
        document, paths = sweep_command(
            [measured],
            shape,
            deadband=dead,
            terms=terms,
            orders=order,
            dependences=dependence,
            constraints=constraint,
            objective=objective,
            bootstrap=bootstrap,
            seed=seed,
            executor=executor,
            output=output,
            units=units,
            progress=lambda done, total: show(done, total, "sweeping"),
        )
    if json_:
        print(json.dumps(document, allow_nan=False))
        return 0
    # What cannot be said in a word is said once, below the table.
    known = {"stable", "not stable"}
    sentences = dict.fromkeys(r["verdict"] for r in document["rows"] if r["verdict"] not in known)
    marks = {sentence: f"see ({k})" for k, sentence in enumerate(sentences, 1)}
    rows = [
        {**row, "verdict": marks.get(row["verdict"], row["verdict"])} for row in document["rows"]
    ]
    for row in rows:
        del row["data"]
    print_rows(f"{len(rows)} fits of {measured.specimen.name}", rows)
    for k, sentence in enumerate(sentences, 1):
        print(f"({k}) {sentence}")
    place.tell(paths)
    return 0
