"""Whether a long bootstrap costs what its chunks cost: rate, linearity, memory, two processes.

    python benchmarks/scaling.py [--programmes 1e6] [--json FILE]

The sweep of the reference work (48 fits, so 48 programmes a replicate) of the bundled DMSP-20-300, its
parts kept in a folder. Each run is a process of its own, whose largest memory the system says; a
first small sweep compiles, or loads what another has compiled, and is not counted. One chunk of 250
replicates is the measure: its least time of some, in the same process and after the same warming.
Times mean nothing on a machine that does other things, whose load is printed.
"""

import argparse
import itertools
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

PER_REPLICATE, CHUNK = 48, 250
RATE, LINEAR, MEMORY, TWO = 0.8, 0.1, 2 * 2**30, 1.6
"""Wanted: of the rate of one chunk, at least; from a straight line, at most; bytes; of one process."""
_SINGLE = 12  # chunks, the quickest of which is the measure


def reference() -> tuple[Any, Any, float]:
    """The bundled DMSP-20-300, a geometry of it, and its deadband [Pa]."""
    import famjax  # noqa: PLC0415 -- not in the process that only starts others
    import fitting  # noqa: PLC0415

    data = fitting.load_bundled("DMSP-20-300")
    rest = data.specimen.rest_length
    braid = famjax.Braid.from_rest(diameter=0.0216, braid_angle=1.1, length=rest)
    return data, famjax.EstimatedGeometry(braid, famjax.Bladder(rest, 0.0195, 1.5e-3)), 43e3


def one(replicates: int, jobs: int) -> dict[str, Any]:
    """A sweep of so many replicates in this process, or by processes: its times and memory."""
    import jax  # noqa: PLC0415 -- not in the process that only starts others

    import fitting  # noqa: PLC0415
    from famjax.commands.compilation_cache import switch_on  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    switch_on()
    data, geometry, deadband = reference()

    def seconds(count: int, executor: int | None) -> list[float]:
        """When the parts were done; the first of these is the fits, or the start."""
        told: list[float] = []
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "replicates.jsonl")
            fitting.sweeps.sweep(
                data, geometry, deadband=deadband, bootstrap=count, executor=executor, resume=file,
                progress=lambda *_: told.append(time.perf_counter()),
            )  # fmt: skip
        return told[1:]

    seconds(CHUNK, None)
    chunks = seconds(_SINGLE * CHUNK, None)
    single = min(later - sooner for sooner, later in itertools.pairwise(chunks))
    times = seconds(replicates, jobs or None)
    own, children = (
        resource.getrusage(who).ru_maxrss * (1024 if sys.platform != "darwin" else 1)
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return {"single_s": single, "times_s": times, "rss_B": own, "worker_rss_B": children}


def started(replicates: int, jobs: int) -> dict[str, Any]:
    """The same in a process of its own."""
    words = [sys.executable, __file__, "--one", str(replicates), "--jobs", str(jobs)]
    env = os.environ | {"PJRT_NPROC": "16"}
    return json.loads(subprocess.run(words, check=True, capture_output=True, env=env).stdout)


def steady_rate(times: list[float], jobs: int) -> float:
    """Programmes a second, without the start of the processes and their uneven end.

    The second process begins seconds after the first, which is a tenth of the work or so.
    """
    steady = times[len(times) // 4 : len(times) - 2 * jobs]
    return PER_REPLICATE * CHUNK * (len(steady) - 1) / (steady[-1] - steady[0])


def nonlinearity(times: list[float]) -> float:
    """The largest departure of a quarter, a half and three quarters of the work from their share."""
    whole, parts = times[-1] - times[0], len(times) - 1
    return max(
        abs((times[parts * quarter // 4] - times[0]) / whole / (parts * quarter // 4 / parts) - 1)
        for quarter in (1, 2, 3)
    )


def measured(programmes: int) -> dict[str, float]:
    """The figures, each run in a process of its own."""
    load = os.getloadavg()[0]
    replicates = -(-programmes // PER_REPLICATE)
    runs = {jobs: started(replicates, jobs) for jobs in (0, 1, 2)}
    here, rates = runs[0], {jobs: steady_rate(runs[jobs]["times_s"], jobs) for jobs in (1, 2)}
    whole = here["times_s"][-1] - here["times_s"][0]
    rate = PER_REPLICATE * replicates / whole
    single = PER_REPLICATE * CHUNK / here["single_s"]
    return {
        "programmes": PER_REPLICATE * replicates,
        "seconds": whole,
        "programmes_per_s": rate,
        "of_the_rate_of_one_chunk": rate / single,
        "nonlinearity": nonlinearity(here["times_s"]),
        "rss_B": max(run[name] for run in runs.values() for name in ("rss_B", "worker_rss_B")),
        "one_process_per_s": rates[1],
        "two_processes_over_one": rates[2] / rates[1],
        "load": load,
    }


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; exit code 1 if a figure misses what is wanted."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--programmes", type=float, default=1e6)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--jobs", type=int, default=0, help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.one is not None:
        print(json.dumps(one(given.one, given.jobs)))
        return 0
    found = measured(int(given.programmes))
    for name, value in found.items():
        print(f"{name.replace('_', ' ')}: {value:.4g}")
    if given.json is not None:
        given.json.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    reached = (
        found["of_the_rate_of_one_chunk"] >= RATE
        and found["nonlinearity"] <= LINEAR
        and found["rss_B"] < MEMORY
        and found["two_processes_over_one"] >= TWO
    )
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
