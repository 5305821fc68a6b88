import dataclasses

import jax
import jax.numpy as jnp
import jax.test_util
import numpy as np
import pytest

from famjax import units
from famjax.design import (
    assumption_notes,
    euler_load,
    load_catalogue,
    stepped_column_gain,
    support_stiffness,
    tube_buckling_rows,
    tube_second_moment,
    tube_strengths,
    yield_load,
)

INCH, PSI = units.INCH, units.PSI
ROUNDING = 1e-12  # relative, float64: a dozen operations


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


def held_column(spring: float, inserted: float, stiffening: float) -> float:
    """Least load of a pinned stepped column with a spring, over pi^2, by finite elements of the slope.

    Energy of bending, of the spring and of shortening, on a grid of `n` equal steps; the error is of
    second order in them.
    """
    n = 248  # the step of the reference work's column falls on a node
    step, x = 1 / n, np.arange(1, n) / n
    bending = (2 * np.eye(n - 1) - np.eye(n - 1, k=1) - np.eye(n - 1, k=-1)) / step**2
    at = round((1 - inserted) * n) - 1
    stiffness = np.where(x > 1 - inserted, stiffening, 1.0)
    stiffness[at] = (1 + stiffening) / 2
    energy = bending @ (stiffness[:, None] * bending) * step
    energy[at, at] += spring
    half = np.linalg.inv(np.linalg.cholesky(bending * step))
    return np.linalg.eigvalsh(half @ energy @ half.T)[0] / np.pi**2


def test_the_reference_works_support_gains_between_1_14_and_2_81():
    inserted, bore = 1.25 / 3.10, 1.0 - 2 * 0.058
    support = tube_second_moment(bore, (bore - 0.75) / 2)
    stiffening = float(1 + support / tube_second_moment(1.0, 0.058))
    assert stiffening == pytest.approx(1.75, abs=0.01)  # printed as a rise by 75 %
    assert stepped_column_gain(inserted, stiffening) == pytest.approx(1.14, abs=0.005)
    assert tube_strengths(load_catalogue())[2].gain == pytest.approx(2.81, abs=0.005)


def test_the_spring_that_doubles_the_load_does():
    inserted, stiffening = 1.25 / 3.10, 1.756
    grid = 1e-3  # of 248 steps, second order
    plain = stepped_column_gain(inserted, stiffening)
    assert held_column(0.0, inserted, stiffening) == pytest.approx(plain, rel=grid)
    for gain in (1.5, 2.0, 2.8):
        spring = np.pi**2 * support_stiffness(gain, inserted, stiffening)
        assert held_column(spring, inserted, stiffening) == pytest.approx(gain, rel=grid)
    assert stepped_column_gain(0.4, 1.0) == 1.0


@pytest.mark.parametrize("gain", [0.5, 1.1, 2.9, 30.0])
def test_a_gain_that_no_spring_gives_is_refused(gain):
    with pytest.raises(ValueError, match=r"must be in \(1\.142, 2\.808\), got"):
        support_stiffness(gain, 1.25 / 3.10, 1.756)


def test_gradients_of_the_buckling_load_agree_with_finite_differences():
    def load(length, thickness):
        return euler_load(1e7, tube_second_moment(1.0, thickness), length) / 1e6

    jax.test_util.check_grads(load, (2.6, 0.058), order=1, modes=["fwd", "rev"], rtol=1e-6)


def test_the_yield_load_is_the_stress_on_the_section():
    section = np.pi / 4 * (1.0 - 0.884**2)
    assert yield_load(40e3, 1.0, 0.058) == pytest.approx(40e3 * section, rel=ROUNDING)


def test_the_loads_keep_float32():
    single = jnp.float32
    moment = tube_second_moment(single(1.0), single(0.058))
    load = euler_load(single(1e7), moment, single(1.85))
    assert load.dtype == single
    assert load == pytest.approx(float(euler_load(1e7, tube_second_moment(1.0, 0.058), 1.85)), 1e-6)
    assert yield_load(single(4e4), single(1.0), single(0.058)).dtype == single


# --------------------------------------------------------------------- the tubes of the catalogue
def with_tube(**changes):
    """The bundled catalogue with one tube, changed."""
    catalogue = load_catalogue()
    return dataclasses.replace(
        catalogue, tubes=(dataclasses.replace(catalogue.tubes[0], **changes),)
    )


def test_the_catalogue_comes_before_what_is_assumed():
    (found,) = tube_strengths(with_tube(modulus=193e9, yield_stress=215e6))
    assert (found.modulus, found.yield_stress, found.assumed) == (193e9, 215e6, ())
    assert found.supported_length == pytest.approx(1.85 * INCH)  # printed
    assert found.free_length == pytest.approx(3.1 * INCH)  # printed
    assert tube_strengths(load_catalogue())[0].assumed == ("modulus", "yield_stress")
    (mine,) = tube_strengths(with_tube(free_length=0.1, supported_length=0.05))
    assert mine.gain == pytest.approx(4.0, rel=ROUNDING)


def test_what_is_assumed_is_said():
    strengths = tube_strengths(with_tube(free_length=None))
    assert strengths[0].gain == pytest.approx((3.10 / 1.85) ** 2, rel=ROUNDING)
    notes = assumption_notes(strengths)
    assert len(notes) == 3
    for note, said in zip(notes, ("68.9 GPa", "276 MPa", "3.10 in"), strict=True):
        assert said in note
    assert assumption_notes(tube_strengths(with_tube(modulus=70e9, yield_stress=250e6))) == []


def test_a_short_tube_yields_and_a_long_one_buckles():
    short, *_ = tube_strengths(load_catalogue())
    assert short.yields_first
    (long,) = tube_strengths(with_tube(free_length=1.0))
    assert not long.yields_first
    # By hand: the slenderness at which Euler's stress is the yield stress.
    moment = float(tube_second_moment(INCH, 0.035 * INCH))
    slender = np.pi * np.sqrt(68.9e9 * moment / long.yield_load)
    assert short.free_length < slender < long.free_length
    (at,) = tube_strengths(with_tube(free_length=slender))
    assert at.buckling_load == pytest.approx(at.yield_load, rel=1e-11)


def test_rows_of_tubes_name_their_units():
    row = tube_buckling_rows(load_catalogue(), system="us")[2]
    assert row["tube"] == "tube 1 in x 0.058 in"
    moment = float(tube_second_moment(1.0, 0.058))
    load = float(euler_load(row["modulus_psi"], moment, 1.85))
    assert row["supported_buckling_load_lbf"] == pytest.approx(load, rel=1e-11)
    assert row["buckling_load_lbf"] == pytest.approx(load * (1.85 / 3.1) ** 2, rel=1e-11)
    assert row["modulus_psi"] == pytest.approx(68.9e9 / PSI)
    assert row["yield_load_lbf"] == pytest.approx(276e6 / PSI * np.pi * 0.058 * 0.942, rel=1e-11)
    assert row["yields_first"]
