"""How well each parameter is known, alone and with the others, and which are known only together."""

import dataclasses

import numpy as np

from fitting.saved import PageTable

from .source import MINUS, Source
from .tables import parameter_unit

TOGETHER = 3.0
"""Times wider than with all others held, from which a parameter is said to be known only together."""
_SHARE = 0.25
"""Part in a ridge's direction from which a parameter belongs to it."""


@dataclasses.dataclass(frozen=True)
class Ridge:
    """A direction in which parameters move together and the force hardly changes.

    Attributes:
        names: of the parameters in it.
        steps: what each changes by along one standard deviation of the ridge, SI.
        inflation: the largest ratio of a standard error to that with all others held.
    """

    names: tuple[str, ...]
    steps: tuple[float, ...]
    inflation: float


def inflations(matrix: np.ndarray) -> np.ndarray:
    """By how much each standard error exceeds that with all other parameters held.

    Args:
        matrix: correlations, shape (k, k).

    Returns:
        Ratios >= 1, the roots of the diagonal of the inverse, shape (k,); inf where the matrix is
        singular in them.

    References:
        Belsley, Kuh & Welsch 1980, section 3.2 (variance inflation).
    """
    values, vectors = np.linalg.eigh(matrix)
    with np.errstate(divide="ignore"):
        return np.sqrt(vectors**2 @ (1 / np.maximum(values, 0.0)))


def ridges(names: tuple[str, ...], matrix: np.ndarray, std: np.ndarray) -> list[Ridge]:
    """The ridges of a fit, the longest first.

    Directions of the correlations whose variance is above one, among parameters that are known
    `TOGETHER` times better where the others are held. Each parameter is counted to its longest.

    Args:
        names: of the parameters.
        matrix: their correlations, shape (k, k).
        std: their standard errors, SI, shape (k,).
    """
    wider = inflations(matrix)
    values, vectors = np.linalg.eigh(matrix)
    found, taken = [], np.zeros(len(names), bool)
    for k in np.argsort(-values):
        inside = (np.abs(vectors[:, k]) > _SHARE) & (wider > TOGETHER) & ~taken
        if values[k] <= 1 or inside.sum() < 2:
            continue
        taken |= inside
        which = np.flatnonzero(inside)
        direction = vectors[:, k] * np.sign(vectors[which[0], k])
        steps = std * direction * np.sqrt(values[k])
        found.append(
            Ridge(tuple(names[i] for i in which), tuple(float(steps[i]) for i in which),
                  float(wider[which].max()))
        )  # fmt: skip
    return found


def uncertainty_table(source: Source) -> PageTable:
    """Every identified parameter of the report's fit, with its errors."""
    fit = source.best
    names, matrix = _correlations(source)
    wider = dict(zip(names, inflations(matrix), strict=True)) if names else {}
    rows = []
    for name, value in fit.figures["values"].items():
        entry = fit.saved.document["parameters"].get(name, {})
        if entry.get("fixed"):
            continue
        kind, unit = parameter_unit(source, [fit], name)
        std, total = (fit.figures[key].get(name, np.nan) for key in ("std_of_scatter", "std"))
        shared = float(np.sqrt(max(total**2 - std**2, 0.0))) if np.isfinite(total) else None
        held = std / wider[name] if name in wider else None
        part = f"{100 * total / abs(value):.2g} %" if value and np.isfinite(total) else ""
        rows.append(
            (
                name, unit, source.number(value, kind, 5), source.number(std, kind, 2),
                source.number(shared, kind, 2),
                source.number(total, kind, 2), part, source.number(held, kind, 2),
                f"{wider[name]:.3g}" if name in wider else "at a bound" if entry.get("at_bound") else "",
            )
        )  # fmt: skip
    header = ("parameter", "unit", "value", "of the scatter", "shared", "together", "of the value",
              "others held", "times wider")  # fmt: skip
    return PageTable(
        f"Identified parameters and their standard errors, {fit.title}: by linear theory from the "
        "scatter of the readings, from the errors that all of them share, and both together; and "
        "that of the scatter with all other parameters held.", header, rows,
        (("", 3), ("standard error", 5), ("", 1)),
    )  # fmt: skip


def shared_table(source: Source) -> list[PageTable]:
    """Standard errors by the source that all readings share; none where nothing is stated."""
    fit = source.best
    by_source = fit.figures["std_by_source"]
    rows = []
    for name in fit.figures["values"]:
        total = fit.figures["std"].get(name, np.nan)
        if not np.isfinite(total):
            continue
        kind, unit = parameter_unit(source, [fit], name)
        # What has no effect has one of rounding.
        shares = [0.0 if of[name] < 1e-9 * total else of[name] for of in by_source.values()]
        rows.append((name, unit, *(source.number(one, kind, 2) for one in shares)))
    if not by_source:
        return []
    header = ("parameter", "unit", *(one.replace("_", " ") for one in by_source))
    return [
        PageTable(
            "Standard errors by source: what the sheet states that all readings share, and the "
            "uncertainty of the measured shape.", header, rows,
            (("", 2), ("standard error from", len(by_source))),
        )
    ]  # fmt: skip


def ridge_sentences(source: Source) -> list[str]:
    """Which parameters are known only together, in words."""
    names, matrix = _correlations(source)
    if not names:
        return ["No parameter has a standard error: nothing can be said of ridges."]
    fit = source.best
    std = np.array([fit.saved.document["parameters"][name]["stderr"] for name in names], float)
    said = []
    for ridge in ridges(names, matrix, std):
        changes = [
            _change(source, name, step) for name, step in zip(ridge.names, ridge.steps, strict=True)
        ]
        said.append(
            f"{_listed(ridge.names)} are known only together: along their ridge "
            f"{_listed(changes)} in one standard deviation, and the force hardly changes. With all "
            f"others held they would be known up to {ridge.inflation:.2g} times better; report them "
            "as a set."
        )
    strong = [
        f"{names[i]} and {names[k]} ({matrix[i, k]:+.2f})".replace("-", MINUS)
        for i in range(len(names))
        for k in range(i)
        if abs(matrix[i, k]) > 0.9
    ]
    if strong:
        said.append(f"Correlations beyond 0.9: {', '.join(strong)}.")
    alone = [name for name, wide in zip(names, inflations(matrix), strict=True) if wide <= TOGETHER]
    if alone:
        verb = "is" if len(alone) == 1 else "are each"
        said.append(f"{_listed(alone)} {verb} known nearly as well alone as with the others held.")
    return said


def _correlations(source: Source) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and correlations of what has an entry of its own; a law in pressure has none for nodes."""
    held = source.best.saved.document
    names = held["correlations"]["parameters"]
    kept = [k for k, name in enumerate(names) if name in held["parameters"]]
    matrix = np.array(held["correlations"]["matrix"], float).reshape(len(names), len(names))
    return tuple(names[k] for k in kept), matrix[np.ix_(kept, kept)]


def _change(source: Source, name: str, step: float) -> str:
    kind, unit = parameter_unit(source, [source.best], name)
    way = "rises" if step > 0 else "falls"
    return f"{name} {way} by {source.number(abs(step), kind, 2)} {unit}".rstrip()


def _listed(words: tuple[str, ...] | list[str]) -> str:
    return " and ".join(words) if len(words) < 3 else f"{', '.join(words[:-1])} and {words[-1]}"
