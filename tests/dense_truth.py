"""Force maps of which the truth is known between the readings, too; nothing here is of famjax.

The truth of a state is what a perfect repetition of the test on the same rig would read.

own: random muscles of `tubes.py`. hard: such muscles fitted to the DMSP-10-250, with 1 N of noise.
bundled: both bundled maps whole, thinned and with noise; their truth is the fit of the whole."""

import dataclasses
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial import Delaunay, QhullError
from tubes import Tube, alike_tube, drawn_rubber

Group = Literal["own", "hard", "bundled"]
BUNDLED = ("DMSP-10-250", "DMSP-20-300")
COUNTS: Mapping[Group, int] = {"own": 60, "hard": 24, "bundled": 30}
"""Maps of each group unless asked otherwise; `bundled` always has them all."""
_DATA = Path(__file__).parents[1] / "fitting" / "maps"
_GRIDS = ((4, 6), (5, 8), (5, 16), (6, 10), (8, 8), (10, 10), (15, 12))  # lengths x pressures
_DENSE, _GAP, _PRESSURES = 25, 8, 17  # lengths of the truth, more in the first gap, and pressures


@dataclasses.dataclass(frozen=True)
class Readings:
    """A force map as it stands in a file: SI, one row per reading, and lines on the specimen."""

    length: np.ndarray
    pressure: np.ndarray
    force: np.ndarray
    lines: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def text(self) -> str:
        head = [f"# specimen: {key} = {value}" for key, value in self.lines.items()]
        rows = zip(self.pressure / 1e3, self.length * 1e3, self.force, strict=True)
        return "\n".join(
            [*head, "pressure_kPa,length_mm,force_N"]
            + [f"{p:.7g},{length:.7g},{f:.6g}" for p, length, f in rows]
        ) + "\n"  # fmt: skip

    def kept(self, which: np.ndarray) -> "Readings":
        columns = (self.length, self.pressure, self.force)
        return Readings(*(column[which] for column in columns), self.lines)


@dataclasses.dataclass(frozen=True)
class TruthMap:
    """Readings, and the states between them with their truth."""

    group: str
    name: str
    seed: int
    about: str  # grid, file and muscle in words
    readings: str  # the CSV file
    length: np.ndarray  # of the states inside the convex hull of the readings
    pressure: np.ndarray
    force: np.ndarray | None = None  # 0 where slack; None: the fit of the map `reference`
    reference: str = ""


def maps(group: Group, count: int | None = None, seed: int = 0) -> Iterator[TruthMap]:
    """The maps of a group, with seeds from this one on; the same seed makes the same map."""
    if group == "bundled":
        yield from itertools.islice(_bundled_maps(), count)
        return
    made = own_map if group == "own" else hard_map
    yield from map(made, range(seed, seed + (COUNTS[group] if count is None else count)))


def states(readings: Readings) -> tuple[np.ndarray, np.ndarray]:
    """A grid in the convex hull of the readings, denser between the longest length and the next."""
    lengths = np.unique(np.round(readings.length, 6))
    gap = np.linspace(lengths[-2], lengths[-1], _GAP + 2)
    L = np.union1d(np.linspace(lengths[0], lengths[-1], _DENSE), gap)
    P = np.linspace(readings.pressure.min(), readings.pressure.max(), _PRESSURES)
    L, P = (grid.ravel() for grid in np.meshgrid(L, P, indexing="ij"))
    scale = np.array([np.ptp(readings.length), np.ptp(readings.pressure)])
    try:
        hull = Delaunay(np.stack([readings.length, readings.pressure], 1) / scale)
    except QhullError:  # all on one line
        return L, P
    inside = hull.find_simplex(np.stack([L, P], 1) / scale, tol=1e-9) >= 0
    return L[inside], P[inside]


# Random muscles in ordinary laboratories


