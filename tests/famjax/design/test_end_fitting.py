import numpy as np
import pytest

from famjax import units
from famjax.design import (
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
