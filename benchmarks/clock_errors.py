"""Whether the stated errors of two clocks are those that are made, over simulated tests of known clocks.

    python benchmarks/clock_errors.py [--twins 100] [--first 0] [--json FILE]

`load`: a test on the simulated rig in air (sensors of 10 bit, a serial line, a device whose clock is
off by some parts in a thousand, a machine's log of 50 rows a second whose clock is ahead and drifts)
is written, read back and analysed; the machine's clock is laid onto the journal by the load. `motion`:
lengths in photographs, with noise and a shutter that jitters, are laid onto a machine's displacement.
Errors are over their stated standard errors: the root mean square is 1 where these are right, and
scatters by 7 % over 100 twins. Seeds are those of the first twin and up. Ends with 1 where a root mean
square lies outside 0.8 to 1.2.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from famjax.app import simulate
from famjax.units import INCH, PSI
from fitting.records import MachineLog, synchronise
from rig.control import Control
from rig.plan import Isobaric, PlanFile
from rig.simulation import MachineClock, mckibben

LIMITS = (0.8, 1.2)
"""Between which a root mean square of standardised errors must lie."""


def by_load(seed: int) -> dict[str, float]:
    """Errors of offset and rate, by the load of a simulated test, over their standard errors."""
    rng = np.random.default_rng((seed, 0))
    muscle = mckibben(friction=rng.uniform(0.005, 0.03), turns=1.09 * rng.uniform(0.97, 1.03))
    low = rng.uniform(30, 45)
    pressures = tuple(float(P) * PSI for P in (low, low + 20, low + 40))
    plan = Isobaric(pressures, 1, 2.0 * INCH, 0.3 * INCH, settle=3.0)
    clock = MachineClock(float(rng.uniform(-50, 50)), float(rng.uniform(-1e-4, 1e-4)))
    with tempfile.TemporaryDirectory() as folder:
        found = simulate(
            PlanFile(plan, "air", 115 * PSI, Control.per_psi(4, 2)), folder, muscle=muscle,
            clock=clock, clock_rate=float(rng.uniform(-3e-3, 3e-3)), seed=seed,
        ).analysis.alignment  # fmt: skip
    apart = float(found.journal_time(found.reference)) - clock.true_time(found.reference)
    gain = 1 / (1 + clock.rate) - 1
    return {
        "offset [ms]": 1e3 * apart,
        "offset": apart / found.offset_error,
        "rate": (found.rate - gain) / found.rate_error,
    }


def by_motion(seed: int) -> dict[str, float]:
    """The same by the lengths in photographs of a stroke there and back."""
    rng = np.random.default_rng((seed, 1))
    offset, rate = rng.uniform(-30, 30), 1 + rng.uniform(-3e-4, 3e-4)
    shown = np.arange(0, 270.0, 0.1)

    def displacement(at: np.ndarray) -> np.ndarray:
        return 2.8 * INCH * (1 - np.abs(2 * np.clip((at - 10) / 240, 0, 1) - 1))

    taken = 0.4 + 1.09 * np.arange(220)
    middle = taken.mean()
    at = taken + offset + (rate - 1) * (taken - middle) + rng.normal(0, 0.01, taken.size)
    lengths = 9.28 * INCH - displacement(at) + rng.normal(0, 0.001 * INCH, taken.size)
    found = synchronise(taken, lengths, MachineLog(shown, displacement(shown), source="log"))
    apart = found.offset - offset - (rate - 1) * (found.reference - middle)
    return {
        "offset [ms]": 1e3 * apart,
        "offset": apart / found.offset_stderr,
        "rate": (found.rate - rate) / found.rate_stderr,
    }


WAYS: dict[str, Callable[[int], dict[str, float]]] = {"load": by_load, "motion": by_motion}
"""How two clocks are laid onto each other."""


def root_mean_squares(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    """Over the twins, by figure."""
    return {key: float(np.sqrt(np.mean([row[key] ** 2 for row in rows]))) for key in rows[0]}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each twin, and the root mean squares."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--twins", type=int, default=100)
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--json", type=Path, help="file for the rows")
    given = parser.parse_args(arguments)
    rows: dict[str, list[dict[str, float]]] = {way: [] for way in WAYS}
    for seed in range(given.first, given.first + given.twins):
        for way, errors in WAYS.items():
            rows[way].append(one := errors(seed))
            told = ", ".join(f"{key} {value:.2f}" for key, value in one.items())
            print(f"seed {seed}, {way}: {told}", flush=True)
    sums = {way: root_mean_squares(found) for way, found in rows.items()}
    print(f"root mean squares of seeds {given.first} to {given.first + given.twins - 1}:")
    for way, figures in sums.items():
        print(f"{way}: " + ", ".join(f"{key} {value:.3f}" for key, value in figures.items()))
    if given.json:
        given.json.write_text(json.dumps({"rows": rows, "root mean squares": sums}, indent=1))
    figures = [of[name] for of in sums.values() for name in ("offset", "rate")]
    return int(any(not LIMITS[0] <= value <= LIMITS[1] for value in figures))


if __name__ == "__main__":
    sys.exit(main())
