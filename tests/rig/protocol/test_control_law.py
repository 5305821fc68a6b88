"""The integers of the controller against the law in fractions, which round nowhere."""

import random
from fractions import Fraction

from rig.protocol import ControlLaw, drive, next_integral, pressure_error

SEED_COUNT = 400


def _law(r: random.Random) -> ControlLaw:
    return ControlLaw(
        set_point=r.randint(0, 120 * 128),
        feed_forward=r.randint(0, 65280),
        proportional=r.randint(0, 10 * 256),
        integral=r.randint(0, 10 * 256),
        low=r.randint(-255, 0),
        high=r.randint(0, 255),
        zero=r.randint(0, 200 * 16),
        span=r.randint(50 * 64, 500 * 64),
    )


def _error_psi(law: ControlLaw, counts: int, ticks: int) -> Fraction:
    slope = Fraction(law.span, 64) / 1024  # psi per count
    measured = slope * (counts - ticks * Fraction(law.zero, 16))
    return ticks * Fraction(law.set_point, 128) - measured


def test_error_is_rounded_once() -> None:
    r = random.Random(1)
    for _ in range(SEED_COUNT):
        law, ticks = _law(r), r.randint(1, 50)
        counts = r.randint(0, 1023 * ticks)
        exact = _error_psi(law, counts, ticks) * 128
        assert abs(pressure_error(law, counts, ticks) - exact) <= Fraction(1, 2)


def test_output_is_the_sum_of_the_three_terms() -> None:
    r = random.Random(2)
    inside = 0
    for _ in range(SEED_COUNT):
        law, error = _law(r), r.randint(-50 * 128, 50 * 128)
        integral = r.randint(-128 * 32768, 128 * 32768)
        exact = (
            Fraction(law.feed_forward, 256)
            + Fraction(law.proportional, 256) * Fraction(error, 128)
            + Fraction(integral, 32768)
        )
        expected = min(max(exact, Fraction(0)), Fraction(255))
        assert abs(drive(law, integral, error) - expected) <= Fraction(1, 2)
        inside += expected == exact
    assert inside > SEED_COUNT // 4  # the limits are not all that was tried


def test_integral_is_odd_in_the_error_and_keeps_within_its_limits() -> None:
    r = random.Random(3)
    for _ in range(SEED_COUNT):
        law = _law(r)._replace(low=-100, high=100)
        error = r.randint(-(10**6), 10**6)
        assert next_integral(law, 0, error) == -next_integral(law, 0, -error)
        wide = next_integral(law._replace(low=-7, high=3), r.randint(-(2**23), 2**23), error)
        assert -7 * 32768 <= wide <= 3 * 32768


def test_literal_reading_cannot_exhaust_at_the_set_point() -> None:
    """An integral in 0..255 upon v = 128 never goes below 128 where the error is 0."""
    literal = ControlLaw(feed_forward=128 * 256, proportional=4 * 256, low=0, high=255)
    lowest = next_integral(literal, 0, -(10**6))
    assert drive(literal, lowest, 0) == 128
    assert drive(literal._replace(low=-128, high=128), -128 * 32768, 0) == 0
