"""Files of results: checked before the work, whole on the disk or not there."""

import base64
import dataclasses
import datetime
import html
import io
import os
import shlex
import sys
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


UNFINISHED = ".unfinished"
"""What the name of a file ends in until it is whole."""
_COMPRESSION = 3  # of 9: two thirds of the time of the usual 6, for files a tenth larger


def check_output(folder: Path) -> None:
    """Refuse an output folder that cannot be written, before any work is done.

    Raises:
        InputError: a file is in the way, or the folder may not be written.
    """
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise InputError(f"the output folder {folder} cannot be made: {nearest} is not a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(
            f"the output folder {folder} cannot be written: no permission in {nearest}"
        )


def make_output(folder: Path) -> None:
    """Make an output folder, with those above it, if need be.

    Raises:
        InputError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the output folder {folder} cannot be made: {error}") from None


def as_png(figure: "Figure") -> bytes:
    """The picture as a PNG file, which says in words what its title does."""
    picture = io.BytesIO()
    figure.savefig(
        picture, format="png", dpi=150, metadata={"Title": figure.get_suptitle()},
        pil_kwargs={"compress_level": _COMPRESSION},
    )  # fmt: skip
    return picture.getvalue()


def as_html(title: str, rows: Iterable[tuple[str, str]], figure: "Figure") -> str:
    """A title, labelled sentences and a picture, for a notebook."""
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
    """Write several files into a folder; none appears before all are complete on the disk.

    Raises:
        InputError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".unfinished-") as unfinished:
            for name, content in files.items():
                (Path(unfinished) / name).write_bytes(content)
            for name in files:
                (Path(unfinished) / name).replace(folder / name)
    except OSError as error:
        raise InputError(f"the output folder {folder} cannot be written: {error}") from None
    return [folder / name for name in files]


def write_whole(file: Path, content: bytes) -> None:
    """Write a file that is whole on the disk when this returns, or not there: one there is replaced."""
    draft = file.with_name(file.name + UNFINISHED)
    with draft.open("wb") as open_draft:
        open_draft.write(content)
        open_draft.flush()
        os.fsync(open_draft.fileno())
    os.replace(draft, file)
    if os.name == "posix":
        folder = os.open(file.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


@dataclasses.dataclass(frozen=True)
class Origin:
    """What a file says of its own making.

    Attributes:
        date: of writing, ISO 8601 with the offset from UTC.
        command: that a person would repeat.
    """

    date: str
    command: str

    @classmethod
    def of_this_command(cls) -> "Origin":
        """That of the running `famjax` command: now, and its arguments."""
        now = datetime.datetime.now(datetime.UTC).astimezone()
        return cls(now.isoformat(timespec="seconds"), shlex.join(["famjax", *sys.argv[1:]]))

    def as_dict(self) -> dict[str, str]:
        """For JSON."""
        return dataclasses.asdict(self)

    def comments(self) -> list[str]:
        """Lines of a CSV file that every reader of force maps leaves out.

        >>> Origin("2026-01-31T12:00:00+00:00", "famjax ramps a.csv=83mm").comments()
        ['# date: 2026-01-31T12:00:00+00:00', '# command: famjax ramps a.csv=83mm']
        """
        return [f"# date: {self.date}", f"# command: {self.command}"]