def own_map(seed: int) -> TruthMap:
    """A random muscle, tested by somebody: noise of 0.1 to 1 % of the largest force, slack as 0 or omitted.

    One map of seven begins up to 1.5 % below the rest length.
    """
    random = np.random.default_rng((seed, 1))
    tube, highest, shortest = _working_tube(random)
    n_lengths, n_pressures = _GRIDS[int(random.integers(len(_GRIDS)))]
    longest = tube.rest_length * (1 - random.uniform(5e-3, 0.015) * (random.random() < 0.15))
    lengths = _steps(random, longest, shortest, n_lengths, 5e-4)
    isobars = bool(random.random() < 0.7)
    if isobars:
        pressures = _steps(random, highest * random.uniform(0.08, 0.25), highest, n_pressures, 1e3)
        L, P = (grid.ravel() for grid in np.meshgrid(lengths, pressures))
    else:
        begins = [_onset(tube, length, highest) for length in lengths]
        rows = [_steps(random, start, highest, n_pressures, 1e3) for start in begins]
        L, P = np.repeat(lengths, [row.size for row in rows]), np.concatenate(rows)
    exact = tube.reading(L, P)
    percent = float(np.exp(random.uniform(np.log(0.1), np.log(1.0))))
    noisy = exact + percent / 100 * exact.max() * random.normal(size=exact.size)
    force = np.where(exact > 0, np.maximum(noisy, 0.0), 0.0)
    dropped, said = bool(random.random() < 0.4), bool(random.random() < 0.6)
    readings = Readings(L, P, force, _lines(tube) if said else {})
    if dropped:
        readings = readings.kept(force > 0)
    length, pressure = states(readings)
    about = (
        f"{n_lengths}x{n_pressures} {'isobars' if isobars else 'isometrics'}, {percent:.2g} %"
        f"{', slack dropped' if dropped else ''}{'' if said else ', no lines'}; {_words(tube)}"
    )
    return TruthMap(
        "own", f"own {seed}", seed, about, readings.text(), length, pressure,
        tube.reading(length, pressure),
    )  # fmt: skip


def _working_tube(random: np.random.Generator) -> tuple[Tube, float, float]:
    """A muscle that shortens by a tenth at least; its highest pressure [Pa] and shortest length [m]."""
    while True:
        tube = _tube(random)
        highest = float(np.round(random.uniform(2.5e5, 8e5), -4))
        ratio = 1 - np.linspace(0, 0.35, 36)
        pull = tube.reading(ratio * tube.rest_length, highest)
        if not np.isfinite(pull).all() or pull[0] < 30:
            continue
        free = 1 - ratio[int(np.argmin(pull > 0))] if (pull <= 0).any() else 0.35
        if free >= 0.1:
            return tube, highest, tube.rest_length * (1 - free * float(random.uniform(0.7, 1.0)))


def _tube(random: np.random.Generator) -> Tube:
    """A muscle in its rig, whether it works or not."""
    length = float(np.round(np.exp(random.uniform(np.log(0.06), np.log(0.5))), 3))
    bore = float(np.round(random.uniform(max(8e-3, length / 24), min(45e-3, length / 6)), 3))
    wall = float(np.round(min(bore * random.uniform(0.05, 0.12), 3e-3), 4))
    embedded = wall > 1.8e-3 or random.random() < 0.4
    ends = ("none", "cones", "domes")[int(random.integers(3))]
    deadband = float(random.uniform(5e3, 5e4)) if random.random() < 0.7 else 0.0
    tube = Tube(
        length, bore, wall, 0.5 if embedded else 0.0, float(np.deg2rad(random.uniform(61, 69))),
        drawn_rubber(random, float(np.exp(random.uniform(np.log(0.2e6), np.log(2e6))))),
        ends=ends, end_size=float(random.uniform(*((1.2, 2.2) if ends == "cones" else (0.5, 1.5)))),
        deadband=deadband,
        gain=float(random.uniform(0.98, 1.02)), offset=float(random.uniform(-2e3, 2e3)),
        branch=("mean", "mean", "shortening", "lengthening")[int(random.integers(4))],
        friction=float(random.uniform(0.02, 0.12)),
    )  # fmt: skip
    blocked = 5e5 * np.pi * tube.braid_radius**2 * (2 * np.tan(tube.angle) ** 2 - 1)
    if random.random() < 0.5:  # 0.1 to 1 % at 5 bar
        tube = dataclasses.replace(
            tube, thread_stretch=float(random.uniform(1e-3, 1e-2)) / _tension(tube)
        )
    if random.random() < 0.5:  # at 5 bar up to 0.6 % of the length, and up to 0.2 % of play
        tube = dataclasses.replace(
            tube, rig_give=float(random.uniform(5e-4, 6e-3)) * length / blocked,
            rig_play=float(random.uniform(0, 2e-3)) * length, taut=0.05 * blocked,
        )  # fmt: skip
    return tube


def _tension(tube: Tube) -> float:
    """Of all threads along themselves [N], in the order of magnitude, at 5 bar and rest."""
    return 5e5 * np.pi * tube.braid_radius**2 * 2 * np.tan(tube.angle) ** 2 / np.sin(tube.angle)


