"""The ladder carries what a map can, and varies nothing that a user has said."""

import numpy as np
import pytest

from fitting import ForceData, Parameter
from fitting.ladder import ladder, rest_length_rounding


def of_lengths(data: ForceData, count: int) -> ForceData:
    """The map at its longest lengths only."""
    level = data.lengths.level
    return data.part(level >= np.unique(level[data.loaded])[-count])


def test_the_laws_of_rubber_come_before_those_that_only_describe(dmsp20: ForceData) -> None:
    candidates, dropped = ladder(dmsp20)
    laws = ["ogden", "mooney-rivlin", "linear", "saturating", "cubic"]
    assert [one.name for one in candidates if not one.rig] == laws
    assert [one.name for one in candidates if one.rig] == [f"{law}, compliant rig" for law in laws]
    ranks = [one.rank for one in candidates]
    assert ranks == sorted(ranks)
    assert not dropped


@pytest.mark.parametrize(("lengths", "most"), [(2, 3), (3, 5), (4, 7)])
def test_a_small_map_gets_fewer_unknowns_instead_of_a_refusal(
    dmsp20: ForceData, lengths: int, most: int
) -> None:
    candidates, dropped = ladder(of_lengths(dmsp20, lengths))
    assert candidates
    assert max(one.unknowns for one in candidates) <= most
    assert dropped or lengths == 4


def test_every_family_has_the_same_unknowns_of_the_geometry(dmsp20: ForceData) -> None:
    for one in ladder(dmsp20)[0]:
        if one.law == "mooney-rivlin":  # of an equivalent cylinder
            assert {"end_factor", "rest_length"}.isdisjoint(one.parameters)
            assert one.parameters["braid_diameter"].max == pytest.approx(0.028)
            continue
        assert {"end_factor", "rest_length", "braid_compliance"} <= {*one.parameters}
        assert one.parameters["end_factor"].prior is not None
        assert one.parameters["rest_length"].prior == (0.296, 0.00025)
        assert ("deadband_pressure" in one.parameters) == one.rig  # held at 0 beside such a rig
        assert ("series_exponent" in one.parameters) == one.rig


def test_what_a_user_says_is_not_varied(dmsp20: ForceData) -> None:
    said = {"end_factor": Parameter(value=1.05, vary=False)}
    candidates, _ = ladder(dmsp20, said)
    assert all(one.parameters["end_factor"] is said["end_factor"] for one in candidates)
    bounded, _ = ladder(dmsp20, bounds={"end_factor": (1.0, 1.1)})
    assert all("end_factor" not in one.parameters for one in bounded)
    assert all(one.bounds == {"end_factor": (1.0, 1.1)} for one in bounded)


def test_no_feature_of_a_law_is_finer_than_the_lengths(dmsp20: ForceData) -> None:
    level = dmsp20.lengths.level
    for data in (dmsp20, dmsp20.part(np.isin(level, np.unique(level[dmsp20.loaded])[::2]))):
        lengths = np.unique(data.lengths.level[data.loaded])
        gap = np.diff(lengths).max() / data.specimen.rest_length
        (law,) = (one for one in ladder(data)[0] if one.name == "saturating")
        assert law.parameters["strain_scale"].min == pytest.approx(min(gap / 2, 0.1))


@pytest.mark.parametrize(("rest_length", "half_a_unit"), [(0.296, 0.5e-3), (0.0832, 0.05e-3)])
def test_the_rounding_of_a_rest_length_is_told_by_its_digits(
    rest_length: float, half_a_unit: float
) -> None:
    assert rest_length_rounding(rest_length) == pytest.approx(half_a_unit)
