"""What goes wrong with a characterisation folder in a laboratory, each done to the folder of a twin."""

import dataclasses
import datetime
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

SHEET, LOG, JOURNAL, PHOTOGRAPHS = "characterisation.toml", "machine.csv", "test.fam", "photographs"


@dataclasses.dataclass(frozen=True)
class Others:
    """Folders that files are taken from: another test of the muscle, and another muscle."""

    test: Path
    muscle: Path


@dataclasses.dataclass(frozen=True)
class Damage:
    """One mistake.

    Attributes:
        name: what was done.
        change: does it to a folder.
        step: at which it must be told; empty where no step must begin.
        says: regular expression of what must be told.
        stops: whether the work must stop there; else it goes on with a warning.
    """

    name: str
    change: Callable[[Path, Others], None]
    step: str
    says: str
    stops: bool = True


Change = Callable[[Path, Others], None]


def _sheet(old: str, new: str) -> Change:
    def change(folder: Path, _: Others) -> None:
        path = folder / SHEET
        text = path.read_text()
        assert old in text, old
        path.write_text(text.replace(old, new))

    return change


def _in_text(name: str, old: str, new: str) -> Change:
    def change(folder: Path, _: Others) -> None:
        text = (folder / name).read_text()
        assert old in text, old
        (folder / name).write_text(text.replace(old, new, 1))

    return change


def _cut(name: str, part: float) -> Change:
    def change(folder: Path, _: Others) -> None:
        content = (folder / name).read_bytes()
        (folder / name).write_bytes(content[: round(part * len(content))])

    return change


def _gone(name: str) -> Change:
    def change(folder: Path, _: Others) -> None:
        (folder / name).unlink()

    return change


def _from_other_test(*names: str) -> Change:
    def change(folder: Path, others: Others) -> None:
        for name in names:
            shutil.copy(others.test / name, folder / name)

    return change


def _columns(factors: tuple[float, float, float], header: str | None = None) -> Change:
    """Time, displacement and force of the log multiplied, its header replaced."""

    def change(folder: Path, _: Others) -> None:
        names, units, *rows = (folder / LOG).read_text().splitlines()
        table = np.array([row.split(",") for row in rows], float)
        table[:, :3] *= factors
        lines = [f"{t:.5f},{x:.7f},{F:.5f},{s:.0f}" for t, x, F, s in table.tolist()]
        (folder / LOG).write_text("\n".join([header or names, units, *lines]) + "\n")

    return change


def _decimal_commas(folder: Path, _: Others) -> None:
    """As a log is written where numbers have commas, and the cells with them."""
    text = (folder / LOG).read_text()
    (folder / LOG).write_text(text.replace(".", ","))


def _pictures_of_another_muscle(folder: Path, others: Others) -> None:
    shutil.rmtree(folder / PHOTOGRAPHS)
    shutil.copytree(others.muscle / PHOTOGRAPHS, folder / PHOTOGRAPHS)


def _no_pictures(folder: Path, _: Others) -> None:
    for path in pictures(folder):
        path.unlink()


def _few_pictures(folder: Path, _: Others) -> None:
    for path in pictures(folder)[5:]:
        path.unlink()


def _ruler_off(inches: float) -> Change:
    """The ruler as it is seen where it lies behind the plane of the axis."""

    def change(folder: Path, _: Others) -> None:
        sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
        from rendering import published_ruler, render_ruler  # noqa: PLC0415

        rows = 900
        size = (rows, round(rows * 1100 / 2650))
        scene = dataclasses.replace(published_ruler(size=size), offset=inches * 0.0254)
        render_ruler(scene, 4).save(folder / "ruler.jpg")

    return change


def _not_a_ruler(folder: Path, _: Others) -> None:
    shutil.copy(pictures(folder)[3], folder / "ruler.jpg")


def pictures(folder: Path) -> list[Path]:
    """The photographs of a folder."""
    return sorted((folder / PHOTOGRAPHS).iterdir())


