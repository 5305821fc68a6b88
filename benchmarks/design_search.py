"""Speed of the search of designs beside NumPy's, on the same candidates, with their agreement.

    python benchmarks/design_search.py [--candidates 1e6] [--loop 2000] [--json]

The peers do what a person would write for the same numbers, blocked force, usable contraction and
outer diameter at the stroke: a loop over candidates with NumPy's scalars and SciPy's `brentq` for the
free contraction, and the same formulas on whole arrays with 50 bisections. They keep no front and no
table; the arrays take 16384 candidates at a time. One process; of ours the compilation is apart. The
free contraction does not depend on the rest length: ours solves it once for all lengths of a pair and
a pressure. The peak of memory is that of the process after
a tenth of the candidates and after all.
"""

import argparse
import json
import math
import os
import resource
import time
from typing import Any

os.environ.setdefault("PJRT_NPROC", "16")

import jax
import numpy as np
from scipy.optimize import brentq

from famjax import PolynomialMaterial, units
from famjax.design import (
    Requirement,
    SearchLimits,
    SearchRanges,
    SpaceSearch,
    load_catalogue,
    search_space,
)

jax.config.update("jax_enable_x64", True)

INCH, PSI, LBF = units.INCH, units.PSI, units.LBF
LATEX = np.array([257.8, -57.9, 32.7]) * PSI
ASKED = Requirement(100 * PSI, 400 * LBF, 0.15, 2.2 * INCH)
LIMITS = SearchLimits(stroke=2 * INCH, longest_length=18 * INCH)
RANGES = SearchRanges((4 * INCH, 18 * INCH), (20 * PSI, 100 * PSI))


def ours(candidates: int) -> SpaceSearch:
    """The search with its front and its table; nothing is refined."""
    return search_space(
        load_catalogue(), ASKED, ranges=RANGES, limits=LIMITS, about=candidates,
        material=PolynomialMaterial(LATEX), refined_pairs=0,
    )  # fmt: skip


def force(L: Any, of: dict[str, Any]) -> Any:
    """Pull [N] at lengths [m]: Gaylord's force, the bladder's axial and hoop stress."""
    R = np.sqrt(of["B"] ** 2 - L**2) / (2 * np.pi * of["N"])
    tangent = L / np.sqrt(of["B"] ** 2 - L**2)
    volume = np.pi * (of["D0"] - of["t0"]) * of["t0"] * of["L0"]
    t = R - np.sqrt(R**2 - volume / (np.pi * L))
    axial, hoop = L / of["L0"] - 1, (R - t / 2) / (of["D0"] / 2 - of["t0"] / 2) - 1
    stress = [sum(np.sign(e) * E * np.abs(e) ** (n + 1) for n, E in enumerate(LATEX))
              for e in (axial, hoop)]  # fmt: skip
    gaylord = of["P"] * np.pi * R**2 * (2 * tangent**2 - 1)
    return gaylord + stress[0] * volume / L - stress[1] * t * L**2 / (2 * np.pi * R * of["N"] ** 2)


def designs(found: SpaceSearch, index: np.ndarray) -> dict[str, Any]:
    """Sizes of some candidates of a search."""
    at = found.grid.candidates(index)

    def each(size: Any) -> np.ndarray:
        return np.array([size(pair) for pair in found.pairs])[at["pair"]]

    nominal = each(lambda p: p.braid.nominal_diameter)
    of = {"D0": each(lambda p: p.bladder.diameter), "t0": each(lambda p: p.bladder.thickness),
          "L0": at["rest_length"], "P": at["pressure"],
          "braid": each(lambda p: p.braid.thickness)}  # fmt: skip
    angle = np.arccos(of["D0"] / nominal / math.sqrt(2))
    jammed = np.arccos(each(lambda p: p.braid.diameter_range[1]) / nominal / math.sqrt(2))
    return of | {
        "B": of["L0"] / np.sin(angle),
        "N": of["L0"] / (np.pi * of["D0"] * np.tan(angle)),
        "jams": 1 - np.sin(jammed) / np.sin(angle),
        "neutral": of["L0"] / np.sin(angle) / math.sqrt(3),
    }


