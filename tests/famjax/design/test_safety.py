import dataclasses
import math

import pytest

from famjax import units
from famjax.design import (
    Requirement,
    load_catalogue,
    safety_factor,
    safety_factor_rows,
    safety_factors,
    search,
    thread_strength_margin,
)

PSI, LBF = units.PSI, units.LBF
ASKED = Requirement(100 * PSI, 900 * LBF, 0.3)


def test_safety_factors_of_the_tested_muscles():
    # FAM 3 burst at 280 psi and works at 100; FAM 2 broke at 2147 lbf and pulls 1029.
    assert safety_factor(280.0, 100.0) == pytest.approx(2.8)
    assert safety_factor(2147.0, 1029.0) == pytest.approx(2.0865, rel=1e-4)


@pytest.fixture(scope="module")
def rows():
    catalogue = load_catalogue()
    factors = safety_factors(catalogue, ASKED, search(catalogue, ASKED))
    return safety_factor_rows(factors, system="us")


def test_the_printed_tests_over_what_is_required(rows):
    found = {(row["failed"], row["demand"]): row["safety_factor"] for row in rows}
    assert found["burst_pressure", "required pressure"] == pytest.approx(280 / 100)
    assert found["burst_force", "required force"] == pytest.approx(2639 / 900)
    assert found["tensile_force", "required force"] == pytest.approx(2147 / 900)
    # Gaylord's blocked force of the ideal braid, 0.875 in and 72.0 deg, by hand.
    cosine = 0.875 / 2.0 * 0.5**0.5
    blocked = 100 * 3.141592653589793 / 4 * 0.875**2 * (2 * (1 / cosine**2 - 1) - 1)
    assert found["tensile_force", "blocked force"] == pytest.approx(2147 / blocked, rel=1e-11)
    assert found["burst_force", "blocked force"] == pytest.approx(2639 / blocked, rel=1e-11)
    assert len(rows) == 5


def test_rows_of_pressures_and_forces_share_their_keys(rows):
    assert len({tuple(row) for row in rows}) == 1
    for row in rows:
        kind, other = ("pressure", "force")[:: 1 if row["failed"] == "burst_pressure" else -1]
        unit = {"pressure": "psi", "force": "lbf"}
        ratio = row[f"{kind}_at_failure_{unit[kind]}"] / row[f"{kind}_in_use_{unit[kind]}"]
        assert row["safety_factor"] == pytest.approx(ratio, rel=1e-12)
        assert row[f"{other}_at_failure_{unit[other]}"] is None


def test_no_required_force_leaves_the_blocked_force():
    asked = dataclasses.replace(ASKED, force=0.0)
    catalogue = load_catalogue()
    found = safety_factors(catalogue, asked, search(catalogue, asked))
    assert [factor.demand for factor in found] == [
        "blocked force",
        "required pressure",
        "blocked force",
    ]


def test_threads_break_at_a_margin_of_one():
    """144 threads of 59.3 lbf, unpressurised at 69.73 deg, hold n T sin(theta)."""
    at = {"n_threads": 144, "breaking_load": 59.3}
    holds = 144 * 59.3 * math.sin(math.radians(69.73))
    theta = math.radians(69.73)
    assert thread_strength_margin(holds, 0.0, 0.5, theta, **at) == pytest.approx(1.0)
    assert thread_strength_margin(holds / 2, 0.0, 0.5, theta, **at) == pytest.approx(2.0)