_STAMP = re.compile(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d")


def _stamp(path: Path) -> bytes:
    match = _STAMP.search(path.read_bytes())
    assert match is not None
    return match.group()


def _restamp(path: Path, stamp: bytes) -> None:
    """Another time of the same length in the picture's EXIF data."""
    content = path.read_bytes()
    path.write_bytes(content.replace(_stamp(path), stamp, 1))


def _clock(hours: float) -> Change:
    def change(folder: Path, _: Others) -> None:
        form = "%Y:%m:%d %H:%M:%S"
        for path in pictures(folder):
            time = datetime.datetime.strptime(_stamp(path).decode(), form)
            time += datetime.timedelta(hours=hours)
            _restamp(path, time.strftime(form).encode())

    return change


def _shuffled_times(folder: Path, _: Others) -> None:
    paths = pictures(folder)
    stamps = [_stamp(path) for path in paths]
    order = np.random.default_rng(0).permutation(len(paths))
    for path, k in zip(paths, order.tolist(), strict=True):
        _restamp(path, stamps[k])


def _no_times(folder: Path, _: Others) -> None:
    for path in pictures(folder):
        _restamp(path, b"0000:00:00 00:00:00")


def _renamed(folder: Path, _: Others) -> None:
    paths = pictures(folder)
    order = np.random.default_rng(0).permutation(len(paths))
    for path in paths:
        path.rename(path.with_suffix(".tmp"))
    for path, k in zip(paths, order.tolist(), strict=True):
        path.with_suffix(".tmp").rename(path.with_name(f"P{k:04d}.JPG"))


_ALL = (1.0, 1.0, 1.0)
DAMAGES: tuple[Damage, ...] = (
    # The files and the sheet.
    Damage("missing ruler", _gone("ruler.jpg"), "", r"ruler\.jpg, which is not in"),
    Damage("missing log", _gone(LOG), "", r"machine\.csv, which is not in"),
    Damage("a photograph of the muscle in place of the ruler", _not_a_ruler, "", r"ruler"),
    Damage("empty journal", _cut(JOURNAL, 0), "records", r"is not a journal"),
    Damage("empty log", _cut(LOG, 0), "records", r"machine\.csv"),
    Damage("wall of 1.5875 mm given as inches",
           _sheet("wall_thickness_in = 0.0625", "wall_thickness_in = 1.5875"), "",
           r"wall of 40\.32 mm does not fit.*check the units"),
    # The records.
    Damage("columns of the log swapped", _in_text(LOG, "Extension,Load", "Load,Extension"),
           "records", r"unit|swapped|agree"),
    Damage("columns of the log swapped with their units",
           lambda folder, _: (_columns(_ALL, "Time,Load,Extension,Digital input")(folder, _),
                              _in_text(LOG, "(mm),(N)", "(N),(mm)")(folder, _))[0],
           "records", r"columns swapped or wrongly named"),
    Damage("mm in the log labelled inches", _in_text(LOG, "(mm)", "(in)"), "records",
           r"check the unit of the displacement"),
    Damage("inches in the log labelled mm", _columns((1.0, 1 / 25.4, 1.0)), "records",
           r"ratio of inches and mm"),
    Damage("lbf in the log labelled N", _columns((1.0, 1.0, 1 / 4.4482216)), "records",
           r"ratio of lbf and N"),
    Damage("minutes in the log labelled seconds", _columns((1 / 60, 1.0, 1.0)), "records",
           r"check the unit of its time"),
    Damage("sign of the force turned round", _columns((1.0, 1.0, -1.0)), "records",
           r"pushing_positive must be true"),
    Damage("sign of the displacement turned round", _columns((1.0, -1.0, 1.0)), "records",
           r"shortening_positive must be true"),
    Damage("decimal commas in a file with commas", _decimal_commas, "records", r"decimal|column"),
    Damage("log of another test", _from_other_test(LOG), "records", r"of (one|the same) test"),
    Damage("journal of another test", _from_other_test(JOURNAL), "records",
           r"of (one|the same|two) tests?"),
    Damage("sync column that is none", _sheet('machine_log = "machine.csv"',
           'machine_log = "machine.csv"\nsync_column = "Sync"'), "records", r"no column 'Sync'"),
    Damage("half of the log", _cut(LOG, 0.55), "records", r"complete strokes.*expected 6", stops=False),
    Damage("half of the journal", _cut(JOURNAL, 0.55), "records", r"complete stroke", stops=False),
    Damage("rest length in mm that is in inches",
           _sheet("rest_length_in = 9.28125", "rest_length_mm = 9.28125"), "records",
           r"rest_length"),
    Damage("wall of 0.0625 in given as mm",
           _sheet("wall_thickness_in = 0.0625", "wall_thickness_mm = 0.0625"), "records",
           r"wall_thickness over bladder_diameter.*units", stops=False),
    # The pictures.
    Damage("no pictures", _no_pictures, "", r"no pictures|there are no|photographs"),
    Damage("five pictures", _few_pictures, "shape", r"5 pictures were measured.*6"),
    Damage("journal and log of another test", _from_other_test(JOURNAL, LOG), "pictures",
           r"length|displacement"),
    Damage("pictures out of order: their times exchanged", _shuffled_times, "pictures",
           r"of another test, or their times are not"),
    Damage("pictures out of order: renamed", _renamed, "pictures", r"differ in order", stops=False),
    Damage("pictures without times", _no_times, "pictures", r"have a time in their EXIF",
           stops=False),
    Damage("camera's time zone off by 8 h", _clock(8), "pictures",
           r"8 h \d min ahead: a time zone|7 h 5\d min ahead: a time zone", stops=False),
    Damage("camera's clock off by 3 h 22 min", _clock(-3.37), "pictures",
           r"3 h 2\d min behind: a clock that was not set", stops=False),
    Damage("photographs of another muscle", _pictures_of_another_muscle, "pictures",
           r"rest length.*another muscle|are of another test"),
    Damage("ruler 1 in nearer than the axis", _ruler_off(-1.0), "pictures",
           r"as if the ruler had been 2[3-7](\.\d)? mm nearer"),
    Damage("ruler 1 in behind the axis", _ruler_off(1.0), "pictures",
           r"as if the ruler had been 2[3-7](\.\d)? mm farther"),
    Damage("ruler of inches read as cm", _sheet("pitch_in = 0.125", "pitch_cm = 0.125"), "pictures",
           r"ratio of inches and cm"),
    Damage("rest length wrong by 1 in", _sheet("rest_length_in = 9.28125", "rest_length_in = 8.28125"),
           "pictures", r"machine's zero, and the rest length: expected .* found 235\.\d mm"),
    Damage("bladder of 1.5 in in place of 0.875",
           _sheet("bladder_diameter_in = 0.875", "bladder_diameter_in = 1.5"), "pictures",
           r"narrower than its bladder"),
    Damage("bladder of 0.6 in in place of 0.875",
           _sheet("bladder_diameter_in = 0.875", "bladder_diameter_in = 0.6"), "pictures",
           r"check bladder_diameter", stops=False),
)  # fmt: skip
"""All of them."""
