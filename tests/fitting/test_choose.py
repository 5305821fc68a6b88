"""What is chosen predicts what it has not seen; the ladder carries what a map can; rigs are told apart."""

import dataclasses
import json
import math

import numpy as np
import pytest
from maps import muscle_map

import famjax
import fitting
from fitting import ForceData, InputError, Parameter, choose, identify, load_fit, predict, write_fit
from fitting.choice import choice_as_dict, choice_table, validate_choice, weigh
from fitting.evidence import Evidence
from fitting.ladder import ladder, rest_length_rounding
from fitting.race import ALIKE, NEAR, Tried, held_out_error, preferred
from fitting.saved import card_of
from fitting.validation import LeftOut


@pytest.fixture(scope="module")
def chosen(dmsp20: ForceData) -> fitting.Choice:
    return choose(dmsp20)


@pytest.mark.slow
def test_the_choice_on_a_measured_muscle(chosen):
    """Within buildable dimensions and stable; the limits are a tenth above what was measured."""
    assert chosen.chosen.errors.rmse < 4.4
    assert chosen.chosen.converged
    assert chosen.chosen.certificate.stability_margin > 0
    columns = chosen.tried[0].columns
    assert columns["pressure"] < 4.6
    assert columns["interior length"] < 9.5
    # The table shows by what the families are ordered.
    assert chosen.tried[0].held_out <= NEAR * min(one.held_out for one in chosen.tried)
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
def test_the_band_contains_what_families_that_fit_alike_disagree_about(chosen, tmp_path):
    at = np.array([0.283, 0.27]), np.array([5e5, 5e5])
    differ = [one.force(*at) - chosen.predict(*at) for one in chosen.alike.values()]
    assert differ
    half = chosen.half_band(*at)
    assert (half >= 1.75 * np.sqrt(np.mean(np.square(differ), axis=0))).all()
    assert (half >= chosen.error.factor() * chosen.error.std(*at)).all()
    # Saved, it predicts with the same band.
    evidence = Evidence(error=chosen.error, left_out=chosen.left_out)
    write_fit(chosen.chosen, tmp_path, evidence=evidence, choice=chosen)
    saved = load_fit(tmp_path / "fit.json")
    assert len(saved.outlook.alike) == len(chosen.alike)
    rows = predict(saved, at[0], at[1][:1])
    assert [row["force_N"] for row in rows] == pytest.approx(list(chosen.predict(*at)), rel=1e-9)
    halves = [(row["high_95_N"] - row["low_95_N"]) / 2 for row in rows]
    assert halves == pytest.approx(list(half), rel=1e-6)
    assert all(row["band"] == "left out" for row in rows)
    document = json.loads(json.dumps(choice_as_dict(chosen)))
    assert (document["chosen"], len(document["tried"])) == (chosen.name, len(chosen.tried))
    title, header, rows = choice_table(chosen, "us")
    assert "lbf" in title
    assert len(header) == len(rows[0])
    assert [row[-1] for row in rows].count("chosen") == 1


@pytest.mark.slow
def test_a_law_of_rubber_is_found_again():
    """Readings of a Mooney-Rivlin muscle, with noise: no other law is nearer to the truth."""
    found = choose(muscle_map(noise=0.5, seed=3))
    assert found.chosen.errors.rmse < 0.7
    truth = muscle_map(noise=0.0, seed=3, lengths=(0.985, 0.93, 0.87))
    error = found.predict(truth.length, truth.pressure) - truth.force
    assert np.sqrt(np.mean(error[truth.loaded] ** 2)) < 1.0


@pytest.mark.slow
def test_the_choice_is_made_anew_without_what_it_predicts(dmsp10):
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


def test_readings_known_well_do_not_outweigh_what_the_law_is_good_for(dmsp20):
    std = np.full(dmsp20.force.shape, 1e-3)
    weighed, least = weigh(dataclasses.replace(dmsp20, force_std=std)), 0.005 * dmsp20.max_force
    assert weighed.force_std == pytest.approx(least, rel=1e-6)
    assert weigh(dmsp20, noise=20.0).force_std == pytest.approx(np.hypot(20.0, least))


def test_one_length_determines_no_family(dmsp20):
    one = dmsp20.part(dmsp20.lengths.level >= 0.29)
    with pytest.raises(InputError, match="two or more lengths"):
        choose(one)


def made(data: ForceData, *errors: float) -> list[Tried]:
    """Families in the order of the ladder, of these held-out errors."""
    of = ladder(data)[0][: len(errors)]
    out = {"length": LeftOut("length", np.zeros(1), np.zeros(1, int), np.zeros(1))}
    return [Tried(one, 1.0, out, error, alike=True) for one, error in zip(of, errors, strict=True)]


def test_the_smallest_held_out_error_is_preferred(dmsp20):
    """Of the first three of the ladder: the law of rubber, the same in a rig, the next law of rubber."""
    assert preferred(made(dmsp20, 4.0, 5.0, 3.0)) == [2, 0, 1]
    assert preferred(made(dmsp20, 4.0, 3.9, 3.8)) == [2, 1, 0]
    assert preferred(made(dmsp20, np.inf, 5.0, 3.0)) == [2, 1, 0]


def test_a_length_missed_by_far_is_not_forgiven_for_others(dmsp20):
    def of_groups(*errors: float) -> float:
        group = np.arange(4)
        out = {"length": LeftOut("length", 0.2 + 0.01 * group, group, np.array(errors))}
        return held_out_error(out, 1.0, 500.0)

    cliff = of_groups(1.1, 0.9, 1.8, 84.0)
    assert cliff == pytest.approx(np.sqrt(np.hypot(0.9, 1.8) * np.hypot(1.1, 84) / 2), rel=0.1)
    assert cliff > 1.5 * of_groups(3.0, 1.5, 2.0, 20.0)


