"""The ladder carries what a map can, and varies nothing that a user has said."""

import numpy as np
import pytest

from fitting import ForceData, Parameter
from fitting.choice import ladder
from fitting.choice.ladder import rest_length_rounding


def of_lengths(data: ForceData, count: int) -> ForceData:
    """The map at its longest lengths only."""
    level = data.lengths.level
    return data.part(level >= np.unique(level[data.loaded])[-count])


def test_the_laws_of_rubber_come_before_those_that_only_describe(dmsp20: ForceData) -> None:
    candidates, dropped = ladder(dmsp20)
    laws = list(dict.fromkeys(one.law for one in candidates))
    assert laws == ["ogden", "mooney-rivlin", "linear", "saturating", "cubic"]
    ranks = [one.rank for one in candidates]
    assert ranks == sorted(ranks)
    assert all(
        one.unknowns <= 9 for one in candidates
    )  # two numbers for each of five lengths, less one
    assert not any("needs" in sentence for sentence in dropped)


@pytest.mark.parametrize(("lengths", "most"), [(2, 3), (3, 5), (4, 7)])
def test_a_small_map_gets_fewer_unknowns_instead_of_a_refusal(
    dmsp20: ForceData, lengths: int, most: int
) -> None:
    candidates, dropped = ladder(of_lengths(dmsp20, lengths))
    assert candidates
    assert max(one.unknowns for one in candidates) <= most
    assert any("left out" in sentence for sentence in dropped)


def test_two_lengths_hold_the_deadband(dmsp20: ForceData) -> None:
    assert {one.deadband for one in ladder(dmsp20)[0]} == {True, False}
    candidates, _ = ladder(of_lengths(dmsp20, 2))
    assert not any(one.deadband for one in candidates)
    assert all(one.parameters["deadband_pressure"].value == 0.0 for one in candidates)
    assert all(one.name.endswith("no deadband") for one in candidates)


def test_what_a_user_says_is_not_varied(dmsp20: ForceData) -> None:
    said = {"end_factor": Parameter(value=1.05, vary=False)}
    candidates, _ = ladder(dmsp20, said)
    assert not any("end_factor" in one.free for one in candidates)
    assert all(one.parameters["end_factor"] is said["end_factor"] for one in candidates)
    bounded, _ = ladder(dmsp20, bounds={"braid_compliance": (0.0, 1e-5)})
    assert all("braid_compliance" not in one.parameters for one in bounded)
    assert all(one.bounds == {"braid_compliance": (0.0, 1e-5)} for one in bounded)


def test_a_law_without_what_was_given_is_left_out(dmsp20: ForceData) -> None:
    candidates, dropped = ladder(dmsp20, bounds={"ogden_exponent": (-8.0, -4.0)})
    assert {one.law for one in candidates} == {"ogden"}
    assert "The linear law has no ogden_exponent, which was given." in dropped


def test_the_prior_of_the_exponent_is_the_same_for_every_muscle(
    dmsp20: ForceData, dmsp10: ForceData
) -> None:
    priors = {
        one.parameters["ogden_exponent"].prior
        for data in (dmsp20, dmsp10)
        for one in ladder(data)[0]
        if one.law == "ogden"
    }
    assert priors == {(0.0, 5.0)}


def test_families_of_one_law_have_the_same_parameters(dmsp20: ForceData) -> None:
    """So one compiled program serves all of them, but for those of a rig that gives way."""
    candidates, _ = ladder(dmsp20)
    for law in {one.law for one in candidates}:
        named = [
            {*one.parameters, "deadband_pressure"}
            for one in candidates
            if one.law == law and "series_compliance" not in one.free
        ]
        assert all(names == named[0] for names in named)


def test_a_rig_that_gives_way_is_judged_by_lengths_left_out(dmsp20: ForceData) -> None:
    """It takes the place of the deadband, in maps of four lengths or more."""
    power = {"series_compliance", "series_exponent"}
    rigs = [one for one in ladder(dmsp20)[0] if power & {*one.free}]
    assert {one.law for one in rigs} == {"ogden", "mooney-rivlin", "linear", "saturating", "cubic"}
    assert all({*one.free} == power and not one.deadband for one in rigs)
    assert all(
        one.name.endswith("compliant rig, as a power of the force, no deadband") for one in rigs
    )
    few, _ = ladder(of_lengths(dmsp20, 3))
    assert not any(power & {*one.free} for one in few)


@pytest.mark.parametrize(("rest_length", "half_a_unit"), [(0.296, 0.5e-3), (0.0832, 0.05e-3)])
def test_the_rounding_of_a_rest_length_is_told_by_its_digits(
    rest_length: float, half_a_unit: float
) -> None:
    assert rest_length_rounding(rest_length) == pytest.approx(half_a_unit)


def test_a_law_has_no_more_coefficients_than_there_are_strained_lengths(dmsp20: ForceData) -> None:
    candidates, dropped = ladder(of_lengths(dmsp20, 3))  # one of them is the rest length
    assert "cubic" not in {one.law for one in candidates}
    assert any(one.startswith("The cubic law needs 3 lengths") for one in dropped)
