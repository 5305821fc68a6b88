"""The raw record of the reference work is not printed: a synthetic one of known truth stands in.

It has the reference work's size (inch, psi, lbf) and law, and around them what a rubber shows:
a stiffer first cycle (Mullins), a permanent set, a lower unloading branch, slack, holds, noise.
"""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from jaxtyping import TypeCheckError

from famjax.boundary.errors import InputError
from fitting.records import BladderCharacterisation, TensileRecord, characterise_bladder

LAW = np.array([257.8, -57.9, 32.7])  # psi: the reference work's latex
LENGTH, AREA, SET = 3.09375, 0.16, 3 / 32  # in, in2, in
SIGMAS = 4.0  # standard errors that an estimate may miss the truth by; seeds are fixed


@dataclasses.dataclass(frozen=True)
class Truth:
    """A tensile test. Everything that is not the law itself can be switched off."""

    cycles: int = 5
    noise: float = 0.0  # of the force, lbf
    mullins: float = 0.35  # the first loading is stiffer by this
    loss: float = 0.12  # unloading is softer by this at half strain
    set: float = SET
    hold: int = 25
    rows: int = 400
    position_noise: float = 0.0
    seed: int = 0

    def sets(self) -> np.ndarray:
        """Permanent set after each cycle: most of it comes with the first."""
        return self.set * (1 - 0.2 ** np.arange(1.0, self.cycles + 1)) / (1 - 0.2**self.cycles)

    def record(self, max_strain: float = 2.1) -> TensileRecord:
        top = max_strain * (LENGTH + self.set) + self.set
        ramp = np.linspace(0, top, self.rows)
        d, force = [], []
        before = 0.0
        for number, after in enumerate(self.sets(), 1):
            for x, zero, rising in ((ramp, before, True), (ramp[::-1], after, False)):
                strain = (x - zero) / (LENGTH + zero)
                part = np.maximum(strain, 0) / max_strain
                stress = sum(E * np.maximum(strain, 0) ** (n + 1) for n, E in enumerate(LAW))
                # Softening and loss vanish at both ends, so that the branches join at the top.
                bump = 4 * part * (1 - part)
                change = self.mullins * (number == 1) if rising else -self.loss
                true = stress * (1 + change * bump)
                F = true * AREA * LENGTH / (LENGTH + x)
                d += [x, np.full(self.hold, x[-1])]
                force += [F, np.full(self.hold, F[-1])]
            before = after
        d, force = np.concatenate(d), np.concatenate(force)
        random = np.random.default_rng(self.seed)
        force = force + self.noise * random.standard_normal(d.size)
        d = d + self.position_noise * random.standard_normal(d.size)
        return TensileRecord(force, d, LENGTH, AREA, time=np.arange(d.size) * 0.05)


NOISY = Truth(noise=0.15, rows=2000, hold=100, seed=3)


@pytest.fixture(scope="module")
def noisy() -> BladderCharacterisation:
    return characterise_bladder(NOISY.record())


def test_truth_without_noise_comes_back() -> None:
    """Only the parabola through the first stresses is not exact: 2e-4 of the length."""
    fit = characterise_bladder(Truth().record()).fit
    np.testing.assert_allclose(fit.coefficients, LAW, rtol=1.5e-3)
    assert fit.rmse < 0.01


def test_truth_with_noise_comes_back_within_its_errors(noisy: BladderCharacterisation) -> None:
    fit = noisy.fit
    assert fit.coefficients.shape == fit.stderr.shape == (3,)
    np.testing.assert_array_less(abs(fit.coefficients - LAW), SIGMAS * fit.stderr)
    np.testing.assert_array_less(fit.stderr, 0.05 * abs(LAW))  # and the errors are worth having
    # Noise of 0.15 lbf on the true stress, 0.15 l / V, rms over the readings; the errors of the
    # unloaded lengths add to it.
    length = 1 + fit.strain
    expected = 0.15 * (LENGTH + SET) / (AREA * LENGTH) * np.sqrt(np.mean(length**2))
    assert expected * 0.97 < fit.rmse < 1.15 * expected
    assert fit.mae == pytest.approx(np.mean(abs(fit.residuals)))


def test_errors_are_those_of_repeated_tests() -> None:
    """Standard errors against the scatter over 60 noise seeds; 25 % is what 60 samples can tell."""
    fits = [
        characterise_bladder(Truth(noise=0.15, rows=80, seed=seed).record(), cycles=[4, 5]).fit
        for seed in range(60)
    ]
    scatter = np.std([fit.coefficients for fit in fits], axis=0, ddof=1)
    claimed = np.sqrt(np.mean([fit.stderr**2 for fit in fits], axis=0))
    np.testing.assert_allclose(claimed, scatter, rtol=0.25)


