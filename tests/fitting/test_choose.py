"""What is chosen predicts what it has not seen, and the choice is made of nothing else."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from fitting import Choice, ForceData, InputError, choose, load_fit, predict, write_fit
from fitting.choice import choice_as_dict, choice_table, validate_choice, weigh
from fitting.evidence import Evidence
from fitting.ladder import ladder
from fitting.race import ALIKE, NEAR, Tried, held_out_error, preferred
from fitting.validation import LeftOut
from tests.fitting.synthetic import muscle_map


@pytest.fixture(scope="module")
def chosen(dmsp20: ForceData) -> Choice:
    return choose(dmsp20)


@pytest.mark.slow
def test_the_choice_on_a_measured_muscle(chosen: Choice) -> None:
    """Within buildable dimensions and stable; the limits are a tenth above what was measured."""
    assert chosen.chosen.errors.rmse < 4.4
    assert chosen.chosen.converged
    assert chosen.chosen.certificate.stability_margin > 0
    columns = chosen.tried[0].columns
    assert columns["pressure"] < 4.6
    assert columns["interior length"] < 9.5


@pytest.mark.slow
def test_the_table_shows_by_what_the_families_are_ordered(chosen: Choice) -> None:
    best = min(one.held_out for one in chosen.tried)
    assert chosen.tried[0].held_out <= NEAR * best
    others = [one.held_out for one in chosen.tried[1:]]
    assert others == sorted(others)
    for one in chosen.tried:
        if one.left_out:
            errors = [*one.columns.values()]
            smallest = 1e-3 * chosen.data.max_force  # errors below are not told apart
            expected = np.exp(np.mean(np.log(np.hypot(errors, smallest))))
            assert one.held_out == pytest.approx(expected, rel=1e-9)
    least = min(one.rmse for one in chosen.tried)
    alike = {one.candidate.name for one in chosen.tried[1:] if one.rmse < ALIKE * least}
    assert alike == {*chosen.alike}


@pytest.mark.slow
def test_the_band_contains_what_families_that_fit_alike_disagree_about(chosen: Choice) -> None:
    at = np.array([0.283, 0.27]), np.array([5e5, 5e5])
    differ = [one.force(*at) - chosen.predict(*at) for one in chosen.alike.values()]
    assert differ
    half = chosen.half_band(*at)
    assert (half >= 1.75 * np.sqrt(np.mean(np.square(differ), axis=0))).all()
    assert (half >= chosen.error.factor() * chosen.error.std(*at)).all()


@pytest.mark.slow
def test_a_law_of_rubber_is_found_again() -> None:
    """Readings of a Mooney-Rivlin muscle, with noise: no other law is nearer to the truth."""
    data = muscle_map(noise=0.5, seed=3)
    found = choose(data)
    assert found.chosen.errors.rmse < 0.7
    truth = muscle_map(noise=0.0, seed=3, lengths=(0.985, 0.93, 0.87))
    error = found.predict(truth.length, truth.pressure) - truth.force
    assert np.sqrt(np.mean(error[truth.loaded] ** 2)) < 1.0


@pytest.mark.slow
def test_a_saved_choice_predicts_with_the_same_band(chosen: Choice, tmp_path: Path) -> None:
    at = np.array([0.29, 0.26]), np.array([3e5, 3e5])
    evidence = Evidence(error=chosen.error, left_out=chosen.left_out)
    write_fit(chosen.chosen, tmp_path, evidence=evidence, choice=chosen)
    saved = load_fit(tmp_path / "fit.json")
    assert len(saved.outlook.alike) == len(chosen.alike)
    rows = predict(saved, at[0], at[1][:1])
    assert [row["force_N"] for row in rows] == pytest.approx(list(chosen.predict(*at)), rel=1e-9)
    half = [(row["high_95_N"] - row["low_95_N"]) / 2 for row in rows]
    assert half == pytest.approx(list(chosen.half_band(*at)), rel=1e-6)
    assert all(row["band"] == "left out" for row in rows)


@pytest.mark.slow
def test_what_was_tried_is_told(chosen: Choice) -> None:
    document = json.loads(json.dumps(choice_as_dict(chosen)))
    assert document["chosen"] == chosen.name
    assert len(document["tried"]) == len(chosen.tried)
    title, header, rows = choice_table(chosen, "us")
    assert "lbf" in title
    assert len(header) == len(rows[0])
    assert [row[-1] for row in rows].count("chosen") == 1


@pytest.mark.slow
def test_the_choice_is_made_anew_without_what_it_predicts(dmsp10: ForceData) -> None:
    """Readings that are spoilt where they are left out change nothing of their own prediction."""
    level = dmsp10.lengths.level
    longest, middle = np.unique(level[dmsp10.loaded])[[-1, 1]]
    few = dmsp10.part((level == longest) | (level >= middle))
    options = {"starts": 2}
    sound = validate_choice(choose(few, **options), "length", **options)
    spoilt = dataclasses.replace(few, force=np.where(few.length == longest, 2.0, 1.0) * few.force)
    wrong = validate_choice(choose(spoilt, **options), "length", **options)
    last = sound.group == sound.group.max()
    at = few.force[few.loaded][last]
    assert wrong.error[last] + 2 * at == pytest.approx(sound.error[last] + at)
    assert wrong.names[-1] == sound.names[-1]


def test_readings_known_well_do_not_outweigh_what_the_law_is_good_for(dmsp20: ForceData) -> None:
    std = np.full(dmsp20.force.shape, 1e-3)
    weighed = weigh(dataclasses.replace(dmsp20, force_std=std))
    assert weighed.force_std == pytest.approx(0.005 * dmsp20.max_force, rel=1e-6)
    assert weigh(dmsp20, noise=20.0).force_std == pytest.approx(
        np.hypot(20.0, 0.005 * dmsp20.max_force)
    )


def test_one_length_determines_no_family(dmsp20: ForceData) -> None:
    one = dmsp20.part(dmsp20.lengths.level >= 0.29)
    with pytest.raises(InputError, match="two lengths or more"):
        choose(one)


def made(data: ForceData, *errors: float, lengths: bool = True) -> list[Tried]:
    """Families in the order of the ladder, of these held-out errors."""
    of = ladder(data)[0][: len(errors)]
    kind = "length" if lengths else "pressure"
    out = {kind: LeftOut(kind, np.zeros(1), np.zeros(1, int), np.zeros(1))}
    return [Tried(one, 1.0, out, error, alike=True) for one, error in zip(of, errors, strict=True)]


@pytest.mark.parametrize(
    ("held_out", "order"),
    [
        ((4.0, 5.0, 3.0), [2, 0, 1]),
        ((4.0, 3.9, 3.8), [2, 1, 0]),
        ((np.inf, 5.0, 3.0), [2, 1, 0]),
    ],
)
def test_the_smallest_held_out_error_is_preferred(
    dmsp20: ForceData, held_out: tuple[float, ...], order: list[int]
) -> None:
    """Of the first three of the ladder: the law of rubber, the same in a rig, the next law of rubber."""
    assert preferred(made(dmsp20, *held_out)) == order


def test_a_length_missed_by_far_is_not_forgiven_for_others(dmsp20: ForceData) -> None:
    def of_groups(*errors: float) -> float:
        group = np.arange(4)
        out = {"length": LeftOut("length", 0.2 + 0.01 * group, group, np.array(errors))}
        return held_out_error(out, 1.0, 500.0)

    cliff = of_groups(1.1, 0.9, 1.8, 84.0)
    assert cliff == pytest.approx(np.sqrt(np.hypot(0.9, 1.8) * np.hypot(1.1, 84) / 2), rel=0.1)
    assert cliff > 1.5 * of_groups(3.0, 1.5, 2.0, 20.0)
