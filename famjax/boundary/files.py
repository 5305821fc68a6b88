"""Write result files: check the folder before work starts, and leave only complete files on disk."""

import base64
import csv
import dataclasses
import datetime
import html
import io
import os
import shlex
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_COMPRESSION = 3  # of 9: two thirds of the default's time, for files a tenth larger


def check_output(folder: Path) -> None:
    """Check that an output folder can be written to, before any work starts.

    Raises:
        InputError: a file has the same name as the folder, or write permission is missing.
    """
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        raise InputError(
            f"cannot write to the output folder {folder}: {nearest} must be a folder with write permission"
        )


def as_png(figure: "Figure") -> bytes:
    """Return the figure as a PNG file with its title in the metadata."""
    picture = io.BytesIO()
    figure.savefig(
        picture, format="png", dpi=150, metadata={"Title": figure.get_suptitle()},
        pil_kwargs={"compress_level": _COMPRESSION},
    )  # fmt: skip
    return picture.getvalue()


def as_svg(figure: "Figure") -> str:
    """Return the figure as an SVG file; identical figures produce identical text."""
    import matplotlib as mpl  # noqa: PLC0415 -- slow to import

    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "famjax"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def csv_text(rows: Sequence[Mapping[str, object]]) -> str:
    """Return rows that have the same keys as CSV, with the keys as the header."""
    text = io.StringIO()
    table = csv.DictWriter(text, rows[0], lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def as_html(title: str, rows: Iterable[tuple[str, str]], figure: "Figure") -> str:
    """Return a title, labelled sentences and a figure as HTML for a notebook."""
    picture, left = base64.b64encode(as_png(figure)).decode(), "style='text-align:left'"
    body = "".join(
        f"<tr><th {left}>{html.escape(label)}</th><td {left}>{html.escape(text)}</td></tr>"
        for label, text in rows
    )
    return (
        f"<table><caption>{html.escape(title)}</caption>{body}</table>"
        f'<img alt="force against contraction" src="data:image/png;base64,{picture}">'
    )


def write_all(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write several files to a folder; none of them appears until all are complete on disk.

    Raises:
        InputError: the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as unfinished:
            for name, content in files.items():
                (Path(unfinished) / name).write_bytes(content)
            for name in files:
                (Path(unfinished) / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"cannot write to the output folder {folder}: {error}") from None
    return [folder / name for name in files]


@dataclasses.dataclass(frozen=True)
class Origin:
    """Date and command with which a file was created.

    Attributes:
        date: date and time at which the file was written, in ISO 8601 with the offset from UTC.
        command: command line that recreates the file.
    """

    date: str
    command: str

    @classmethod
    def of_this_command(cls) -> "Origin":
        """Return the date and arguments of the running `famjax` command."""
        now = datetime.datetime.now(datetime.UTC).astimezone()
        return cls(now.isoformat(timespec="seconds"), shlex.join(["famjax", *sys.argv[1:]]))

    def as_dict(self) -> dict[str, str]:
        """Return the fields for JSON."""
        return dataclasses.asdict(self)

    def comments(self) -> list[str]:
        """Return comment lines for a CSV file; readers of force maps skip them.

        >>> Origin("2026-01-31T12:00:00+00:00", "famjax ramps a.csv=83mm").comments()
        ['# date: 2026-01-31T12:00:00+00:00', '# command: famjax ramps a.csv=83mm']
        """
        return [f"# date: {self.date}", f"# command: {self.command}"]


def differing(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """List the differences between two sets of JSON settings, each as "name was a, now b".

    >>> differing({"seed": 0, "settings": {"law": "ogden"}}, {"seed": 1, "settings": {}})
    ['seed was 0, now 1', 'law was ogden, now None']
    """
    before, now = (of | of.get("settings", {}) | {"settings": None} for of in (old, new))
    return [
        f"{name} was {before.get(name)}, now {now.get(name)}"
        for name in now | before
        if before.get(name) != now.get(name)
    ]


def some_of(texts: Sequence[str], between: str = ", ") -> str:
    """Join the first five texts, each cut to 200 characters, and state how many more there are."""
    more = [f"and {len(texts) - 5} more"] * (len(texts) > 5)
    return between.join([text[:200] for text in texts[:5]] + more)
