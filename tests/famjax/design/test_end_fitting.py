import numpy as np
import pytest

from famjax import units
from famjax.design import (
    end_fitting_rows,
    fitting_diameter_on_bladder,
    fitting_diameter_on_braid,
    load_catalogue,
    size_end_fittings,
    swaged_bore,
)

INCH = units.INCH
THOUSANDTH = 0.001  # in; the published diameters' last digit, and what a lathe holds
ROUNDING = 1e-12  # relative, float64: a dozen operations
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
