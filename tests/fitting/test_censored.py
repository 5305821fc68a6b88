"""Censored readings: what a slack muscle and a load cell at its limit say, against SciPy's optimum."""

import dataclasses

import numpy as np
import pytest
from scipy.optimize import minimize

import famjax
import fitting
from fitting import ForceData

HELD = {"braid_diameter": (0.0236,) * 2, "braid_angle": (1.0776,) * 2,
        "deadband_pressure": (30e3,) * 2}  # fmt: skip


@pytest.fixture(scope="module")
def data() -> ForceData:
    return fitting.load_bundled("DMSP-20-300")


def one_sided_sum(data: ForceData, result: fitting.Identification, E: np.ndarray) -> float:
    """Half the sum of squares, by the muscle itself."""
    muscle = famjax.Muscle(
        result.muscle.geometry, famjax.PolynomialMaterial(E), result.muscle.deadband_pressure
    )
    force = np.asarray(muscle.force(data.length, data.pressure))
    limit = data.force_limit or np.inf
    return 0.5 * float(
        np.sum((force - data.force)[data.loaded] ** 2)
        + np.sum(np.maximum(force[data.slack], 0) ** 2)
        + np.sum(np.maximum(limit - force[data.saturated], 0) ** 2)
    )


@pytest.mark.parametrize("limit", [None, 1000.0])
def test_coefficients_are_the_optimum_of_one_sided_squares(data: ForceData, limit: float) -> None:
    capped = dataclasses.replace(data, force_limit=limit)
    result = fitting.identify(capped, order=2, bounds=HELD, constraint="none", censored=True)
    assert result.certificate.kkt_residual < 1e-12
    assert result.errors.slack_violations  # some of the one-sided residuals are on
    scale = np.abs(result.coefficients[0])
    found = minimize(
        lambda z: one_sided_sum(capped, result, z * scale) / 1e4, np.array([0.5, 0.5]),
        method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-14, "maxiter": 4000},
    )  # fmt: skip
    ours = one_sided_sum(capped, result, result.coefficients[0])
    assert ours <= found.fun * 1e4 * (1 + 1e-9)
    np.testing.assert_allclose(result.coefficients[0], found.x * scale, rtol=1e-4)


def outside_brackets(result: fitting.Identification) -> float:
    """Sum over lengths [Pa] of how far the onset lies outside what slack and loaded readings bound."""
    data, outside = result.data, 0.0
    for length in np.unique(data.lengths.level):
        at = data.lengths.level == length
        if (at & data.slack).any() and (at & data.loaded).any():
            onset = float(result.muscle.onset_pressure(length, 8e5))
            highest = data.pressure[at & data.slack].max()
            lowest = data.pressure[at & data.loaded].min()
            outside += max(highest - onset, onset - lowest, 0.0)
    return outside


@pytest.mark.parametrize(("name", "order"), [("DMSP-20-300", 2), ("DMSP-10-250", 3)])
def test_onset_moves_to_where_it_was_seen(name: str, order: int) -> None:
    """20-300: 26 to 13 kPa over five lengths, 10-250: 14 to 11 kPa over four."""
    data = fitting.load_bundled(name)
    plain, censored = (fitting.identify(data, order=order, censored=one) for one in (False, True))
    assert censored.errors.max_slack_force < 0.8 * plain.errors.max_slack_force
    assert outside_brackets(censored) < 0.8 * outside_brackets(plain)


def test_saturated_readings_are_no_data_but_information(data: ForceData) -> None:
    capped = dataclasses.replace(data, force=np.minimum(data.force, 900.0), force_limit=900.0)
    assert capped.saturated.sum() > 3
    believed = fitting.identify(dataclasses.replace(capped, force_limit=None))
    dropped, censored = (fitting.identify(capped, censored=one) for one in (False, True))
    true = data.force[capped.saturated]
    off = [
        np.abs(one.predict(data.length, data.pressure)[capped.saturated] - true).mean()
        for one in (believed, dropped, censored)
    ]
    assert max(off[1:]) < 0.2 * off[0]
    assert dropped.errors.n_points == capped.loaded.sum() == censored.errors.n_points


def test_validation_and_bootstrap_of_a_censored_fit(data: ForceData) -> None:
    result = fitting.identify(data, censored=True, starts=4)
    left_out = fitting.validate(result, "pressure", starts=1)
    assert result.errors.rmse < left_out.rmse < 3 * result.errors.rmse
    # Nothing is on here, so that both draw of the same residuals.
    plain = fitting.bootstrap(fitting.identify(data, starts=4), 100)
    assert fitting.bootstrap(result, 100).stderr["E_1"] == pytest.approx(
        plain.stderr["E_1"], rel=0.3
    )
