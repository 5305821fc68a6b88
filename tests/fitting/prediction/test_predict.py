"""Predictions by one program against the muscle's own methods."""

import dataclasses

import jax
import numpy as np
import pytest
from slow_cases import slow_after

import famjax
from fitting import Identification, predict
from fitting.bands import pull
from fitting.prediction import onset_pressure, pressures_for
from fitting.result import Outlook
from tests.fitting.bare import bare_fit

LENGTHS = np.linspace(0.23, 0.29, 7)  # at rest the law has a kink


def muscle(deadband: float, coefficients: tuple[float, ...] = (5.9e6, -19.0e6, 25.8e6)):
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=np.deg2rad(62.0), length=0.296)
    bladder = famjax.Bladder(0.296, 23e-3, 1.8e-3, embedded=True)
    law = famjax.PolynomialMaterial(coefficients)
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, deadband)


def saved(one: famjax.Muscle, outlook: Outlook | None = None) -> Identification:
    force = np.append(np.zeros(LENGTHS.size - 1), 1.0)
    return bare_fit(one, LENGTHS, np.linspace(0.0, 6e5, LENGTHS.size), force, outlook)


@pytest.mark.parametrize("deadband", [0.0, 40e3])
@pytest.mark.parametrize("coefficients", [(5.9e6, -19.0e6, 25.8e6), (-1e6,), (0.0,)])
@pytest.mark.parametrize("highest", [1e5, 1.8e6])
def test_the_onset_is_that_of_the_muscle(
    deadband: float, coefficients: tuple[float, ...], highest: float
) -> None:
    one = muscle(deadband, coefficients)
    lengths = np.append(LENGTHS, 0.4)  # the last is longer than the threads
    expected = np.asarray(one.onset_pressure(lengths, highest, throw=False))
    force = jax.jit(lambda L, P: one.force(L, P))  # noqa: PLW0108 -- a Module's method has no hash
    found = [
        onset_pressure(lambda P, L=L: np.array(force(np.full(P.shape, L), P)), highest)
        for L in lengths
    ]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)
    assert np.isnan(found[-1])


@pytest.mark.parametrize("rest_length", [None, 0.25])
@pytest.mark.parametrize("compliance", slow_after(2, [0.0, 2e-6]))
def test_forces_are_those_of_the_muscle_and_errors_those_of_finite_differences(
    compliance: float, rest_length: float | None
) -> None:
    mounted = famjax.MountedMuscle(muscle(40e3), compliance)
    numbers = [np.asarray(leaf) for leaf in jax.tree.leaves(mounted)]
    spread = np.random.default_rng(0).normal(size=(3, sum(n.size for n in numbers)))
    spread *= 1e-3 * np.concatenate([n.ravel() for n in numbers])
    L, P = np.repeat(LENGTHS, 2) * (rest_length or 0.296) / 0.296, np.tile([2e5, 6e5], 7)
    found = pull(mounted, spread, L, P, rest_length=rest_length, length_std=1e-4)

    def force(changed: famjax.MountedMuscle, length: np.ndarray) -> np.ndarray:
        one = changed.muscle
        one = one if rest_length is None else famjax.cut_to_length(one, rest_length)
        return np.asarray(changed.with_muscle(one).force(length, P))

    alone = dataclasses.replace(mounted, compliance=0.0)
    np.testing.assert_allclose(found.force, force(mounted, L), rtol=1e-12)
    np.testing.assert_allclose(found.muscle_force, force(alone, L), rtol=1e-12)
    _, unflat = jax.flatten_util.ravel_pytree(mounted)
    flat = np.concatenate([n.ravel() for n in numbers])
    step = 1e-3  # of the directions, which are a thousandth of the numbers
    slopes = [
        (force(unflat(flat + step * d), L) - force(unflat(flat - step * d), L)) / (2 * step)
        for d in spread
    ]
    slopes.append((force(mounted, L + 1e-7) - force(mounted, L - 1e-7)) / 2e-7 * 1e-4)
    np.testing.assert_allclose(found.std, np.sqrt(np.sum(np.square(slopes), axis=0)), rtol=1e-6)


@pytest.mark.parametrize("factor", [1.0, 1.08])
def test_why_a_state_is_not_inside(factor: float) -> None:
    one = muscle(40e3)
    if factor > 1:
        ends = famjax.geometries.EndEffectGeometry(one.geometry, factor)
        one = dataclasses.replace(one, geometry=ends)
    thread = 0.296 / np.sin(np.deg2rad(62.0))
    longest, lock = (0.296 + (at - 0.296) / factor for at in (thread, thread / np.sqrt(3)))
    fit = saved(one, Outlook(directions=np.full((1, _numbers(one)), 1e-3)))

    def outside(length: float, pressure: float) -> tuple[str | None, object]:
        (row,) = predict(fit, np.array([length]), np.array([pressure]))
        assert row["inside"] is (row["outside"] is None)
        return row["outside"], row["force_std_N"]

    assert outside(0.27, 3e5)[0] is None
    beyond, std = outside(1.001 * longest, 3e5)
    assert beyond == f"the length is beyond the thread's, {longest * 1e3:.4g} mm"
    assert std is None
    assert "below the braid's lock at the neutral angle" in outside(0.999 * lock, 3e5)[0]
    assert outside(1.001 * lock, 3e5)[0] == "the length is beyond the measured 230 mm to 290 mm"
    assert outside(0.27, 7e5)[0] == "the pressure is beyond the measured 0 kPa to 600 kPa"
    (onset,) = predict(fit, np.array([0.4]), np.array([]), onset=True)
    assert "beyond the thread's" in onset["outside"]


def _numbers(one: famjax.Muscle) -> int:
    return 1 + sum(np.size(leaf) for leaf in jax.tree.leaves(one))


def test_a_force_is_turned_into_its_pressure_and_back() -> None:
    one = saved(muscle(40e3))
    lengths, forces = np.array([0.25, 0.28]), np.array([0.0, 100.0, 1e5])
    rows = pressures_for(one, lengths, forces)
    assert [row["inside"] for row in rows] == [True, True, False] * 2
    for row in rows:
        if row["pressure_Pa"] is None:
            assert "more than the muscle pulls" in row["outside"]
            continue
        (back,) = predict(one, np.array([row["length_m"]]), np.array([row["pressure_Pa"]]))
        assert back["force_N"] == pytest.approx(row["force_N"], abs=1e-6)
    for length, force, words in (([], [1.0], "one of each"), ([-1.0], [1.0], "> 0"),
                                 ([0.25], [-1.0], "only pulls")):  # fmt: skip
        with pytest.raises(famjax.boundary.errors.InputError, match=words):
            pressures_for(one, np.array(length), np.array(force))
