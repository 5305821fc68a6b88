import pickle
from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest

from fitting import ForceData, Identification, identify, load_bundled

DMSP20, DMSP10 = "DMSP-20-300", "DMSP-10-250"


class _Sent(Executor):
    """Sends function, arguments and result through pickle, and does a task in this thread.

    Attributes:
        count: of the tasks so far.
    """

    def __init__(self) -> None:
        self.count = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        self.count += 1
        function, given, named = pickle.loads(pickle.dumps((fn, args, kwargs)))
        future: Future[Any] = Future()
        future.set_result(pickle.loads(pickle.dumps(function(*given, **named))))
        return future


@pytest.fixture
def sent() -> Any:
    """An executor whose tasks are sent as to another process, and counted; none is started."""
    return _Sent()


@pytest.fixture(scope="session")
def dmsp20() -> ForceData:
    return load_bundled(DMSP20)


@pytest.fixture(scope="session")
def dmsp10() -> ForceData:
    return load_bundled(DMSP10)


@pytest.fixture(scope="session")
def fitted20(dmsp20: ForceData) -> Identification:
    return identify(dmsp20)


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    """A small valid map that tests spoil."""
    rows = ["pressure_kPa,length_mm,force_N"]
    rows += [
        f"{P},{L},{max(0.0, P * (0.4 - (300 - L) / 150) - 8)}"
        for P in (100, 200, 300, 400)
        for L in (300, 290, 280, 270)
    ]
    path = tmp_path / "map.csv"
    path.write_text("\n".join(rows) + "\n")
    return path
