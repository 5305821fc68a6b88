"""A rig that gives way by a power of the force is identified with the muscle, and told from others."""

import math
from pathlib import Path

import numpy as np
import pytest

import famjax
from fitting import (
    ForceData,
    Identification,
    Parameter,
    choose,
    identify,
    load_fit,
    predict,
    write_fit,
)
from fitting.saved import card_of
from tests.fitting.synthetic import muscle_map

COMPLIANCE, EXPONENT = 1.5e-5, 0.5
POWER = {
    "series_compliance": Parameter(),
    "series_exponent": Parameter(),
    "deadband_pressure": Parameter(value=0.0, vary=False, unit="Pa"),
}
LENGTHS = (1.0, 0.985, 0.96, 0.93, 0.9, 0.87)
RECOVERED = 1e-5  # relative
ROUNDED = 1e-9


def readings(rig: tuple[float, float | None] | None, noise: float = 0.0) -> ForceData:
    return muscle_map(noise=noise, seed=7, lengths=LENGTHS, deadband=0.0, rig=rig)


@pytest.fixture(scope="module")
def identified() -> Identification:
    data = readings((COMPLIANCE, EXPONENT))
    return identify(data, law="mooney-rivlin", parameters=POWER, starts=8)


def test_it_is_recovered(identified: Identification) -> None:
    assert identified.converged
    assert identified.errors.rmse < 1e-5
    truth = {
        "braid_diameter": 0.0135, "braid_angle": math.radians(64), "C10": 0.4e6, "C01": 0.15e6,
        "series_compliance": COMPLIANCE, "series_exponent": EXPONENT,
    }  # fmt: skip
    for name, value in truth.items():
        assert identified.estimate(name).value == pytest.approx(value, rel=RECOVERED), name
    assert identified.mounted.exponent == pytest.approx(EXPONENT, rel=RECOVERED)


@pytest.mark.slow
def test_a_fit_file_and_a_card_keep_the_rig(identified: Identification, tmp_path: Path) -> None:
    write_fit(identified, tmp_path)
    saved = load_fit(tmp_path / "fit.json")
    assert saved.mounted.exponent == identified.mounted.exponent
    L, P = np.array([0.24]), np.array([4e5])
    (row,) = predict(saved, L, P)
    assert row["force_N"] == pytest.approx(float(identified.predict(L, P)[0]), rel=ROUNDED)
    # Of another rest length it is in the same rig.
    (other,) = predict(saved, np.array([0.19]), P, rest_length=0.2)
    shorter = identified.mounted.with_muscle(famjax.cut_to_length(identified.muscle, 0.2))
    assert other["force_N"] == pytest.approx(float(shorter.force(0.19, 4e5)), rel=ROUNDED)
    card = card_of(saved)
    assert card.members[0].exponent == identified.mounted.exponent
    assert float(card.muscle.force(0.24, 4e5)) == pytest.approx(row["force_N"], rel=ROUNDED)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "power"),
    [(None, False), ((COMPLIANCE, EXPONENT), True)],
    ids=["rigid", "square root"],
)
def test_a_rig_is_chosen_where_there_is_one(
    rig: tuple[float, float | None] | None, *, power: bool
) -> None:
    choice = choose(readings(rig, noise=0.5))
    assert ("compliant rig" in choice.name) is power
    assert choice.chosen.errors.rmse < 0.8
