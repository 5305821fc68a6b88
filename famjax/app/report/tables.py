"""Tables of the specimen, the set-up, what the test measured, and the geometries side by side."""

from pathlib import Path

import numpy as np

from fitting.saved import PageTable

from ..evaluation import PICTURES
from .bladder_charts import stable_range, visited
from .chart import printed
from .source import MINUS, NONE, FittedGeometry, Source, picture_rows

_ROUNDING = 1e-9
"""Of the largest coefficient."""


def specimen_table(source: Source) -> PageTable:
    """What was known of the muscle before the test."""
    one, sheet = source.sheet.specimen, source.sheet
    unit = source.unit("length")
    rows = [("name", one.name)]
    rows += [
        (name.replace("_", " "), f"{source.number(value, 'length', 5)} {unit}")
        for name in ("rest_length", "nominal_diameter", "bladder_diameter", "wall_thickness",
                     "braid_thickness")
        if (value := getattr(one, name)) is not None
    ]  # fmt: skip
    rows.append(
        ("turns of a thread", "identified" if sheet.turns is None else f"{sheet.turns:g}, counted")
    )
    rows.append(("bladder", "around the braid's threads" if one.embedded else "under the braid"))
    fit = sheet.fit
    law = fit.law if fit.order is None else f"{fit.law}, order {fit.order}"
    rows.append(("law, constraint", f"{law}, {fit.constraint}"))
    return PageTable("Specimen.", ("quantity", "value"), rows, text=True)


def setup_table(source: Source) -> PageTable:
    """How force and shape were measured."""
    sheet, unit = source.sheet, source.unit
    records, rows = sheet.records, []
    if records.force_map is not None:
        rows.append(("force", f"force map {records.force_map}"))
    else:
        rows.append(
            ("force", f"rig's journal {records.journal}, test machine's log {records.machine_log}")
        )
    readings = source.data
    low, high = (float(end) for end in (readings.pressure.min(), readings.pressure.max()))
    contraction = 1 - readings.length / sheet.specimen.rest_length
    rows += [
        ("gauge pressures", f"{len(source.pressures)}, {source.number(low, 'pressure', 3)} to "
         f"{source.number(high, 'pressure', 3)} {unit('pressure')}"),
        ("contraction", f"{contraction.min():.3f} to {contraction.max():.3f}"),
        ("readings", f"{readings.force.size}, of which {int(readings.loaded.sum())} pull"),
    ]  # fmt: skip
    if source.isobars:
        cycles = sorted({int(bar["cycles"]) for bar in source.isobars})
        rows.append(("cycles at each pressure", " or ".join(map(str, cycles))))
    if aligned := source.test.get("alignment"):
        rows.append(
            ("clocks of journal and log", f"aligned by the {aligned['method']} within "
             f"{1e3 * aligned['offset_error_s']:.2g} ms")
        )  # fmt: skip
    return PageTable(
        "Set-up and measurements.", ("what", "how"), [*rows, *_camera(source)], text=True
    )


def _camera(source: Source) -> list[tuple[str, str]]:
    from imaging import read_recipe

    photographs, pictures = source.sheet.photographs, source.pictures
    if photographs is None or pictures is None:
        return [("photographs", "none")]
    recipe = read_recipe(source.results / PICTURES / "recipe.toml")
    unit = source.unit("length")
    scale = source.unit("scale")
    rows = [
        ("photographs", f"{len(pictures)} measured, {pictures.diameter.shape[1]} positions along the "
         f"axis each, {source.shape['pictures'] if source.shape else 0} on the surface"),
        ("scale", f"{source.number(recipe.scale.px_per_m, 'scale', 5)} ± "
         f"{source.number(recipe.scale.stderr, 'scale', 2)} {scale}"
         + (f", from the ruler {photographs.ruler}" if photographs.ruler else ", as given")),
    ]  # fmt: skip
    for name, value in (
        ("camera to muscle", photographs.distance), ("pitch of the ruler's marks", photographs.pitch),
        ("placement of the ruler, standard error", photographs.ruler_placement),
    ):  # fmt: skip
        if value is not None:
            rows.append((name, f"{source.number(value, 'length')} {unit}"))
    return rows


def test_table(source: Source) -> list[PageTable]:
    """Pressure held, blocked force, free contraction, hysteresis; none without the test's record."""
    if not source.isobars:
        return []
    P, N = source.unit("pressure"), source.unit("force")
    rows = [
        (
            source.number(bar["set_pressure_Pa"], "pressure"),
            source.number(bar["pressure_Pa"], "pressure"),
            source.number(bar["pressure_std_Pa"], "pressure", 2),
            source.number(bar["largest_pressure_error_Pa"], "pressure", 2),
            source.number(bar["blocked_force_N"], "force"),
            source.number(bar["free_contraction"]),
            source.number(bar["hysteresis_J"], "energy", digits=3),
            source.number(bar["hysteresis_ratio"], digits=2),
        )
        for bar in source.isobars
    ]
    header = (
        f"set [{P}]", f"mean [{P}]", f"std [{P}]", f"largest error [{P}]", f"blocked force [{N}]",
        "free contraction", f"hysteresis [{source.unit('energy')}]", "of the work",
    )  # fmt: skip
    groups = (("pressure", 4), ("", 4))
    return [PageTable("What the test measured, by set pressure.", header, rows, groups)]


