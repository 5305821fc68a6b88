"""One specimen predicts muscles of other lengths by all accounts of it, with a band that holds."""

from pathlib import Path

import numpy as np
import pytest

import famjax
from fitting import Choice, ForceData, Identification, choose, load_fit, predict, write_fit
from fitting.series import FROM_ONE
from tests.fitting.synthetic import muscle_map

LENGTHS = (1.0, 0.97, 0.94, 0.91, 0.88, 0.85)
MAKES = {
    "deadband": {"deadband": 3e4, "rig": None},
    "rig that gives way": {"deadband": 0.0, "rig": (1.5e-5, 0.5)},
}


def one_of(make: str, rest: float, noise: float) -> ForceData:
    return muscle_map(noise=noise, seed=5, lengths=LENGTHS, rest=rest, **MAKES[make])


@pytest.fixture(scope="module", params=list(MAKES))
def chosen(request: pytest.FixtureRequest) -> tuple[str, Choice]:
    return request.param, choose(one_of(request.param, 0.25, noise=0.5))


@pytest.fixture
def saved(chosen: tuple[str, Choice], tmp_path: Path) -> Identification:
    _, choice = chosen
    write_fit(choice.chosen, tmp_path, choice=choice)
    return load_fit(tmp_path / "fit.json")


@pytest.mark.slow
@pytest.mark.parametrize("rest", [0.1, 0.5])
def test_the_band_holds_what_a_muscle_of_that_length_pulls(
    chosen: tuple[str, Choice], saved: Identification, rest: float
) -> None:
    data = one_of(chosen[0], rest, noise=0.0)
    held = []
    for length in np.unique(data.length):
        at = (data.length == length) & data.loaded
        rows = predict(saved, np.array([length]), data.pressure[at], rest_length=rest)
        assert {row["band"] for row in rows} == {"one specimen"}
        held += [
            row["low_95_N"] <= force <= row["high_95_N"]
            for row, force in zip(rows, data.force[at], strict=True)
        ]
    assert np.mean(held) > 0.9


@pytest.mark.slow
def test_a_prediction_is_the_mean_of_the_accounts(
    chosen: tuple[str, Choice], saved: Identification
) -> None:
    known = chosen[1].other_lengths
    assert known is not None
    assert len(saved.outlook.other_lengths) == len(known.members) == len(known.names) > 1
    forces = [
        float(one.with_muscle(famjax.cut_to_length(one.muscle, 0.4)).force(0.36, 4e5))
        for one in known.members
    ]
    (row,) = predict(saved, np.array([0.36]), np.array([4e5]), rest_length=0.4)
    assert row["force_N"] == pytest.approx(np.mean(forces), rel=1e-9)
    between = FROM_ONE * chosen[1].data.max_force
    assert row["force_std_N"] == pytest.approx(np.hypot(np.std(forces), between), rel=1e-9)
