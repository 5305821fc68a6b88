import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax import units
from famjax.design import (
    bladder_compression,
    braid_compression,
    compression_sensitivity,
    end_fitting_rows,
    fitting_diameter_on_bladder,
    fitting_diameter_on_braid,
    load_catalogue,
    size_end_fittings,
    swaged_bore,
    swaged_thickness,
)

INCH = units.INCH
THOUSANDTH = 0.001  # in; the published diameters' last digit, and what a lathe holds
ROUNDING = 1e-12  # relative, float64: a dozen operations
BRAID, BLADDER = 0.011, 0.0625  # in, the 7/8 in muscle's


def test_the_swaged_tube_has_the_published_diameters():
    assert swaged_bore(1.0, 0.058, 0.027) + 2 * 0.058 == pytest.approx(0.973, rel=ROUNDING)


def test_fitting_diameters_come_within_a_thousandth_of_the_published_ones():
    bore = swaged_bore(1.0, 0.058, 0.027)
    assert abs(fitting_diameter_on_braid(bore, BRAID, 0.17) - 0.838) < THOUSANDTH
    assert abs(fitting_diameter_on_bladder(bore, BRAID, BLADDER, 0.30) - 0.748) < THOUSANDTH


def test_compressions_are_the_inverses_of_the_sizing():
    bore = 0.857
    on_braid = fitting_diameter_on_braid(bore, BRAID, 0.27)
    on_bladder = fitting_diameter_on_bladder(bore, BRAID, BLADDER, 0.3)
    assert braid_compression(bore, on_braid, BRAID) == pytest.approx(0.27, rel=1e-11)
    assert bladder_compression(bore, on_bladder, BRAID, BLADDER) == pytest.approx(0.3, rel=1e-11)


def test_the_layers_fill_the_gap_between_fitting_and_tube():
    bore = 0.857
    fitting = fitting_diameter_on_bladder(bore, BRAID, BLADDER, 0.3)
    assert fitting + 2 * (BRAID + 0.7 * BLADDER) == pytest.approx(bore, rel=ROUNDING)


def test_sensitivity_is_the_published_one_and_the_finite_difference():
    per_radius = compression_sensitivity(0.857, 0.838, BRAID)
    assert per_radius == pytest.approx(1 / BRAID, rel=ROUNDING)
    assert round(float(per_radius) * THOUSANDTH, 2) == 0.09
    step = 1e-4  # the rule is linear in the diameter, so any step does
    change = braid_compression(0.857, 0.838 + 2 * step, BRAID) - braid_compression(
        0.857, 0.838, BRAID
    )
    assert per_radius == pytest.approx(float(change) / step, rel=1e-9)


def test_sensitivity_broadcasts():
    bores, fittings = jnp.linspace(0.84, 0.9, 3), jnp.linspace(0.8, 0.83, 2)[:, None]
    found = jax.jit(compression_sensitivity)(bores, fittings, BRAID)
    np.testing.assert_allclose(found, np.full((2, 3), 1 / BRAID), rtol=ROUNDING)


def test_the_wall_that_keeps_its_section_has_the_same_section():
    thick = swaged_thickness(1.0, 0.058, 0.027)
    assert thick * (0.973 - thick) == pytest.approx(0.058 * (1.0 - 0.058), rel=ROUNDING)
    assert thick > 0.058
    assert swaged_thickness(1.0, 0.058, 0.0) == pytest.approx(0.058, rel=ROUNDING)
    assert np.isnan(swaged_thickness(1.0, 0.3, 0.5))


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


def test_an_allowed_stretch_of_the_bore_admits_thinner_tubes():
    catalogue = load_catalogue()
    found = size_end_fittings(
        catalogue, catalogue.braids[1], 0.875 * INCH, allowed_bore_stretch=0.03
    )
    fits = [f.tube.thickness / INCH for f in found if f.feasible]
    np.testing.assert_allclose(fits, [0.049, 0.058, 0.065])


def test_sizing_is_refused_for_what_the_catalogue_does_not_hold():
    catalogue = load_catalogue()
    with pytest.raises(ValueError, match=r"no bladder of diameter 0\.02 m; it has 0\.0127"):
        size_end_fittings(catalogue, catalogue.braids[1], 0.02)
    with pytest.raises(ValueError, match="compression of the braid must be in"):
        size_end_fittings(catalogue, catalogue.braids[1], 0.875 * INCH, braid_compression=17.0)


def test_rows_name_their_units():
    row = next(
        row
        for row in end_fitting_rows(load_catalogue(), system="us")
        if (row["tube"], row["bladder"], row["braid"])
        == ("tube 1 in x 0.058 in", "bladder 0.875 in x 0.0625 in", "Kevlar 2.0 in")
    )
    assert row["diameter_on_braid_in"] == pytest.approx(0.838, abs=THOUSANDTH)
    assert row["diameter_on_bladder_in"] == pytest.approx(0.748, abs=THOUSANDTH)
    assert row["bladder_bore_in"] == pytest.approx(0.75)
    assert row["braid_compression_per_in"] * THOUSANDTH == pytest.approx(0.001 / BRAID)


def test_the_sizing_keeps_float32():
    single = jnp.float32
    bore = swaged_bore(single(1.0), single(0.058), single(0.027))
    found = (
        fitting_diameter_on_braid(bore, single(BRAID), single(0.17)),
        fitting_diameter_on_bladder(bore, single(BRAID), single(BLADDER), single(0.3)),
        compression_sensitivity(bore, single(0.838), single(BRAID)),
    )
    assert all(value.dtype == single for value in found)
    assert found[0] == pytest.approx(0.83874, rel=1e-6)  # eight digits, three operations
