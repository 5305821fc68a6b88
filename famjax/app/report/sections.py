"""What stands on the page, and in which order."""

import dataclasses
import re
from collections.abc import Sequence

from fitting.saved import PageTable

from ..checks import AGREES, checks_table, read_checks
from ..evaluation import CYLINDER, ELASTIC, PICTURES, RECORDS
from ..sheet import SHEET
from .bladder_charts import law_charts, strain_charts
from .chart import Chart, Drawing
from .error_tables import error_tables, onset_tables
from .force_charts import actuation_charts, pressure_charts, term_charts
from .photograph_figure import photograph_figure
from .shape_charts import shape_charts
from .source import Source
from .tables import failed_pictures, geometry_tables, setup_table, specimen_table, test_table
from .uncertainty import ridge_sentences, shared_table, uncertainty_table

_SAME = 1e-6  # of the RMSE
_OPTION = re.compile(r"\(--specimen ([a-z_]+=)\.\.\.(?:, or embedded=false)?\)")


@dataclasses.dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: of it.
        text: paragraphs above its figures.
        figures: in their order.
        tables: below the figures.
        beside: how many of the tables stand beside the figures where the page is wide.
    """

    title: str
    text: Sequence[str] = ()
    figures: Sequence[Drawing] = ()
    tables: Sequence[PageTable] = ()
    beside: int = 0


def sections(source: Source) -> list[Section]:
    """The page's parts but for notes and provenance; what the folder lacks is left out."""
    found = [
        Section(
            "Specimen and set-up", figures=[*photograph_figure(source), *_test(source)],
            tables=[specimen_table(source), setup_table(source), *test_table(source)], beside=2,
        ),
        Section("Actuation", figures=_drawn(actuation_charts(source))),
        Section("Shape", figures=_drawn(shape_charts(source))),
        Section("Strains of the bladder", [_names(source)], figures=_drawn(strain_charts(source))),
        Section("Stress of the bladder", figures=_drawn(law_charts(source))),
        Section("Parts of the force", figures=_drawn(term_charts(source))),
        Section(
            "Blocked force, free contraction and errors by pressure",
            figures=_drawn(pressure_charts(source)),
            tables=[*onset_tables(source), *error_tables(source)],
        ),
        Section("Geometries side by side", alike(source), tables=geometry_tables(source)),
        Section(
            "Uncertainty", ridge_sentences(source),
            tables=[uncertainty_table(source), *shared_table(source)],
        ),
        Section("Cross-checks", tables=checks_table(source.steps, source.system)),
    ]  # fmt: skip
    return [one for one in found if one.text or one.figures or one.tables]


def summary(source: Source) -> str:
    """The page in a sentence."""
    fit = source.best.figures
    rmse, most = fit["rmse_N"], fit["largest_force_N"]
    shape = source.shape
    of = "" if shape is None else f", its shape from {shape['pictures']} photographs"
    unit = source.unit("force")
    return (
        f"{source.sheet.specimen.name}: the force is described within "
        f"{source.number(rmse, 'force', 3)} {unit} RMS, {100 * rmse / most:.2g} % of the largest, "
        f"{source.number(most, 'force', 4)} {unit}{of}."
    )


def verdict(source: Source) -> str:
    """Whether the fit that the page shows may be believed, the gravest reason first, and the checks."""
    document = source.best.saved.document
    level, reasons = document.get("verdict") or "not judged", document.get("reasons") or []
    checks = [one for place in source.steps for one in read_checks(place)]
    agreeing = sum(one.verdict == AGREES for one in checks)
    return " ".join(
        [
            f"{level.capitalize()}{f': {reasons[0]}' if reasons else '.'}",
            f"Shown is the {source.best.short} fit.",
            f"{agreeing} of {len(checks)} cross-checks agree." if checks else "",
        ]
    ).strip()


def alike(source: Source) -> list[str]:
    """Why the columns of cylinder and elastic cylinder are the same, where they are."""
    fits = [source.fits.get(name) for name in (CYLINDER, ELASTIC)]
    known = [one.figures["rmse_N"] for one in fits if one is not None]
    if len(known) < 2 or abs(known[0] - known[1]) > _SAME * known[0]:
        return []
    return [
        "Cylinder and elastic cylinder are the same here: the stretch of the threads, braid_compliance, "
        "was identified as 0, its lower bound, and an elastic braid that does not stretch is an "
        "inextensible one. So the force of this test shows no stretch of the threads."
    ]


def unknown(source: Source) -> list[str]:
    """What the folder lacks, and what is not known therefore."""
    said = []
    if PICTURES not in source.names:
        said.append(
            "There are no photographs: the shape is the cylinder of the braid's triangle, its "
            "diameter and angle identified from the force, and no strain was measured."
        )
    if source.sheet.records.force_map is not None:
        said.append(
            "There is a force map and no record of the test: hysteresis, the pressure that was held, "
            "blocked force and free contraction as measured are not known."
        )
        if PICTURES in source.names:
            said.append(
                "The photographs have no log beside them: force and pressure at each are not known, "
                "their clock and scale are not checked, and the shape is taken as one at all pressures."
            )
    photographs = source.sheet.photographs
    if photographs is not None and photographs.ruler is None:
        said.append(
            "There is no photograph of a ruler: the scale of the pictures is as stated, and all "
            "lengths and diameters are as wrong as it is."
        )
    if PICTURES in source.names and source.sheet.specimen.bladder_diameter is None:
        said.append(
            "The bladder's diameter at rest is not stated: it is taken to fill the braid, and its "
            "strain is as wrong as that."
        )
    if not source.sheet.errors.stated():
        said.append(
            "The sheet states no errors that all readings share: standard errors and bands are of "
            "scatter and shape alone."
        )
    if source.sheet.turns is None and PICTURES in source.names:
        said.append(
            "The turns of the threads were not counted: they are identified from the force."
        )
    if failed := failed_pictures(source):
        count = "1 picture" if len(failed) == 1 else f"{len(failed)} pictures"
        said.append(f"{count} could not be measured: {'; '.join(failed[:5])}.")
    return said


def notes(source: Source) -> list[str]:
    """What a reader must know of test, shape and readings."""
    of_shape = source.shape["notes"] if source.shape else []
    found = [*source.test.get("notes", []), *of_shape, *source.data.notes]
    # A force map advises an option of `famjax fit`; here the same stands in the sheet.
    return [_OPTION.sub(rf"(\1 in [specimen] of {SHEET})", one) for one in found]


def _test(source: Source) -> list[Drawing]:
    """The picture that the records' step drew; none without the test's record."""
    drawn = source.results / RECORDS / "characterisation"
    files = [drawn.with_suffix(".svg"), drawn.with_suffix(".pdf"), drawn.with_name("branches.csv")]
    if not all(path.exists() for path in files):
        return []
    svg, pdf, table = files
    caption = (
        "The test. Left: force against contraction at each set pressure, shortening solid, lengthening "
        "dashed. Right: the pressure held less the set pressure."
    )
    texts = (svg.read_text(encoding="utf-8"), pdf.read_bytes(), table.read_text(encoding="utf-8"))
    return [Drawing("test", caption, *texts, size="wide")]


def _names(source: Source) -> str:
    """What the short names of the geometries stand for."""
    named = "; ".join(f"{fit.short} = {fit.title}" for fit in source.fits.values())
    return f"Geometries, here and below: {named}."


def _drawn(charts: Sequence[Chart]) -> list[Drawing]:
    return [one.drawing() for one in charts]
