"""Tables of errors: by pressure and geometry, and of blocked force and free contraction."""

import numpy as np

from fitting.saved import PageTable

from .source import MINUS, FittedGeometry, Source


def error_tables(source: Source) -> list[PageTable]:
    """Of the fits, in sample and on what was left out."""
    return [_overall(source), _by_pressure(source)]


def _overall(source: Source) -> PageTable:
    unit = source.unit("force")
    rows = [
        (
            fit.short,
            source.number(fit.figures["rmse_N"], "force", 3),
            f"{100 * fit.figures['rmse_N'] / fit.figures['largest_force_N']:.2g} %",
            source.number(fit.figures["largest_N"], "force", 3),
            source.number(fit.figures.get("left_out_pressure_N"), "force", 3),
            source.number(fit.figures.get("left_out_length_N"), "force", 3),
        )
        for fit in source.fits.values()
    ]
    header = ("geometry", "RMSE", "of largest force", "largest", "each pressure", "each length")
    groups = (("", 1), ("in sample", 3), ("RMSE, left out", 2))
    return PageTable(f"Errors of the force by geometry [{unit}].", header, rows, groups)


def _by_pressure(source: Source) -> PageTable:
    fits = [*source.fits.values()]
    levels = np.unique(np.concatenate([np.unique(fit.levels) for fit in fits]))
    rows = []
    for level in levels:
        cells = [source.number(float(level), "pressure", 4)]
        for fit in fits:
            left = fit.residuals[np.isclose(fit.levels, level)]
            worst = float(np.abs(left).max()) if left.size else None
            rmse = float(np.sqrt(np.mean(left**2))) if left.size else None
            cells += [
                source.number(rmse, "force", 3), source.number(worst, "force", 3),
                source.number(_left_out(fit, level), "force", 3),
            ]  # fmt: skip
        rows.append(tuple(cells))
    header = (f"P [{source.unit('pressure')}]", *(("RMSE", "worst", "left out") * len(fits)))
    groups = (("", 1), *((fit.short, 3) for fit in fits))
    return PageTable(
        f"Errors of the force by pressure and geometry [{source.unit('force')}]: RMSE and largest "
        "in sample, and RMSE while the pressure was left out of the fit.", header, rows, groups,
    )  # fmt: skip


def _left_out(fit: FittedGeometry, level: float) -> float | None:
    """RMSE [N] at a pressure while it was left out; None where it was not."""
    out = fit.saved.document.get("leave_one_pressure_out")
    if out is None:
        return None
    for one, rmse in zip(out["left_out"], out["group_rmse_N"], strict=True):
        if np.isclose(one, level):
            return rmse
    return None


def onset_tables(source: Source) -> list[PageTable]:
    """Blocked force and free contraction by pressure: measured, each geometry, its error."""
    blocked = _compared(
        source, "Blocked force", "force", "blocked_force_N",
        [fit.states.blocked_force for fit in source.fits.values()],
    )  # fmt: skip
    free = _compared(
        source, "Free contraction", "number", "free_contraction",
        [fit.states.free_contraction() for fit in source.fits.values()],
    )  # fmt: skip
    return [blocked, free]


def _compared(
    source: Source, title: str, kind: str, key: str, models: list[np.ndarray]
) -> PageTable:
    seen = [bar[key] for bar in source.isobars] or [None] * len(source.pressures)
    rows, errors, beyond = [], [], False
    stroke = float(source.best.states.contraction[-1])
    for k, pressure in enumerate(source.pressures):
        measured = np.nan if seen[k] is None else float(seen[k])
        off = [float(model[k]) - measured for model in models]
        cells = [source.number(float(pressure), "pressure"), source.number(measured, kind)]
        for model, error in zip(models, off, strict=True):
            text = source.number(float(model[k]), kind)
            outside = kind == "number" and float(model[k]) > stroke
            beyond |= outside
            cells += [f"({text})" if outside else text, _signed(source, error, kind)]
        rows.append(tuple(cells))
        errors.append(off)
    if len(rows) > 1 and np.isfinite(errors).any():
        cells = ["RMS", ""]
        for column in np.array(errors, float).T:
            known = column[np.isfinite(column)]
            rms = float(np.sqrt(np.mean(known**2))) if known.size else None
            cells += ["", source.number(rms, kind, 3)]
        rows.append(tuple(cells))
    unit = f" [{source.unit(kind)}]" if source.unit(kind) else ""
    note = " In brackets: beyond the stroke that was measured." if beyond else ""
    header = (f"P [{source.unit('pressure')}]", "measured", *(("model", "error") * len(models)))
    groups = (("", 2), *((fit.short, 2) for fit in source.fits.values()))
    return PageTable(
        f"{title} by pressure{unit}: measured, and model and error of each geometry.{note}",
        header,
        rows,
        groups,
    )


def _signed(source: Source, value: float, kind: str) -> str:
    if not np.isfinite(value):
        return source.number(None)
    return f"{source.scaled(value, kind):+.3g}".replace("-", MINUS)
