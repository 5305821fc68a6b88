"""The two bpa10 specimens, built from their raw ramps through the public functions.

The raw records are not part of the project; tests that need them are skipped where they are absent.
"""

from pathlib import Path

from fitting.data import ForceData, Specimen
from fitting.records import StaticMap, quasi_static, read_ramp, static_map

FOLDER = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "bpa10"
ABSENT = "the raw ramps of bpa10 are not beside the repository"
COLUMNS = {"force": "1 [N]", "pressure": "2 [kPa]", "time": "3 [s]", "valve_state": "4"}
ATMOSPHERE = 8.94e3  # Pa, what the sensor reads, by the data's own description
LEAST_PULL = 8.0  # N, the same
LENGTHS = {
    "10cm": {"Unkink": 83e-3, "kinked25": 79.75e-3, "kinked50": 76.5e-3, "kinked75": 73.25e-3},
    "30cm": {"Unkink": 281e-3, "kinked25": 268.75e-3, "kinked50": 256.5e-3, "kinked75": 244.25e-3},
}
TESTS = (8, 9, 10)


def bpa10_maps(folder: Path = FOLDER) -> dict[str, StaticMap]:
    """The static maps of tests 8 to 10 at four lengths, by specimen."""
    return {
        name: static_map(
            quasi_static(
                [
                    read_ramp(
                        folder / f"10mm_{name}_{state}_Test{test}.csv",
                        length=length,
                        columns=COLUMNS,
                    )
                    for state, length in lengths.items()
                    for test in TESTS
                ],
                atmosphere=ATMOSPHERE,
                slack_below=LEAST_PULL,
            )
        )
        for name, lengths in LENGTHS.items()
    }


def bpa10_data(maps: dict[str, StaticMap]) -> dict[str, ForceData]:
    """The mean curves where the muscle pulls, as data of an identification."""
    return {
        name: made.force_data(
            Specimen(
                name=f"bpa10 {name}",
                rest_length=LENGTHS[name]["Unkink"],
                wall_thickness=1.8e-3,
                nominal_diameter=10e-3,
                embedded=True,
            )
        )
        for name, made in maps.items()
    }
