import dataclasses
import itertools
import json
import math

import jax
import numpy as np
import pytest
from slow_cases import slow_after

from famjax import PolynomialMaterial, units
from famjax.design import (
    Combination,
    Requirement,
    SearchLimits,
    SearchRanges,
    TubeOptions,
    load_catalogue,
    search,
    search_space,
)
from famjax.design.space import (
    design_rows,
    exclusion_rows,
    search_document,
    summary,
)
from famjax.materials import NeoHookeanMaterial

INCH, PSI, LBF = units.INCH, units.PSI, units.LBF
ROUNDING = 1e-9  # relative, float64: the free contraction is bisected, forces near zero cancel
SINGLE = 2e-3  # relative, float32: the same, where a force is a small difference of two
ATMOSPHERE = 101325.0

ASKED = Requirement(100 * PSI, 400 * LBF, 0.15, 2.2 * INCH)
LIMITS = SearchLimits(stroke=2 * INCH, longest_length=18 * INCH)
RANGES = SearchRanges((4 * INCH, 24 * INCH), (20 * PSI, 100 * PSI))
LATEX = np.array([257.8, -57.9, 32.7]) * PSI


def found_with(**changes):
    catalogue = changes.pop("catalogue", None) or load_catalogue()
    options = {
        "requirement": ASKED, "ranges": RANGES, "limits": LIMITS, "about": 3000, "chunk": 1024,
        "material": PolynomialMaterial(LATEX), "refined_pairs": 0,
    }  # fmt: skip
    options |= changes
    return search_space(catalogue, options.pop("requirement"), **options)


def two_pairs():
    """The catalogue with two bladders and one braid."""
    catalogue = load_catalogue()
    names = ("bladder 0.875 in x 0.0625 in", "bladder 1 in x 0.125 in")
    return dataclasses.replace(
        catalogue,
        bladders=tuple(b for b in catalogue.bladders if b.name in names),
        braids=tuple(b for b in catalogue.braids if b.name == "Kevlar 2.0 in"),
        tests=(),
    )


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
    catalogue, material = two_pairs(), PolynomialMaterial(LATEX)
    steps = 5
    found = found_with(catalogue=catalogue, about=2 * steps**2, chunk=7, front_step=0.0)
    assert found.grid.total == 2 * steps**2
    rows, kept = [], []
    for pair, pressure, length in itertools.product(
        found.pairs,
        np.linspace(*RANGES.pressure, steps),
        np.linspace(*RANGES.rest_length, steps),
    ):
        muscle = Combination.of(pair.bladder, pair.braid, length)
        usable = float(muscle.usable_contraction(pressure, material))
        at = min(max(ASKED.contraction, LIMITS.stroke / length), usable)
        force = float(muscle.force(0.0, pressure, material))
        row = {
            "rest_length": length, "pressure": pressure, "force": force, "contraction": usable,
            "stroke": usable * length, "outer_diameter": float(muscle.outer_diameter(at)),
            "air": free_air(pair.bladder, muscle, at, pressure),
        }  # fmt: skip
        rows.append(row)
        kept.append(
            row["force"] >= ASKED.force
            and usable >= ASKED.contraction
            and row["stroke"] >= LIMITS.stroke
            and row["outer_diameter"] <= ASKED.largest_diameter
            and length <= LIMITS.longest_length
        )
    assert 5 < sum(kept) < len(kept)
    assert found.feasible == sum(kept)
    assert found.sample["index"].tolist() == np.flatnonzero(kept).tolist()
    for name in rows[0]:
        expected = [row[name] for row, keeps in zip(rows, kept, strict=True) if keeps]
        np.testing.assert_allclose(found.sample[name], expected, rtol=ROUNDING, err_msg=name)
    excluded = {one.constraint: one.excluded for one in found.exclusions}
    assert excluded["force"] == sum(row["force"] < ASKED.force for row in rows)
    assert excluded["longest_length"] == 2 * steps * 2  # two of five lengths
    # Nothing that is feasible is nowhere worse and somewhere better than a member of the front.
    costs = np.stack([found.sample[name] for name in found.objectives], axis=-1)
    for index in found.front["index"]:
        own = costs[found.sample["index"] == index]
        assert not np.any(np.all(costs <= own, axis=-1) & np.any(costs < own, axis=-1))


