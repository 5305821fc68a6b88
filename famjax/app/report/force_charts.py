"""Charts of the force: actuation diagram, residuals, its terms, blocked force and free contraction."""

import dataclasses
from typing import Any

import numpy as np

from fitting.prediction.forces import model_forces, static_rows

from .chart import AxisQuantity, Chart, PlottedSeries, shades
from .shape_charts import CONTRACTION
from .source import COLOURS, DASHES, MINUS, Source

_BAND_POINTS = 25
"""Contractions at which the error band is computed."""
_TERMS = {"pressure on the braid": "#0072b2", "bladder, axial stress": "#d55e00",
          "bladder, hoop stress": "#009e73"}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Isobars:
    """The report's model over the stroke, in the report's units.

    Attributes:
        levels: of pressure [Pa], shape (p,).
        contraction: shape (c,).
        force, low, high: with the 95 % band of single readings, shape (p, c); nan without one.
        half: half of the band where none of it is cut at zero.
        band: what it is of, or None.
    """

    levels: np.ndarray
    contraction: np.ndarray
    force: np.ndarray
    low: np.ndarray
    high: np.ndarray
    half: np.ndarray
    band: str | None


def actuation_charts(source: Source) -> list[Chart]:
    """The isobars with points, model and band, and what is left."""
    model = _modelled(source)
    return [_actuation(source, model), _residuals(source, model)]


def _modelled(source: Source) -> _Isobars:
    fit, data = source.best, source.data
    levels = np.unique(data.pressures.level[data.loaded])
    lengths = np.linspace(float(fit.data.length.max()), float(fit.data.length.min()), _BAND_POINTS)
    grid = [one.ravel() for one in np.meshgrid(levels, lengths, indexing="ij")]
    rows = static_rows(fit.saved, grid[1], grid[0])
    force, low, high = (
        source.scaled(np.array([row[key] for row in rows], float), "force").reshape(levels.size, -1)
        for key in ("force_N", "low_95_N", "high_95_N")
    )
    half = model_forces(fit.saved, grid[1], grid[0]).half.reshape(levels.size, -1)
    contraction = 1 - lengths / source.sheet.specimen.rest_length
    return _Isobars(
        levels, contraction, force, low, high, source.scaled(half, "force"), rows[0]["band"]
    )


def _actuation(source: Source, model: _Isobars) -> Chart:
    data, fit, unit = source.data, source.best, source.unit("pressure")
    rest = source.sheet.specimen.rest_length
    series = []
    for k, (colour, level) in enumerate(zip(shades(model.levels.size), model.levels, strict=True)):
        of = (data.pressures.level == level) & data.loaded
        name = source.number(level, "pressure", 3)
        series += [
            PlottedSeries(f"model, {name} {unit}", model.contraction, model.force[k], model.low[k],
                   model.high[k], colour=colour, in_legend=False, at_end=name),
            PlottedSeries(f"measured, {name} {unit}", 1 - data.length[of] / rest,
                   source.scaled(data.force[of], "force"), colour=colour, marker="o", dash="",
                   in_legend=False),
        ]  # fmt: skip
    of = (
        ""
        if model.band is None
        else f", the band holding 95 % of single readings ({_band(model.band)})"
    )
    return Chart(
        "actuation",
        f"Actuation diagram: force against contraction at the gauge pressures written beside the "
        f"curves [{unit}]. Circles are measured (mean of both branches), lines the model with the "
        f"{fit.title}{of}.",
        CONTRACTION, AxisQuantity("force", "force $F$", source.unit("force")), series, from_zero=True,
    )  # fmt: skip


def _band(name: str) -> str:
    return (
        "from readings left out of the fit" if name.startswith("left out") else f"by {name} theory"
    )


def _residuals(source: Source, model: _Isobars) -> Chart:
    fit, rest, unit = source.best, source.sheet.specimen.rest_length, source.unit("force")
    lengths = fit.data.length[fit.data.loaded]
    levels = np.unique(fit.levels)
    middle = model.levels.size // 2
    half = model.half[middle]
    series = [
        PlottedSeries(
            "95 % of readings", model.contraction, 0 * half, -half, half, colour="0.5", width=0.5
        )
    ]
    for colour, level in zip(shades(levels.size), levels, strict=True):
        of = fit.levels == level
        series.append(
            PlottedSeries(
                source.pressure(level), 1 - lengths[of] / rest,
                source.scaled(fit.residuals[of], "force"), colour=colour, marker="o", dash="",
                in_legend=levels.size <= 6,
            )
        )  # fmt: skip
    return Chart(
        "residuals",
        f"What the model with the {fit.title} leaves: model less measured force against "
        f"contraction, by pressure in the colours of the actuation diagram; shaded the band of the "
        f"diagram at {source.pressure(model.levels[middle])}.",
        CONTRACTION, AxisQuantity("residual", f"model {MINUS} measured", unit),
        series, zero=True,
    )  # fmt: skip


