"""The figures that the identification is measured by, each from measured data by the shipped code.

Run `python benchmarks/goals.py` in a clone: it prints one row for each goal, in and out of sample,
and writes them as JSON with `--json PATH`. What is known of a specimen besides its force map, and
every choice of model that was made by looking at these maps, is said in the row. A goal counts as
met by a converged fit of a law that is stable on its path. Standard error says which is pursued.
"""

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax

import fitting
from fitting import Parameter

MUSCLES = {"A1": "DMSP-20-300", "A2": "DMSP-10-250"}

ENDS, BRAID, RIG = (
    {name: Parameter()} for name in ("end_factor", "braid_compliance", "series_compliance")
)
# Lengths are printed in whole millimetres, so the rest length is good to half of one.
ROUNDED = {"rest_length": Parameter(min=295.5, max=296.5, unit="mm")}
# The rubber of A1, identified there as -6.47 +- 0.56: the same make and compound.
SAME_RUBBER = {"ogden_exponent": Parameter(prior=(-6.5, 0.6))}
NO_DEADBAND = {"deadband_pressure": Parameter(value=0.0, vary=False, unit="kPa")}


@dataclasses.dataclass(frozen=True)
class Goal:
    """One fit and what is asked of it.

    Attributes:
        data: name of the force map.
        what: the model, in words.
        options: of `identify`.
        rmse, lopo, lolo_interior: targets [N]; nan where none is set.
    """

    data: str
    what: str
    options: dict[str, Any]
    rmse: float = math.nan
    lopo: float = math.nan
    lolo_interior: float = math.nan


GOALS = (
    Goal("A1", "Ogden, ends, rest length to its rounding, physical box",
         {"law": "ogden", "parameters": ENDS | ROUNDED}, 4.0, 4.2, 11.0),
    Goal("A1", "Ogden, ends, physical box", {"law": "ogden", "parameters": ENDS}, 4.0, 4.2, 11.0),
    Goal("A2", "Ogden, compliant braid, the rubber of A1 as a prior, physical box",
         {"law": "ogden", "parameters": BRAID | SAME_RUBBER, "noise": 1.0}, 1.25, 1.55, 7.0),
    Goal("A2", "Ogden, compliant braid, physical box",
         {"law": "ogden", "parameters": BRAID}, 1.25, 1.55, 7.0),
    Goal("A2", "Ogden, ends, compliant braid, the rubber of A1 as a prior, physical box",
         {"law": "ogden", "parameters": ENDS | BRAID | SAME_RUBBER, "noise": 1.0}, 1.25, 1.55, 7.0),
    Goal("A1", "Mooney-Rivlin, open box", {"law": "mooney-rivlin", "box": "open"}, 3.3),
    Goal("A2", "odd cubic, open box", {"order": 3, "box": "open"}, 1.7),
    Goal("A1", "odd quartic linear in pressure, open box",
         {"order": 4, "dependence": "linear", "box": "open"}, 3.0),
    Goal("A2", "odd cubic linear in pressure, open box",
         {"order": 3, "dependence": "linear", "box": "open"}, 1.1),
)  # fmt: skip

RAMPS = (
    Goal("bpa10 10cm", "saturating, ends, compliant rig, no deadband, open box",
         {"law": "saturating", "parameters": ENDS | RIG | NO_DEADBAND, "box": "open"}, 2.3),
    Goal("bpa10 30cm", "saturating, ends, compliant rig, no deadband, open box",
         {"law": "saturating", "parameters": ENDS | RIG | NO_DEADBAND, "box": "open"}, 2.3),
    Goal("bpa10 30cm", "saturating, compliant rig, physical box",
         {"law": "saturating", "parameters": RIG}, 2.3),
)  # fmt: skip
"""Goals on raw ramps, for maps that `famjax ramps` has made of them."""


def reach(goal: Goal, data: fitting.ForceData) -> dict[str, Any]:
    """One goal pursued: what was asked, what was reached, and where the numbers are weak."""
    result = fitting.identify(data, **goal.options)
    asked = {"rmse": goal.rmse, "lopo": goal.lopo, "lolo_interior": goal.lolo_interior}
    got = {"rmse": result.errors.rmse, "lopo": math.nan, "lolo_interior": math.nan}
    if math.isfinite(goal.lopo):
        got["lopo"] = fitting.validate(result, "pressure", starts=12).rmse
        got["lolo_interior"] = fitting.validate(result, "length", starts=12).interior_rmse
    return {
        "data": goal.data,
        "model": goal.what,
        "n_parameters": result.n_parameters,
        **{f"{key}_N": _number(value) for key, value in got.items()},
        **{f"{key}_goal_N": _number(value) for key, value in asked.items()},
        "met": result.converged
        and result.certificate.stability_margin >= -1e-9 * float(abs(result.coefficients).max())
        and all(got[key] <= asked[key] for key in asked if math.isfinite(asked[key])),
        "stability_margin_Pa": result.certificate.stability_margin,
        "converged": result.converged,
        "at_bound": [e.name for e in result.estimates if e.at_bound],
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def main(arguments: Sequence[str] | None = None) -> None:
    """Print every goal, and write them as JSON where asked to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, help="file for the rows")
    parser.add_argument("--ramps", type=Path, nargs=2, metavar=("MAP_10CM", "MAP_30CM"),
                        help="maps of the two bpa10 specimens, from famjax ramps")  # fmt: skip
    options = parser.parse_args(arguments)
    jax.config.update("jax_enable_x64", True)
    jobs = [(goal, fitting.load_bundled(MUSCLES[goal.data])) for goal in GOALS]
    if options.ramps:
        maps = dict(zip(("bpa10 10cm", "bpa10 30cm"), options.ramps, strict=True))
        # Each reading counts the same: the target is a plain RMSE.
        read = {name: fitting.read_csv(path) for name, path in maps.items()}
        plain = {name: dataclasses.replace(one, force_std=None) for name, one in read.items()}
        jobs += [(goal, plain[goal.data]) for goal in RAMPS]
    rows = []
    for number, (goal, data) in enumerate(jobs, 1):
        print(f"{number} of {len(jobs)}: {goal.data}, {goal.what}", file=sys.stderr, flush=True)
        row = reach(goal, data)
        rows.append(row)
        figures = ", ".join(
            f"{key} {row[f'{key}_N']:.3f} ({row[f'{key}_goal_N']:g})"
            for key in ("rmse", "lopo", "lolo_interior")
            if row[f"{key}_goal_N"] is not None
        )
        print(f"{'met ' if row['met'] else 'MISS'} {row['data']}: {row['model']}, "
              f"{row['n_parameters']} parameters: {figures}", flush=True)  # fmt: skip
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1, allow_nan=False))


if __name__ == "__main__":
    main()
