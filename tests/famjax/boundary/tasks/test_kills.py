"""Workers are killed, then the client: the same call finishes to the same bytes."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from famjax.boundary.tasks import Store, run_tasks

sys.path.insert(0, str(Path(__file__).parent))
import chunk_work

HERE = Path(__file__).parent
ROOT = HERE.parents[3]

pytestmark = pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX")


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def wait_for(folder: Path, parts: int, client: subprocess.Popen) -> None:
    while len(list(folder.glob("parts/*.parquet"))) < parts:
        assert client.poll() is None, client.communicate()[1]
        time.sleep(0.02)


def kill_a_worker(place: Path) -> None:
    """The process that began an item last."""
    newest = max(place.iterdir(), key=lambda file: int(file.name.partition("-")[2]))
    with contextlib.suppress(ProcessLookupError):
        os.kill(int(newest.read_text()), signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.timeout(90)
@pytest.mark.parametrize("engine", ["processes", "dask"])
def test_three_workers_and_the_client_are_killed(engine: str, tmp_path: Path) -> None:
    if engine == "dask":
        pytest.importorskip("distributed", reason="dask comes with the extra 'cluster'")
    undisturbed = tmp_path / "undisturbed"
    run_tasks(
        chunk_work.drawn,
        range(chunk_work.COUNT),
        store=Store(undisturbed, "test", {"seed": 3}, chunk_work.COUNT),
    )
    folder, place = tmp_path / "killed", tmp_path / "seen"
    place.mkdir()
    command = [sys.executable, HERE / "chunk_work.py", engine, folder, place]
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(HERE)])}
    given = {"env": env, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **given) as client:
        for parts in (2, 5, 8):
            wait_for(folder, parts, client)
            kill_a_worker(place)
        wait_for(folder, 12, client)
        client.kill()
    done = len(list(folder.glob("parts/*.parquet")))
    assert 12 <= done < chunk_work.COUNT
    killed = {file.read_text() for file in place.iterdir()}
    again = subprocess.run(command, **given, check=False, timeout=60)
    assert again.returncode == 0, again.stderr
    begun = [file.name for file in place.iterdir() if file.read_text() not in killed]
    assert len(begun) == chunk_work.COUNT - done
    assert content(folder) == content(undisturbed)
