"""Tasks on every engine: the same parts, what breaks is said, what is done is kept, a kill included."""

import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import Store, run_tasks

sys.path.insert(0, str(Path(__file__).parent))
import chunk_work

HERE = Path(__file__).parent
SPAWN = multiprocessing.get_context("spawn")


@contextmanager
def loky() -> Iterator[Any]:
    engine = pytest.importorskip("loky", reason="loky is not installed")
    executor = engine.ProcessPoolExecutor(2)
    try:
        yield executor
    finally:
        executor.shutdown(kill_workers=True)


@contextmanager
def dask() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed", reason="dask comes with the extra 'cluster'")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        yield client


ENGINES = {
    "None": lambda: nullcontext(None),
    "2": lambda: nullcontext(2),
    "threads": lambda: ThreadPoolExecutor(2),
    "spawn": lambda: ProcessPoolExecutor(2, SPAWN),
    "loky": loky,
    "dask": dask,
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_finds_the_same(name, tmp_path):
    told: list[tuple[int, int]] = []
    store = Store(tmp_path / "parts.jsonl", "test", {"seed": 3}, 7)
    with ENGINES[name]() as executor:
        found = run_tasks(
            chunk_work.drawn, range(7), executor=executor, store=store,
            progress=lambda *done: told.append(done),
        )  # fmt: skip
    assert found is store
    assert told == [(done, 7) for done in range(8)]
    for there in (store, Store(tmp_path / "parts.jsonl", "test", {"seed": 3}, 7)):
        assert len(list(there)) == 7
        for index, part in enumerate(there):
            np.testing.assert_array_equal(part["values"], chunk_work.drawn(index)["values"])
            assert (part["count"], part["name"]) == (20, f"part {index}")


PART = {
    "double": np.array([[0.1, np.nan], [np.inf, -0.0]]), "single": np.float32([1 / 3]),
    "whole": np.arange(3), "names": np.array(["a", "bcd"]), "none": np.zeros((0, 4)),
    "flag": np.array([True, False]), "text": "tän", "number": 1 / 3, "nothing": None,
    "nested": {"pair": [1, 2.5]},
}  # fmt: skip


def test_a_part_comes_back_to_the_last_bit(tmp_path):
    Store(tmp_path / "new" / "a.jsonl", "test", {}, 3).keep(1, PART)
    (back,) = Store(tmp_path / "new" / "a.jsonl", "test", {}, 3)
    assert back.keys() == PART.keys()
    for name, value in PART.items():
        if isinstance(value, np.ndarray):
            assert (back[name].dtype, back[name].shape) == (value.dtype, value.shape)
            np.testing.assert_array_equal(back[name], value)
        else:
            assert back[name] == value
    assert np.signbit(back["double"][1, 1])


def test_the_file_of_another_work_is_refused_with_what_differs(tmp_path):
    file = tmp_path / "a.jsonl"
    Store(file, "sweep", {"orders": [1, 2], "seed": 0}, 3)
    with pytest.raises(InputError, match=r"data or settings: parts was 3, now 4; seed was 0"):
        Store(file, "sweep", {"orders": [1, 2], "seed": 1}, 4)
    file.write_text("{]\n")
    with pytest.raises(InputError, match=r"a.jsonl is damaged \(.*\): remove it, or choose a"):
        Store(file, "sweep", {}, 3)
    with pytest.raises(InputError, match=r"the sweep file .* cannot be used"):
        Store(tmp_path, "sweep", {}, 3)
    with pytest.raises(InputError, match="arrays and plain values, got a Store"):
        Store(tmp_path / "b.jsonl", "sweep", {}, 1).keep(0, {"store": Store(None, "x", {}, 1)})


@pytest.mark.timeout(60)
@pytest.mark.parametrize("executor", [1, "own"])
def test_a_pool_that_breaks_says_what_is_kept(executor, tmp_path):
    file = tmp_path / "a.jsonl"
    store = Store(file, "test", {}, 6)
    with (
        ProcessPoolExecutor(1, SPAWN) as pool,
        pytest.raises(InputError, match=rf"failed after \d of 6 .* are in {file}: repeat the same"),
    ):
        run_tasks(
            chunk_work.poisoned_part, range(6), executor=pool if executor == "own" else 1,
            store=store,
        )  # fmt: skip
    assert len(list(store)) == 3
    run_tasks(chunk_work.drawn, range(6), executor=1, store=store)
    assert [part["name"] for part in store] == [f"part {index}" for index in range(6)]


@pytest.mark.parametrize("executor", [None, 2])
def test_an_interrupt_keeps_what_is_done(executor):
    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    store = Store(None, "test", {}, 9)
    with pytest.raises(KeyboardInterrupt):
        run_tasks(str, range(9), executor=executor, store=store, progress=stop)
    assert 2 <= len(list(store)) < 9
    assert list(run_tasks(str, range(9), store=store)) == list("012345678")


def kept(file: Path) -> int:
    return max(0, len(file.read_bytes().splitlines()) - 1) if file.exists() else 0


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX")
@pytest.mark.timeout(90)
@pytest.mark.parametrize("engine", ["processes", "dask"])
def test_the_client_is_killed(engine, tmp_path):
    if engine == "dask":
        pytest.importorskip("distributed", reason="dask comes with the extra 'cluster'")
    file, place = tmp_path / "killed.jsonl", tmp_path / "seen"
    place.mkdir()
    command = [sys.executable, HERE / "chunk_work.py", engine, file, place]
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(HERE.parents[3]), str(HERE)])}
    given = {"env": env, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **given) as client:
        while kept(file) < 8:
            assert client.poll() is None, client.communicate()[1]
            time.sleep(0.02)
        client.kill()
    done = kept(file)
    assert 8 <= done < chunk_work.COUNT
    killed = {one.read_text() for one in place.iterdir()}
    again = subprocess.run(command, **given, check=False, timeout=60)
    assert again.returncode == 0, again.stderr
    begun = [one.name for one in place.iterdir() if one.read_text() not in killed]
    assert len(begun) == chunk_work.COUNT - done
    for index, part in enumerate(Store(file, "test", {"seed": 3}, chunk_work.COUNT)):
        np.testing.assert_array_equal(part["values"], chunk_work.drawn(index)["values"])
