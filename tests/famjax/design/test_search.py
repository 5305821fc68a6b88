import dataclasses
import itertools
import math

import numpy as np
import pytest

from famjax import PolynomialMaterial, units
from famjax.design import (
    Combination,
    Requirement,
    exclusion_rows,
    front_members,
    load_catalogue,
    search,
)
from famjax.design.search import LATEX

INCH, PSI, LBF = units.INCH, units.PSI, units.LBF
ROUNDING = 1e-9  # relative, float64: the usable contraction is bisected, forces near zero cancel
ATMOSPHERE = 101325.0
RNG = np.random.default_rng(20)

ASKED = Requirement(
    100 * PSI, 400 * LBF, 0.15, 2.2 * INCH, stroke=2 * INCH, longest_length=18 * INCH
)
LENGTHS, PRESSURES = (4 * INCH, 24 * INCH), (20 * PSI, 100 * PSI)


def found_with(requirement=ASKED, *, catalogue=None, **changes):
    options = {"rest_length": LENGTHS, "pressure": PRESSURES, "about": 3000} | changes
    return search(catalogue or load_catalogue(), requirement, **options)


def two_pairs():
    """The catalogue with two bladders and one braid."""
    catalogue = load_catalogue()
    names = ("bladder 0.875 in x 0.0625 in", "bladder 1 in x 0.125 in")
    return dataclasses.replace(
        catalogue,
        bladders=tuple(b for b in catalogue.bladders if b.name in names),
        braids=tuple(b for b in catalogue.braids if b.name == "Kevlar 2.0 in"),
    )


@pytest.fixture(scope="module")
def of_all():
    return found_with()


def free_air(bladder, combination, contraction, pressure):
    """By hand: a cylinder less the rubber."""
    length = float(combination.rest_length)
    rubber = math.pi * (bladder.diameter - bladder.thickness) * bladder.thickness * length

    def volume(at):
        wide = float(combination.diameter(at))
        return math.pi / 4 * wide**2 * length * (1 - at) - rubber

    full, empty = volume(contraction), volume(0.0)
    return ((pressure + ATMOSPHERE) * full - ATMOSPHERE * empty) / ATMOSPHERE


@pytest.mark.slow
def test_a_tiny_space_is_what_a_loop_over_it_finds():
    steps, material = 5, PolynomialMaterial(LATEX)
    found = found_with(catalogue=two_pairs(), about=2 * steps**2)
    rows, kept = [], []
    for pair, pressure, length in itertools.product(
        found.pairs, np.linspace(*PRESSURES, steps), np.linspace(*LENGTHS, steps)
    ):
        muscle = Combination.of(pair.bladder, pair.braid, length)
        usable = float(muscle.usable_contraction(pressure, material))
        at = min(max(ASKED.contraction, ASKED.stroke / length), usable)
        rows.append({
            "rest_length": length, "pressure": pressure, "contraction": usable,
            "force": float(muscle.force(0.0, pressure, material)),
            "stroke": usable * length, "outer_diameter": float(muscle.outer_diameter(at)),
            "air": free_air(pair.bladder, muscle, at, pressure),
        })  # fmt: skip
        kept.append(
            rows[-1]["force"] >= ASKED.force
            and usable >= ASKED.contraction
            and rows[-1]["stroke"] >= ASKED.stroke
            and rows[-1]["outer_diameter"] <= ASKED.largest_diameter
            and length <= ASKED.longest_length
        )
    assert len(found.margins) == len(kept) == 2 * steps**2
    assert 5 < sum(kept) < len(kept)
    assert found.feasible.tolist() == np.flatnonzero(kept).tolist()
    for name in rows[0]:
        expected = [row[name] for row in rows]
        np.testing.assert_allclose(found.columns[name], expected, rtol=ROUNDING, err_msg=name)
    excluded = {row["constraint"]: row for row in exclusion_rows(found, system="si")}
    assert excluded["force"]["excluded"] == sum(row["force"] < ASKED.force for row in rows)
    assert excluded["longest_length"]["excluded"] == 2 * steps * 2  # two of five lengths
    costs = np.stack([found.columns[name] for name in found.objectives], axis=-1)
    for own in costs[found.front]:
        better = np.all(costs <= own, axis=-1) & np.any(costs < own, axis=-1)
        assert not better[found.feasible].any()


