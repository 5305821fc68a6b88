"""Plants found again from simulated records, and what is no record of one."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.boundary.errors import InputError
from famjax.plant import DahlFriction, LinearMcKibben, Plant, PneumaticCircuit, simulate
from famjax.units import PSI
from fitting.plant import PlantRecord, identify_plant

STEP, TICKS = 0.01, 5  # s between samples, ticks in it
NOISE = 0.05 * PSI, 0.5  # Pa, N
TRUTHS = {
    "air": PneumaticCircuit(conductance=4.6e-9, critical_ratio=0.26, lag=0.015, leak=0.005),
    "water": famjax.plant.HydraulicCircuit(displacement=0.9e-6, lag=0.08, bulk_modulus=42e6),
}
SIGNALS = {"air": (0.95, 0.5, 0.3, 0.58, 0.1, 0.7, 0.42), "water": (0.9, 0.4, 0.7, 0.2, 0.8, 0.5)}


def record_of(plant: Plant, signals: tuple[float, ...], seconds: float, seed: int) -> PlantRecord:
    """A record of a plant, noise of the sensors on top; it begins at a held signal."""
    rng, time = np.random.default_rng(seed), np.arange(0, seconds, STEP)
    held = np.array([signals[0], *rng.choice(signals, int(seconds / 0.4))])
    signal = held[(time / 0.4).astype(int)]
    share = 0.05 * (1 - np.cos(2 * np.pi * time / 5)) + 0.03 * np.sin(2 * np.pi * time / 1.7) ** 2
    length = float(plant.muscle.rest_length) * (1 - share)
    speed = np.repeat(np.diff(length) / STEP, TICKS)
    each = famjax.plant.Command(np.repeat(signal[:-1], TICKS), 0.0, speed)
    states = simulate(plant, each, STEP / TICKS, start=plant.start(length[0]))
    at = slice(TICKS - 1, None, TICKS)
    true = [np.append(0.0, one[at]) for one in (states.pressure, states.force)]
    each = zip(true, NOISE, strict=True)
    pressure, force = (one + std * rng.standard_normal(time.size) for one, std in each)
    return PlantRecord(time, signal, pressure, length, force).part(30, time.size)


@pytest.mark.slow
@pytest.mark.parametrize("fluid", TRUTHS)
def test_a_plant_is_found_again(fluid):
    friction = DahlFriction(share=0.025)
    truth = Plant(TRUTHS[fluid], LinearMcKibben(), friction=friction, viscosity=220.0)
    first = Plant(type(TRUTHS[fluid])(), LinearMcKibben(), friction=DahlFriction())
    fit = identify_plant(record_of(truth, SIGNALS[fluid], 12.0, 1), first)
    known = {**truth.circuit.parameters(), "friction.share": 0.025, "viscosity": 220.0}
    for one in fit.estimates:
        assert one.value == pytest.approx(float(known[one.name]), rel=0.03), one.name
        assert abs(one.value - float(known[one.name])) < 4 * one.stderr, one.name
    assert fit.pressure_rms == pytest.approx(NOISE[0], rel=0.1)
    unseen = record_of(truth, SIGNALS[fluid], 8.0, 9)
    states = fit.predict(unseen)
    for measured, found in ((unseen.pressure, states.pressure), (unseen.force, states.force)):
        assert measured is not None
        assert np.sqrt(np.mean((found - measured) ** 2)) < 0.01 * np.ptp(measured)
    assert fit.plot(unseen).axes


@pytest.mark.slow
def test_what_a_record_does_not_tell_is_said():
    plant = Plant(PneumaticCircuit(), LinearMcKibben())
    record = record_of(plant, (0.45, 0.5, 0.55), 6.0, 2)
    fit = identify_plant(record, plant, free=("conductance", "critical_ratio", "dead_band"))
    assert any("never exceeded" in one for one in fit.warnings)


TIME = np.arange(0, 2, STEP)
GOOD = PlantRecord(TIME, 0.5 + 0.2 * (TIME > 1), 1e4 * TIME, np.full(TIME.size, 0.23))


def changed(**columns: np.ndarray) -> PlantRecord:
    return dataclasses.replace(GOOD, **columns)


@pytest.mark.parametrize(
    ("record", "free", "said"),
    [
        (lambda: changed(signal=np.full(TIME.size, 0.5)), None, "A pressure set point cannot be used"),
        (lambda: changed(signal=GOOD.signal * 5), None, "must vary between 0 and 1"),
        (lambda: changed(time=TIME**2), None, "equal steps"),
        (lambda: changed(force=np.full(TIME.size, np.nan)), None, "force must be finite"),
        (lambda: changed(pressure=GOOD.pressure + 101e3), None, "subtract the atmospheric pressure"),
        (lambda: changed(time=TIME * 10), None, "determine a lag of about 12 ms"),
        (lambda: GOOD, ("size",), "free must contain names of plant parameters, chosen from supply"),
        (lambda: [], None, "at least one PlantRecord"),
    ],
)  # fmt: skip
def test_what_is_no_record_or_cannot_be_identified_is_refused(record, free, said):
    with pytest.raises(InputError, match=said):
        identify_plant(record(), Plant(PneumaticCircuit(), LinearMcKibben()), free=free)


@pytest.mark.slow
def test_derivatives_of_the_residual():
    from fitting.plant import _pieces, _Shooting

    plant = Plant(PneumaticCircuit(), LinearMcKibben(), friction=DahlFriction())
    names = ("conductance", "lag", "dead_volume", "friction.share")
    problem = _Shooting(plant, names, [_pieces(record_of(plant, (0.9, 0.3, 0.6), 2.6, 3))])
    scale, sigma = problem.first.copy(), problem.noise()
    u = np.concatenate([np.ones(4), problem.openings, problem.pieces[0].pressure[:, 0]])
    exact, steps = problem.jacobian(u, scale, sigma), [1e-5] * 5 + [1.0]  # Pa of a pressure
    for k, h in enumerate(steps):
        step = h * (np.arange(u.size) == k)
        rise = problem.residual(u + step, scale, sigma) - problem.residual(u - step, scale, sigma)
        atol = 1e-5 * jnp.abs(exact[:, k]).max()
        np.testing.assert_allclose(exact[:, k], rise / (2 * h), atol=atol)
