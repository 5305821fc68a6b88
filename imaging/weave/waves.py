"""The yarns' wave in windows along the muscle: how fast it turns, and how many yarns make it."""

import numpy as np

from ..arrays import Array
from .directions import ENDS, Directions, Spectrum, rows_of
from .front import Unrolled

_HARMONICS = (1, 2)
_SPAN = (
    2.0  # widths of a window in the spectrum to either side within which a yarn's wave is sought
)
_FINE = 0.1  # of such a width
_SIDES = 0.95, 0.28  # azimuth and width of the parts between which yarns are counted [rad]
_SEEN = 0.3  # coherence of both parts from which a harmonic counts
_BY_ONE = (
    0.45,
    0.0,
    0.8,
)  # by the first harmonic: off an even number, off an odd one, standard error
_BY_BOTH = 0.6, 0.25, 0.3  # the same by both


class Waves:
    """One family's wave in each window.

    Args:
        surface: the unrolled front.
        seen: what the whole pattern says.
        width: standard deviation of the windows along the meridian [m].
        spacing: of the windows, over this.

    Attributes:
        centres: of the windows along the meridian [m], shape (w,).
    """

    def __init__(self, surface: Unrolled, seen: Directions, width: float, spacing: float) -> None:
        self.surface, self.width = surface, width
        last = float(surface.arc[-1])
        first = min(ENDS * width, 0.4 * last)
        number = max(2, round((last - 2 * first) / (spacing * width)) + 1)
        self.centres = centres = np.linspace(first, last - first, number)
        model = seen.twist_rate(surface.radius)
        between = (model[1:] + model[:-1]) / 2 * np.diff(surface.arc)
        turn = np.concatenate([[0.0], np.cumsum(between)])
        self.model = np.interp(centres, surface.arc, model)
        self._windows: list[tuple[slice, Array, Array]] = []
        for centre, here in zip(centres, self.model, strict=True):
            near = np.flatnonzero(np.abs(surface.arc - centre) < 3 * self.width)
            rows = slice(int(near[0]), int(near[-1]) + 1)
            weight = np.exp(-((surface.arc[rows] - centre) ** 2) / (2 * self.width**2))
            # In this length, in place of the arc's own, threads of one length run straight.
            off = (turn[rows] - np.interp(centre, surface.arc, turn)) / here
            self._windows.append((rows, weight / weight.sum(), off))

    def twist_rates(self, n: float) -> tuple[Array, Array]:
        """Azimuth per arc length g of both families, for n yarns around in each direction.

        Returns:
            g: [rad/m], shape (2, w).
            part: of the power at n / (2 pi) that is the family's wave, shape (2, w).
        """
        k = n / (2 * np.pi)
        spectrum = rows_of(self.surface, k * np.array(_HARMONICS))
        rates, parts = np.empty((2, self.centres.size)), np.empty((2, self.centres.size))
        for w, (rows, weight, off) in enumerate(self._windows):
            for family, sign in enumerate((1, -1)):
                f, part = self._wave(spectrum[rows], weight, sign * off, k * self.model[w])
                rates[family, w], parts[family, w] = f / k, part
        return rates, parts

    def _wave(self, rows: Spectrum, weight: Array, off: Array, about: float) -> tuple[float, float]:
        """Frequency near `about` at which a family's wave runs, and its part of the rows' power."""
        unit = 1 / (2 * np.pi * self.width)
        reach = min(_SPAN * unit, 0.5 * about)
        f = about + np.arange(-reach, reach + _FINE * unit, _FINE * unit)
        power = np.zeros(f.size)
        for column, harmonic in enumerate(_HARMONICS):
            waves = np.exp(-2j * np.pi * harmonic * np.outer(f, off))
            power += harmonic * np.abs(waves @ (weight * rows[:, column])) ** 2
        top = int(np.clip(np.argmax(power), 1, f.size - 2))
        before, here, after = np.log(power[top - 1 : top + 2] + 1e-30)
        shift = (before - after) / 2 / (before - 2 * here + after - 1e-30)
        total = sum(h * float(weight @ np.abs(rows[:, c]) ** 2) for c, h in enumerate(_HARMONICS))
        found = f[top] + float(np.clip(shift, -1, 1)) * (f[1] - f[0])
        return float(found), float(power[top]) / max(total, 1e-30)

    def phase_across(self, n: float, rates: Array, harmonic: int) -> tuple[float, float]:
        """Phase by which a harmonic's wave on the right is ahead of n yarns', against the left.

        Returns:
            The phase [rad], and how far all windows agree in it, 0 to 1.
        """
        k = np.array([harmonic * n / (2 * np.pi)])
        left, right = (
            rows_of(self.surface, k, middle=side * _SIDES[0], across=_SIDES[1])[:, 0]
            for side in (-1, 1)
        )
        product, power = 0j, 0.0
        for w, (rows, weight, off) in enumerate(self._windows):
            for family, sign in enumerate((1, -1)):
                wave = weight * np.exp(-2j * np.pi * sign * k * rates[family, w] * off)
                one, other = wave @ left[rows], wave @ right[rows]
                product += other * np.conj(one)
                power += abs(one * other)
        return float(np.angle(product)), float(abs(product) / max(power, 1e-30))


def count_yarns(waves: Waves, apparent: float) -> tuple[float, float]:
    """Yarns around in each direction, whole where they can be counted.

    Shade moves the crests that the first harmonic sees by so much of a pitch between the left and
    the right, and those of the second by half of it: 2 n_2 - n_1 is free of it. In a braid
    of two over two n is even.

    Args:
        waves: of the muscle.
        apparent: n by the spectrum, to within one and a half.

    Returns:
        n, and its relative standard error, 0 where it is whole.
    """
    rates, _ = waves.twist_rates(apparent)
    numbers = [apparent]
    for harmonic in _HARMONICS:
        phase, agreed = waves.phase_across(apparent, rates, harmonic)
        if agreed < _SEEN:
            break
        numbers.append(apparent + phase / harmonic / (2 * _SIDES[0]))
    both = len(numbers) > len(_HARMONICS)
    best = 2 * numbers[2] - numbers[1] if both else numbers[-1]
    even, odd, stderr = _BY_BOTH if both else _BY_ONE
    nearest = 2 * round(best / 2)
    if abs(best - nearest) < even:
        return float(nearest), 0.0
    if abs(best - round(best)) < odd:
        return float(round(best)), 0.0
    return best, stderr / best
