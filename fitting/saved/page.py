"""Pages of results: one file each, offline, of one style, on a screen, on a telephone and in print."""

import dataclasses
import functools
import io
import re
from collections.abc import Sequence

import jinja2
import matplotlib as mpl
from markupsafe import Markup, escape
from matplotlib.figure import Figure

_SVG_ID = re.compile(r'(\bid="|href="#|url\(#)')


@dataclasses.dataclass(frozen=True)
class PageTable:
    """A table of a page.

    Attributes:
        title: what it shows, with the units that its header does not say.
        header: of the columns.
        rows: cells of text.
        groups: names over several columns, each with their number; "" over none.
        text: the cells are words, not numbers.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    groups: Sequence[tuple[str, int]] = ()
    text: bool = False

    def html(self, number: int | None = None) -> Markup:
        """The table; scrolls sideways by itself where it is wider than the page."""
        label = Markup("") if number is None else Markup(f"<b>Table {number}.</b>")
        return Markup(
            _templates("fitting").get_template("table.html").render(table=self, label=label)
        )


def page(template: str, package: str = "fitting", **values: object) -> str:
    """A page from a template that extends `page.html`.

    Args:
        template: name of a file in the package's folder `templates`.
        package: that has it.
        values: of the template; text is escaped, `markupsafe.Markup` is not.
    """
    return _templates(package).get_template(template).render(**values)


def svg_file(figure: Figure) -> str:
    """The figure as an SVG file, the same bytes every time."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "famjax"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def inline_svg(file: str, name: str, description: str) -> Markup:
    """An SVG file for the inside of a page.

    Args:
        file: its text.
        name: before each of its ids, which are its own then among all figures of the page.
        description: for those who do not see it.
    """
    drawn = _SVG_ID.sub(rf"\g<1>{name}-", file[file.index("<svg") :])
    label = f'<svg role="img" aria-label="{escape(description)}"'
    return Markup(drawn.replace("<svg", label, 1))


@functools.cache
def _templates(package: str) -> jinja2.Environment:
    loaders = [jinja2.PackageLoader(name) for name in dict.fromkeys((package, "fitting"))]
    return jinja2.Environment(autoescape=True, loader=jinja2.ChoiceLoader(loaders))