def test_mullins_softening_is_found(noisy: BladderCharacterisation) -> None:
    assert noisy.mullins
    assert len(noisy.cycles) == 5
    first, *later = noisy.cycles
    assert (first.half_ratio, first.half_ratio_stderr) == (1.0, 0.0)
    assert first.peak_ratio == 1.0
    truth = NOISY.record()
    clean = characterise_bladder(dataclasses.replace(NOISY, noise=0.0).record())
    for cycle, exact in zip(later, clean.cycles[1:], strict=True):
        assert cycle.half_ratio < 0.85
        assert abs(cycle.half_ratio - exact.half_ratio) < SIGMAS * cycle.half_ratio_stderr
        assert abs(cycle.peak_ratio - exact.peak_ratio) < SIGMAS * cycle.peak_ratio_stderr
        assert cycle.peak_ratio > cycle.half_ratio  # softening closes up at the largest strain
    assert first.max_strain == pytest.approx(truth.displacement.max() / LENGTH, rel=1e-3)


def test_half_ratio_is_the_ratio_of_the_curves() -> None:
    """By hand: the two loading curves at half the largest displacement, with their zeros."""
    truth = Truth()
    report = characterise_bladder(truth.record()).cycles[1]
    half, top = truth.record().displacement.max() / 2, 2.1

    def stress(zero: float, change: float) -> float:
        e = (half - zero) / (LENGTH + zero)
        part = e / top
        return float(LAW @ e ** np.arange(1, 4)) * (1 + change * 4 * part * (1 - part))

    want = stress(truth.sets()[0], 0.0) / stress(0.0, truth.mullins)
    assert report.half_ratio == pytest.approx(want, rel=1e-4)


def test_a_rubber_without_softening_is_not_called_soft() -> None:
    for seed in range(5):
        result = characterise_bladder(Truth(mullins=0, set=0, noise=0.15, seed=seed).record())
        assert not result.mullins
        assert abs(1 - result.cycles[1].half_ratio) < SIGMAS * result.cycles[1].half_ratio_stderr


def test_permanent_set_and_gauge_length(noisy: BladderCharacterisation) -> None:
    for cycle, after in zip(noisy.cycles, NOISY.sets(), strict=True):
        assert abs(cycle.permanent_set - after) < SIGMAS * cycle.permanent_set_stderr
        assert cycle.permanent_set_stderr < 0.01
        assert cycle.gauge_length == LENGTH + cycle.permanent_set
    assert noisy.cycles[-1].gauge_length == pytest.approx(3.1875, abs=0.02)  # printed


def test_rate_and_lost_energy() -> None:
    truth = Truth(loss=0.0, mullins=0.0, set=0.0)
    for cycle in characterise_bladder(truth.record()).cycles:
        assert cycle.lost_energy == pytest.approx(0, abs=1e-6)
        top = 2.1 * LENGTH
        assert cycle.rate == pytest.approx(top / ((truth.rows - 1) * 0.05), rel=1e-6)
    lossy = characterise_bladder(dataclasses.replace(truth, loss=0.12).record()).cycles[2]
    e = np.linspace(0, 2.1, 20001)
    power = (e[:, None] ** np.arange(1, 4) @ LAW) * 0.12 * 4 * e / 2.1 * (1 - e / 2.1) / (1 + e)
    assert lossy.lost_energy == pytest.approx(np.trapezoid(power, e), rel=1e-4)
    record = dataclasses.replace(truth.record(), time=None)
    assert characterise_bladder(record).cycles[0].rate is None


def test_true_stress_is_at_constant_volume() -> None:
    record = Truth().record()
    area = record.volume / (LENGTH + record.displacement)  # of the stretched strip
    np.testing.assert_allclose(record.true_stress, record.force / area, rtol=1e-12)
    # The reference work's own figures: 0.49 in3 at rest, 0.05 in2 at the largest strain.
    assert record.volume == pytest.approx(0.49, abs=0.01)
    assert record.volume / (3.1875 * 3.1) == pytest.approx(0.05, abs=0.002)


@pytest.mark.parametrize("branch", ["unloading", "both"])
def test_other_branches(branch: str) -> None:
    result = characterise_bladder(Truth(noise=0.05).record(), branch=branch, order=4)  # pyright: ignore
    loading = characterise_bladder(Truth(noise=0.05).record(), order=4)
    middle = np.linspace(0.5, 1.5, 5)
    lower = result.fit.material.stress(middle) / loading.fit.material.stress(middle)
    part = middle / 2.1
    want = 1 - 0.12 * 4 * part * (1 - part) * (1 if branch == "unloading" else 0.5)
    np.testing.assert_allclose(lower, want, atol=0.01)  # a quartic follows a quintic


