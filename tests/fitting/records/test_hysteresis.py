"""Half-differences of branches: known strengths recovered, measured muscles predicted, feed-forward."""

import numpy as np
import pytest
from maps import BPA10, bpa10_maps, clarabel_objective, festo10_pairs

import fitting
from famjax.boundary.errors import InputError
from famjax.cards import slip_from_dict
from famjax.slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements
from fitting.records import BranchPairs, fit_hysteresis, hysteresis as module, leave_out
from fitting.records.hysteresis import half_difference_columns, threshold_grid

REST, TOP = 0.25, 6e5
WALL, BRAID = np.array([0.006, 0.02]), np.array([0.002, 0.008, 0.02])
TRUTH = MaxwellSlip(
    SlipElements(WALL, [4.0, 0.0]), SlipElements(BRAID, [9.0, 0.0, 30.0]), REST, 1e6
)
CERTIFIED = 1e-10


def _ramp(contraction: float, noise: float, seed: int) -> BranchPairs:
    """A record made by going through it step by step."""
    L, P = REST * (1 - contraction), np.linspace(0, TOP, 25)
    whole = np.asarray(TRUTH.along(np.full(49, L), np.concatenate([P, P[-2::-1]])))
    half = (whole[24:][::-1] - whole[:25]) / 2
    half = half + noise * np.random.default_rng(seed).normal(size=half.size)
    about = {"turn_pressure": TOP, "rest_length": REST, "name": f"{contraction:.0%}"}
    return BranchPairs.ramp(L, P[4:-1], half[4:-1], **about)


def _ramps(noise: float = 0.0) -> BranchPairs:
    contractions = (0.0, 0.03, 0.07, 0.12)
    return BranchPairs.joined([_ramp(eps, noise, k) for k, eps in enumerate(contractions)])


TRUE = np.array([4.0, 0.0, 9.0, 0.0, 30.0])


def test_known_strengths_are_recovered(monkeypatch):
    """At the true thresholds, without shrinkage."""
    monkeypatch.setattr(module, "SHRINKAGE", 0.0)
    monkeypatch.setattr(module, "threshold_grid", lambda _: (WALL, BRAID))
    fit = fit_hysteresis(_ramps())
    np.testing.assert_allclose(fit.strength, TRUE, atol=1e-6 * TRUE.max())  # of exact data
    assert fit.rms < 1e-9


def test_strengths_are_optimal_and_certified():
    pairs = _ramps(noise=0.5)
    fit = fit_hysteresis(pairs)
    assert 0 <= fit.duality_gap < CERTIFIED
    assert 0 <= fit.kkt_residual < CERTIFIED
    S = fit.strength
    assert (S >= 0).all()
    A = half_difference_columns(pairs, threshold_grid(pairs))
    size = np.sqrt(1e-3) * np.linalg.norm(A, axis=0).max()
    A = np.concatenate([A, size * np.eye(S.size)])
    b = np.concatenate([pairs.half_difference, np.zeros(S.size)])
    theirs = clarabel_objective(A, b, np.eye(S.size), np.zeros(S.size))
    assert 0.5 * float(np.sum((A @ S - b) ** 2)) == pytest.approx(theirs, rel=1e-6)


def test_records_and_lengths_left_out_are_predicted():
    twice = BranchPairs.joined([_ramps(noise=0.2), _ramps(noise=0.3)])
    fit = leave_out(fit_hysteresis(twice))
    kinds = {one.groups: one for one in fit.left_out}
    assert set(kinds) == {"record", "length"}
    assert kinds["record"].ratio < 0.2
    assert kinds["length"].ratio < 0.4
    assert fitting.records.hysteresis_warnings(fit) == ()


def test_a_muscle_at_rest_has_no_loop():
    fit = leave_out(fit_hysteresis(_bad(length=REST)))
    assert not fit.strength.any()
    assert "zero strength" in fitting.records.hysteresis_warnings(fit)[0]


