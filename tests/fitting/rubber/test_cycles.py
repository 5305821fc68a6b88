import numpy as np
import pytest

from famjax.boundary.errors import InputError
from fitting.rubber.cycles import (
    Cycle,
    checked_columns,
    choose_cycles,
    lost_work,
    pair_cycles,
    split_branches,
)


def _triangle(cycles: int, rows: int, hold: int = 0) -> np.ndarray:
    """Position of a test between 0 and 1: ramps of `rows` steps, holds of `hold` more readings."""
    ramp = np.linspace(0, 1, rows + 1)
    up = np.concatenate([ramp, np.ones(hold)])
    cycle = np.concatenate([up, ramp[-2::-1], np.zeros(hold)])
    return np.concatenate([cycle, np.tile(cycle[1:], cycles - 1)])


@pytest.mark.parametrize("hold", [0, 30])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-3])
def test_branches_of_a_known_record(noise: float, hold: int) -> None:
    rows, cycles = 200, 5
    clean = _triangle(cycles, rows, hold)
    x = clean + noise * np.random.default_rng(1).standard_normal(clean.size)
    branches = split_branches(x)
    assert [branch.rising for branch in branches] == [True, False] * cycles
    # Turning points lie in the holds; where noise hides the turn, within its width (2 %) of it.
    slack = int(np.ceil(min(6 * noise, 0.02) * rows)) + (0 if noise == 0 else 8)
    for number, branch in enumerate(branches):
        start = number * (rows + hold)
        assert abs(branch.start - start) <= slack
        assert abs(branch.stop - (start + rows + 1)) <= slack
    if noise == 0:
        assert all(np.ptp(x[branch.rows]) == 1 for branch in branches)


def test_scale_offset_and_direction_do_not_matter() -> None:
    x = _triangle(3, 50, 5)
    rows = [(b.start, b.stop) for b in split_branches(x)]
    assert [(b.start, b.stop) for b in split_branches(2.5 - 40 * x)] == rows
    assert [b.rising for b in split_branches(-x)] == [False, True] * 3


def test_small_wiggles_are_no_branches() -> None:
    t = np.linspace(0, 3, 1501)
    x = 1 - np.cos(2 * np.pi * t) + 0.3 * np.sin(40 * np.pi * t)  # wiggles of 0.6 in a range of 2.4
    assert len(split_branches(x)) == 6
    assert len(split_branches(x, min_travel=0.02)) > 60


def test_a_partial_branch_counts_from_min_travel_on() -> None:
    x = np.concatenate([np.linspace(0, 1, 51), np.linspace(0.98, 0.4, 30)])
    assert len(split_branches(x)) == 2
    assert len(split_branches(x, min_travel=0.7)) == 1


def test_nothing_moves() -> None:
    assert split_branches(np.ones(10)) == ()
    assert pair_cycles((), rising_first=True) == ()
    with pytest.raises(InputError, match="no complete cycle"):
        choose_cycles((), [1])


def test_cycles_pair_a_branch_with_the_next() -> None:
    branches = split_branches(_triangle(3, 20)[10:])  # starts half-way up
    up, down = pair_cycles(branches, rising_first=True), pair_cycles(branches, rising_first=False)
    assert (len(up), len(down)) == (3, 2)
    assert up[1] == Cycle(branches[2], branches[3])
    assert down[1] == Cycle(branches[3], branches[4])
    assert choose_cycles(up, [3, 1]) == (up[2], up[0])


@pytest.mark.parametrize(
    ("numbers", "match"),
    [([4], "has 3 complete cycles"), ([0], "from 1 up"), ([], "from 1 up"), ([2, 2], "different")],
)
def test_cycles_that_are_not_there(numbers: list[int], match: str) -> None:
    cycles = pair_cycles(split_branches(_triangle(3, 20)), rising_first=True)
    with pytest.raises(InputError, match=match):
        choose_cycles(cycles, numbers)


def test_lost_work_is_the_area_of_an_ellipse() -> None:
    t = np.linspace(0, 1, 2001)
    x, F = -3 * np.cos(2 * np.pi * t), 2 * np.sin(2 * np.pi * t) + 5
    cycle = pair_cycles(split_branches(x), rising_first=True)[0]
    # Force is higher while x grows, so work is lost; 1e-3 of it is cut off with the turning rows.
    assert lost_work(x, F, cycle) == pytest.approx(np.pi * 3 * 2, rel=1e-3)
    assert lost_work(x, -F, cycle) == pytest.approx(-np.pi * 3 * 2, rel=1e-3)
    assert lost_work(x, 7 + x**3, cycle) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize(
    ("columns", "match"),
    [
        ({"a": [1, 2, 3], "b": [1, 2]}, r"b of shape \(2,\)"),
        ({"a": [[1, 2, 3]]}, "one-dimensional"),
        ({"a": [1, np.nan, 3]}, "a of reading 2 is nan"),
        ({"a": [1, 2, np.inf]}, "must be finite"),
        ({"a": [1, 2]}, "at least 3 readings"),
        ({"a": [1, 2, 3], "time": [0, 2, 1]}, "run backwards"),
    ],
)
def test_bad_columns_are_named(columns: dict, match: str) -> None:
    with pytest.raises(InputError, match=match):
        checked_columns(columns)


def test_good_columns_pass_repeated_stamps_included() -> None:
    good = checked_columns({"a": [1, 2, 3], "time": [0, 0, 1], "b": None})
    assert good["b"] is None
    assert good["a"] is not None
    assert good["a"].dtype == float


def test_min_travel_is_a_fraction() -> None:
    with pytest.raises(InputError, match="fraction of the range"):
        split_branches([0, 1, 0], min_travel=1.0)
