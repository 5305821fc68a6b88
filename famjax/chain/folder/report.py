"""The report of a characterisation folder: one page, offline, from the files of its steps."""

import base64
import csv
import importlib.resources
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

import famjax
import fitting
from famjax.boundary.origin import Origin
from famjax.boundary.units import factor, unit_system

from .cached_steps import Step
from .evaluation import (
    CYLINDER,
    GEOMETRIES,
    MEASURED,
    PICTURES,
    RECORDS,
    REPORT,
    SHAPE,
    read_map,
)
from .report_figures import profile_figure, svg
from .sheet import RESULTS, SHEET, Sheet

Table = tuple[str, Sequence[str], Sequence[Sequence[str]]]
"""Title, header, rows."""

FIRST_RUN = "first-run.json"


def first_run(results: Path, now: Origin) -> Origin:
    """When the folder was first evaluated, and by which command: the date of all its files."""
    path = results / FIRST_RUN
    if not path.exists():
        path.write_text(json.dumps(now.as_dict()) + "\n", encoding="utf-8")
    return Origin(**json.loads(path.read_text(encoding="utf-8")))


def report_step(sheet: Sheet, steps: Sequence[Step], *, origin: Origin, system: str) -> Step:
    """The step that writes the report of the steps before it."""
    names = [step.name for step in steps]

    def run(place: Path) -> None:
        page = _page(sheet, names, origin, system)
        (place / "report.html").write_text(page, encoding="utf-8")

    return Step(REPORT, [sheet.folder / SHEET], {"system": system}, names, run)


def _page(sheet: Sheet, names: Sequence[str], origin: Origin, system: str) -> str:
    results = sheet.folder / RESULTS
    fits = {name: _read(results / name / "figures.json") for name in GEOMETRIES if name in names}
    best = MEASURED if MEASURED in fits else CYLINDER
    shape = _read(results / SHAPE / "shape.json") if SHAPE in names else None
    tables = [
        _specimen(sheet, system),
        *_isobars(results, system),
        _errors(fits, system),
        *_parameters(fits, best),
        *_onsets(sheet, results, fits, system),
    ]
    figures = [*_figures(sheet, results, names, best, system)]
    template = importlib.resources.files("famjax") / "templates" / "characterisation.html"
    return (
        jinja2.Environment(autoescape=True)
        .from_string(template.read_text(encoding="utf-8"))
        .render(
            name=sheet.specimen.name,
            summary=_summary(sheet, fits, best, shape),
            unknown=_unknown(sheet, results, names),
            notes=[
                *_test_notes(results),
                *(shape["told"] if shape else []),
                *read_map(sheet).notes,
            ],
            figures=[(Markup(content), caption) for content, caption in figures],
            tables=tables,
            origin=origin,
            version=famjax.__version__,
            digest=read_map(sheet).sha256,
        )
    )


def _summary(sheet: Sheet, fits: dict[str, Any], best: str, shape: Any) -> str:
    fit = fits[best]
    rmse, most = fit["rmse_N"], fit["largest_force_N"]
    of = "" if shape is None else f", its shape from {shape['pictures']} photographs"
    return (
        f"{sheet.specimen.name}: the force is described within {rmse:.3g} N RMS, "
        f"{100 * rmse / most:.2g} % of the largest, {most:.4g} N{of}."
    )


def _unknown(sheet: Sheet, results: Path, names: Sequence[str]) -> list[str]:
    """What the folder lacks, and what is not known therefore."""
    said = []
    if PICTURES not in names:
        said.append(
            "There are no photographs: the shape is the cylinder of the braid's triangle, its "
            "diameter and angle identified from the force, and no strain was measured."
        )
    if sheet.records.force_map is not None:
        said.append(
            "There is a force map and no record of the test: hysteresis, the pressure that was held, "
            "blocked force and free contraction as measured are not known."
        )
    if sheet.turns is None and PICTURES in names:
        said.append(
            "The turns of the threads were not counted: they are identified from the force."
        )
    failed = _failed_pictures(results) if PICTURES in names else []
    if failed:
        count = "1 picture" if len(failed) == 1 else f"{len(failed)} pictures"
        said.append(f"{count} could not be measured: {'; '.join(failed[:5])}.")
    return said


def _test_notes(results: Path) -> list[str]:
    """What the records of the test lack, such as a stroke that a gap in the log costs."""
    path = results / RECORDS / "characterisation.json"
    return _read(path)["notes"] if path.exists() else []


def _failed_pictures(results: Path) -> list[str]:
    with (results / PICTURES / "measurements.csv").open(encoding="utf-8", newline="") as file:
        return [
            f"{Path(row['path']).name}, {row['error'].partition(':')[0]}"
            for row in csv.DictReader(file)
            if row["ok"] != "true"
        ]


def _specimen(sheet: Sheet, system: str) -> Table:
    unit = unit_system(system)["length"]
    one = sheet.specimen
    rows = [
        (name.replace("_", " "), f"{value / factor(unit, 'length'):.5g} {unit}")
        for name in ("rest_length", "wall_thickness", "bladder_diameter", "braid_thickness")
        if (value := getattr(one, name)) is not None
    ]
    turns = "identified" if sheet.turns is None else f"{sheet.turns:g}, counted"
    return "Specimen", ("quantity", "value"), [*rows, ("turns of a thread", turns)]