def test_at_one_length_and_pressure_it_is_the_search_of_the_catalogue():
    catalogue = load_catalogue()
    alone = search(catalogue, ASKED, material=PolynomialMaterial(LATEX))
    met = {(c.bladder.name, c.braid.name): c for c in alone if not c.failures}
    found = found_with(
        ranges=SearchRanges((0.3, 0.3), (100 * PSI, 100 * PSI)),
        limits=SearchLimits(end_fittings=False),
    )
    assert found.grid.total == len(found.pairs) == sum(c.force > 0 for c in alone)
    assert found.feasible == len(met) > 3
    for row in design_rows(found, found.sample):
        candidate = met[row["bladder"], row["braid"]]
        assert row["blocked_force_N"] == pytest.approx(candidate.blocked_force, rel=ROUNDING)
        assert row["contraction"] == pytest.approx(candidate.usable_contraction, rel=ROUNDING)
        assert row["outer_diameter_m"] == pytest.approx(candidate.outer_diameter, rel=ROUNDING)
        assert row["tube"] is None


@pytest.mark.slow
def test_what_is_found_does_not_depend_on_the_chunk():
    done = []
    one = found_with(chunk=4096, table_rows=200)
    other = found_with(chunk=300, table_rows=200, progress=lambda *both: done.append(both))
    for name in one.front:
        np.testing.assert_array_equal(one.front[name], other.front[name], err_msg=name)
        np.testing.assert_array_equal(one.sample[name], other.sample[name], err_msg=name)
    assert len(one.sample["index"]) == 200 < one.feasible == other.feasible
    assert one.exclusions == other.exclusions
    assert done[1] == (300, one.grid.total)
    assert done[-1] == (one.grid.total,) * 2


@pytest.mark.slow
def test_processes_find_the_same():
    one, other = found_with(), found_with(executor=2)
    for name, column in one.front.items():
        np.testing.assert_array_equal(other.front[name], column)
    assert one.exclusions == other.exclusions


def test_the_table_is_an_even_choice():
    found, all_of_them = found_with(table_rows=300), found_with()
    assert set(found.sample["index"]) < set(all_of_them.sample["index"])
    # The mean of 300 of them differs from that of all by a few standard errors at the most.
    for name in ("rest_length", "pressure", "force"):
        every = all_of_them.sample[name]
        error = np.std(every) / math.sqrt(300)
        assert abs(np.mean(found.sample[name]) - np.mean(every)) < 4 * error


@pytest.mark.slow
@pytest.mark.parametrize("made_to_order", [False, True])
def test_refined_designs_keep_to_everything_and_are_better(made_to_order):
    catalogue = load_catalogue()
    if made_to_order:
        braids = tuple(
            dataclasses.replace(braid, made_to_order_range=(1.4 * INCH, 2.6 * INCH))
            for braid in catalogue.braids
            if braid.name == "Kevlar 2.0 in"
        )
        catalogue = dataclasses.replace(two_pairs(), braids=braids)
    found = found_with(catalogue=catalogue, refined_pairs=2)
    assert [one.goal for one in found.refined] == ["balanced", *found.objectives]
    for one in found.refined:
        end = one.end
        assert end["force"] >= ASKED.force
        assert end["contraction"] >= ASKED.contraction
        assert end["stroke"] >= LIMITS.stroke
        assert end["outer_diameter"] <= ASKED.largest_diameter
        assert RANGES.rest_length[0] <= end["rest_length"] <= LIMITS.longest_length
        assert RANGES.pressure[0] <= end["pressure"] <= RANGES.pressure[1]
        assert one.gain >= 0
        if one.goal != "balanced":
            assert end[one.goal] <= one.start[one.goal] == found.front[one.goal].min()
            assert 1 - end[one.goal] / one.start[one.goal] == pytest.approx(one.gain)
    # The least air is where force and stroke are just reached; a coarse grid does not hit that.
    air = found.refined[-1]
    assert air.goal == "air"
    assert air.gain > 1e-3
    assert air.end["stroke"] == pytest.approx(LIMITS.stroke, rel=1e-6)
    if made_to_order:
        assert air.end["nominal_diameter"] != air.start["nominal_diameter"]
    else:
        assert air.end["force"] == pytest.approx(ASKED.force, rel=1e-6)


