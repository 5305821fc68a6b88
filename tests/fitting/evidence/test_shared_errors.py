"""Errors that all readings share: carried by linear theory, against fits of readings that were moved."""

import dataclasses
import functools

import numpy as np
import pytest

import famjax
import fitting
from fitting.data import ForceData
from fitting.evidence import Carried, Move, SharedErrors, carry, gather, moves_of

STATED = SharedErrors(
    rest_length=1e-4, shortening=1e-3, pressure_reading=2e-3, pressure_zero=300.0,
    force_reading=2e-3, wall_thickness=2e-5,
)  # fmt: skip
FIRST_ORDER = 0.08
"""What is left of effects to second order in errors of a few parts in a thousand."""


def fit(data: ForceData) -> fitting.Identification:
    return fitting.identify(data, starts=1, bounds={"braid_diameter": (0.0236, 0.0236)})


@pytest.fixture(scope="module")
def found() -> fitting.Identification:
    return fit(fitting.load_bundled("DMSP-20-300"))


@pytest.fixture(scope="module")
def carried(found: fitting.Identification) -> Carried:
    return carry(found, moves_of(found.data, STATED))


def numbers(result: fitting.Identification) -> np.ndarray:
    return np.concatenate([result.end.point.parameters, result.end.point.x])


@pytest.mark.parametrize("source", STATED.stated())
def test_the_effect_is_that_of_readings_moved_and_fitted_again(
    source: str, found: fitting.Identification, carried: Carried
) -> None:
    moved = fit(STATED.moved(found.data, source))
    scale = np.maximum(np.abs(numbers(found)), 1.0)
    apart = np.abs(numbers(moved) - numbers(found)) / scale
    effect = carried.effects[carried.sources.index(source)] / scale
    np.testing.assert_allclose(effect, apart, rtol=FIRST_ORDER, atol=1e-6)


@pytest.mark.slow
def test_an_error_widens_the_band_and_is_told(found: fitting.Identification, tmp_path) -> None:
    told = {}
    for errors in (SharedErrors(), SharedErrors(force_reading=0.02)):
        evidence = gather(
            found, validation=False, profiles=False, replicates=0, seed=0,
            progress=lambda *_: None, shared=moves_of(found.data, errors),
        )  # fmt: skip
        fitting.report.write_fit(found, tmp_path, "si", evidence)
        saved = fitting.load_fit(tmp_path / "fit.json")
        told[errors.force_reading] = fitting.predict(saved, np.array([0.28]), np.array([5e5]))[0]
        tables = [title for title, *_ in fitting.report.Findings(found, evidence).tables("si")]
        assert ("Standard errors by source" in tables) == bool(errors.force_reading)
    plain, wide = told[0.0], told[0.02]
    added = np.sqrt((wide["high_95_N"] - wide["force_N"]) ** 2
                    - (plain["high_95_N"] - plain["force_N"]) ** 2)  # fmt: skip
    assert added == pytest.approx(1.96 * 0.02 * wide["force_N"], rel=0.02)
    assert wide["band"] == "left out, shared errors"


def test_what_cannot_be_moved_is_refused(found: fitting.Identification) -> None:
    with pytest.raises(ValueError, match=r"standard error of pressure_zero must be >= 0, got -1"):
        SharedErrors(pressure_zero=-1.0)
    with pytest.raises(fitting.InputError, match="no bladder_diameter"):
        moves_of(found.data, SharedErrors(bladder_diameter=1e-4))
    fewer = fitting.load_bundled("DMSP-10-250")
    with pytest.raises(fitting.InputError, match="must have the 126 readings"):
        carry(found, {"other": [Move(fewer)]})
    shape = functools.partial(famjax.geometries.EndEffectGeometry, end_factor=1.05)
    with pytest.raises(fitting.InputError, match="of the kind that was fitted"):
        carry(found, {"ends": [Move(None, shape)]})
    alike = dataclasses.replace(found.data, notes=("another",))
    assert carry(found, {"nothing": [Move(alike)]}).std["E_1"] == 0
