"""Both branches of the five festo10 specimens, from their reduced staircases.

The readings are not part of the project; tests that need them are skipped where they are absent.
"""

from pathlib import Path

import numpy as np
import pandas as pd

from fitting.records import BranchPairs

FOLDER = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "festo10_series"
ABSENT = "the readings of festo10_series are not beside the repository"
LEAST_PULL = 8.0  # N, by the data's own description
TURN = 620e3  # Pa, to which every specimen was filled, by the same


def festo10_pairs(folder: Path = FOLDER) -> dict[str, BranchPairs]:
    """Where both branches pull, by specimen; one record for each length."""
    table = pd.read_csv(folder / "quasistatic.csv")
    pulls = (table["F_fill_N"] > LEAST_PULL) & (table["F_vent_N"] > LEAST_PULL)
    found = {}
    for name, mine in table[pulls].groupby("cut_cm"):
        found[f"{name}cm"] = BranchPairs.joined(
            [
                BranchPairs.ramp(
                    1e-3 * float(str(length)),
                    1e6 * np.asarray(rows["P_MPa_gauge"], float),
                    np.asarray(rows["half_hyst_N"], float),
                    turn_pressure=TURN,
                    rest_length=1e-3 * float(rows["l0_mm"].iloc[0]),
                    name=f"{length} mm",
                )
                for length, rows in mine.groupby("L_mm")
            ]
        )
    return found
