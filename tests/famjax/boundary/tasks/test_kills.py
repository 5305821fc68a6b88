"""The client is killed: the same call goes on, and finishes what a run undisturbed does."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.tasks import Store

sys.path.insert(0, str(Path(__file__).parent))
import chunk_work

HERE = Path(__file__).parent
ROOT = HERE.parents[3]

pytestmark = pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX")


def kept(file: Path) -> int:
    """Parts that are in a file."""
    return max(0, len(file.read_bytes().splitlines()) - 1) if file.exists() else 0


@pytest.mark.slow
@pytest.mark.timeout(90)
@pytest.mark.parametrize("engine", ["processes", "dask"])
def test_the_client_is_killed(engine: str, tmp_path: Path) -> None:
    if engine == "dask":
        pytest.importorskip("distributed", reason="dask comes with the extra 'cluster'")
    file, place = tmp_path / "killed.jsonl", tmp_path / "seen"
    place.mkdir()
    command = [sys.executable, HERE / "chunk_work.py", engine, file, place]
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(HERE)])}
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
