"""The muscle's twin: records and photographs of a known muscle, created once in a folder.

The work's own records and photographs are not published. `tests/rendering` in the clone simulates a
similar muscle, tests it on the simulated rig and photographs it with the simulated camera, including
noise, clock errors and faults. Measurements are kept in the folder, so that other chapters can reuse them.
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
"""Distance from camera to muscle, pitch of the ruler marks, and error in the ruler's plane [m]."""


@dataclasses.dataclass(frozen=True)
class Twin:
    """The twin of a muscle in its folder, and measurements of it in SI units.

    Attributes:
        folder: folder that contains the journal, log, photographs, ruler, sheet and truth.
    """

    folder: Path

    @classmethod
    def of_command_line(cls) -> "Twin":
        """Open the twin in `--folder`; create it if it is missing."""
        parser = argparse.ArgumentParser(allow_abbrev=False)
        parser.add_argument("--folder", type=Path, default=Path("chambers2021-twin"))
        parser.add_argument("--size", choices=("small", "large"), default="small")
        given, _ = parser.parse_known_args()  # a notebook kernel has its own arguments
        if not (given.folder / "characterisation.toml").exists():
            print(f"creating the {given.size} twin in {given.folder} ...", file=sys.stderr)
            made.write_twin(given.folder, size=given.size)
        return cls(given.folder)

    @functools.cached_property
    def sheet(self) -> Sheet:
        """Known data of the muscle, from its `characterisation.toml`."""
        return read_sheet(self.folder)

    @functools.cached_property
    def truth(self) -> "folder_truth.Truth":
        """True parameters of the twin, used to judge the results; they also supply the braid's turns."""
        drawn = folder_truth.drawn_truth(0, "small", flawed=True)  # replaced entirely by the file
        return folder_truth.read_truth(self.folder / folder_truth.TRUTH, drawn)

    @functools.cached_property
    def lengths(self) -> dict[str, float]:
        """True length [m] of the muscle in each photograph."""
        with (self.folder / made.TRUE_LENGTHS).open(encoding="utf-8") as file:
            return {row["picture"]: float(row["length_m"]) for row in csv.DictReader(file)}

    @property
    def muscle(self) -> "folder_truth.TwinMuscle":
        """True muscle, of which the records were made."""
        return self.truth.muscle

    @functools.cached_property
    def test(self) -> Analysis:
        """Journal and machine log on a common clock, and the curves at each pressure."""
        return analyse(
            read_journal(self.folder / "test.fam"),
            read_machine_log(self.folder / "machine.csv"),
            rest_length=self.sheet.specimen.rest_length,
        )

    @functools.cached_property
    def data(self) -> fitting.ForceData:
        """Force map, which is the mean of both branches at each pressure."""
        path = self.folder / "dataset.csv"
        entries = {k: v for k, v in self.sheet.entries.items() if not k.startswith("rest_length_")}
        write_dataset(self.test.characterisation, path, specimen=entries)
        return fitting.read_csv(path)

    @functools.cached_property
    def pictures(self) -> "imaging.Table":
        """Measurements from the photographs, with the machine's readings at the time of each."""
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
        """Surface D(z; L) fitted to the photographs."""
        _ = self.pictures
        return fitting.shape_surface(self.folder / "pictures" / "measurements.nc")

    def geometries(self) -> dict[str, AbstractGeometry]:
        """Return the work's four geometries, with its thread length and the counted turns of the twin."""
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
