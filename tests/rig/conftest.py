"""The firmware's executions: Python always, C where there is a compiler, AVR where there is simavr."""

import functools
import shutil
import sys
from pathlib import Path

import processes
import pytest

from rig.device import Device, firmware_folder

sys.path.insert(0, str(Path(__file__).parent))  # the harness and the misbehaving host

from avr import Avr, build_harness
from benches import Bench, write_plan
from native import NativeDevice, build_native


@pytest.fixture(scope="session")
def native_library(tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("no C compiler 'cc' on the path")
    return build_native(tmp_path_factory.mktemp("core"))


@pytest.fixture(params=["python", "c"])
def make(request):
    """Makes a device, in Python or in C, from its memory."""
    if request.param == "python":
        return Device
    library = request.getfixturevalue("native_library")
    return lambda eeprom=None: NativeDevice(library, eeprom)


@pytest.fixture
def bench(make):
    """A device on the bench; it must not tear a line."""
    bench = Bench(make())
    yield bench
    assert bench.torn == []


@pytest.fixture
def path(tmp_path):
    """Of a journal."""
    return tmp_path / "run.fam"


@pytest.fixture(scope="session")
def harness(tmp_path_factory):
    """The simulator with its lock step."""
    library = build_harness(tmp_path_factory.mktemp("simavr"))
    if library is None:
        pytest.skip("no libsimavr (Debian: libsimavr-dev) or no C compiler")
    return library


@pytest.fixture
def avr(harness):
    """An Uno with the firmware that ships, just switched on."""
    return Avr(harness, firmware_folder() / "famrig.hex")


@pytest.fixture
def command(run):
    """A command of `famjax rig`: its exit code, output and errors."""
    return functools.partial(run, "rig")


@pytest.fixture(scope="session")
def simulated(tmp_path_factory):
    """The files of a simulated test of 40 and 80 psi."""
    folder = tmp_path_factory.mktemp("simulated")
    made = "--output", folder / "out", "--seed", 4
    processes.command("rig", "simulate", write_plan(folder), *made)
    return folder / "out"
