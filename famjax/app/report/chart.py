"""Charts of the report: what they show as numbers, and from these the picture, its file and its CSV."""

import csv
import dataclasses
import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from fitting.saved import pdf_file, svg_file

_STYLE: dict[Any, Any] = {
    "font.size": 7.5, "axes.labelsize": 7.5, "axes.titlesize": 7.5, "xtick.labelsize": 7,
    "ytick.labelsize": 7, "legend.fontsize": 6.5, "axes.linewidth": 0.6, "lines.linewidth": 1.1,
    "axes.spines.top": False, "axes.spines.right": False, "xtick.major.width": 0.6,
    "ytick.major.width": 0.6, "xtick.major.size": 2.5, "ytick.major.size": 2.5,
    "legend.frameon": False, "legend.handlelength": 2.2, "pdf.fonttype": 42, "svg.fonttype": "path",
    "axes.formatter.limits": (-3, 4), "axes.formatter.use_mathtext": True,
}  # fmt: skip
_MM = 1 / 25.4  # inch
_SIZES = {
    "column": (88.0, 66.0, (0.165, 0.165, 0.775, 0.78)),
    "small": (60.0, 48.0, (0.255, 0.225, 0.72, 0.705)),
}
"""Width and height [mm], one column of a journal or a third of its page, and in parts of them the axes'
left, bottom, width and height: given, as a layout engine draws each figure several times."""


@dataclasses.dataclass(frozen=True)
class AxisQuantity:
    """What an axis shows.

    Attributes:
        name: in the CSV's header.
        label: on the axis, mathtext allowed.
        unit: behind both; "" without one.
    """

    name: str
    label: str
    unit: str = ""

    @property
    def title(self) -> str:
        """Of the axis."""
        return f"{self.label} [{printed(self.unit)}]" if self.unit else self.label

    def column(self, prefix: str = "") -> str:
        """In a CSV file."""
        name = f"{prefix}{self.name}"
        return f"{name}_{self.unit}" if self.unit else name


@dataclasses.dataclass(frozen=True)
class PlottedSeries:
    """Points or a line of a chart, in the units of its axes.

    Attributes:
        label: in legend and CSV.
        x, y: shape (n,); nan is left out.
        low, high: of its 95 % band, or None.
        colour: of all of it.
        marker: of its points; "" for a line.
        dash: of its line; "" for points alone.
        in_legend: whether the legend names it.
        width: of its line, in parts of the others'.
        at_end: written beside its last point, or "".
    """

    label: str
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    low: NDArray[np.floating] | None = None
    high: NDArray[np.floating] | None = None
    colour: str | tuple[float, ...] = "black"
    marker: str = ""
    dash: str = "-"
    in_legend: bool = True
    width: float = 1.0
    at_end: str = ""


@dataclasses.dataclass(frozen=True)
class Span:
    """A shaded range of a chart's x axis, named in the legend."""

    label: str
    low: float
    high: float
    colour: str = "0.92"


@dataclasses.dataclass(frozen=True)
class Chart:
    """One figure of the report.

    Attributes:
        name: of its files.
        caption: below it, without the number.
        x, y: axes.
        series: drawn one above the other.
        spans: behind them.
        zero: a line at y = 0.
        from_zero: the y axis begins there.
        size: "column" or "small".
    """

    name: str
    caption: str
    x: AxisQuantity
    y: AxisQuantity
    series: Sequence[PlottedSeries]
    spans: Sequence[Span] = ()
    zero: bool = False
    from_zero: bool = False
    size: str = "column"

    def drawing(self) -> "Drawing":
        """The files of the figure."""
        width, height, place = _SIZES[self.size]
        with mpl.rc_context(_STYLE):
            figure = Figure(figsize=(width * _MM, height * _MM))
            self._draw(figure.add_axes(place))
            return Drawing(
                self.name, self.caption, svg_file(figure), pdf_file(figure), self.table(), self.size
            )

    def _draw(self, axes: Axes) -> None:
        for span in self.spans:
            axes.axvspan(span.low, span.high, color=span.colour, lw=0, zorder=0, label=span.label)
        if self.zero:
            axes.axhline(0, color="0.6", lw=0.6, zorder=1)
        for one in self.series:
            if one.low is not None and one.high is not None:
                axes.fill_between(one.x, one.low, one.high, color=one.colour, alpha=0.2, lw=0)
            axes.plot(
                one.x, one.y, ls=one.dash or "none", marker=one.marker or None, ms=2.6, mew=0.6,
                mfc="white", color=one.colour, label=one.label if one.in_legend else "_",
                lw=1.1 * one.width, zorder=2 if one.dash else 3,
            )  # fmt: skip
            known = np.flatnonzero(np.isfinite(one.y))
            if one.at_end and known.size:
                at = known[np.argmax(one.x[known])]
                axes.annotate(
                    one.at_end, (one.x[at], one.y[at]), (2.5, 0), textcoords="offset points",
                    fontsize=6, va="center", color=one.colour,
                )  # fmt: skip
        axes.set(xlabel=self.x.title, ylabel=self.y.title)
        if self.from_zero:
            axes.set_ylim(0, None)
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="best")

    def table(self) -> str:
        """The numbers behind it as CSV, one row for each point."""
        banded = any(one.low is not None for one in self.series)
        header = ["series", self.x.column(), self.y.column()]
        if banded:
            header += [self.y.column("low_95_"), self.y.column("high_95_")]
        lines = io.StringIO()
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(header)
        for one in self.series:
            ends = [] if one.low is None or one.high is None else [one.low, one.high]
            for row in zip(one.x, one.y, *ends, strict=True):
                cells = ["" if np.isnan(value) else f"{value:.8g}" for value in row]
                writer.writerow([one.label, *cells, *[""] * (len(header) - 1 - len(cells))])
        return lines.getvalue()


@dataclasses.dataclass(frozen=True)
class Drawing:
    """A figure as it is written.

    Attributes:
        name: of its files.
        caption: below it.
        svg: text of the file.
        pdf: the file.
        table: text of the CSV file.
        size: of the page's grid it stands in; "wide" for a row by itself.
    """

    name: str
    caption: str
    svg: str
    pdf: bytes
    table: str
    size: str = "column"


def printed(unit: str) -> str:
    """A unit as it is read: in³ for in3."""
    return unit.replace("3", "\N{SUPERSCRIPT THREE}")


def shades(count: int) -> list[tuple[float, ...]]:
    """Colours of ordered curves, such as isobars, from dark to light, all dark enough for white paper."""
    return [tuple(mpl.colormaps["viridis"](at)[:3]) for at in np.linspace(0.0, 0.72, count)]
