"""Records of known truth: the model's own static force, a friction term and noise."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.boundary.errors import InputError
from famjax.terms import AbstractFriction, PressureFriction, ThreadFriction, smooth_sign
from fitting.rubber import (
    CyclicRecord,
    HysteresisLoop,
    fit_pressure_friction,
    fit_thread_friction,
    hysteresis_loop,
)

REST, SHORT, SPEED = 0.296, 0.23, 2e-3  # m, m, m/s
C0, C1, COEFFICIENT = 6.0, 4e-5, 0.004
SIGMAS = 4.0  # standard errors that an estimate may miss the truth by; seeds are fixed
PRESSURES = (2e5, 3e5, 4e5, 5e5)


@pytest.fixture(scope="module")
def muscle() -> famjax.Muscle:
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=jnp.deg2rad(62.0), length=REST)
    bladder = famjax.Bladder(REST, 23e-3, 1.8e-3, embedded=True)
    law = famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6])
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 40e3)


@pytest.fixture(scope="module")
def thread(muscle: famjax.Muscle) -> ThreadFriction:
    return ThreadFriction(COEFFICIENT, 2 * np.pi * 0.0115 * REST, np.deg2rad(62.0))


def _record(
    muscle: famjax.Muscle,
    friction: AbstractFriction,
    pressure: float,
    noise: float = 0.0,
    *,
    cycles: int = 3,
    rows: int = 600,
    hold: int = 40,
    seed: int = 0,
) -> CyclicRecord:
    """Cycles of constant speed that begin at rest length, shortening, with holds at the ends."""
    ramp = np.linspace(REST, SHORT, rows)
    turn = [ramp, np.full(hold, SHORT), ramp[::-1], np.full(hold, REST)]
    length = np.concatenate([*turn] * cycles)
    velocity = np.gradient(length) / np.abs(np.diff(ramp)).mean() * SPEED
    random = np.random.default_rng(seed)
    at = muscle.geometry.dimensions(length, pressure)
    static = muscle.force(length, pressure)
    force = static + friction.force(at, pressure, smooth_sign(velocity, SPEED / 4))
    return CyclicRecord(
        length=length + 1e-5 * (noise > 0) * random.standard_normal(length.size),
        force=np.asarray(force) + noise * random.standard_normal(length.size),
        pressure=np.full(length.size, pressure),
        rest_length=REST,
        time=np.arange(length.size) * float(np.abs(np.diff(ramp)).mean()) / SPEED,
    )


def _loops(muscle: famjax.Muscle, friction: AbstractFriction, noise: float) -> list[HysteresisLoop]:
    return [
        hysteresis_loop(_record(muscle, friction, P, noise, seed=i))
        for i, P in enumerate(PRESSURES)
    ]


def test_branches_mean_and_half_difference_are_those_put_in(muscle: famjax.Muscle) -> None:
    P = 4e5
    loop = hysteresis_loop(_record(muscle, PressureFriction(C0, C1), P))
    inner = slice(2, -2)  # the smooth sign takes a few readings to build up
    static = np.asarray(muscle.force(loop.length, P))[inner]
    friction = (C0 + C1 * P) * np.tanh(4.0)
    curvature = abs(np.diff(static, 2)).max() / 16  # of a bin's mean: 1/24, and it still grows
    np.testing.assert_allclose(loop.mean[inner], static, atol=curvature)
    np.testing.assert_allclose(loop.half_difference[inner], friction, rtol=1e-3)
    np.testing.assert_allclose(loop.eccentric[inner], static + friction, atol=curvature)
    np.testing.assert_allclose(loop.concentric[inner], static - friction, atol=curvature)
    np.testing.assert_allclose(loop.pressure, P, rtol=1e-12)
    np.testing.assert_allclose(loop.pressure_difference, 0, atol=1e-6)


def test_grid_increases_within_what_both_branches_cover(muscle: famjax.Muscle) -> None:
    loop = hysteresis_loop(_record(muscle, PressureFriction(C0, C1), 4e5, noise=1.0), points=33)
    assert (np.diff(loop.contraction) > 0).all()
    assert loop.contraction.size == 33
    assert loop.contraction[0] > -1e-3
    assert loop.contraction[-1] < 1 - SHORT / REST + 1e-3
    np.testing.assert_allclose(loop.length, REST * (1 - loop.contraction))


def test_nothing_is_extrapolated(muscle: famjax.Muscle) -> None:
    """A record that comes back only three quarters of the way, in one cycle."""
    whole = _record(muscle, PressureFriction(C0, C1), 4e5, cycles=1, hold=0)
    part = slice(0, 600 + 450)
    columns = {name: getattr(whole, name)[part] for name in ("length", "force", "pressure", "time")}
    record = CyclicRecord(**columns, rest_length=REST)
    loop = hysteresis_loop(record)
    assert loop.contraction[0] > record.contraction[-1]
    assert loop.contraction.size == 41
    assert loop.half_difference[3:-3] == pytest.approx((C0 + C1 * 4e5) * np.tanh(4.0), rel=1e-3)


def test_bins_without_readings_of_both_branches_are_left_out(muscle: famjax.Muscle) -> None:
    record = _record(muscle, PressureFriction(C0, C1), 4e5, cycles=1, hold=0)
    middle = abs(record.contraction - 0.11) < 0.02
    keep = ~(middle & (np.arange(record.length.size) < 600))  # a gap in the concentric branch
    columns = {
        name: getattr(record, name)[keep] for name in ("length", "force", "pressure", "time")
    }
    loop = hysteresis_loop(CyclicRecord(**columns, rest_length=REST))
    assert loop.contraction.size < 41
    assert not (abs(loop.contraction - 0.11) < 0.015).any()
    assert np.isfinite(loop.half_difference).all()


def test_lost_work_is_the_loop_area(muscle: famjax.Muscle) -> None:
    record = _record(muscle, PressureFriction(C0, C1), 4e5)
    loop = hysteresis_loop(record)
    want = 2 * (C0 + C1 * 4e5) * np.tanh(4.0) * (REST - SHORT)
    assert loop.lost_work.shape == (3,)
    # Friction builds up in the first and the last step of each ramp: 2 of 599.
    np.testing.assert_allclose(loop.lost_work, want, rtol=5e-3)
    area = np.trapezoid(2 * loop.half_difference, loop.contraction) * REST
    assert area == pytest.approx(want, rel=0.05)  # the grid stops half a bin short at both ends
    assert hysteresis_loop(record, cycles=[2]).lost_work.shape == (1,)
    frictionless = hysteresis_loop(_record(muscle, PressureFriction(0.0, 0.0), 4e5))
    np.testing.assert_allclose(frictionless.lost_work, 0, atol=1e-6)


def test_speed(muscle: famjax.Muscle) -> None:
    record = _record(muscle, PressureFriction(C0, C1), 4e5)
    assert hysteresis_loop(record).speed == pytest.approx(SPEED, rel=1e-6)
    assert hysteresis_loop(dataclasses.replace(record, time=None)).speed is None


def test_cycles_may_begin_in_either_direction_and_in_contraction(muscle: famjax.Muscle) -> None:
    record = _record(muscle, PressureFriction(C0, C1), 4e5)
    assert record.time is not None
    loop = hysteresis_loop(record)
    late = slice(640, None)  # begins with lengthening
    other = CyclicRecord.from_contraction(
        record.contraction[late],
        record.force[late],
        record.pressure[late],
        rest_length=REST,
        time=record.time[late],
    )
    np.testing.assert_allclose(other.length, record.length[late], rtol=1e-14)
    shifted = hysteresis_loop(other)
    inner = slice(2, -2)  # the first ramp has no turn before it
    np.testing.assert_allclose(
        shifted.half_difference[inner], loop.half_difference[inner], rtol=1e-6
    )
    assert shifted.lost_work.shape == (2,)


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_pressure_friction_comes_back(muscle: famjax.Muscle, noise: float) -> None:
    fit = fit_pressure_friction(_loops(muscle, PressureFriction(C0, C1), noise))
    truth = np.array([C0, C1]) * np.tanh(4.0)
    assert fit.names == ("constant", "per_pressure")
    if noise:
        np.testing.assert_array_less(abs(fit.values - truth), SIGMAS * fit.stderr)
        np.testing.assert_array_less(fit.stderr, 0.1 * truth)
    else:
        np.testing.assert_allclose(fit.values, truth, rtol=1e-6)
    assert isinstance(fit.friction, PressureFriction)
    at = muscle.geometry.dimensions(0.26, 3e5)
    got = float(fit.friction.amplitude(at, 3e5))
    assert got == pytest.approx(float(fit.values @ [1, 3e5]), rel=1e-12)


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_thread_friction_comes_back(
    muscle: famjax.Muscle, thread: ThreadFriction, noise: float
) -> None:
    loops = _loops(muscle, thread, noise)
    fit = fit_thread_friction(loops, muscle.geometry)
    truth = COEFFICIENT * np.tanh(4.0)
    if noise:
        assert abs(fit.values[0] - truth) < SIGMAS * fit.stderr[0]
        assert fit.stderr[0] < 0.02 * truth
        # Half the difference of two means of about 3 x 600 / 41 readings each.
        assert fit.rmse == pytest.approx(noise / np.sqrt(2 * 3 * 600 / 41), rel=0.25)
    else:
        assert fit.values[0] == pytest.approx(truth, rel=1e-4)
        assert fit.rmse < 1e-2
    assert isinstance(fit.friction, ThreadFriction)
    assert float(fit.friction.rest_area) == pytest.approx(float(thread.rest_area), rel=1e-12)
    # Only the product of coefficient and area is measured.
    halved = fit_thread_friction(loops, muscle.geometry, rest_area=float(thread.rest_area) / 2)
    assert halved.values[0] == pytest.approx(2 * fit.values[0], rel=1e-12)


def test_errors_are_those_of_repeated_tests(muscle: famjax.Muscle) -> None:
    """Standard errors against the scatter over 40 noise seeds; 35 % is what 40 samples can tell."""
    clean = [_record(muscle, PressureFriction(C0, C1), P) for P in PRESSURES]
    fits = []
    for seed in range(40):
        random = np.random.default_rng(seed)
        loops = [
            hysteresis_loop(
                dataclasses.replace(
                    record, force=record.force + 2 * random.standard_normal(record.force.size)
                )
            )
            for record in clean
        ]
        fits.append(fit_pressure_friction(loops))
    scatter = np.std([fit.values for fit in fits], axis=0, ddof=1)
    claimed = np.sqrt(np.mean([fit.stderr**2 for fit in fits], axis=0))
    np.testing.assert_allclose(claimed, scatter, rtol=0.35)


def test_the_right_form_fits_better(muscle: famjax.Muscle, thread: ThreadFriction) -> None:
    loops = _loops(muscle, thread, 0.5)
    assert fit_thread_friction(loops, muscle.geometry).rmse < fit_pressure_friction(loops).rmse
    loops = _loops(muscle, PressureFriction(C0, C1), 0.5)
    assert fit_pressure_friction(loops).rmse < fit_thread_friction(loops, muscle.geometry).rmse


def test_pressure_that_differs_between_branches_is_reported(muscle: famjax.Muscle) -> None:
    record = _record(muscle, PressureFriction(C0, C1), 4e5)
    ripple = 4e5 + 2e3 * np.sign(np.gradient(record.length))
    loop = hysteresis_loop(dataclasses.replace(record, pressure=ripple))
    np.testing.assert_allclose(loop.pressure_difference[2:-2], 4e3, rtol=1e-3)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"rest_length": 0.0}, "rest_length must be > 0"),
        ({"length": np.linspace(-0.1, 0.2, 3840)}, "length must be > 0"),
        ({"force": np.full(3840, np.inf)}, "force of reading 1 is inf"),
        ({"pressure": np.linspace(1e5, 4e5, 3840)}, "must be constant within 10%"),
        ({"time": -np.arange(3840.0)}, "run backwards"),
        ({"length": np.full(3840, 0.25)}, "no complete cycle"),
        ({"length": np.linspace(0.2, 0.3, 3840)}, "no complete cycle"),
    ],
)
def test_bad_records(muscle: famjax.Muscle, change: dict, match: str) -> None:
    record = _record(muscle, PressureFriction(C0, C1), 4e5)
    with pytest.raises(InputError, match=match):
        hysteresis_loop(dataclasses.replace(record, **change))


def test_bad_options(muscle: famjax.Muscle, thread: ThreadFriction) -> None:
    record = _record(muscle, thread, 4e5)
    loop = hysteresis_loop(record)
    with pytest.raises(InputError, match="cycle 4 was asked for"):
        hysteresis_loop(record, cycles=[4])
    with pytest.raises(InputError, match="from 1 up"):
        hysteresis_loop(record, cycles=[])
    with pytest.raises(InputError, match="at least 3 points"):
        hysteresis_loop(record, points=2)
    with pytest.raises(InputError, match="two pressures at least"):
        fit_pressure_friction([loop])
    with pytest.raises(InputError, match="two pressures at least"):
        fit_pressure_friction([loop, loop])
    with pytest.raises(InputError, match="at least one loop"):
        fit_thread_friction([], muscle.geometry)
    with pytest.raises(InputError, match="rest_area must be > 0"):
        fit_thread_friction([loop], muscle.geometry, rest_area=0.0)
    with pytest.raises(InputError, match="trim is a fraction"):
        fit_thread_friction([loop], muscle.geometry, trim=0.5)
    millimetres = dataclasses.replace(loop, rest_length=296.0)
    with pytest.raises(InputError, match="no braid angle somewhere"):
        fit_thread_friction([millimetres], muscle.geometry)
