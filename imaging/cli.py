"""The `famjax measure` command and its options.

The application that registers the command supplies the function that reads test-machine logs.
"""

import dataclasses
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.units import parse_quantity
from famjax.console import (
    Columns,
    Jobs,
    Signed,
    Units,
    parse_columns,
    print_json,
    print_rows,
    progress,
)

from .errors import ImagingError

if TYPE_CHECKING:
    from .campaign import Table
    from .recipe import Recipe

AddLog = Callable[["Table"], "Table"]
"""Function that adds columns from a test machine's log to a table."""

_SHOWN = 20  # pictures listed on the console
_PRINTED = re.compile(r"path|error|(length|mean_diameter|distance)(_stderr)?_(in|mm|m)")


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class RecipeOptions:
    """Recipe entries set on the command line; an entry is None if its option is not used.

    Parameters
    ----------
    ruler
        Photograph of a ruler in the plane of the muscle's axis, taken with the same camera.
    distance
        Distance from the camera to the muscle, with its unit. If omitted, the distance and its standard
        error are estimated from the curvature of the tape edges.
    pitch
        Spacing of the finest marks on the ruler, such as `0.125in`. If omitted, it is inferred from the
        number of marks between numerals.
    ruler_placement
        Standard error of the distance between the ruler and the plane of the muscle's axis, such as
        `0.01in`. The picture does not show this distance, and an error in it affects every result.
    crop_offset
        Column and row of the cropped pictures' top-left pixel in the uncropped camera frame, such as
        `1459,531`.
    frame_size
        Width and height of the uncropped camera frame in pixels, such as `5568,3712`.
    scale
        Known scale in the plane of the muscle's axis, used instead of a ruler, such as
        `"226.63+-0.02 px/in"`.
    k1
        Radial distortion coefficient of the lens. If omitted, it is estimated from the ruler's marks.
    tone
        Use srgb if the camera was set to a neutral picture style, with contrast and sharpening off. If
        omitted, the standard errors allow for other picture styles.
    tape_diameter
        Known diameter of the tapes on the fittings, used to check the scale.
    braid_angle
        Also measure the braid angle from the weave: its profile, mean and standard error, and the number
        of turns that each thread makes.
    orientation
        Orientation of the muscle in the pictures.
    """

    ruler: Path | None = None
    distance: str | None = None
    pitch: str | None = None
    ruler_placement: str | None = None
    crop_offset: str | None = None
    frame_size: str | None = None
    scale: str | None = None
    k1: Annotated[float | None, Signed] = None
    tone: Literal["srgb"] | None = None
    tape_diameter: str | None = None
    braid_angle: bool | None = None
    orientation: Literal["vertical", "horizontal", "auto"] | None = None


_UNSAID = RecipeOptions()


