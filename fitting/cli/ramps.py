"""`famjax ramps`."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from famjax.console import Output, Units, print_json, print_rows

from .inputs import load_fitting


def ramps(
    *records: str,
    atmosphere: str,
    specimen: tuple[str, ...] = (),
    columns: str | None = None,
    branches: Literal["both", "fill", "vent"] = "both",
    period_s: float | None = None,
    step_kPa: Annotated[float, Parameter(name="--step-kPa")] = 25.0,
    slack_below_N: Annotated[float | None, Parameter(name="--slack-below-N")] = None,
    length_std_mm: float | None = None,
    output: Path = Path("famjax-ramps"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Turn raw isometric pressure ramps into a static force map with its noise and hysteresis.

    Writes `map.csv` (which `famjax fit` reads), `ramps.png`, `ramps.json` and, where records were filled
    and vented, `branches.csv` (which `famjax assess --hysteresis` reads).

    Parameters
    ----------
    records
        Raw records with the length at which each was taken, `test8.csv=73.25mm`; or a list, a CSV
        file with the columns `file,length_mm`.
    atmosphere
        What the pressure sensor reads at atmosphere, `8.94kPa`, or the interval of each record in
        which the muscle is vented, `0s:0.5s`.
    specimen
        Describe the muscle, key_unit=value, repeatable; rest_length is needed.
    columns
        Names of the columns, with units, where the records have no header that names them.
    branches
        Which branch the map holds: the mean of both, fill or vent.
    period_s
        Time between valve pulses; found in the record unless given.
    step_kPa
        Of the pressures of the map.
    slack_below_N
        Force under which the muscle does not pull; found from the clamp of the sensor unless given.
    length_std_mm
        Standard deviation of the lengths, where it is known.
    output
        Folder for the files, created if missing.
    units
        Of summary, picture and map: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    load_fitting()
    from famjax.boundary.origin import Origin
    from fitting.reading import parse_specimen
    from fitting.records import parse_atmosphere, ramps_command

    place = Output(output)
    summary, files = ramps_command(
        records,
        atmosphere=parse_atmosphere(atmosphere),
        columns=columns,
        specimen=parse_specimen(specimen),
        period=period_s,
        step=step_kPa * 1e3,
        slack_below=slack_below_N,
        branches=branches,
        length_std=None if length_std_mm is None else length_std_mm / 1e3,
        system=units,
    )
    origin = Origin.of_this_command()
    summary["origin"] = origin.as_dict()
    files["map.csv"] = "\n".join(origin.comments()).encode() + b"\n" + files["map.csv"]
    paths = place.write({**files, "ramps.json": summary})
    if json_:
        print_json(summary)
        return 0
    print_rows("Records", summary["records"])
    print_rows("Lengths", summary["lengths"])
    for note in summary["notes"]:
        print(f"note: {note}")
    place.tell(paths)
    return 0
