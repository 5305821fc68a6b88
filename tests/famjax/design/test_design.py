"""Catalogues, combinations, end fittings and the search, against tables, loops and virtual work."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

import famjax
from famjax import Muscle, units
from famjax.boundary.errors import InputError
from famjax.braids import gaylord_force
from famjax.design import Combination, Requirement, fam_angle, front_members, load_catalogue, search
from famjax.design.search import LATEX

INCH, PSI, LBF = units.INCH, units.PSI, units.LBF

# Table 2.2: nominal diameter, thickness, diameter range [in], angle range [deg].
TABLE_2_2 = [
    (1.5, 0.012, (0.60, 1.75), (73.6, 34.4)),
    (2.0, 0.011, (0.76, 2.23), (74.4, 38.0)),
    (2.5, 0.018, (1.40, 2.65), (66.7, 41.5)),
]
BRAID = """
source = "a vendor"
[[braid]]
name = "PET 20 mm"
nominal_diameter_mm = 20
thickness_mm = 0.5
diameter_range_mm = [10, 25]
"""
BLADDER = """
source = "a vendor"
[[bladder]]
diameter_mm = 12
thickness_mm = 1
name = "thin"
[[bladder]]
diameter_mm = 12
thickness_mm = 2
name = "thick"
"""
TUBE = """
source = "a vendor"
[[tube]]
name = "steel"
outer_diameter_mm = 25
thickness_mm = 1.5
swage_reduction_mm = 0.7
"""


def read(tmp_path, text, *, bundled=False):
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return load_catalogue([path], bundled=bundled)


def test_bundled_braids_are_those_of_table_2_2():
    found = load_catalogue().braids
    for braid, (nominal, thickness, diameters, angles) in zip(found, TABLE_2_2, strict=True):
        assert braid.nominal_diameter == pytest.approx(nominal * INCH)
        assert braid.thickness == pytest.approx(thickness * INCH)
        assert braid.diameter_range == pytest.approx([d * INCH for d in diameters])
        at = [fam_angle(d, braid.nominal_diameter) for d in braid.diameter_range]
        assert np.rad2deg(at) == pytest.approx(angles, abs=LAST_DIGIT)


def test_a_users_file_can_replace_the_bundled_catalogue(tmp_path):
    catalogue = read(tmp_path, BLADDER)
    assert (catalogue.braids, catalogue.tubes) == ((), ())
    assert [b.bore for b in catalogue.bladders] == pytest.approx([0.010, 0.008])


@pytest.mark.parametrize(
    ("text", "old", "new", "message"),
    [
        (BRAID, "thickness_mm", "thickness", "number 1 .'PET 20 mm'.: unknown key 'thickness'; .*.in>"),
        (BRAID, "thickness_mm", "wall_mm", "unknown key 'wall_mm'; thickness_<m.*> is missing"),
        (BRAID, "[10, 25]", "[25, 10]", r"\[smallest, largest\]"),
        (BRAID, "[10, 25]", "[21, 25]", "contain the nominal diameter"),
        (BRAID, "[10, 25]", "[10, 30]", "where the threads run around"),
        (BRAID, "[[braid]]", "[[braids]]", "unknown key 'braids'; valid keys: source, braid"),
        (BRAID, "[[braid]]", "[braid]", "below a"),
        (BRAID, "thickness_mm = 0.5", "thickness_mm 0.5", "must be a TOML file"),
        (BLADDER, "thickness_mm = 2", "thickness_mm = 6", "twice the wall thickness must be"),
        (BLADDER, "thick\"", "thin\"", "appears twice"),
        (TUBE, "swage_reduction_mm = 0.7", "swage_reduction_mm = 23", "twice the wall thickness must be"),
    ],
)  # fmt: skip
def test_a_wrong_row_is_refused_with_the_reason(tmp_path, text, old, new, message):
    assert old in text
    with pytest.raises(InputError, match=message):
        read(tmp_path, text.replace(old, new))


ROUNDING = 1e-12  # relative, float64: a dozen operations
LAST_DIGIT = 0.0501  # deg; half of the last printed digit, and float noise

# Table 2.3: the printed angle, "" where the combination is infeasible.
DIAMETERS = (1.0, 0.875, 0.75, 0.625)
TABLE_2_3 = {
    "Kevlar 1.5 in": ("61.9", "65.6", "69.3", "72.9"),
    "Kevlar 2.0 in": ("69.3", "72.0", "74.6", ""),
    "Kevlar 2.5 in": ("73.6", "", "", ""),
}
ENTRIES = [
    (name, *one) for name, row in TABLE_2_3.items() for one in zip(DIAMETERS, row, strict=True)
]


def braid_named(name):
    return next(braid for braid in load_catalogue().braids if braid.name == name)


def the_7_8_in():
    bladders = {bladder.name: bladder for bladder in load_catalogue().bladders}
    bladder = bladders["bladder 0.875 in x 0.0625 in"]
    return Combination.of(bladder, braid_named("Kevlar 2.0 in"), LATEX)


@pytest.mark.parametrize(("name", "diameter", "printed"), ENTRIES)
def test_table_2_3(name, diameter, printed):
    braid = braid_named(name)
    angle = math.degrees(fam_angle(diameter * INCH, braid.nominal_diameter))
    assert braid.fits(diameter * INCH) == bool(printed)
    assert not printed or abs(angle - float(printed)) < LAST_DIGIT


def test_a_combination_jams_at_its_largest_diameter_and_pulls_as_its_muscle():
    combination = the_7_8_in()
    greatest = combination.jam_contraction
    wide = combination.outer_diameter(greatest) - 2 * combination.braid_thickness
    assert wide == pytest.approx(2.23 * INCH, rel=ROUNDING)
    # 38.0 deg printed, steeper than the neutral angle: this braid jams before it runs out of force.
    expected = 1 - math.sin(math.acos(2.23 / 8**0.5)) / math.sin(math.acos(0.875 / 8**0.5))
    assert greatest == pytest.approx(expected, rel=ROUNDING)
    assert combination.usable_contraction(1000 * PSI) == greatest
    assert np.isnan(combination.outer_diameter(greatest + 1e-6))
    assert np.isnan(combination.force(greatest + 1e-6, 100 * PSI))
    # Its force with a bladder is the muscle's.
    muscle = combination.muscle
    assert isinstance(muscle, Muscle)
    length = combination.rest_length * (1 - 0.2)
    force = float(combination.force(0.2, 60 * PSI))
    assert force == pytest.approx(float(muscle.force(length, 60 * PSI)), rel=ROUNDING)
    # At rest the bladder is unstrained and the blocked force that of the braid alone.
    alone = gaylord_force(60 * PSI, combination.bladder_diameter / 2, combination.braid_angle)
    assert combination.force(0.0, 60 * PSI) == pytest.approx(float(alone), rel=ROUNDING)


THOUSANDTH = 0.001  # in; the published diameters' last digit, and what a lathe holds
THIN, WALL = 0.011, 0.0625  # in, the 7/8 in muscle's


def test_fitting_diameters_come_within_a_thousandth_of_the_published_ones():
    bore = famjax.design.swaged_bore(1.0, 0.058, 0.027)
    on_braid = famjax.design.fitting_diameter_on_braid(bore, THIN, 0.17)
    on_bladder = famjax.design.fitting_diameter_on_bladder(bore, THIN, WALL, 0.30)
    assert (on_braid, on_bladder) == pytest.approx((0.838, 0.748), abs=THOUSANDTH)


def test_only_a_tube_of_0p058_in_or_more_lets_the_fitting_into_the_bore():
    catalogue = load_catalogue()
    wide = [one for one in catalogue.bladders if one.diameter == pytest.approx(0.875 * INCH)]
    sized = (famjax.design.size_end_fittings(catalogue, catalogue.braids[1], one) for one in wide)
    found = [*itertools.chain.from_iterable(sized)]
    assert len(found) == 4 * 3
    fits = [(f.tube.thickness / INCH, f.bladder.thickness / INCH) for f in found if f.feasible]
    np.testing.assert_allclose(fits, [(0.058, 0.0625), (0.065, 0.0625)])
    for fitting in found:
        bore = fitting.bladder.diameter - 2 * fitting.bladder.thickness
        ratio = fitting.diameter_on_bladder / bore
        assert ratio == pytest.approx(1 + fitting.bore_stretch, rel=ROUNDING)
        assert fitting.feasible == (fitting.diameter_on_bladder <= bore)


SOLVED = 1e-9  # relative, float64: the usable contraction is bisected, forces near zero cancel
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
    catalogue = load_catalogue()
    names = ("bladder 0.875 in x 0.0625 in", "bladder 1 in x 0.125 in")
    bladders = tuple(b for b in catalogue.bladders if b.name in names)
    return dataclasses.replace(catalogue, bladders=bladders, braids=(braid_named("Kevlar 2.0 in"),))


def free_air(bladder, combination, contraction, pressure):
    """By hand: a cylinder less the rubber."""
    length = float(combination.rest_length)
    rubber = math.pi * (bladder.diameter - bladder.thickness) * bladder.thickness * length

    def volume(at):
        wide = float(combination.outer_diameter(at)) - 2 * float(combination.braid_thickness)
        return math.pi / 4 * wide**2 * length * (1 - at) - rubber

    full, empty = volume(contraction), volume(0.0)
    return ((pressure + ATMOSPHERE) * full - ATMOSPHERE * empty) / ATMOSPHERE


@pytest.mark.slow
def test_a_tiny_space_is_what_a_loop_over_it_finds():
    steps = 5
    found = found_with(catalogue=two_pairs(), about=2 * steps**2)
    rows, kept = [], []
    for pair, pressure, length in itertools.product(
        found.pairs, np.linspace(*PRESSURES, steps), np.linspace(*LENGTHS, steps)
    ):
        muscle = Combination.of(pair.bladder, pair.braid, LATEX)
        muscle = dataclasses.replace(muscle, rest_length=length)
        usable = float(muscle.usable_contraction(pressure))
        at = min(max(ASKED.contraction, ASKED.stroke / length), usable)
        rows.append({
            "rest_length": length, "pressure": pressure, "contraction": usable,
            "force": float(muscle.force(0.0, pressure)),
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
        np.testing.assert_allclose(found.columns[name], expected, rtol=SOLVED, err_msg=name)
    excluded = {row["constraint"]: row for row in famjax.design.exclusion_rows(found, system="si")}
    assert excluded["force"]["excluded"] == sum(row["force"] < ASKED.force for row in rows)
    assert excluded["longest_length"]["excluded"] == 2 * steps * 2  # two of five lengths
    costs = np.stack([found.columns[name] for name in found.objectives], axis=-1)
    for own in costs[found.front]:
        better = np.all(costs <= own, axis=-1) & np.any(costs < own, axis=-1)
        assert not better[found.feasible].any()


@pytest.mark.slow
def test_the_refined_design_keeps_to_everything_and_is_better():
    of_all = found_with()
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
    card = famjax.design.design_card(of_all)
    pull = card.muscle.force(end["rest_length"] - ASKED.stroke / 2, end["pressure"])
    own = of_all.muscle.force(end["rest_length"] - ASKED.stroke / 2, end["pressure"])
    assert pull == pytest.approx(float(own), rel=1e-6)
    assert card.muscle.force(end["rest_length"], end["pressure"]) == pytest.approx(
        end["force"], rel=1e-5
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pressure": 0.0}, "pressure must be > 0"),
        ({"force": -1.0}, "force must be >= 0"),
        ({"contraction": 35.0}, r"fraction in \[0, 1\), got 35\.0; 0\.35 is 35 %"),
        ({"force_contraction": math.nan}, "force_contraction must be a fraction"),
        ({"force_stroke": -0.01}, "force_stroke must be >= 0"),
        ({"largest_diameter": 0.0}, "largest_diameter must be > 0"),
        ({"stroke": -1.0}, "stroke must be >= 0"),
        ({"longest_length": 0.0}, "longest_length must be > 0"),
        ({"rest_length": (0.2, 0.1)}, "rest_length range .* 0.2 to 0.1 m"),
        ({"pressure": (0.0, 2e5)}, "the pressure range must"),
        ({"pressure": (1e5, 2e6)}, "above the required supply pressure"),
        ({"objectives": ("width",)}, "one or more of outer_diameter, .*; got 'width'"),
        ({"objectives": ("air", "air")}, "each at most once"),
        ({"about": 0}, "about must be >= 1"),
        ({"catalogue": dataclasses.replace(load_catalogue(), tubes=())}, "no swage tubes: add"),
    ],
)  # fmt: skip
def test_an_impossible_requirement_or_search_is_refused(change, message):
    required = all(isinstance(value, float) for value in change.values())
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(ASKED, **change) if required else found_with(**change)


def test_a_load_over_a_stroke_is_the_force_at_its_end():
    required = Requirement(PRESSURES[1], force=200.0, force_stroke=0.03, force_contraction=0.01)
    found = search(two_pairs(), required, rest_length=LENGTHS, about=8)
    for row in range(8):
        at = {name: column[row] for name, column in found.columns.items()}
        pair = found.pairs[int(at["pair"])]
        muscle = Combination.of(pair.bladder, pair.braid, LATEX)
        expected = float(muscle.force(0.03 / at["rest_length"], at["pressure"]))
        assert at["force"] == pytest.approx(expected, rel=SOLVED)


# ---- the front


def dominated(costs):
    """By the definition: some other is nowhere worse and somewhere better."""
    nowhere_worse = np.all(costs[:, None] <= costs[None], axis=-1)
    return np.any(nowhere_worse & np.any(costs[:, None] < costs[None], axis=-1), axis=0)


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
