"""What the tests of tasks have done in workers; a client script that is killed."""

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

COUNT = 24


def drawn(index: int) -> dict[str, Any]:
    """Numbers that depend on the index alone, some of them nan."""
    values = np.random.default_rng((3, index)).normal(size=(4, 5))
    values[0, 0] = np.nan
    return {"values": values, "count": values.size, "name": f"part {index}"}


def seen(place: Path, index: int) -> dict[str, Any]:
    """The same, slowly, after the process has left its number."""
    (place / f"{index}-{time.monotonic_ns()}").write_text(str(os.getpid()))
    time.sleep(0.1)
    return drawn(index)


def poisoned_part(index: int) -> dict[str, Any]:
    if index == 3:
        os._exit(1)
    return drawn(index)


def client(engine: str, folder: str, place: str) -> None:
    """A client with workers of its own, for a test that kills both."""
    import functools

    from famjax.boundary.tasks import Store, run_tasks

    store = Store(folder, "test", {"seed": 3}, COUNT)
    work = functools.partial(seen, Path(place))
    if engine == "processes":
        run_tasks(work, range(COUNT), executor=2, store=store)
        return
    from distributed import Client, LocalCluster

    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster,
        Client(cluster) as of_dask,
    ):
        run_tasks(work, range(COUNT), executor=of_dask, store=store)


if __name__ == "__main__":
    import chunk_work

    chunk_work.client(*sys.argv[1:])