@pytest.mark.slow
def test_the_refined_design_keeps_to_everything_and_is_better(of_all):
    end, (first, *_) = of_all.refined, of_all.front
    assert end["gain"] > 0.01
    margins = {
        "force": end["force"] - ASKED.force,
        "contraction": end["contraction"] - ASKED.contraction,
        "stroke": end["stroke"] - ASKED.stroke,
        "largest_diameter": ASKED.largest_diameter - end["outer_diameter"],
        "longest_length": ASKED.longest_length - end["rest_length"],
    }
    assert min(margins.values()) >= 0
    assert PRESSURES[0] <= end["pressure"] <= PRESSURES[1]
    # What it is asked for it just reaches; a coarse grid does not hit that.
    assert end["stroke"] == pytest.approx(ASKED.stroke, rel=1e-6)
    assert end["force"] == pytest.approx(ASKED.force, rel=1e-6)
    assert of_all.columns["air"][first] > end["air"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pressure": 0.0}, "pressure must be > 0"),
        ({"force": -1.0}, "force must be >= 0"),
        ({"contraction": 35.0}, r"fraction in \[0, 1\), got 35\.0; 0\.35 is 35 %"),
        ({"force_contraction": math.nan}, "force_contraction must be a fraction"),
        ({"largest_diameter": 0.0}, "largest_diameter must be > 0"),
        ({"stroke": -1.0}, "stroke must be >= 0"),
        ({"longest_length": 0.0}, "longest_length must be > 0"),
        ({"rest_length": (0.2, 0.1)}, "range of the rest_length .* 0.2 to 0.1 m"),
        ({"pressure": (0.0, 2e5)}, "range of the pressure"),
        ({"pressure": (1e5, 2e6)}, "above the pressure of the requirement"),
        ({"objectives": ("width",)}, "one or more of outer_diameter, .*; got 'width'"),
        ({"objectives": ("air", "air")}, "each once"),
        ({"about": 0}, "about must be >= 1"),
        ({"catalogue": dataclasses.replace(load_catalogue(), tubes=())}, "no swage tubes: add"),
    ],
)  # fmt: skip
def test_an_impossible_requirement_or_search_is_refused(change, message):
    required = all(isinstance(value, float) for value in change.values())
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(ASKED, **change) if required else found_with(**change)


# --------------------------------------------------------------------------------------- the front
def dominated(costs):
    """By the definition: some other is nowhere worse and somewhere better."""
    nowhere_worse = np.all(costs[:, None] <= costs[None], axis=-1)
    better = np.any(costs[:, None] < costs[None], axis=-1)
    return np.any(nowhere_worse & better, axis=0)


@pytest.mark.parametrize("objectives", [1, 2, 3, 5])
def test_the_front_is_what_the_definition_says(objectives):
    costs = RNG.normal(size=(300, objectives))
    costs[:, 0] = np.round(costs[:, 0], 1)  # with ties
    found = front_members(costs)
    kept = np.flatnonzero(~dominated(costs))
    np.testing.assert_array_equal(np.unique(costs[found], axis=0), np.unique(costs[kept], axis=0))
    assert set(found) <= set(kept)


@pytest.mark.parametrize("step", [0.02, 0.3])
def test_a_thinned_front_is_part_of_the_front_and_within_the_step_of_all(step):
    costs = RNG.normal(size=(2000, 3))
    kept = front_members(costs, step)
    assert not dominated(costs)[kept].any()
    assert 3 < len(kept) < len(front_members(costs))
    near = np.all(costs[kept][None] <= costs[:, None] + np.log1p(step), axis=-1)
    assert near.any(axis=-1).all()
