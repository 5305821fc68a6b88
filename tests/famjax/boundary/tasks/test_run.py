"""Tasks on every engine: the same bytes, what dies is named, what is done is kept."""

import functools
import multiprocessing
import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import EngineLost, Store, TaskRefused, run_tasks

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
    "polled": lambda: plain(chunk_work.Polled()),
}


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", ENGINES)
def test_every_engine_writes_the_same_bytes(name: str, tmp_path: Path) -> None:
    told: list[tuple[int, int]] = []
    for place in ("here", name):
        store = Store(tmp_path / place, "test", {"seed": 3}, 7)
        with ENGINES[name]() if place == name else plain(None) as executor:
            found = run_tasks(
                chunk_work.drawn, range(7), executor=executor, store=store,
                progress=lambda *done: told.append(done),
            )  # fmt: skip
        assert found is store
    assert told == [(done, 7) for done in range(8)] * 2
    assert content(tmp_path / "here") == content(tmp_path / name)
    assert len(content(tmp_path / name)) == 8
    for index, part in enumerate(store):
        np.testing.assert_array_equal(part["values"], chunk_work.drawn(index)["values"])
        assert (part["count"], part["name"]) == (20, f"part {index}")


def test_what_is_there_is_not_done_again() -> None:
    store = Store(None, "test", {}, 4)
    for index in (0, 2):
        store.keep(index, "kept")
    told: list[tuple[int, int]] = []
    run_tasks(str, range(4), store=store, progress=lambda *done: told.append(done))
    assert list(store) == ["kept", "1", "kept", "3"]
    assert told == [(2, 4), (3, 4), (4, 4)]
    assert list(run_tasks(str, range(3))) == ["0", "1", "2"]


@pytest.mark.timeout(60)
def test_an_item_with_which_workers_die_is_named_and_the_rest_goes_on() -> None:
    store, names = Store(None, "test", {}, 6), [f"muscle {index}" for index in range(6)]
    with pytest.raises(TaskRefused, match=r"1 of 6 .*muscle 3: .* ended abnormally, 3 times"):
        run_tasks(chunk_work.poisoned, range(6), executor=2, store=store, names=names)
    assert list(store) == [0, 1, 2, 4, 5]
    refused: list[tuple[int, str]] = []
    run_tasks(chunk_work.poisoned, range(2, 4), executor=1, refuse=lambda *one: refused.append(one))
    assert refused[0][0] == 1


@pytest.mark.timeout(60)
def test_a_pool_of_ones_own_that_breaks_says_what_is_kept(tmp_path: Path) -> None:
    store = Store(tmp_path, "test", {}, 6)
    with (
        ProcessPoolExecutor(1, SPAWN) as pool,
        pytest.raises(EngineLost, match=rf"gone after \d of 6 .* kept in {tmp_path}, and the same"),
    ):
        run_tasks(chunk_work.poisoned_part, range(6), executor=pool, store=store)
    assert len(list(store)) == 3
    run_tasks(chunk_work.drawn, range(6), executor=1, store=store)
    assert [part["name"] for part in store] == [f"part {index}" for index in range(6)]


@pytest.mark.timeout(60)
@pytest.mark.parametrize("executor", [None, 2])
def test_an_error_of_the_function_has_the_name_of_the_item(executor: int | None) -> None:
    store = Store(None, "test", {}, 5)
    with pytest.raises(ValueError, match="no root") as caught:
        run_tasks(chunk_work.failing, range(5), executor=executor, store=store)
    assert caught.value.__notes__[-1] == "in item 3"
    assert {0, 1, 2} <= set(store)


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


class Counting:
    """Counts what is under way; a job is done when it is waited for."""

    def __init__(self) -> None:
        self.most = self.now = 0
        self._max_workers = 3

    def submit(self, function: Any, /, *args: Any) -> Any:
        self.now += 1
        self.most = max(self.most, self.now)
        job = chunk_work.Job(function, args)
        real = job.result

        def result() -> Any:
            self.now -= 1
            return real()

        job.result = result
        return job