def measure(
    *photos: str,
    how: RecipeOptions = _UNSAID,
    log: Path | None = None,
    log_offset: Annotated[str | None, Signed] = None,
    column: Columns = (),
    rest_length: str | None = None,
    diameter: str | None = None,
    jobs: Jobs = None,
    units: Units = "metric",
    output: Path = Path("famjax-measure"),
    overlays: int = 12,
    rescaled: bool = False,
    json_: bool = False,
    read_log: Annotated[Callable[..., Any] | None, Parameter(parse=False)] = None,
) -> int:
    """Measure the shape of a muscle in photographs, with standard errors for each picture.

    Writes `measurements.csv` (one row per picture), `measurements.nc` (with the profiles),
    `recipe.toml` (all settings) and `overlays/`. If a campaign was stopped, run the same command again to
    resume it. The exit code is 3 if any picture could not be measured or matched to the log; the table
    states the reason for each.

    Parameters
    ----------
    photos
        Picture files, folders, or patterns such as `'stroke/*.jpg'`. All pictures must be the same size.
    how
        Measurement settings.
    log
        Test-machine log, a CSV file with columns such as `time_s,displacement_in,force_lbf,
        pressure_psi`. Its force and pressure are added to each picture's row. The clocks of the camera and
        the machine are aligned by the recorded motion.
    log_offset
        Time on the test machine's clock when the first picture was taken, such as `12s`, accurate to
        within 10 s. Required if the motion is periodic.
    column
        Name or number of the log column for a quantity, such as `force="Kraft [N]"`, with its unit.
        Required if the column's name is ambiguous. Repeatable; `pressure=-` ignores the pressure. Also
        accepts `decimal=,` and, for absolute pressures, `atmosphere=101.3kPa`.
    rest_length
        Rest length used to compute the contraction and to check the scale, such as `9.28in`. If omitted,
        the contraction is computed from the longest measured length.
    diameter
        Nominal diameter of the braid at rest, such as `0.875in`, used to check the scale.
    jobs
        Number of worker processes. If omitted, one per core is used where that saves time.
    units
        Units in the CSV file, plots and printed output: us (in, lbf, psi), metric (mm, N, kPa) or si.
    output
        Output folder, created if missing.
    overlays
        Number of pictures to save with the detected edges drawn on them, for visual inspection.
    rescaled
        Accept a ruler picture that differs in size from the other pictures, and use its scale unchanged.
    json_
        Print a single JSON object to standard output.
    read_log
        Function that takes the log's path, `offset` and `columns`, and returns an `AddLog`.
    """
    # Idle OpenBLAS threads spin, and the matrices here are small. NumPy reads this when it is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from .pictures import expand, measure_pictures
    from .recipe import recipe_text

    try:
        with progress("measuring") as show:
            expand(photos)  # report a missing picture before an incomplete recipe
            recipe, provenance = command_recipe(how)
            add_log = None
            if log is not None and read_log is not None:
                add_log = read_log(
                    log, offset=None if log_offset is None else parse_quantity(log_offset, "time"),
                    columns=parse_columns(column),
                )  # fmt: skip
            rest, nominal = (
                None if one is None else parse_quantity(one, "length")
                for one in (rest_length, diameter)
            )
            outcome = measure_pictures(
                photos, recipe=recipe, provenance=provenance, add_log=add_log, rest_length=rest,
                executor="auto" if jobs is None else jobs, system=units, output=output,
                overlays=overlays, rescaled=rescaled, diameter=nominal, progress=show,
            )  # fmt: skip
    except (InputError, OSError) as error:
        # The documentation explains the specific error classes by name.
        named = type(error) not in (InputError, ImagingError)
        print(f"famjax: {type(error).__name__ + ': ' if named else ''}{error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(
            f"famjax: stopped; finished measurements are in {output}. Run the same command again to resume",
            file=sys.stderr,
        )
        return 130
    table = outcome.table
    document = {
        "pictures": len(table), "ok": int(table.ok.sum()), "complete": outcome.complete,
        "notes": table.notes, "files": [str(path) for path in outcome.files],
        "rows": table.rows(units),
    }  # fmt: skip
    if json_:
        print_json(document)
    else:
        print(recipe_text(recipe))
        _print(document)
    return 0 if outcome.complete else 3


def _print(document: dict[str, Any]) -> None:
    shown = document["rows"][:_SHOWN]
    keys = [key for key in shown[0] if _PRINTED.fullmatch(key)]
    print_rows(
        f"{len(shown)} of {document['pictures']}", [{k: row[k] for k in keys} for row in shown]
    )
    print(f"{document['ok']} of {document['pictures']} pictures measured")
    for note in document["notes"]:
        print(f"note: {note}")
    print("written:", ", ".join(document["files"]))


def command_recipe(options: RecipeOptions) -> tuple["Recipe", dict[str, str]]:
    """Build the recipe and the table's provenance entries from command-line options.

    Args:
        options: settings. Lengths are strings with a unit; the scale is a string such as `226.63 px/in` or
            `226.63+-0.02 px/in`.

    Raises:
        ImagingError: the scale is missing or stated twice, or an option cannot be parsed.
    """
    from .camera import Tone
    from .pictures import picture_recipe

    given = {name: one for name, one in vars(options).items() if one is not None}
    for name in ("pitch", "ruler_placement", "distance", "tape_diameter"):
        if name in given:
            given[name] = parse_quantity(given[name], "length")
    for name, kind in (("crop_offset", float), ("frame_size", int)):
        if name in given:
            given[name] = _pair(given[name], name, kind)
    if "tone" in given:
        given["tone"] = Tone.srgb()
    if "ruler_placement" in given:
        given["placement_stderr"] = given.pop("ruler_placement")
    return picture_recipe(given.pop("ruler", None), given.pop("scale", None), given)


def _pair(text: str, name: str, kind: Callable[[str], float]) -> tuple[float, float]:
    try:
        u, v = map(kind, text.split(","))
    except ValueError:
        raise ImagingError(
            f"the {name.replace('_', ' ')} must be two numbers in px, such as 1459,531; got {text!r}"
        ) from None
    return u, v
