"""The raw record of the reference work is not printed: a synthetic one of known truth stands in.

It has the reference work's size (inch, psi, lbf) and law, and around them what a rubber shows:
a stiffer first cycle (Mullins), a permanent set, a lower unloading branch, slack, holds, noise.
"""

import dataclasses

import numpy as np
import pytest

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


def test_true_stress_is_at_constant_volume() -> None:
    record = Truth().record()
    area = record.volume / (LENGTH + record.displacement)  # of the stretched strip
    np.testing.assert_allclose(record.true_stress, record.force / area, rtol=1e-12)
    # The reference work's own figures: 0.49 in3 at rest, 0.05 in2 at the largest strain.
    assert record.volume == pytest.approx(0.49, abs=0.01)
    assert record.volume / (3.1875 * 3.1) == pytest.approx(0.05, abs=0.002)


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
