"""`famjax design`."""

import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .loading import load_fitting
from .terminal import Output, print_rows


def design(
    require: Annotated[tuple[str, ...], Parameter(negative=())] = ("pressure_psi=100",),
    *,
    catalogue: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    bundled: bool = True,
    tube: Annotated[tuple[str, ...], Parameter(negative=())] = (),
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
    tube
        What is known of the swage tubes, key_unit=value, repeatable: modulus_psi=10e6,
        yield_stress_psi=40e3, free_length_in=2.6, supported_length_in=1.85. What is not given is
        the catalogue's, else assumed, and the output says so.
    rest_length_mm
        Active length at rest, for thread length and turns; that of the reference work's specimen.
    output
        Folder for the files, made if need be.
    units
        Of tables and files: si, metric (mm, kPa, N) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    load_fitting()
    from famjax.boundary.files import write_all
    from famjax.boundary.origin import Origin

    from ..design.document import design_document, design_picture
    from .options.designs import parse_requirement, parse_tube

    place = Output(output)
    document = design_document(
        parse_requirement(require),
        catalogue,
        bundled=bundled,
        rest_length=rest_length_mm / 1e3,
        system=units,
        tube=parse_tube(tube),
    )
    document["origin"] = Origin.of_this_command().as_dict()
    content = json.dumps(document, indent=1, allow_nan=False).encode()
    paths = write_all(
        output, {"design.json": content, "design.png": design_picture(document, units)}
    )
    if json_:
        print(json.dumps(document, allow_nan=False))
        return 0
    print_rows("Braid angle of each braid on each bladder", document["braid_angles"])
    print_rows("Candidates, the best first", document["candidates"])
    usable = [row for row in document["end_fittings"] if row["feasible"]]
    print_rows("End-fittings that enter the bladder's bore", usable)
    print_rows("Buckling of the swage tubes in the die", document["tube_buckling"])
    print_rows("Safety factors of tested muscles", document["safety_factors"])
    for note in document["notes"]:
        print("note:", note)
    place.tell(paths)
    return 0