def geometry_tables(source: Source) -> list[PageTable]:
    """The geometries side by side: dimensions, strains, stresses, force terms; what was identified."""
    k, fits = source.middle, [*source.fits.values()]
    ends = _ends(fits)
    length, stress, force = source.unit("length"), source.unit("stress"), source.unit("force")
    quantities = (
        (f"mean diameter [{length}]", "diameter", "length", 4),
        (f"braid angle [{source.unit('angle')}]", "braid_angle", "angle", 4),
        (f"wall [{length}]", "thickness", "length", 3),
        (f"volume [{printed(source.unit('volume'))}]", "volume", "volume", 4),
        ("axial strain", "axial_strain", "number", 3),
        ("mean hoop strain", "mean_hoop_strain", "number", 3),
        ("largest hoop strain", "most_hoop_strain", "number", 3),
        (f"mean axial stress [{stress}]", "axial_stress", "stress", 3),
        (f"mean hoop stress [{stress}]", "hoop_stress", "stress", 3),
    )
    rows = [
        (label, *(source.number(float(getattr(one.states, name)[k, at]), kind, digits)
                  for _, at in ends for one in fits))
        for label, name, kind, digits in quantities
    ]  # fmt: skip
    rows += [
        (f"{term} [{force}]", *(_part(source, one, term, at) for _, at in ends for one in fits))
        for term in fits[0].states.terms
    ]
    rows += [
        (f"{label} [{force}]", *(source.number(float(clip(one.states.force[k, at])), "force")
                                 for _, at in ends for one in fits))
        for label, clip in (("model force", float), ("force", lambda one: max(one, 0.0)))
    ]  # fmt: skip
    states = PageTable(
        f"The geometries side by side, at {source.pressure(source.pressures[k])}.",
        ("", *(one.short for _ in ends for one in fits)), rows,
        (("", 1), *((name, len(fits)) for name, _ in ends)),
    )  # fmt: skip
    law = PageTable(
        "What was identified with each geometry, where its law is stable, and how well it fits.",
        ("", *(one.short for one in fits)), _laws(source, fits),
    )  # fmt: skip
    return [states, law] if ends else [law]


def _ends(fits: list[FittedGeometry]) -> list[tuple[str, int]]:
    """Two states that every geometry knows: the least and the most contraction of the stroke."""
    known = np.all([np.isfinite(one.states.force).all(axis=0) for one in fits], axis=0)
    which = np.flatnonzero(known)
    c = fits[0].states.contraction
    return [(f"contraction {c[at]:.3f}", int(at)) for at in which[[0, -1]]] if which.size else []


def _part(source: Source, fit: FittedGeometry, term: str, at: int) -> str:
    """A part of the force; none where the geometry's model has no such part."""
    part = fit.states.terms.get(term)
    return NONE if part is None else source.number(float(part[source.middle, at]), "force")


def _laws(source: Source, fits: list[FittedGeometry]) -> list[tuple[str, ...]]:
    """Identified numbers, what the law is stable on, and errors."""
    stress, force = source.unit("stress"), source.unit("force")
    names = dict.fromkeys(name for one in fits for name in one.figures["values"])
    rows = []
    for name in names:
        kind, shown = parameter_unit(source, fits, name)
        cells = [_identified(source, one, name, kind) for one in fits]
        if any(cell != NONE for cell in cells):
            rows.append((f"{name} [{shown}]" if shown else name, *cells))
    return [
        *rows,
        ("strains visited", *(_between(visited(one)) for one in fits)),
        ("law rises within", *(_between(stable_range(one)) for one in fits)),
        (f"least modulus along the path [{stress}]", *(_margin(source, one) for one in fits)),
        (f"RMSE [{force}]", *(source.number(one.figures["rmse_N"], "force", 3) for one in fits)),
    ]  # fmt: skip


def _identified(source: Source, fit: FittedGeometry, name: str, kind: str) -> str:
    """A number that was sought; none where it was held, or the geometry has none such."""
    entry = fit.saved.document["parameters"].get(name, {"fixed": True})
    if entry["fixed"]:
        return NONE
    text = source.number(fit.figures["values"].get(name), kind)
    return f"{text} (at a bound)" if entry["at_bound"] else text


def _margin(source: Source, fit: FittedGeometry) -> str:
    """The stability margin; that of an active constraint is zero but for rounding."""
    margin = fit.saved.document["stability_margin_Pa"]
    largest = float(np.abs(fit.saved.document["coefficients_Pa"]).max(initial=0.0))
    if margin is not None and abs(margin) < _ROUNDING * largest:
        return "0, active"
    return source.number(margin, "stress", 3)


def _between(ends: tuple[float, float] | None) -> str:
    if ends is None:
        return "falls at zero"
    return f"{ends[0]:.3g} to {ends[1]:.3g}".replace("-", MINUS)


def parameter_unit(source: Source, fits: list[FittedGeometry], name: str) -> tuple[str, str]:
    """Kind of an identified number, and its unit in the report."""
    kinds: dict[str, str] = {"Pa": "stress", "m": "length", "rad": "angle", "": "number"}
    for one in fits:
        entry = one.saved.document["parameters"].get(name)
        if entry is not None:
            unit = str(entry["unit"])
            pressure = unit == "Pa" and name.endswith("pressure")
            kind = "pressure" if pressure else kinds.get(unit, unit)
            return kind, source.unit(kind)
    return "number", ""


def failed_pictures(source: Source) -> list[str]:
    """Names of the photographs that could not be measured, with the reason."""
    return [
        f"{Path(row['path']).name}, {row['error'].partition(':')[0]}"
        for row in picture_rows(source)
        if row["ok"] != "true"
    ]