@pytest.mark.parametrize(
    "cycle",
    [ReferenceCycle("ramp", 0.0, TOP, False), ReferenceCycle("stroke", REST, 0.85 * REST, True)],
    ids=["ramp", "stroke"],
)
def test_the_static_map_is_the_middle_of_its_cycles(cycle):
    model = CentredSlip(TRUTH, cycle)
    n = 31
    moving = np.linspace(cycle.start, cycle.turn, n)
    there_and_back = np.concatenate([moving, moving[-2::-1]])
    other = np.full(there_and_back.size, 0.92 * REST if cycle.kind == "ramp" else 4e5)
    L, P = (other, there_and_back) if cycle.kind == "ramp" else (there_and_back, other)
    added = np.asarray(model.along(L, P))
    np.testing.assert_allclose(added[:n] + added[n - 1 :][::-1], 0.0, atol=1e-9)
    whole = np.asarray(TRUTH.along(L, P))
    if cycle.kind == "ramp":
        difference = (whole[n - 1 :][::-1] - whole[:n]) / 2
        np.testing.assert_allclose(added[n - 1 :][::-1], difference, atol=1e-9)
    assert added[n + n // 2] > 0 > added[n // 2]
    assert np.isfinite(model.middle(L, 1.3 * P)).all()


def test_saved_and_read_back():
    fit = leave_out(fit_hysteresis(_ramps(noise=0.1)))
    document = fitting.records.hysteresis_as_dict(fit)
    again = slip_from_dict(document)
    assert again.cycle == fit.centred.cycle
    L, P = np.full(5, 0.22), np.array([0, 3e5, 6e5, 2e5, 4e5])
    np.testing.assert_array_equal(again.along(L, P), fit.centred.along(L, P))
    assert document["left_out"]["length"]["ratio"] == pytest.approx(fit.left_out[1].ratio)
    with pytest.raises(InputError, match=r"cannot be read .*required field .wall"):
        slip_from_dict({k: v for k, v in document.items() if k != "wall"})
    title, header, rows = fitting.records.hysteresis_table(fit, "us")
    assert "80 points" in title
    assert header[1] == "lbf"
    assert float(rows[0][1]) == pytest.approx(fit.pairs.measured_rms / 4.4482216, rel=1e-3)


P2, HALF2 = np.array([1e5, 2e5]), np.array([1.0, 2.0])


def _bad(length=0.2, P=P2, half=HALF2, turn=TOP, rest=REST) -> BranchPairs:
    return BranchPairs.ramp(length, P, half, turn_pressure=turn, rest_length=rest)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: _bad(turn=1.5e5), "between 0 and its turning point"),
        (lambda: _bad(P=P2[:0], half=HALF2[:0]), "got none"),
        (lambda: _bad(half=np.array([1.0, np.nan])), "half_difference of reading 2 is nan"),
        (lambda: _bad(length=-0.2), "length must be > 0"),
        (lambda: _bad(rest=0.0), "rest_length must be > 0"),
        (lambda: BranchPairs.joined([_bad(), _bad(rest=1.0)]), "the same rest length"),
    ],
)  # fmt: skip
def test_bad_pairs(call, words):
    with pytest.raises(InputError, match=words):
        call()


LIMIT = 0.6  # of the measured root mean square


def _fit(pairs: BranchPairs) -> fitting.records.HysteresisFit:
    fit = leave_out(fit_hysteresis(pairs))
    assert fit.duality_gap < CERTIFIED
    assert fit.kkt_residual < CERTIFIED
    return fit


@pytest.mark.slow
def test_bpa10_records_and_lengths_left_out():
    for name, made in bpa10_maps().items():
        rest_length = BPA10[name]["Unkink"]
        fit = _fit(fitting.records.ramp_pairs(made.points, rest_length=rest_length))
        ratios = {one.groups: one.ratio for one in fit.left_out}
        assert set(ratios) == {"record", "length"}
        assert max(ratios.values()) <= LIMIT, (name, ratios)


@pytest.mark.slow
def test_festo10_lengths_left_out():
    fits = {name: _fit(pairs) for name, pairs in festo10_pairs().items()}
    each = ((name, one) for name, fit in fits.items() for one in fit.left_out)
    left = {name: one for name, one in each if one.groups == "length"}
    assert len(left) == 5
    assert max(one.ratio for one in left.values()) <= LIMIT
    points = [fit.pairs.length.size for fit in fits.values()]
    errors = np.dot(points, [one.rms**2 for one in left.values()])
    measured = np.dot(points, [fit.pairs.measured_rms**2 for fit in fits.values()])
    assert np.sqrt(errors / measured) <= LIMIT
