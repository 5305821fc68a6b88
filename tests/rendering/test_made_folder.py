"""Twins: the truth that a person edits, and the same bytes for the same seed."""

import itertools

import pytest

from rendering.folder import write_twin
from rendering.folder_truth import TRUTH

SMALL = """
[muscle]
rest_length_in = 8
friction = 0.02
[rig]
pressures_psi = [60]
stroke_mm = 20
rate_mm_per_s = 4
settle_s = 2
[camera]
pictures = 4
rows = 600
damaged = 1
"""


def written(path, text):
    path.write_text(text)
    return path


@pytest.mark.slow
def test_a_twin_of_a_truth_is_the_same_bytes_again_from_its_own(tmp_path):
    """The file that the first wrote makes the second, on another day."""
    write_twin(tmp_path / "a", seed=4, truth=written(tmp_path / TRUTH, SMALL))
    write_twin(tmp_path / "b", seed=4, truth=tmp_path / "a" / TRUTH)
    names = sorted(path.relative_to(tmp_path / "a") for path in (tmp_path / "a").rglob("*.*"))
    assert [str(name) for name in names if "DSC" in str(name)] == [
        f"photographs/DSC_{k:04d}.JPG" for k in range(4)
    ]
    differing = [
        n for n in names if (tmp_path / "a" / n).read_bytes() != (tmp_path / "b" / n).read_bytes()
    ]
    assert differing == []
    lines = (tmp_path / "a" / "machine.csv").read_text().splitlines()[2:]
    times = [float(line.split(",")[0]) for line in lines]
    assert max(b - a for a, b in itertools.pairwise(times)) == pytest.approx(1.02)
