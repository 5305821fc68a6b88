"""The picture of a search: its front with the limits, and what there is to build on it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ...boundary.files import as_png
from ...boundary.units import UNITS, unit_system
from .limits import BALANCED, COLUMNS, CONSTRAINTS
from .space_search import SpaceSearch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_POINTS = 20_000  # of the feasible candidates: more only make the picture darker
_CROWDED = 300  # members of a front, beyond which each gets a smaller mark
_LIMIT = "#b2182b"


def search_picture(found: SpaceSearch, *, system: str = "si") -> bytes:
    """The front over two objectives, coloured by a third, and its rest lengths and pressures, as PNG.

    Args:
        found: from `search_space`, with something feasible.
        system: "si", "metric" or "us".
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 -- slow to load

    figure = Figure(figsize=(12, 5.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    size = 16 if len(found.front["pair"]) <= _CROWDED else 5
    for axes in (left, right):
        axes.margins(0.08)
    others = [name for name in ("pressure", "rest_length") if name not in found.objectives]
    x, y, colour = [*found.objectives, *others, "contraction"][:3]
    _cloud(left, found, x, y, system)
    front = left.scatter(
        _values(found, x, system), _values(found, y, system), c=_values(found, colour, system),
        s=size, cmap="viridis", label="front", zorder=3,
    )  # fmt: skip
    figure.colorbar(front, ax=left, label=_label(colour, system))
    _refined(left, found, x, y, system)
    _limits(left, found, x, y, system)
    left.set(xlabel=_label(x, system), ylabel=_label(y, system), title="Front")
    _cloud(right, found, "rest_length", "pressure", system)
    for at in np.unique(found.front["pair"]):
        mine = found.front["pair"] == at
        right.scatter(
            _values(found, "rest_length", system)[mine], _values(found, "pressure", system)[mine],
            s=size, label=found.pairs[at].name, zorder=3,
        )  # fmt: skip
    _refined(right, found, "rest_length", "pressure", system)
    _limits(right, found, "rest_length", "pressure", system)
    right.set(
        xlabel=_label("rest_length", system), ylabel=_label("pressure", system),
        title="What to build",
    )  # fmt: skip
    figure.legend(
        *right.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8,
        frameon=False,
    )  # fmt: skip
    figure.suptitle(
        f"{found.feasible:,} of {found.grid.total:,} candidates meet everything; "
        f"{len(found.front['pair']):,} on the front"
    )
    return as_png(figure)


def _cloud(axes: "Axes", found: SpaceSearch, x: str, y: str, system: str) -> None:
    """The feasible candidates."""
    every = -(-len(found.sample["pair"]) // _MOST_POINTS) or 1
    axes.scatter(
        found.sample[x][::every] / _factor(x, system),
        found.sample[y][::every] / _factor(y, system),
        s=2, color="0.85", label="feasible", rasterized=True, zorder=1,
    )  # fmt: skip


def _refined(axes: "Axes", found: SpaceSearch, x: str, y: str, system: str) -> None:
    """The refined designs: a star for all objectives at once, a ring for each."""
    for k, one in enumerate(found.refined):
        at = one.end[x] / _factor(x, system), one.end[y] / _factor(y, system)
        star = one.goal == BALANCED
        axes.plot(
            *at, marker="*" if star else "o", ms=15 if star else 9, ls="",
            mfc="#f4a582" if star else "none", mec="black", zorder=4,
            label={0: "refined, balanced", 1: "refined, best of one objective"}.get(k),
        )  # fmt: skip


def _limits(axes: "Axes", found: SpaceSearch, x: str, y: str, system: str) -> None:
    """Lines where a limit is on one of the two numbers, labelled along them."""
    asked = {**vars(found.requirement), **vars(found.limits)}
    limits = [(column, side, asked[name]) for name, (column, side) in CONSTRAINTS.items()]
    limits.append(("pressure", "most", found.requirement.pressure))
    for column, side, limit in limits:
        if not (0 < limit < np.inf) or column not in (x, y):
            continue
        value, upper = limit / _factor(column, system), side == "most"
        unit = unit_system(system)[COLUMNS[column]]
        said = f"{'at most' if upper else 'at least'} {value:.4g} {unit}".strip()
        # Labels stand on the side that is left out.
        line: dict[str, Any] = {"color": _LIMIT, "ls": "--", "lw": 1.2, "zorder": 2}
        text: dict[str, Any] = {"color": _LIMIT, "fontsize": 8}
        if column == x:
            axes.axvline(value, **line)
            axes.annotate(
                said, (value, 0.02), xycoords=axes.get_xaxis_transform(), rotation=90, va="bottom",
                ha="left" if upper else "right", xytext=(3 if upper else -3, 0),
                textcoords="offset points", **text,
            )  # fmt: skip
        else:
            axes.axhline(value, **line)
            axes.annotate(
                said, (0.01, value), xycoords=axes.get_yaxis_transform(),
                va="bottom" if upper else "top", **text,
            )  # fmt: skip


def _factor(column: str, system: str) -> float:
    kind = COLUMNS[column]
    return UNITS[kind][unit_system(system)[kind]]


def _values(found: SpaceSearch, column: str, system: str) -> np.ndarray:
    return found.front[column] / _factor(column, system)


def _label(column: str, system: str) -> str:
    unit = unit_system(system)[COLUMNS[column]]
    name = {"air": "free air of a stroke"}.get(column, column.replace("_", " "))
    return f"{name}, {unit}" if unit else name
