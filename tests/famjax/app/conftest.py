from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def map_text() -> str:
    """A force map of a known muscle, rounded to 0.1 mN."""
    from muscles import FESTO

    muscle = FESTO.with_parameters({
        "braid_diameter": 0.022, "braid_angle": 1.13, "rest_length": 0.3, "wall_thickness": 0.002,
        "E_1": 3e6, "E_2": -2e6, "E_3": 0.0, "deadband_pressure": 2e4,
    })  # fmt: skip
    states = [(P, L) for P in (100, 200, 300, 400) for L in (300, 290, 280, 270)]
    rows = [f"{P},{L},{max(0.0, float(muscle.force(L / 1e3, P * 1e3))):.4f}" for P, L in states]
    return "\n".join(["pressure_kPa,length_mm,force_N", *rows, ""])


@pytest.fixture
def force_map(map_text: str, tmp_path: Path) -> Path:
    path = tmp_path / "map.csv"
    path.write_text(map_text)
    return path