def test_the_laws_of_rubber_come_before_those_that_only_describe(dmsp20):
    candidates, dropped = ladder(dmsp20)
    laws = ["ogden", "mooney-rivlin", "linear", "saturating", "cubic"]
    assert [one.name for one in candidates if not one.rig] == laws
    assert [one.name for one in candidates if one.rig] == [f"{law}, compliant rig" for law in laws]
    ranks = [one.rank for one in candidates]
    assert ranks == sorted(ranks)
    assert not dropped


@pytest.mark.parametrize(("lengths", "most"), [(2, 3), (3, 5), (4, 7)])
def test_a_small_map_gets_fewer_unknowns_instead_of_a_refusal(dmsp20, lengths, most):
    level = dmsp20.lengths.level
    part = dmsp20.part(level >= np.unique(level[dmsp20.loaded])[-lengths])
    candidates, dropped = ladder(part)
    assert candidates
    assert max(one.unknowns for one in candidates) <= most
    assert dropped or lengths == 4


def test_what_a_user_says_is_not_varied(dmsp20):
    said = {"end_factor": Parameter(value=1.05, vary=False)}
    candidates, _ = ladder(dmsp20, said)
    assert all(one.parameters["end_factor"] is said["end_factor"] for one in candidates)
    bounded, _ = ladder(dmsp20, bounds={"end_factor": (1.0, 1.1)})
    assert all("end_factor" not in one.parameters for one in bounded)
    assert all(one.bounds == {"end_factor": (1.0, 1.1)} for one in bounded)


def test_no_feature_of_a_law_is_finer_than_the_lengths(dmsp20):
    level = dmsp20.lengths.level
    for data in (dmsp20, dmsp20.part(np.isin(level, np.unique(level[dmsp20.loaded])[::2]))):
        lengths = np.unique(data.lengths.level[data.loaded])
        gap = np.diff(lengths).max() / data.specimen.rest_length
        (law,) = (one for one in ladder(data)[0] if one.name == "saturating")
        assert law.parameters["strain_scale"].min == pytest.approx(min(gap / 2, 0.1))


def test_the_rounding_of_a_rest_length_is_told_by_its_digits():
    found = [rest_length_rounding(length) for length in (0.296, 0.0832)]
    assert found == pytest.approx([0.5e-3, 0.05e-3])


COMPLIANCE, EXPONENT = 1.5e-5, 0.5
RECOVERED = 1e-5  # relative
ROUNDED = 1e-9


def in_rig(rig: tuple[float, float | None] | None, noise: float = 0.0) -> ForceData:
    lengths = (1.0, 0.985, 0.96, 0.93, 0.9, 0.87)
    return muscle_map(noise=noise, seed=7, lengths=lengths, deadband=0.0, rig=rig)


@pytest.fixture(scope="module")
def identified() -> fitting.Identification:
    none = {"deadband_pressure": Parameter(value=0.0, vary=False, unit="Pa")}
    rig = {"series_compliance": Parameter(), "series_exponent": Parameter(), **none}
    data = in_rig((COMPLIANCE, EXPONENT))
    return identify(data, law="mooney-rivlin", parameters=rig, starts=8)


def test_it_is_recovered(identified):
    assert identified.converged
    assert identified.errors.rmse < 1e-5
    truth = {
        "braid_diameter": 0.0135, "braid_angle": math.radians(64), "C10": 0.4e6, "C01": 0.15e6,
        "series_compliance": COMPLIANCE, "series_exponent": EXPONENT,
    }  # fmt: skip
    for name, value in truth.items():
        assert identified.estimate(name).value == pytest.approx(value, rel=RECOVERED), name
    assert identified.mounted.exponent == pytest.approx(EXPONENT, rel=RECOVERED)


@pytest.mark.slow
def test_a_fit_file_and_a_card_keep_the_rig(identified, tmp_path):
    write_fit(identified, tmp_path)
    saved = load_fit(tmp_path / "fit.json")
    assert saved.mounted.exponent == identified.mounted.exponent
    L, P = np.array([0.24]), np.array([4e5])
    (row,) = predict(saved, L, P)
    assert row["force_N"] == pytest.approx(float(identified.predict(L, P)[0]), rel=ROUNDED)
    (other,) = predict(saved, np.array([0.19]), P, rest_length=0.2)
    shorter = identified.mounted.with_muscle(famjax.cut_to_length(identified.muscle, 0.2))
    assert other["force_N"] == pytest.approx(float(shorter.force(0.19, 4e5)), rel=ROUNDED)
    card = card_of(saved)
    assert card.members[0].exponent == identified.mounted.exponent
    assert float(card.muscle.force(0.24, 4e5)) == pytest.approx(row["force_N"], rel=ROUNDED)
    bare, alone = card_of(saved, rig=False), float(saved.muscle.force(0.24, 4e5))
    assert float(bare.muscle.force(0.24, 4e5)) == pytest.approx(alone, rel=ROUNDED)
    assert "is left out" in bare.provenance.notes[-1]


@pytest.mark.slow
@pytest.mark.parametrize("rig", [None, (COMPLIANCE, EXPONENT)], ids=["rigid", "square root"])
def test_a_rig_is_chosen_where_there_is_one(rig):
    choice = choose(in_rig(rig, noise=0.5))
    assert ("compliant rig" in choice.name) is (rig is not None)
    assert choice.chosen.errors.rmse < 0.8