@pytest.mark.slow
def test_a_finer_grid_comes_near_to_what_is_refined():
    coarse = found_with(catalogue=two_pairs(), about=400, refined_pairs=2)
    fine = found_with(catalogue=two_pairs(), about=40_000, chunk=8192)
    for one in coarse.refined[1:]:
        best = fine.front[one.goal].min()
        assert one.end[one.goal] <= best * (1 + ROUNDING)
        assert one.end[one.goal] > 0.97 * best  # 141 steps an axis, 1 % of front


def test_a_braid_made_to_order_is_searched_at_every_angle_that_does_not_jam():
    catalogue = two_pairs()
    (braid,) = catalogue.braids
    woven = dataclasses.replace(braid, made_to_order_range=(1.0 * INCH, 4.0 * INCH))
    found = found_with(catalogue=dataclasses.replace(catalogue, braids=(woven,)))
    assert (found.grid.counts[:, 0] > 5).all()
    angle = found.sample["braid_angle"]
    assert angle.min() < found_with(catalogue=catalogue).sample["braid_angle"].min()
    diameter = np.array([pair.bladder.diameter for pair in found.pairs])[found.sample["pair"]]
    nominal = found.sample["nominal_diameter"]
    np.testing.assert_allclose(np.cos(angle), diameter / nominal / math.sqrt(2), rtol=ROUNDING)
    share = diameter / nominal
    smallest, largest = (limit / braid.nominal_diameter for limit in braid.diameter_range)
    assert share.min() >= smallest * (1 - ROUNDING)
    assert share.max() <= largest * (1 + ROUNDING)


def test_safety_factors_are_those_of_the_tests_threads_and_tubes():
    limits = dataclasses.replace(LIMITS, burst_factor=3.0, pull_factor=2.0, thread_factor=5.0)
    found = found_with(limits=limits, tube=TubeOptions(yield_stress=40e3 * PSI))
    (pair,) = found.pairs  # the one that was tested
    assert found.left_out == {"braid": 21, "end_fitting": 13, "untested": 10}
    sample = found.sample
    np.testing.assert_allclose(sample["burst_factor"], 280 * PSI / sample["pressure"], rtol=1e-12)
    force, pressure = sample["blocked_force"], sample["pressure"]
    np.testing.assert_allclose(sample["pull_factor"], 2147 * LBF / force, rtol=1e-12)
    carried = force + pressure * math.pi / 4 * pair.bladder.diameter**2
    tension = carried / (144 * np.sin(sample["braid_angle"]))
    np.testing.assert_allclose(sample["thread_factor"], 59.3 * LBF / tension, rtol=1e-12)
    assert pair.tube == "tube 1 in x 0.065 in"
    section = math.pi * 0.065 * (1 - 0.065) * INCH**2
    np.testing.assert_allclose(sample["tube_factor"], section * 40e3 * PSI / force, rtol=1e-12)
    for name in ("burst_factor", "pull_factor", "thread_factor"):
        assert sample[name].min() >= getattr(limits, name)
    assert {"burst_factor", "pull_factor"} <= {one.constraint for one in found.exclusions}


@pytest.mark.slow
def test_the_rubber_of_a_bladder_is_the_catalogues_where_it_is_known():
    catalogue = two_pairs()
    stiff, known = (3e6, 1e6), catalogue.bladders[0]
    bladders = (dataclasses.replace(known, coefficients=stiff), *catalogue.bladders[1:])
    mixed = dataclasses.replace(catalogue, bladders=bladders)
    for material in (None, PolynomialMaterial(LATEX)):
        alone = {
            c.bladder.name: c.usable_contraction for c in search(mixed, ASKED, material=material)
        }
        found = found_with(
            catalogue=mixed, material=material, limits=SearchLimits(),
            requirement=Requirement(100 * PSI, 0.0, 0.0),
            ranges=SearchRanges((0.3, 0.3), (100 * PSI, 100 * PSI)), refined_pairs=2,
        )  # fmt: skip
        for row in design_rows(found, found.sample):
            assert row["contraction"] == pytest.approx(alone[row["bladder"]], rel=ROUNDING)
        expected = Combination.of(known, catalogue.braids[0]).usable_contraction(
            100 * PSI, PolynomialMaterial(list(stiff))
        )
        assert alone[known.name] == pytest.approx(float(expected), rel=ROUNDING)
        soft = search(catalogue, ASKED, material=material)
        assert alone[known.name] < next(
            c.usable_contraction for c in soft if c.bladder.name == known.name
        )
    with pytest.raises(ValueError, match="give a PolynomialMaterial"):
        found_with(catalogue=mixed, material=NeoHookeanMaterial(3e5))


