import numpy as np
import pytest
from scipy.optimize import curve_fit

from famjax.braids import LinearThread, ToeThread
from fitting import InputError
from fitting.rubber import fit_thread

# The reference work's thread in SI: 16.9e6 psi, 1.332e-4 in2, broken at 59.3 lbf
GAUGE, AREA, MODULUS, TOE, TOE_TENSION = 0.25, 8.594e-8, 116.5e9, 0.004, 12.0
FORCE = np.linspace(0, 260, 200)
NOISE = 2e-5  # of strain: 5 um on the gauge length


def toe_law(force, modulus, toe_strain, toe_tension):
    return force / (AREA * modulus) + toe_strain * force / (force + toe_tension)


def noisy(seed: int, slack: float = 0.0) -> np.ndarray:
    noise = NOISE * np.random.default_rng(seed).standard_normal(FORCE.size)
    return GAUGE * (toe_law(FORCE, MODULUS, TOE, TOE_TENSION) + noise) + slack


@pytest.mark.parametrize("slack", [0.0, 3e-4])
def test_a_noiseless_record_returns_its_law(slack: float) -> None:
    """The least misfit is found to rounding, the toe tension to the root of it."""
    elongation = GAUGE * toe_law(FORCE, MODULUS, TOE, TOE_TENSION) + slack
    fit = fit_thread(FORCE, elongation, gauge_length=GAUGE, area=AREA, slack=slack > 0)
    assert isinstance(fit.thread, ToeThread)
    assert float(fit.thread.modulus) == pytest.approx(MODULUS, rel=1e-6)
    assert float(fit.thread.toe_strain) == pytest.approx(TOE, rel=1e-6)
    assert float(fit.thread.toe_tension) == pytest.approx(TOE_TENSION, rel=1e-6)
    assert fit.slack == pytest.approx(slack, abs=1e-9)
    assert fit.rmse < 1e-9


def test_toe_fit_and_its_errors_meet_scipys() -> None:
    elongation = noisy(0)
    fit = fit_thread(FORCE, elongation, gauge_length=GAUGE, area=AREA)
    units = np.array([1e9, 1e-3, 1.0])  # GPa, thousandths, N: scipy wants parameters of order one
    best, matrix = curve_fit(
        lambda force, *values: 1e3 * toe_law(force, *(units * values)),
        FORCE,
        1e3 * elongation / GAUGE,
        np.array([MODULUS, TOE, TOE_TENSION]) / units,
    )
    assert isinstance(fit.thread, ToeThread)
    got = [float(getattr(fit.thread, name)) for name in ("modulus", "toe_strain", "toe_tension")]
    # scipy stops at a relative change of 1e-8 of the sum of squares; its Jacobian is by differences
    np.testing.assert_allclose(got, best * units, rtol=1e-4)
    errors = [fit.stderr[name] for name in ("modulus", "toe_strain", "toe_tension")]
    np.testing.assert_allclose(errors, np.sqrt(np.diag(matrix)) * units, rtol=1e-3)
    assert fit.degrees_of_freedom == FORCE.size - 3


def test_standard_errors_are_those_of_repeated_tests() -> None:
    """Spread over 200 records; the spread itself is known to 1 / sqrt(400) = 5 %, three times it."""
    fits = [
        fit_thread(FORCE[::4], noisy(seed)[::4], gauge_length=GAUGE, area=AREA)
        for seed in range(200)
    ]
    for name in ("modulus", "toe_strain", "toe_tension"):
        values = [float(getattr(fit.thread, name)) for fit in fits]
        told = np.mean([fit.stderr[name] for fit in fits])
        assert told == pytest.approx(np.std(values, ddof=1), rel=0.15)


@pytest.mark.parametrize("slack", [False, True])
def test_linear_fit_is_the_regression_line(slack: bool) -> None:
    elongation = noisy(1, slack=2e-4)
    fit = fit_thread(FORCE, elongation, gauge_length=GAUGE, area=AREA, law="linear", slack=slack)
    assert isinstance(fit.thread, LinearThread)
    columns = np.stack([FORCE, np.ones_like(FORCE)][: 1 + slack], axis=1)
    best, squares, *_ = np.linalg.lstsq(columns, elongation / GAUGE)
    assert float(fit.thread.modulus) == pytest.approx(1 / (AREA * best[0]), rel=1e-12)
    variance = squares[0] / (FORCE.size - 1 - slack)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(columns.T @ columns)))
    expected = errors[0] / (AREA * best[0] ** 2)
    assert fit.stderr["modulus"] == pytest.approx(expected, rel=1e-9)
    assert fit.rmse == pytest.approx(np.sqrt(variance), rel=1e-9)
    if slack:
        assert fit.slack == pytest.approx(best[1] * GAUGE, rel=1e-9)
        assert fit.stderr["slack"] == pytest.approx(errors[1] * GAUGE, rel=1e-9)
    else:
        assert fit.slack == 0
        assert set(fit.stderr) == {"modulus"}


def test_units_do_not_matter() -> None:
    """The same record in psi, inch and lbf gives the same law."""
    inch, lbf = 0.0254, 4.4482216152605
    si = fit_thread(FORCE, noisy(2), gauge_length=GAUGE, area=AREA)
    us = fit_thread(FORCE / lbf, noisy(2) / inch, gauge_length=GAUGE / inch, area=AREA / inch**2)
    psi = lbf / inch**2
    assert float(us.thread.modulus) * psi == pytest.approx(float(si.thread.modulus), rel=1e-6)
    assert us.stderr["modulus"] * psi == pytest.approx(si.stderr["modulus"], rel=1e-6)


def test_a_record_without_a_toe_is_told_so() -> None:
    with pytest.raises(InputError, match="no toe region"):
        fit_thread(
            FORCE,
            GAUGE * (FORCE / (AREA * MODULUS) + 1e-8 * FORCE**2),
            gauge_length=GAUGE,
            area=AREA,
        )


GOOD = {"force": FORCE, "elongation": noisy(3), "gauge_length": GAUGE, "area": AREA}


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"force": FORCE[:-1]}, "equally long"),
        ({"force": FORCE[:, None], "elongation": FORCE[:, None]}, "one-dimensional"),
        ({"force": np.where(FORCE == 0, np.nan, FORCE)}, "force of reading 1 is nan"),
        ({"force": -FORCE}, "sign and the zero"),
        ({"elongation": -noisy(3)}, "must rise with the force"),
        ({"elongation": 1e3 * noisy(3)}, "check the units"),
        ({"gauge_length": 0.0}, "gauge_length .* must be positive"),
        ({"area": -1.0}, "area .* must be positive"),
        ({"law": "cubic"}, "law must be one of linear, toe"),
        ({"force": FORCE[:3], "elongation": noisy(3)[:3]}, "3 parameters need more than 3"),
    ],
)
def test_bad_records_are_refused(change: dict, match: str) -> None:
    with pytest.raises(InputError, match=match):
        fit_thread(**{**GOOD, **change})


def test_the_record_is_not_changed() -> None:
    force, elongation = FORCE.copy(), noisy(4)
    before = elongation.copy()
    fit_thread(force, elongation, gauge_length=GAUGE, area=AREA)
    np.testing.assert_array_equal(force, FORCE)
    np.testing.assert_array_equal(elongation, before)