def test_few_tasks_are_under_way_however_many_there_are() -> None:
    executor = Counting()
    assert len(list(run_tasks(str, range(40), executor=executor))) == 40
    assert executor.most == 6


def test_threads_take_turns_unless_they_may_run_at_once() -> None:
    for threads in (False, True):
        running: list[int] = []
        with ThreadPoolExecutor(4) as pool:
            work = functools.partial(chunk_work.alone, running)
            most = max(run_tasks(work, range(8), executor=pool, threads=threads))
        assert (most > 1) == threads


@pytest.mark.timeout(60)
def test_a_worker_is_set_up_as_its_host_is() -> None:
    (found,) = run_tasks(chunk_work.surroundings, [0], executor=2)
    assert found["threads"] == ["1", "1", "1"]
    assert found["x64"]
    assert found["cache"] == jax.config.values["jax_compilation_cache_dir"]
    assert found["pid"] != os.getpid()


def test_what_takes_no_tasks_is_refused() -> None:
    with pytest.raises(InputError, match="at least one worker is needed, got 0"):
        run_tasks(str, [0], executor=0)
    with (
        ProcessPoolExecutor(1, multiprocessing.get_context("fork")) as pool,
        pytest.raises(InputError, match="processes must be spawned"),
    ):
        run_tasks(str, [0], executor=pool)


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ("executor", "text"),
    [
        ("1", 'needs its calls under `if __name__ == "__main__":`'),
        ("'dask'", "or have `submit` as the executors of concurrent.futures have; got str"),
    ],
)
def test_a_script_learns_what_is_wrong_with_it(executor: str, text: str, tmp_path: Path) -> None:
    call = f"run_tasks(str, [0], executor={executor})"
    (tmp_path / "script.py").write_text(f"from famjax.boundary.tasks import run_tasks\n{call}\n")
    done = subprocess.run(
        [sys.executable, tmp_path / "script.py"], capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 1
    assert text in done.stderr


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_cluster_names_an_item_with_which_its_workers_die() -> None:
    # Before what is set: the settings that it brings would go with that.
    pytest.importorskip("distributed", reason="dask comes with the extra 'cluster'")
    dask_itself = pytest.importorskip("dask")
    with dask_itself.config.set({"distributed.scheduler.allowed-failures": 0}), dask() as client:
        for executor in (client, client.get_executor()):
            store = Store(None, "test", {}, 6)
            with pytest.raises(TaskRefused, match=r"1 of 6 .*item 3"):
                run_tasks(chunk_work.poisoned, range(6), executor=executor, store=store)
            assert list(store) == [0, 1, 2, 4, 5]


@pytest.mark.slow
@pytest.mark.timeout(60)
def test_a_client_whose_scheduler_is_gone_is_said_so(tmp_path: Path) -> None:
    with dask() as client:

        def stop(done: int, total: int) -> None:
            if done == 2:
                client.cluster.close()

        (tmp_path / "seen").mkdir()
        store = Store(tmp_path / "store", "test", {}, 40)
        work = functools.partial(chunk_work.seen, tmp_path / "seen")
        with pytest.raises(EngineLost, match=r"Error: .* kept in"):
            run_tasks(work, range(40), executor=client, store=store, progress=stop)
        assert 2 <= len(list(store)) < 40
        with pytest.raises(InputError, match=r"the dask client is \w+, without a scheduler"):
            run_tasks(work, range(40), executor=client, store=store)


def test_a_future_of_a_broken_executor_is_tried_again_alone() -> None:
    class Breaks:
        """Its worker dies with item 2 the first time."""

        def __init__(self) -> None:
            self.died = 0

        def submit(self, function: Any, /, *args: Any) -> Future[Any]:
            future: Future[Any] = Future()
            if args == (2,) and not self.died:
                self.died += 1
                future.set_exception(BrokenExecutor("a worker died"))
            else:
                future.set_result(function(*args))
            return future

    assert list(run_tasks(str, range(4), executor=Breaks())) == ["0", "1", "2", "3"]