def _isobars(results: Path, system: str) -> list[Table]:
    path = results / RECORDS / "characterisation.json"
    if not path.exists():
        return []
    units = unit_system(system)
    Pa, N = factor(units["pressure"], "pressure"), factor(units["force"], "force")
    rows = []
    for bar in _read(path)["isobars"]:
        shown = [
            _number(bar["set_pressure_Pa"], Pa), _number(bar["pressure_std_Pa"], Pa),
            _number(bar["blocked_force_N"], N), _number(bar["free_contraction"], 1.0),
            _number(bar["hysteresis_J"], 1.0),
        ]  # fmt: skip
        rows.append(shown)
    header = (
        f"set pressure [{units['pressure']}]", f"std held [{units['pressure']}]",
        f"blocked force [{units['force']}]", "free contraction", "hysteresis [J]",
    )  # fmt: skip
    return [("What the test measured", header, rows)]


def _errors(fits: dict[str, Any], system: str) -> Table:
    unit = unit_system(system)["force"]
    N = factor(unit, "force")
    rows = [
        (
            GEOMETRIES[name], f"{fit['rmse_N'] / N:.3g}",
            f"{100 * fit['rmse_N'] / fit['largest_force_N']:.2g} %",
            f"{fit['largest_N'] / N:.3g}", _number(fit.get("left_out_pressure_N"), N),
            _number(fit.get("left_out_length_N"), N),
        )
        for name, fit in fits.items()
    ]  # fmt: skip
    header = (
        "geometry", f"RMSE [{unit}]", "of the largest force", f"largest error [{unit}]",
        f"each pressure left out [{unit}]", f"each length left out [{unit}]",
    )  # fmt: skip
    return "Errors of the fits by geometry", header, rows


def _parameters(fits: dict[str, Any], best: str) -> list[Table]:
    """Every parameter in every geometry, and of the best one the sources of its error."""
    fit = fits[best]
    known = [name for name in fit["values"] if np.isfinite(fit["std"][name])]
    rows = [
        (
            name, f"{fit['values'][name]:.5g}", f"{fit['std'][name]:.2g}",
            *(_number(one["values"].get(name), 1.0) for key, one in fits.items() if key != best),
        )
        for name in known
    ]  # fmt: skip
    header = (
        "parameter (SI)", f"value, {GEOMETRIES[best]}", "std error",
        *(GEOMETRIES[key] for key in fits if key != best),
    )  # fmt: skip
    sources = {"scatter": fit["std_of_scatter"], **fit["std_by_source"]}
    shares = [
        (name, *(f"{of[name]:.2g}" for of in sources.values()), f"{fit['std'][name]:.2g}")
        for name in known
    ]
    told = ("parameter (SI)", *(one.replace("_", " ") for one in sources), "all together")
    return [("Parameters", header, rows), ("Standard errors by source", told, shares)]


def _onsets(sheet: Sheet, results: Path, fits: dict[str, Any], system: str) -> list[Table]:
    """Blocked force and free contraction by pressure, measured and of every geometry."""
    path = results / RECORDS / "characterisation.json"
    if not path.exists():
        return []
    units = unit_system(system)
    Pa, N = factor(units["pressure"], "pressure"), factor(units["force"], "force")
    muscles = [fitting.load_fit(results / name / "fit.json").muscle for name in fits]
    bars = _read(path)["isobars"]
    pressures = np.array([bar["pressure_Pa"] for bar in bars])
    rest = sheet.specimen.rest_length
    blocked = [np.asarray(one.force(rest, pressures)) for one in muscles]
    free = [np.asarray(one.free_contraction(pressures, throw=False)) for one in muscles]
    rows = [
        [
            _number(bar["set_pressure_Pa"], Pa),
            _number(bar["blocked_force_N"], N), *(_number(float(one[k]), N) for one in blocked),
            _number(bar["free_contraction"], 1.0), *(_number(float(one[k]), 1.0) for one in free),
        ]
        for k, bar in enumerate(bars)
    ]  # fmt: skip
    names = [*fits]
    header = (
        f"set pressure [{units['pressure']}]", f"blocked force measured [{units['force']}]", *names,
        "free contraction measured", *names,
    )  # fmt: skip
    return [("Blocked force and free contraction", header, rows)]


def _figures(
    sheet: Sheet, results: Path, names: Sequence[str], best: str, system: str
) -> list[tuple[str, str]]:
    found = []
    actuation = results / RECORDS / "characterisation.svg"
    if actuation.exists():
        found.append(
            (_inline(actuation), "The test: force over contraction, and the pressure held.")
        )
    picture = results / best / "fit.png"
    found.append(
        (
            _image(picture),
            f"The fit with the {GEOMETRIES[best]}: isobars, residuals, the bladder's law.",
        )
    )
    if SHAPE in names:
        drawn = profile_figure(sheet, system)
        found.append((svg(drawn), "Profiles at five contractions with their 95 % band, and the mean "
                      "diameter of every picture."))  # fmt: skip
        overlays = sorted((results / PICTURES / "overlays").glob("*"))
        if overlays:
            found.append(
                (_image(overlays[len(overlays) // 2]), "A photograph with what was found in it.")
            )
    return found


def _inline(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    return text[text.index("<svg") :]


def _image(path: Path) -> str:
    kind = "png" if path.suffix.lower() == ".png" else "jpeg"
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="" src="data:image/{kind};base64,{data}">'


def _read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def _number(value: float | None, unit: float) -> str:
    return "none" if value is None or not np.isfinite(value) else f"{value / unit:.4g}"
