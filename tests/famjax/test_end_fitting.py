import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from famjax import units
from famjax._catalogue import load_catalogue
from famjax._design_report import end_fitting_rows
from famjax._end_fitting import (
    bladder_compression,
    braid_compression,
    compression_sensitivity,
    euler_load,
    fitting_diameter_on_bladder,
    fitting_diameter_on_braid,
    safety_factor,
    size_end_fittings,
    swaged_bore,
    swaged_thickness,
    tube_buckling,
    tube_second_moment,
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
    catalogue = load_catalogue()
    found = size_end_fittings(catalogue, catalogue.braids[1], 0.875 * INCH)
    row = end_fitting_rows(found, system="us")[6]  # 0.058 in tube, 0.0625 in bladder
    assert row["tube"] == "tube 1 in x 0.058 in"
    assert row["diameter_on_braid_in"] == pytest.approx(0.838, abs=THOUSANDTH)
    assert row["diameter_on_bladder_in"] == pytest.approx(0.748, abs=THOUSANDTH)
    assert row["bladder_bore_in"] == pytest.approx(0.75)
    assert row["braid_compression_per_in"] * THOUSANDTH == pytest.approx(0.001 / BRAID)


@pytest.mark.parametrize("wall", [0.01, 0.058, 0.125, 0.5])
def test_second_moment_is_the_difference_of_two_discs(wall):
    expected = np.pi / 64 * (1.0 - (1.0 - 2 * wall) ** 4)
    assert tube_second_moment(1.0, wall) == pytest.approx(expected, rel=ROUNDING)


def test_euler_load_is_the_least_eigenvalue_of_the_pinned_column():
    n, length, stiffness = 200, 1.85, 3.0e5  # E I
    step = length / n
    bending = (2 * np.eye(n - 1) - np.eye(n - 1, k=1) - np.eye(n - 1, k=-1)) / step**2
    expected = stiffness * np.linalg.eigvalsh(bending)[0]
    # Central differences fall short of the eigenvalue by (pi / n)^2 / 12 = 2.1e-5 of it.
    assert euler_load(3.0e7, 0.01, length) == pytest.approx(expected, rel=3e-5)


def test_a_clamped_column_bears_four_times_as_much():
    clamped, pinned = euler_load(1e7, 0.02, 2.0, 0.5), euler_load(1e7, 0.02, 2.0)
    assert clamped == pytest.approx(4 * float(pinned), rel=ROUNDING)


def test_the_support_doubles_the_load_of_a_tube_root_two_as_long():
    found = tube_buckling(
        modulus=1e7,
        outer_diameter=1.0,
        thickness=0.058,
        length=1.85 * 2**0.5,
        supported_length=1.85,
    )
    assert found.gain == pytest.approx(2.0, rel=ROUNDING)
    second_moment = tube_second_moment(1.0, 0.058)
    assert found.supported_load == pytest.approx(
        float(euler_load(1e7, second_moment, 1.85)), rel=ROUNDING
    )
    section = np.pi / 4 * (1.0 - 0.884**2)
    assert found.supported_stress == pytest.approx(
        float(found.supported_load) / section, rel=ROUNDING
    )


def test_gradients_of_the_buckling_load_agree_with_finite_differences():
    def gain(length, thickness):
        found = tube_buckling(
            modulus=1e7,
            outer_diameter=1.0,
            thickness=thickness,
            length=length,
            supported_length=1.85,
        )
        return found.unsupported_load / 1e6

    jax.test_util.check_grads(gain, (2.6, 0.058), order=1, modes=["fwd", "rev"], rtol=1e-6)


def test_safety_factors_of_the_tested_muscles():
    # FAM 3 burst at 280 psi and works at 100; FAM 2 broke at 2147 lbf and pulls 1029.
    assert safety_factor(280.0, 100.0) == pytest.approx(2.8)
    assert safety_factor(2147.0, 1029.0) == pytest.approx(2.0865, rel=1e-4)


def test_the_sizing_keeps_float32():
    single = jnp.float32
    bore = swaged_bore(single(1.0), single(0.058), single(0.027))
    found = (
        fitting_diameter_on_braid(bore, single(BRAID), single(0.17)),
        fitting_diameter_on_bladder(bore, single(BRAID), single(BLADDER), single(0.3)),
        compression_sensitivity(bore, single(0.838), single(BRAID)),
        euler_load(single(1e7), tube_second_moment(single(1.0), single(0.058)), single(1.85)),
    )
    assert all(value.dtype == single for value in found)
    assert found[0] == pytest.approx(0.83874, rel=1e-6)  # eight digits, three operations
