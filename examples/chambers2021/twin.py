"""The twin of the muscle: records and photographs of a muscle that is known, made once into a folder.

The work's own records and photographs are not published. `tests/rendering` of the clone draws a
muscle near the work's, tests it on the simulated rig, and photographs it with the simulated camera,
noise, clocks and faults included. What a chapter measures of it is kept in the folder, so that the
next chapter need not measure it again.
"""

import argparse
import csv
import dataclasses
import functools
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))

from rendering import folder as made, folder_truth
from specimen import elastic_braid, inelastic_braid

import famjax
import fitting
import imaging
from famjax import units
from famjax.app import Analysis, Sheet, add_log, analyse, read_log_of_pictures, read_sheet
from famjax.geometries import AbstractGeometry
from famjax.measured import AverageDiameterGeometry
from fitting.records import read_machine_log, write_dataset
from imaging.pictures import measure_pictures
from rig.journal import read_journal

DISTANCE, PITCH, PLACEMENT = 60 * units.INCH, units.INCH / 8, 0.01 * units.INCH
"""Camera to muscle, from mark to mark of the ruler, and how far that may be off the axis [m]."""


@dataclasses.dataclass(frozen=True)
class Twin:
    """A twin in its folder, and what is measured of it, in SI.

    Attributes:
        folder: with journal, log, photographs, ruler, sheet and the truth.
    """

    folder: Path

    @classmethod
    def of_command_line(cls) -> "Twin":
        """The twin of `--folder`, made if it is not there yet."""
        parser = argparse.ArgumentParser(allow_abbrev=False)
        parser.add_argument("--folder", type=Path, default=Path("chambers2021-twin"))
        parser.add_argument("--size", choices=("small", "large"), default="small")
        given, _ = parser.parse_known_args()  # a notebook's kernel has arguments of its own
        if not (given.folder / "characterisation.toml").exists():
            print(f"making the {given.size} twin in {given.folder} ...", file=sys.stderr)
            made.write_twin(given.folder, size=given.size)
        return cls(given.folder)

    @functools.cached_property
    def sheet(self) -> Sheet:
        """What is known of the muscle beforehand."""
        return read_sheet(self.folder)

    @functools.cached_property
    def truth(self) -> "folder_truth.Truth":
        """What the twin was made from; used to judge, and where the work counted the braid's turns."""
        drawn = folder_truth.drawn_truth(0, "small", flawed=True)  # which the file replaces whole
        return folder_truth.read_truth(self.folder / folder_truth.TRUTH, drawn)

    @functools.cached_property
    def lengths(self) -> dict[str, float]:
        """The true length [m] in each photograph."""
        with (self.folder / made.TRUE_LENGTHS).open(encoding="utf-8") as file:
            return {row["picture"]: float(row["length_m"]) for row in csv.DictReader(file)}

    @property
    def muscle(self) -> "folder_truth.TwinMuscle":
        """The true muscle."""
        return self.truth.muscle

    @functools.cached_property
    def test(self) -> Analysis:
        """Journal and machine's log on one clock, and the curves at each pressure."""
        return analyse(
            read_journal(self.folder / "test.fam"),
            read_machine_log(self.folder / "machine.csv"),
            rest_length=self.sheet.specimen.rest_length,
        )

    @functools.cached_property
    def data(self) -> fitting.ForceData:
        """The force map: mean of both branches at each pressure."""
        path = self.folder / "dataset.csv"
        entries = {k: v for k, v in self.sheet.entries.items() if not k.startswith("rest_length_")}
        write_dataset(self.test.characterisation, path, specimen=entries)
        return fitting.read_csv(path)

    @functools.cached_property
    def pictures(self) -> "imaging.Table":
        """The photographs measured, each with what the machine read when it was taken."""
        ruler = self.folder / "ruler.jpg"
        scale = imaging.calibrate_ruler(
            ruler, pitch=PITCH, distance=DISTANCE, placement_stderr=PLACEMENT
        )
        return measure_pictures(
            [str(self.folder / "photographs")],
            recipe=imaging.Recipe(scale, distance=DISTANCE),
            provenance={"ruler": str(ruler)},
            add_log=add_log(read_log_of_pictures(self.folder / "machine.csv"), None),
            rest_length=self.sheet.specimen.rest_length,
            output=self.folder / "pictures",
        ).table

    @functools.cached_property
    def surface(self) -> "fitting.shapes.ShapeSurface":
        """D(z; L) through the pictures."""
        _ = self.pictures
        return fitting.shape_surface(self.folder / "pictures" / "measurements.nc")

    def geometries(self) -> dict[str, AbstractGeometry]:
        """The work's four, with its thread length and the twin's turns, which one counts."""
        known, turns = self.sheet.specimen, self.muscle.turns
        given = inelastic_braid(units.INCH), elastic_braid(inch=units.INCH, psi=units.PSI)
        rigid, stretching = (dataclasses.replace(one, turns=turns) for one in given)
        measured = self.surface.geometry(known, braid=rigid)
        return {
            "estimated inelastic": famjax.EstimatedGeometry(rigid, measured.bladder),
            "estimated elastic": famjax.EstimatedGeometry(stretching, measured.bladder),
            "measured average diameter": AverageDiameterGeometry(measured.family, measured.bladder),
            "measured": measured,
        }
