"""Force maps of known muscles, raw records that are not part of the project, a fit that nobody made."""

from collections.abc import Sequence
from pathlib import Path

import clarabel
import numpy as np
import pytest
from scipy import sparse

import famjax
from fitting import ForceData, Identification, Specimen
from fitting.records import BranchPairs, StaticMap, quasi_static, read_ramp, static_map
from fitting.result import Outlook

KNOWN = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
SOFTENING = (4e6, -6e6, 6e6)  # Pa


def cylinder(
    diameter: float = 0.022, angle: float = 65.0, rest: float = 0.3, wall: float = 2e-3
) -> famjax.EstimatedGeometry:
    """A braid of no thickness, its angle in degrees, with a bladder inside its wall."""
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle * np.pi / 180, length=rest)
    return famjax.EstimatedGeometry(braid, famjax.Bladder(rest, diameter, wall, embedded=True))


def known_muscle(
    law: famjax.materials.AbstractMaterial | None = None, deadband: float = 30e3
) -> famjax.Muscle:
    return famjax.Muscle(cylinder(), law or famjax.PolynomialMaterial(SOFTENING), deadband)


def readings(
    muscle: famjax.AbstractMuscle,
    lengths: int = 8,
    pressures: Sequence[float] = (3e5, 4e5, 5e5, 6e5, 7e5),
    noise: float = 0.0,
    seed: int = 0,
    specimen: Specimen = KNOWN,
) -> ForceData:
    """Of a muscle like `KNOWN`, on a grid of states."""
    L, P = (grid.ravel() for grid in np.meshgrid(np.linspace(0.3, 0.25, lengths), pressures))
    force = np.asarray(muscle.force(L, P))
    force = force + noise * np.random.default_rng(seed).normal(size=L.size)
    return ForceData(force, P, L, specimen)


def muscle_map(
    *,
    noise: float,
    seed: int,
    lengths: Sequence[float] = (1.0, 0.96, 0.92, 0.88, 0.84, 0.8),
    pressures: Sequence[float] = (1e5, 2e5, 3e5, 4e5, 5e5, 6e5),
    deadband: float = 2e4,
    rig: tuple[float, float | None] | None = None,
    rest: float = 0.25,
) -> ForceData:
    """A Mooney-Rivlin muscle of 12 mm bore, braided at 64 deg.

    Lengths are in parts of the rest length, `rig` is compliance [m/N] and exponent of one that gives way.
    """
    law = famjax.materials.MooneyRivlinMaterial(0.4e6, 0.15e6)
    muscle = famjax.Muscle(cylinder(0.0135, 64, rest, 1.5e-3), law, deadband_pressure=deadband)
    L, P = (grid.ravel() for grid in np.meshgrid(rest * np.array(lengths), pressures))
    measured = muscle if rig is None else famjax.MountedMuscle(muscle, *rig)
    force = np.asarray(measured.force(L, P)) + np.random.default_rng(seed).normal(0, noise, L.size)
    specimen = Specimen("synthetic", rest, 1.5e-3, nominal_diameter=0.012, embedded=True)
    return ForceData(np.maximum(force, 0.0), P, L, specimen)


def bare_fit(
    muscle: famjax.Muscle, *readings: np.ndarray, outlook: Outlook | None = None
) -> Identification:
    """What predictions need of a muscle and its lengths, pressures and forces, and nothing else."""
    specimen = Specimen("bare", float(muscle.geometry.rest_length), 1.8e-3)
    fit = object.__new__(Identification)
    for name, value in {
        "data": ForceData(*readings[::-1], specimen),
        "mounted": famjax.MountedMuscle(muscle, 0.0),
        "outlook": outlook or Outlook(directions=np.zeros((0, 0))),
    }.items():
        object.__setattr__(fit, name, value)
    return fit


def clarabel_objective(A: np.ndarray, b: np.ndarray, G: np.ndarray, h: np.ndarray) -> float:
    """The optimal objective of a quadratic programme by somebody else's interior-point solver.

    Solved in units in which columns, data and constraint rows are of order one.
    """
    columns, size = np.linalg.norm(A, axis=0), np.linalg.norm(b)
    A, G, b, h = A / columns, G / columns, b / size, h / size
    on = np.linalg.norm(G, axis=1) > 0
    rows = np.linalg.norm(G[on], axis=1)
    G, h = G[on] / rows[:, None], h[on] / rows
    cones = [clarabel.NonnegativeConeT(len(h))] if len(h) else []
    solution = solved(np.triu(A.T @ A), -A.T @ b, -G, -h, cones)
    assert str(solution.status) in {"Solved", "AlmostSolved"}
    return 0.5 * float(np.sum((A @ np.array(solution.x) - b) ** 2)) * size**2


def solved(P: np.ndarray, q: np.ndarray, A: np.ndarray, b: np.ndarray, cones: list):
    """Clarabel's solution of x'Px/2 + q'x, A x + s = b, s in the cones."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    P, A = sparse.csc_matrix(P), sparse.csc_matrix(A)
    return clarabel.DefaultSolver(P, q, A, b, cones, settings).solve()


# ---- raw records beside the repository; tests that need them are skipped where they are absent

RAW = Path(__file__).resolve().parents[1] / ".." / "shared" / "data"
COLUMNS = {"force": "1 [N]", "pressure": "2 [kPa]", "time": "3 [s]"}
LEAST_PULL = 8.0  # N, by the data's own description
BPA10 = {
    "10cm": {"Unkink": 83e-3, "kinked25": 79.75e-3, "kinked50": 76.5e-3, "kinked75": 73.25e-3},
    "30cm": {"Unkink": 281e-3, "kinked25": 268.75e-3, "kinked50": 256.5e-3, "kinked75": 244.25e-3},
}
"""Its specimens, with the lengths [m] of their records."""


def raw(name: str) -> Path:
    if not (RAW / name).is_dir():
        pytest.skip(f"the records of {name} are not beside the repository")
    return RAW / name


def bpa10_maps() -> dict[str, StaticMap]:
    """The static maps of tests 8 to 10 at four lengths, by specimen; the sensor reads 8.94 kPa at 0."""
    folder, maps = raw("bpa10"), {}
    for name, lengths in BPA10.items():
        ramps = [
            read_ramp(folder / f"10mm_{name}_{at}_Test{test}.csv", length=length, columns=COLUMNS)
            for at, length in lengths.items()
            for test in (8, 9, 10)
        ]
        maps[name] = static_map(quasi_static(ramps, atmosphere=8.94e3, slack_below=LEAST_PULL))
    return maps


def festo10_pairs() -> dict[str, BranchPairs]:
    """Both branches of reduced staircases to 620 kPa where both pull, by specimen."""
    import pandas as pd

    table = pd.read_csv(raw("festo10_series") / "quasistatic.csv")
    pulls = (table["F_fill_N"] > LEAST_PULL) & (table["F_vent_N"] > LEAST_PULL)

    def ramp(length: object, rows: pd.DataFrame) -> BranchPairs:
        P, half = (np.asarray(rows[key], float) for key in ("P_MPa_gauge", "half_hyst_N"))
        L, rest = 1e-3 * float(str(length)), 1e-3 * float(rows["l0_mm"].iloc[0])
        about = {"turn_pressure": 620e3, "rest_length": rest, "name": f"{length} mm"}
        return BranchPairs.ramp(L, 1e6 * P, half, **about)

    return {
        f"{name}cm": BranchPairs.joined([ramp(*one) for one in mine.groupby("L_mm")])
        for name, mine in table[pulls].groupby("cut_cm")
    }
