"""Twins: the truth that a person edits, what is refused in it, and the same bytes for the same seed."""

import itertools
from pathlib import Path

import pytest

from famjax.boundary.errors import InputError
from rendering.folder import write_twin
from rendering.folder_truth import TRUTH, drawn_truth, read_truth

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


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_what_a_truth_does_not_say_is_drawn(tmp_path: Path) -> None:
    drawn = drawn_truth(5, "large", flawed=True)
    assert len(drawn.rig.pressures) == 10
    assert (drawn.rig.cycles, drawn.camera.pictures, drawn.camera.damaged) == (3, 200, 1)
    found = read_truth(written(tmp_path / TRUTH, SMALL), drawn)
    assert found.muscle.rest_length == pytest.approx(0.2032)
    assert found.muscle.coefficients == drawn.muscle.coefficients
    assert found.rig.stroke == pytest.approx(0.02)
    assert found.rig.clock_drift == drawn.rig.clock_drift
    assert found.camera.pictures == 4
    assert drawn_truth(5, "small", flawed=False).rig.lost == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[mussel]\n", "tables .muscle., .rig., .camera. and .errors., all or some; got mussel"),
        ("[rig]\nstroke_in = 4\n", "stroke must be at most 0.080153 m"),
        ("[rig]\nstroke = 4\n", "has no unit"),
        ("[rig]\npressures_psi = []\n", "pressures must be numbers > 0"),
        ("[camera]\ndamaged = 30\n", "0 to a quarter of the pictures"),
        ("[muscle]\nwall = 3\n", "unknown key 'wall'"),
        ("muscle = 3\n", "must be a table"),
    ],
)
def test_a_truth_that_cannot_be_made_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read_truth(written(tmp_path / TRUTH, text), drawn_truth(0, "small", flawed=True))


@pytest.mark.slow
def test_a_twin_of_a_truth_is_the_same_bytes_again_from_its_own(tmp_path: Path) -> None:
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
