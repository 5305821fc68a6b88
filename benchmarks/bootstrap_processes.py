"""Replicates of an identification in this process and in several: wall time, CPU time, the same bits.

`python benchmarks/bootstrap_processes.py --replicates 20000 --jobs 2`. A ratio of wall times means
something on a machine that does nothing else; CPU times also on another one.
"""

import argparse
import json
import os
import resource
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")  # as in the workers
os.environ.setdefault("PJRT_NPROC", "16")

import jax
import numpy as np

import fitting


def cpu() -> float:
    """CPU time [s] of this process and of its children that have ended."""
    whose = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(of.ru_utime + of.ru_stime for of in map(resource.getrusage, whose))


def main() -> int:
    """Time both; the exit code says whether their bits are the same."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--replicates", type=int, default=20_000)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    result = fitting.identify(fitting.load_bundled("DMSP-20-300"))
    fitting.bootstrap(result, 250)  # traced before the clock runs
    found, seconds = [], []
    for executor in (None, given.jobs):
        began = time.monotonic(), cpu()
        found.append(fitting.bootstrap(result, given.replicates, executor=executor))
        seconds.append((time.monotonic() - began[0], cpu() - began[1]))
    same = np.array_equal(found[0].samples, found[1].samples)
    same &= np.array_equal(found[0].forces, found[1].forces)
    (wall, used), (wall_there, used_there) = seconds
    print(
        json.dumps(
            {
                "replicates": given.replicates,
                "jobs": given.jobs,
                "wall_s": [wall, wall_there],
                "cpu_s": [used, used_there],
                "times_as_fast": wall / wall_there,
                "same_bits": bool(same),
            },
            indent=1,
        )
    )
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main())
