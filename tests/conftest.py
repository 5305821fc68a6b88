"""Set up before anything imports JAX: threads, float64, and run-time checks of every annotation."""

import gc
import importlib
import os
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

os.environ.setdefault("PJRT_NPROC", "16")  # see docs: batched LAPACK on few cores
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")  # a twentieth of the time
# Most of the time of these tests is XLA compiling, and its passes cost more than they save: see
# famjax.compile_options. XLA ends a process at a flag that it does not know, so that all but those
# of every release are for the one of constraints.txt. Examples, pages and commands that tests start
# as processes have the same flags: what they print does not depend on them.
os.environ["XLA_FLAGS"] = " ".join(
    [
        os.environ.get("XLA_FLAGS", ""),
        "--xla_backend_optimization_level=0",
        "--xla_llvm_disable_expensive_passes=true",
        "--xla_cpu_parallel_codegen_split_count=1",
        "--xla_cpu_use_fusion_emitters=false" if version("jaxlib").startswith("0.10.") else "",
    ]
)

sys.path.insert(0, str(Path(__file__).parent))  # the headless browser, the checks of annotations

import jax
import pytest
from annotation_checks import check_annotations

jax.config.update("jax_enable_x64", True)
check_annotations(["famjax", "fitting"])
os.environ["FAMJAX_CACHE_DIR"] = str(Path(__file__).parents[1] / ".pytest_cache" / "jax")

# What is compiled is kept, here and not in the user's cache: for other workers, for commands that
# tests start as processes, after `_forget_programs`, and for the next run.
importlib.import_module("famjax.compilation_cache").switch_on()

# What Python compiles of tests and packages is kept, whatever the environment says: for the next run,
# and for the commands that tests start as processes.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Tracing makes many objects that live long, and looking through all of them for garbage again and
# again takes a tenth of the time.
gc.set_threshold(100_000, 20, 50)
BEGUN = time.monotonic()
LONG_TAKES = 60.0  # [s] that must be left for a test which is given more than the usual time


def pytest_addoption(parser: pytest.Parser) -> None:
    """How continuous integration does as many of the slow tests as its time allows."""
    group = parser.getgroup("famjax")
    group.addoption(
        "--begin-within", type=float, metavar="SECONDS", help="skip what is begun later"
    )
    group.addoption("--shuffle", metavar="WORD", help="files in an order that goes with the word")


def _given_more(item: pytest.Item) -> bool:
    mark = item.get_closest_marker("timeout")
    return mark is not None and mark.args[0] > float(item.config.getini("timeout"))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What is given more than the usual time is begun first: no worker is to wait for it at the end.

    But for files in another order than their own, of which not all may be done.
    """
    if word := config.getoption("shuffle"):
        items.sort(key=lambda item: zlib.crc32(f"{word} {item.path.name}".encode()))
    else:
        items.sort(key=lambda item: not _given_more(item))


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what would be begun too late."""
    within = item.config.getoption("begin_within")
    if within is not None:
        left = within - (time.monotonic() - BEGUN)
        if left < (LONG_TAKES if _given_more(item) else 0.0):
            pytest.skip(f"not begun within {within:g} s")


def pytest_collection_finish() -> None:
    """Leave what has been imported out of every later look for garbage."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish() -> None:
    """Look for garbage once: pytest does so five times at the end, through all that was compiled."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def run(capsys: pytest.CaptureFixture) -> Callable[..., tuple[int, str, str]]:
    """A command in this process: its exit code, and what it prints to both streams."""
    from famjax.__main__ import main

    def command(*words: object) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as stop:
            main([*map(str, words)])
        printed = capsys.readouterr()
        return int(stop.value.code or 0), printed.out, printed.err

    return command


@pytest.fixture
def said(run: Callable) -> Callable[..., str]:
    """What a command prints that must end well."""

    def command(*words: object) -> str:
        code, out, err = run(*words)
        assert code == 0, err
        return out

    return command


@pytest.fixture
def refused(run: Callable) -> Callable[..., str]:
    """The errors, in one line, of a command that must end with 2 and a sentence."""

    def command(sentence: str, *words: object) -> str:
        code, _, err = run(*words)
        told = " ".join(err.split())
        assert (code, sentence in told) == (2, True), told
        return told

    return command


MAPPINGS = Path("/proc/self/maps")
MANY = 20_000  # of the 65 530 mappings that Linux gives a process


@pytest.fixture(scope="module", autouse=True)
def _forget_programs() -> Iterator[None]:
    """Give back what was compiled before thousands of programs exhaust the process's mappings."""
    yield
    if not MAPPINGS.exists() or MAPPINGS.read_bytes().count(b"\n") > MANY:
        jax.clear_caches()
