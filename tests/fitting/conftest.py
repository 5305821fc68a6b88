from pathlib import Path

import pytest

from fitting import ForceData, Identification, identify, load_bundled


@pytest.fixture(scope="session")
def dmsp20() -> ForceData:
    return load_bundled("DMSP-20-300")


@pytest.fixture(scope="session")
def dmsp10() -> ForceData:
    return load_bundled("DMSP-10-250")


@pytest.fixture(scope="session")
def fitted20(dmsp20: ForceData) -> Identification:
    return identify(dmsp20)


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    """A small valid map that tests spoil."""
    rows = ["pressure_kPa,length_mm,force_N"]
    states = [(P, L) for P in (100, 200, 300, 400) for L in (300, 290, 280, 270)]
    rows += [f"{P},{L},{max(0.0, P * (0.4 - (300 - L) / 150) - 8)}" for P, L in states]
    path = tmp_path / "map.csv"
    path.write_text("\n".join(rows) + "\n")
    return path
