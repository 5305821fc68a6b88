"""The firmware's C core, compiled for this computer: the same bytes as `Device`, sooner."""

import ctypes
import struct
import subprocess
from pathlib import Path

from rig.controller import Latch
from rig.device import POWER_ON, TRIP_CEILING, Device, Memory, firmware_folder
from rig.protocol import DRIVEN

_SOURCES = ("famrig_core.c", "famrig_plausibility.c", "famrig_text.c", "famrig_host.c")


def build_native(folder: str | Path, *, ring: int = 64, bytes_per_tick: int = 21,
                 trip_ceiling: int = TRIP_CEILING) -> Path:  # fmt: skip
    """The core as a shared library, compiled into an existing folder by `cc`; options as of `Device`."""
    library = Path(folder) / f"famrig_{ring}_{bytes_per_tick}_{trip_ceiling}.so"
    command = [
        "cc", "-std=c99", "-O2", "-fPIC", "-shared", "-Wall", "-Wextra", "-Werror",
        f"-DFR_RING={ring}", f"-DFR_BYTES_PER_TICK={bytes_per_tick}",
        f"-DFR_TRIP_CEILING={trip_ceiling}",
        *(str(firmware_folder() / name) for name in _SOURCES), "-o", str(library),
    ]  # fmt: skip
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return library


class NativeDevice(Device):
    """`Device` in C, from a library of `build_native`; attributes and bytes are the same."""

    def __init__(self, library: str | Path, eeprom: bytearray | None = None) -> None:
        core = ctypes.CDLL(str(library))
        core.famrig_host_size.restype = ctypes.c_size_t
        core.famrig_host_tick.restype = ctypes.c_size_t
        self._core = core
        self._state = (ctypes.c_uint64 * (core.famrig_host_size() // 8 + 1))()
        self._pointer = ctypes.byref(self._state)
        self._sent = ctypes.create_string_buffer(256)
        self._looked = (ctypes.c_int * 8)()  # output, state, sync, boot, and the latch
        self._out = bytearray()
        self._tick = core.famrig_host_tick
        self._memory = Memory(eeprom)
        self.reset(POWER_ON)

    def reset(self, cause: int) -> None:
        boot, latch = self._memory.boot, struct.pack("<BBHH", *self._memory.latch)
        why = ctypes.c_uint8(cause)
        self._core.famrig_host_reset(self._pointer, why, ctypes.c_uint16(boot), latch)
        self._core.famrig_host_look(self._pointer, self._looked)
        self._store()

    def feed(self, data: bytes) -> None:
        self._core.famrig_host_feed(self._pointer, data, ctypes.c_size_t(len(data)))

    def tick(self, pressure_counts: int, force_counts: int) -> None:
        number = self._tick(self._pointer, pressure_counts, force_counts, self._sent, self._looked)
        if self._looked[4:8] != self._latched:
            self._store()
        if number:
            self._out += ctypes.string_at(self._sent, number)

    def _store(self) -> None:
        self.boot, self._latched = self._looked[3], self._looked[4:8]
        self._memory.store(self.boot, Latch(*self._latched))

    output = property(lambda self: self._looked[0])
    state = property(lambda self: self._looked[1])
    sync = property(lambda self: bool(self._looked[2]))
    board = property(lambda self: self._looked[7])
    dump_open = property(lambda self: self.state not in DRIVEN)
