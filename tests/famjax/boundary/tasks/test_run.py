"""Tasks on every engine: the same parts, what breaks is said, what is done is kept."""

import multiprocessing
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import Store, run_tasks

sys.path.insert(0, str(Path(__file__).parent))
import chunk_work

ROOT = Path(__file__).parents[4]
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
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


@contextmanager
def plain(executor: Any) -> Iterator[Any]:
    yield executor


ENGINES = {
    "None": lambda: plain(None),
    "2": lambda: plain(2),
    "threads": lambda: ThreadPoolExecutor(2),
    "spawn": lambda: ProcessPoolExecutor(2, SPAWN),
    "loky": loky,
    "dask": dask,
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_finds_the_same(name: str, tmp_path: Path) -> None:
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


def test_a_part_comes_back_to_the_last_bit(tmp_path: Path) -> None:
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


def test_the_file_of_another_work_is_refused_with_what_differs(tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    Store(file, "sweep", {"orders": [1, 2], "seed": 0}, 3)
    with pytest.raises(InputError, match=r"other settings: parts was 3, now 4; seed was 0"):
        Store(file, "sweep", {"orders": [1, 2], "seed": 1}, 4)
    file.write_text("{]\n")
    with pytest.raises(InputError, match=r"a.jsonl is damaged \(.*\): give another, or remove it"):
        Store(file, "sweep", {}, 3)
    with pytest.raises(InputError, match=r"the sweep file .* cannot be used"):
        Store(tmp_path, "sweep", {}, 3)
    with pytest.raises(InputError, match="arrays and plain values, got a Store"):
        Store(tmp_path / "b.jsonl", "sweep", {}, 1).keep(0, {"store": Store(None, "x", {}, 1)})


@pytest.mark.timeout(60)
@pytest.mark.parametrize("executor", [1, "own"])
def test_a_pool_that_breaks_says_what_is_kept(executor: int | str, tmp_path: Path) -> None:
    file = tmp_path / "a.jsonl"
    store = Store(file, "test", {}, 6)
    with (
        ProcessPoolExecutor(1, SPAWN) as pool,
        pytest.raises(InputError, match=rf"broke after \d of 6 .* is in {file}, and the same"),
    ):
        run_tasks(
            chunk_work.poisoned_part, range(6), executor=pool if executor == "own" else 1,
            store=store,
        )  # fmt: skip
    assert len(list(store)) == 3
    run_tasks(chunk_work.drawn, range(6), executor=1, store=store)
    assert [part["name"] for part in store] == [f"part {index}" for index in range(6)]


@pytest.mark.parametrize("executor", [None, 2])
def test_an_interrupt_keeps_what_is_done(executor: int | None) -> None:
    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    store = Store(None, "test", {}, 9)
    with pytest.raises(KeyboardInterrupt):
        run_tasks(str, range(9), executor=executor, store=store, progress=stop)
    assert 2 <= len(list(store)) < 9
    assert run_tasks(str, range(9), store=store)[8] == "8"