def term_charts(source: Source) -> list[Chart]:
    """The parts of the force against contraction at one pressure, by geometry."""
    k, unit = source.middle, source.unit("force")
    pressure = source.pressures[k]
    near = np.isclose(source.data.pressures.level, pressure, rtol=0.02) & source.data.loaded
    measured = PlottedSeries(
        "measured", 1 - source.data.length[near] / source.sheet.specimen.rest_length,
        source.scaled(source.data.force[near], "force"), colour="0.3", marker="o", dash="",
    )  # fmt: skip
    charts = []
    for name, fit in source.fits.items():
        c = fit.states.contraction
        series = [
            PlottedSeries(
                term, c, source.scaled(values[k], "force"), colour=_TERMS.get(term, "#cc79a7")
            )
            for term, values in fit.states.terms.items()
        ]
        total = source.scaled(fit.states.force[k], "force")
        charts.append(
            Chart(
                f"terms-{name}",
                f"Parts of the force at {source.pressure(pressure)}: {fit.title}.",
                CONTRACTION,
                AxisQuantity("force", "force $F$", unit),
                [
                    *series,
                    PlottedSeries("model force", c, total, colour="black", dash="--"),
                    measured,
                ],
                zero=True,
            )
        )
    return charts


def pressure_charts(source: Source) -> list[Chart]:
    """Blocked force and free contraction by pressure with their errors, and RMSE by pressure."""
    charts = []
    axis = AxisQuantity("pressure", "gauge pressure $P$", source.unit("pressure"))
    P = source.scaled(source.pressures, "pressure")
    for name, title, label, kind, key in (
        ("blocked-force", "Blocked force", "blocked force", "force", "blocked_force_N"),
        ("free-contraction", "Free contraction", "free contraction", "number", "free_contraction"),
    ):
        seen = np.array([bar[key] for bar in source.isobars], float) if source.isobars else None
        unit, lines, errors = source.unit(kind), [], []
        for geometry, fit in source.fits.items():
            found = fit.states.blocked_force if kind == "force" else fit.states.free_contraction()
            style: dict[str, Any] = {"colour": COLOURS[geometry], "dash": DASHES[geometry]}
            if np.isfinite(found).any():
                lines.append(PlottedSeries(fit.short, P, source.scaled(found, kind), **style))
            if seen is not None and np.isfinite(found - seen).any():
                error = source.scaled(found - seen, kind)
                errors.append(PlottedSeries(fit.short, P, error, **style, marker="o"))
        if seen is not None and np.isfinite(seen).any():
            lines.append(
                PlottedSeries(
                    "measured", P, source.scaled(seen, kind), colour="black", marker="o", dash=""
                )
            )
        points = "measured and of" if errors else "not reached in the test, of"
        if lines:
            charts.append(
                Chart(name, f"{title} by pressure, {points} each geometry.", axis,
                      AxisQuantity(name.replace("-", "_"), label, unit), lines)
            )  # fmt: skip
        if errors:
            charts.append(
                Chart(f"{name}-error", f"{title}: model less measured, by pressure and geometry.",
                      axis, AxisQuantity("error", f"error of {label}", unit), errors, zero=True)
            )  # fmt: skip
    return [*charts, _rmse(source, axis)]


def _rmse(source: Source, axis: AxisQuantity) -> Chart:
    series = []
    for geometry, fit in source.fits.items():
        levels = np.unique(fit.levels)
        of = [float(np.sqrt(np.mean(fit.residuals[fit.levels == one] ** 2))) for one in levels]
        series.append(
            PlottedSeries(
                fit.short, source.scaled(levels, "pressure"),
                source.scaled(np.array(of), "force"), colour=COLOURS[geometry], marker="o",
            )
        )  # fmt: skip
        out = fit.saved.document.get("leave_one_pressure_out")
        if out is not None:
            series.append(
                PlottedSeries(
                    f"{fit.short}, left out", source.scaled(np.array(out["left_out"]), "pressure"),
                    source.scaled(np.array(out["group_rmse_N"], float), "force"),
                    colour=COLOURS[geometry], marker="s", dash=":", in_legend=False,
                )
            )  # fmt: skip
    return Chart(
        "rmse-by-pressure",
        "RMSE of the force by pressure and geometry: solid in sample, dotted each pressure while it "
        "was left out of the fit.",
        axis, AxisQuantity("rmse", "RMSE", source.unit("force")), series, from_zero=True,
    )  # fmt: skip
