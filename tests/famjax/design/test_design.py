import math

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from famjax import PolynomialMaterial, units
from famjax.design import (
    Combination,
    Feasibility,
    fam_angle,
    feasibility,
    fitting_diameter_on_bladder,
    fitting_diameter_on_braid,
    load_catalogue,
    size_end_fittings,
    swaged_bore,
)

INCH, PSI, LBF = units.INCH, units.PSI, units.LBF
ROUNDING = 1e-12  # relative, float64: a dozen operations
LAST_DIGIT = 0.0501  # deg; half of the last printed digit, and float noise

# Table 2.3: the printed angle, "" where the combination is infeasible.
DIAMETERS = (1.0, 0.875, 0.75, 0.625)
TABLE_2_3 = {
    "Kevlar 1.5 in": ("61.9", "65.6", "69.3", "72.9"),
    "Kevlar 2.0 in": ("69.3", "72.0", "74.6", ""),
    "Kevlar 2.5 in": ("73.6", "", "", ""),
}
# Printed in table 2.3 although outside the range of table 2.2.
BOUNDARY = {("Kevlar 2.0 in", 0.75), ("Kevlar 2.5 in", 1.0)}
ENTRIES = [
    (name, diameter, printed)
    for name, row in TABLE_2_3.items()
    for diameter, printed in zip(DIAMETERS, row, strict=True)
]


def braid_named(name):
    return next(braid for braid in load_catalogue().braids if braid.name == name)


def bladder_of(diameter_in, thickness_in=0.0625):
    return next(
        bladder
        for bladder in load_catalogue().bladders
        if bladder.name == f"bladder {diameter_in:g} in x {thickness_in:g} in"
    )


def the_7_8_in(rest_length=9.28125 * INCH):
    return Combination.of(bladder_of(0.875), braid_named("Kevlar 2.0 in"), rest_length)


def latex():
    return PolynomialMaterial(np.array([257.8, -57.9, 32.7]) * PSI)


@pytest.mark.parametrize(("name", "diameter", "printed"), ENTRIES)
def test_table_2_3(name, diameter, printed):
    braid = braid_named(name)
    angle = math.degrees(fam_angle(diameter * INCH, braid.nominal_diameter))
    verdict = feasibility(diameter * INCH, braid)
    if not printed:
        assert verdict is Feasibility.INFEASIBLE
        return
    assert abs(angle - float(printed)) < LAST_DIGIT
    boundary = (name, diameter) in BOUNDARY
    assert verdict is (Feasibility.BOUNDARY if boundary else Feasibility.FEASIBLE)


def test_ideal_force_is_the_virtual_work_of_the_pressure():
    combination = the_7_8_in()
    braid, length, pressure = combination.braid, combination.rest_length, 100 * PSI

    def volume(length):
        return math.pi / 4 * braid.diameter(length) ** 2 * length

    for contraction in (-0.01, 0.0, 0.1, 0.3):
        work = -pressure * jax.jit(jax.grad(volume))(length * (1 - contraction))
        assert combination.force(contraction, pressure) == pytest.approx(float(work), rel=1e-11)


def test_the_braid_jams_at_its_largest_diameter_and_not_before():
    combination = the_7_8_in()
    least, greatest = combination.contraction_range()
    assert combination.diameter(greatest) == pytest.approx(2.23 * INCH, rel=ROUNDING)
    assert combination.diameter(least) == pytest.approx(0.76 * INCH, rel=ROUNDING)
    # 38.0 deg printed, steeper than the neutral angle: this braid jams before it runs out of force.
    expected = 1 - math.sin(math.acos(2.23 / 8**0.5)) / math.sin(math.acos(0.875 / 8**0.5))
    assert greatest == pytest.approx(expected, rel=ROUNDING)
    assert combination.usable_contraction(100 * PSI) == greatest
    for beyond in (greatest + 1e-6, least - 1e-6):
        assert np.isnan(combination.diameter(beyond))
        assert np.isnan(combination.force(beyond, 100 * PSI))


def test_force_with_a_bladder_is_the_muscles():
    combination, material = the_7_8_in(), latex()
    muscle = combination.muscle(material)
    length = combination.rest_length * (1 - 0.2)
    assert combination.force(0.2, 60 * PSI, material) == pytest.approx(
        float(muscle.force(length, 60 * PSI)), rel=ROUNDING
    )
    # At rest the bladder is unstrained and the blocked force that of the braid alone.
    assert combination.force(0.0, 60 * PSI, material) == pytest.approx(
        float(combination.force(0.0, 60 * PSI)), rel=ROUNDING
    )
    assert combination.force(0.2, 60 * PSI, material) < combination.force(0.2, 60 * PSI)


@pytest.mark.slow
def test_usable_contraction_with_a_bladder_ends_where_the_force_does():
    combination, material = the_7_8_in(), latex()
    pressures = np.array([20.0, 60.0]) * PSI
    usable = combination.usable_contraction(pressures, material)
    blocked = combination.force(0.0, pressures, material)
    # The root is bisected to 1e-15 of the rest length; the force falls by some blocked / 0.3.
    assert np.all(np.abs(combination.force(usable, pressures, material)) < 1e-10 * blocked)
    assert np.all(np.diff(usable) > 0)


def test_gradients_are_finite_at_rest_at_the_jam_and_beyond():
    combination = the_7_8_in()
    slope = jax.jit(jax.grad(combination.force))
    greatest = combination.contraction_range()[1]
    assert np.isfinite(slope(0.0, 100 * PSI))
    assert np.isfinite(slope(greatest, 100 * PSI))
    total = jax.grad(lambda c: jnp.nansum(combination.force(c, 100 * PSI)))(
        jnp.array([0.0, 0.2, 0.5, -3.0])
    )
    assert np.all(np.isfinite(total))


THOUSANDTH = 0.001  # in; the published diameters' last digit, and what a lathe holds
BRAID, BLADDER = 0.011, 0.0625  # in, the 7/8 in muscle's


def test_fitting_diameters_come_within_a_thousandth_of_the_published_ones():
    bore = swaged_bore(1.0, 0.058, 0.027)
    assert abs(fitting_diameter_on_braid(bore, BRAID, 0.17) - 0.838) < THOUSANDTH
    assert abs(fitting_diameter_on_bladder(bore, BRAID, BLADDER, 0.30) - 0.748) < THOUSANDTH


def test_only_a_tube_of_0p058_in_or_more_lets_the_fitting_into_the_bore():
    catalogue = load_catalogue()
    found = size_end_fittings(catalogue, catalogue.braids[1], 0.875 * INCH)
    assert len(found) == 4 * 3
    fits = [(f.tube.thickness / INCH, f.bladder.thickness / INCH) for f in found if f.feasible]
    np.testing.assert_allclose(fits, [(0.058, 0.0625), (0.065, 0.0625)])
    for fitting in found:
        bore = fitting.bladder.diameter - 2 * fitting.bladder.thickness
        ratio = fitting.diameter_on_bladder / bore
        assert ratio == pytest.approx(1 + fitting.bore_stretch, rel=ROUNDING)
        assert fitting.feasible == (fitting.diameter_on_bladder <= bore)