def test_chosen_cycles_only() -> None:
    """The first cycle is stiffer: fitted alone it must show."""
    record = Truth().record()
    first = characterise_bladder(record, cycles=[1]).fit
    later = characterise_bladder(record, cycles=[3, 4, 5]).fit
    assert float(first.material.stress(1.0)) > 1.2 * float(later.material.stress(1.0))


def test_material_goes_into_the_model(noisy: BladderCharacterisation) -> None:
    law = noisy.fit.material
    np.testing.assert_allclose(
        law.stress(noisy.fit.strain) - noisy.fit.stress, noisy.fit.residuals, atol=1e-9
    )
    axial, hoop = eqx.filter_jit(law.stresses)(-0.3, 1.5, 80.0)
    assert float(axial) == -float(law.stress(0.3))
    assert float(hoop) == float(law.stress(1.5))


def test_errors_as_large_as_the_reference_works_do_not_hide_the_law() -> None:
    """The reference work prints an RMSE of 5.5 psi; here all of it is noise, its worst kind."""
    record = Truth(rows=2000).record()
    unit = record.volume / (LENGTH + record.displacement)
    noise = 5.5 * unit * np.random.default_rng(0).standard_normal(unit.size)
    fit = characterise_bladder(dataclasses.replace(record, force=record.force + noise)).fit
    np.testing.assert_array_less(abs(fit.coefficients - LAW), SIGMAS * fit.stderr)
    assert 5.3 < fit.rmse < 8.3  # the unloaded lengths, found in that noise, add to it


def test_slack_below_the_unloaded_length_does_not_matter() -> None:
    """A buckled specimen pushes a little: those readings neither move zero nor enter the fit."""
    record = Truth().record()
    slack = record.force == 0
    assert slack.sum() > 100
    pushed = dataclasses.replace(record, force=np.where(slack, -0.05, record.force))
    for one, other in zip(
        characterise_bladder(record).cycles, characterise_bladder(pushed).cycles, strict=True
    ):
        # In inches; the window's edge, found in a running mean, may move by one reading.
        assert one.permanent_set == pytest.approx(other.permanent_set, abs=2e-4)


def test_noise_in_position_and_no_holds() -> None:
    truth = Truth(noise=0.05, position_noise=1e-3, hold=0, seed=5)
    result = characterise_bladder(truth.record())
    assert len(result.cycles) == 5
    np.testing.assert_allclose(result.fit.coefficients, LAW, rtol=0.02)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"cycles": [5, 6]}, "cycle 6 was asked for, but the record has 5"),
        ({"cycles": []}, "from 1 up"),
        ({"order": 0}, "order must be 1 to 8"),
        ({"branch": "up"}, "branch"),
        ({"min_travel": 2.0}, "min_travel"),
    ],
)
def test_bad_options(options: dict, match: str) -> None:
    # The suite checks annotations at run time, and is then the first to see a wrong literal.
    with pytest.raises((InputError, TypeCheckError), match=match):
        characterise_bladder(Truth(rows=60).record(), **options)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"area": 0.0}, "area must be > 0"),
        ({"area": np.nan}, "area must be > 0"),
        ({"gauge_length": -1.0}, "gauge_length must be > 0"),
        ({"force": np.full(850, np.nan)}, "force of reading 1 is nan"),
        ({"time": -np.arange(850.0)}, "time must not run backwards"),
        ({"displacement": np.full(850, -9.0)}, "shortens the gauge length"),
        ({"displacement": np.ones(850)}, "no complete cycle"),
        ({"displacement": np.linspace(0, 9, 850)}, "no complete cycle"),
    ],
)
def test_bad_records(change: dict, match: str) -> None:
    with pytest.raises(InputError, match=match):
        characterise_bladder(dataclasses.replace(Truth(rows=60).record(), **change))


def test_a_cycle_that_is_not_unloaded_has_no_set_and_no_fit() -> None:
    record = Truth(hold=0).record()
    loaded = record.displacement > 0.3 * record.displacement.max()
    held = TensileRecord(record.force[loaded], record.displacement[loaded], LENGTH, AREA)
    with pytest.raises(InputError, match="does not return to zero force"):
        characterise_bladder(held)


def test_too_few_readings() -> None:
    d = np.tile([0.0, 1.0, 2.0, 1.0], 4)
    with pytest.raises(InputError, match="does not return to zero force"):
        characterise_bladder(TensileRecord(20 * d, d, LENGTH, AREA), cycles=[1])