def test_a_pressure_that_does_not_move_the_bladder_makes_no_design():
    found = found_with(
        requirement=Requirement(2 * PSI, 1.0, 0.0),
        ranges=SearchRanges((0.2, 0.4), (0.01 * PSI, 2 * PSI)), limits=SearchLimits(),
    )  # fmt: skip
    moved = found.grid.total - max(one.excluded for one in found.exclusions)
    assert 0 < found.feasible <= moved < found.grid.total
    assert {one.constraint for one in found.exclusions} <= {"force", "contraction"}
    assert np.isfinite(found.sample["outer_diameter"]).all()
    json.dumps(search_document(found), allow_nan=False)


@pytest.mark.parametrize("longest", slow_after(1, [18 * INCH, 0.3, 1 / 3]))
def test_a_length_at_its_limit_keeps_to_it(longest):
    ranges = SearchRanges((longest / 4, longest), RANGES.pressure)
    found = found_with(ranges=ranges, limits=SearchLimits(longest_length=longest), about=600)
    assert found.sample["rest_length"].max() == longest
    assert "longest_length" not in {one.constraint for one in found.exclusions}


def test_pairs_at_the_boundary_are_named():
    found = found_with(limits=SearchLimits(end_fittings=False), front_step=0.0)
    rows = design_rows(found, found.sample)
    boundary = {(r["bladder"], r["braid"]) for r in rows if r["feasibility"] == "boundary"}
    assert ("bladder 1 in x 0.0625 in", "Kevlar 2.5 in") in boundary
    assert ("bladder 0.875 in x 0.0625 in", "Kevlar 2.0 in") not in boundary


def test_force_may_be_asked_for_at_a_travel():
    limits = dataclasses.replace(LIMITS, force_stroke=1.5 * INCH)
    found = found_with(catalogue=two_pairs(), limits=limits, about=200)
    for row in design_rows(found, found.sample)[::7]:
        pair = next(p for p in found.pairs if p.bladder.name == row["bladder"])
        muscle = Combination.of(pair.bladder, pair.braid, row["rest_length_m"])
        force = muscle.force(
            limits.force_stroke / row["rest_length_m"], row["pressure_Pa"],
            PolynomialMaterial(LATEX),
        )  # fmt: skip
        assert row["force_N"] == pytest.approx(float(force), rel=ROUNDING)
        assert row["blocked_force_N"] > row["force_N"] >= ASKED.force


@pytest.mark.slow
@pytest.mark.parametrize("law", [lambda: None, lambda: PolynomialMaterial(LATEX)])
def test_single_precision_finds_the_same(law):
    double = found_with(material=law(), refined_pairs=1)
    with jax.enable_x64(False):
        single = found_with(material=law(), refined_pairs=1)
    assert single.front["force"].dtype == np.float32
    assert single.feasible == pytest.approx(double.feasible, rel=0.01)  # those at a limit
    same, of_double, of_single = np.intersect1d(
        double.sample["index"], single.sample["index"], return_indices=True
    )
    assert len(same) > 0.98 * double.feasible
    for name in ("force", "contraction", "outer_diameter", "air"):
        np.testing.assert_allclose(
            single.sample[name][of_single], double.sample[name][of_double], rtol=SINGLE
        )
    for one, other in zip(single.refined, double.refined, strict=True):
        assert one.end["force"] >= np.float32(ASKED.force)
        if one.goal != "balanced":
            assert one.end[one.goal] == pytest.approx(other.end[one.goal], rel=5 * SINGLE)