def results(free_length: Any, of: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Blocked force [N], usable contraction [-], outer diameter [m] at the stroke."""
    usable = np.minimum(1 - free_length / of["L0"], of["jams"])
    at = np.minimum(np.maximum(ASKED.contraction, LIMITS.stroke / of["L0"]), usable)
    L = of["L0"] * (1 - at)
    diameter = np.sqrt(of["B"] ** 2 - L**2) / (np.pi * of["N"]) + 2 * of["braid"]
    return force(of["L0"], of), usable, diameter


def loop(of: dict[str, Any]) -> np.ndarray:
    """One candidate after the other, with `brentq`."""
    rows = []
    for k in range(len(of["L0"])):
        one = {name: values[k] for name, values in of.items()}
        free = brentq(force, 0.95 * one["neutral"], one["L0"], args=(one,), xtol=1e-14)
        rows.append(results(free, one))
    return np.array(rows)


def arrays(of: dict[str, Any]) -> np.ndarray:
    """All candidates at once, with 50 bisections."""
    low, high = 0.95 * of["neutral"], of["L0"].copy()
    for _ in range(50):
        middle = 0.5 * (low + high)
        pulls = force(middle, of) > 0
        low, high = np.where(pulls, low, middle), np.where(pulls, middle, high)
    return np.stack(results(0.5 * (low + high), of), axis=-1)


def peak_mib() -> float:
    """Greatest memory of this process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def timed(function: Any, *given: Any) -> tuple[Any, float, float]:
    """What a function returns, and its wall and processor time [s]."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = function(*given)
    return found, time.perf_counter() - wall, time.process_time() - cpu


def run(candidates: int, looped: int) -> dict[str, Any]:
    """Times, rates, memory and agreement."""
    ours(candidates // 10)
    _, tenth_wall, tenth_cpu = timed(ours, candidates // 10)
    tenth_peak = peak_mib()
    _, first, _ = timed(ours, candidates)
    found, wall, cpu = timed(ours, candidates)
    peak = peak_mib()
    total = found.grid.total
    rng = np.random.default_rng(0)
    of_loop = designs(found, np.sort(rng.choice(total, looped, replace=False)))
    _, _, loop_cpu = timed(loop, of_loop)
    sample = np.sort(rng.choice(found.sample["index"], min(16384, found.feasible), replace=False))
    of_arrays = designs(found, sample)
    numbers, _, arrays_cpu = timed(arrays, of_arrays)
    at = np.searchsorted(found.sample["index"], sample)
    own = np.stack(
        [found.sample[name][at] for name in ("blocked_force", "contraction", "outer_diameter")], -1
    )
    return {
        "candidates": total,
        "feasible": found.feasible,
        "front": len(found.front["index"]),
        "wall_with_compilation_s": round(first, 2),
        "tenth_wall_s": round(tenth_wall, 2),
        "tenth_cpu_s": round(tenth_cpu, 2),
        "wall_s": round(wall, 2),
        "cpu_s": round(cpu, 2),
        "per_cpu_second": round(total / cpu),
        "peak_tenth_MiB": round(tenth_peak),
        "peak_MiB": round(peak),
        "loop_per_cpu_second": round(looped / loop_cpu),
        "arrays_per_cpu_second": round(len(sample) / arrays_cpu),
        "times_loop": round(total / cpu / (looped / loop_cpu), 1),
        "times_arrays": round(total / cpu / (len(sample) / arrays_cpu), 2),
        "largest_difference": float(np.max(np.abs(numbers / own - 1))),
    }


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description="Speed of the search of designs.")
    parser.add_argument("--candidates", type=float, default=1e6)
    parser.add_argument("--loop", type=int, default=2000)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found = run(int(given.candidates), given.loop)
    if given.json:
        print(json.dumps(found))
        return
    for name, value in found.items():
        print(f"{name.replace('_', ' '):24} {value:,}")


if __name__ == "__main__":
    main()