def _onset(tube: Tube, length: float, highest: float) -> float:
    """A pressure [Pa] a little above that at which the muscle begins to pull at a length."""
    P = np.linspace(0.05, 0.9, 86) * highest
    return float(P[int(np.argmax(tube.reading(length, P) > 0))])


def _steps(
    random: np.random.Generator, first: float, last: float, count: int, least: float
) -> np.ndarray:
    """Set points from one to the other, even or somewhat uneven, as an instrument can be set."""
    part = np.linspace(0, 1, count)
    if random.random() < 0.5:
        part[1:-1] += random.uniform(-0.3, 0.3, count - 2) / (count - 1)
    return np.unique(np.round((first + part * (last - first)) / least)) * least


def _lines(tube: Tube) -> dict[str, str]:
    return {
        "rest_length_mm": f"{tube.rest_length * 1e3:.4g}",
        "nominal_diameter_mm": f"{tube.bore * 1e3:.4g}",
        "wall_thickness_mm": f"{tube.wall * 1e3:.3g}",
        "embedded": "true" if tube.depth else "false",
    }


def _words(tube: Tube) -> str:
    return (
        f"{tube.rubber.law}, {tube.bore * 1e3:.0f}x{tube.rest_length * 1e3:.0f} mm, "
        f"ends {tube.ends}, threads {'stretch' if tube.thread_stretch else 'stiff'}, "
        f"rig {'gives' if tube.rig_give else 'rigid'}, {tube.branch}"
    )


# Muscles that a real map cannot tell apart


def hard_map(seed: int) -> TruthMap:
    """A muscle that fits the map of the DMSP-10-250, on its grid with 1 N of noise, without lines."""
    whole = bundled_readings(BUNDLED[0])
    loaded = whole.kept(whole.force > 0)
    tube, rmse = alike_tube(loaded.length, loaded.pressure, loaded.force, seed)
    exact = tube.reading(whole.length, whole.pressure)
    noisy = exact + np.random.default_rng((seed, 3)).normal(size=exact.size)
    readings = dataclasses.replace(
        whole, force=np.where(exact > 0, np.maximum(noisy, 0.0), 0.0), lines={}
    )
    length, pressure = states(readings)
    gap = float(tube.reading(np.unique(whole.length)[-1] - 3e-3, 5e5))
    about = f"{gap:.0f} N at 5 bar 3 mm below rest, fits within {rmse:.2f} N; {_words(tube)}"
    return TruthMap(
        "hard", f"hard {seed}", seed, about, readings.text(), length, pressure,
        tube.reading(length, pressure),
    )  # fmt: skip


# Both bundled maps


def bundled_readings(name: str) -> Readings:
    text = (_DATA / f"{name.lower()}.csv").read_text(encoding="utf-8").splitlines()
    marked = [line.removeprefix("# specimen:") for line in text if line.startswith("# specimen:")]
    lines = {key.strip(): value.strip() for key, _, value in (one.partition("=") for one in marked)}
    rows = [line for line in text if not line.startswith("#")][1:]
    P, L, F = np.loadtxt(rows, delimiter=",", unpack=True)
    return Readings(L, P, F, lines)


def _bundled_maps() -> Iterator[TruthMap]:
    """Each whole, thinned and with noise, with lines and without; the whole with lines is the truth."""
    for name in BUNDLED:
        whole = bundled_readings(name)
        for kind, seed, readings in _variants(whole):
            for said in (True, False):
                if kind == "whole" and said:
                    continue
                text = (readings if said else dataclasses.replace(readings, lines={})).text()
                about = f"{kind}{'' if said else ', no lines'}"
                yield TruthMap(
                    "bundled", name, seed, about, text, *states(readings), reference=name
                )


def _variants(whole: Readings) -> Iterator[tuple[str, int, Readings]]:
    yield "whole", 0, whole
    for what, values in (("length", whole.length), ("pressure", whole.pressure)):
        kept = np.unique(values)[::-1][::2]
        yield f"every second {what}", 0, whole.kept(np.isin(values, kept))
    for seed in range(3):
        order = np.random.default_rng((seed, 4)).permutation(whole.force.size)
        yield f"random half {seed}", seed, whole.kept(np.sort(order[: whole.force.size // 2]))
    for kind, size in (("1 N", 1.0), ("1 %", 0.01 * whole.force.max())):
        noise = size * np.random.default_rng((0, 5)).normal(size=whole.force.size)
        noisy = np.where(whole.force > 0, np.maximum(whole.force + noise, 0.0), 0.0)
        yield kind, 0, dataclasses.replace(whole, force=noisy)