# ----------------------------------------------------------------------------- nothing is feasible
def test_where_nothing_is_feasible_it_says_why_and_what_comes_nearest():
    asked = dataclasses.replace(ASKED, force=3000 * LBF)
    found = found_with(requirement=asked)
    assert (found.feasible, found.front, found.sample, found.refined) == (0, {}, {}, ())
    first = found.exclusions[0]
    assert (first.constraint, first.limit) == ("force", 3000 * LBF)
    assert first.excluded == found.grid.total
    # The strongest candidate is the nearest to the force; others fail the candidate that is nearest.
    (row,) = design_rows(found, found.nearest, system="us")
    assert row["force_lbf"] <= first.closest / LBF < 3000
    said = summary(found, system="us")
    assert said[0].startswith("0 of 2,992 candidates, of 11 pairs of bladder and braid")
    assert "21: the braid does not fit the bladder, 13: no swage tube" in said[1]
    assert f"2,992 fail the force, {first.alone:,} of them that alone" in said[2]
    assert "asked for is at least 3000 lbf, the best of all is 1728 lbf" in said[2]
    assert said[-1].startswith("Nearest miss, by 4")
    assert "force 1728 lbf, not at least 3000 lbf" in said[-1]
    json.dumps(search_document(found, system="us"), allow_nan=False)


def test_the_nearest_miss_has_the_least_worst_shortfall():
    asked = dataclasses.replace(ASKED, force=1000 * LBF)
    limits = dataclasses.replace(LIMITS, longest_length=6 * INCH)
    found = found_with(requirement=asked, limits=limits, about=500)
    every = found_with(
        requirement=Requirement(100 * PSI, 0.0, 0.0), limits=SearchLimits(stroke=1e-6), about=500
    ).sample
    assert len(every["index"]) == found.grid.total

    def used(contraction, row):
        pair = found.pairs[row["pair"]]
        muscle = Combination.of(pair.bladder, pair.braid, row["rest_length"])
        return float(muscle.outer_diameter(contraction))

    least = math.inf
    for at in range(len(every["index"])):
        row = {name: values[at] for name, values in every.items()}
        shares = [
            1 - row["force"] / asked.force,
            1 - row["contraction"] / asked.contraction,
            1 - row["stroke"] / limits.stroke,
            row["rest_length"] / limits.longest_length - 1,
        ]
        if max(shares) >= least:
            continue
        at_stroke = max(asked.contraction, limits.stroke / row["rest_length"])
        wide = used(min(at_stroke, row["contraction"]), row) / asked.largest_diameter - 1
        least = min(least, max(*shares, wide))
    assert found.nearest["shortfall"] == pytest.approx(least, rel=1e-6)
    assert found.nearest["shortfall"] > 0


def test_a_catalogue_of_which_nothing_can_be_built_is_said():
    catalogue = load_catalogue()
    narrow = dataclasses.replace(catalogue, bladders=catalogue.bladders[:1])
    found = found_with(catalogue=dataclasses.replace(narrow, tests=()))
    assert found.grid.total == found.feasible == 0
    assert "Pairs left out: 3: the braid does not fit the bladder." in summary(found)
    assert exclusion_rows(found) == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"objectives": ("width",)}, "one or more of outer_diameter, .*; got 'width'"),
        ({"objectives": ()}, "got none"),
        ({"about": 0}, "about must be >= 1, got 0"),
        ({"front_step": 1.0}, "front_step must be in"),
        ({"ranges": SearchRanges((0.1, 0.2), (1e5, 8e5))}, "above the pressure of the requirement"),
    ],
)
def test_what_cannot_be_searched_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        found_with(**changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SearchRanges((0.2, 0.1), (1e5, 2e5)), "range of the rest_length .* 0.2 to 0.1 m"),
        (lambda: SearchRanges((0.1, 0.2), (0.0, 2e5)), "range of the pressure"),
        (lambda: SearchLimits(stroke=-1.0), "stroke must be >= 0"),
        (lambda: SearchLimits(longest_length=0.0), "longest_length must be > 0"),
        (lambda: SearchLimits(tube_factor=2.0, end_fittings=False), "needs the end-fittings"),
    ],
)
def test_impossible_limits_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_catalogue_without_tubes_is_searched_without_end_fittings_only():
    bare = dataclasses.replace(load_catalogue(), tubes=())
    with pytest.raises(ValueError, match="no swage tubes: add"):
        found_with(catalogue=bare)
    found = found_with(catalogue=bare, limits=SearchLimits(end_fittings=False))
    assert np.isnan(found.front["tube_factor"]).all()


def test_a_front_at_the_end_of_a_range_is_said():
    notes = found_with(limits=SearchLimits()).notes
    assert any("of the front has the least rest length of its range" in note for note in notes)
    assert "yield stress of swage tubes is assumed" in notes[0]
