"""The firmware's C core, compiled for this computer: the same bytes as `Device`, sooner."""

import ctypes
import shutil
import struct
import subprocess
from pathlib import Path

from rig.controller import Latch
from rig.device import POWER_ON, TRIP_CEILING, Device, Memory, firmware_folder
from rig.errors import RigError
from rig.protocol import DRIVEN

_SOURCES = ("famrig_core.c", "famrig_plausibility.c", "famrig_text.c", "famrig_host.c")
_SENT = 256


def build_native(
    folder: str | Path,
    *,
    ring: int = 64,
    bytes_per_tick: int = 21,
    trip_ceiling: int = TRIP_CEILING,
) -> Path:
    """The core as a shared library, compiled into `folder` by the C compiler `cc`.

    Args:
        folder: an existing folder that may be written.
        ring: as for `Device`.
        bytes_per_tick: as for `Device`.
        trip_ceiling: as for `Device`.

    Raises:
        RigError: there is no C compiler, or it fails.
    """
    compiler = shutil.which("cc")
    if compiler is None:
        raise RigError("a C compiler is needed on the path as 'cc'; `Device` does the same without")
    library = Path(folder) / f"famrig_{ring}_{bytes_per_tick}_{trip_ceiling}.so"
    options = [
        f"-DFR_RING={ring}",
        f"-DFR_BYTES_PER_TICK={bytes_per_tick}",
        f"-DFR_TRIP_CEILING={trip_ceiling}",
    ]
    sources = [str(firmware_folder() / name) for name in _SOURCES]
    command = [compiler, "-std=c99", "-O2", "-fPIC", "-shared", "-Wall", "-Wextra", "-Werror"]
    command += [*options, *sources, "-o", str(library)]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    if built.returncode != 0:
        raise RigError(f"the C compiler failed: {' '.join(command)}\n{built.stderr.strip()}")
    return library


class NativeDevice(Device):
    """`Device` in C; arguments, attributes and bytes are the same.

    Args:
        library: from `build_native`.
        eeprom: as for `Device`.
    """

    def __init__(self, library: str | Path, eeprom: bytearray | None = None) -> None:
        core = ctypes.CDLL(str(library))
        core.famrig_host_size.restype = ctypes.c_size_t
        core.famrig_host_tick.restype = ctypes.c_size_t
        self._core = core
        self._state = (ctypes.c_uint64 * (core.famrig_host_size() // 8 + 1))()
        self._pointer = ctypes.byref(self._state)
        self._sent = ctypes.create_string_buffer(_SENT)
        self._looked = (ctypes.c_int * 8)()
        self._out = bytearray()
        self._tick = core.famrig_host_tick
        self._memory = Memory(eeprom)
        self.reset(POWER_ON)

    def reset(self, cause: int) -> None:
        """As `Device.reset`."""
        boot, latch = self._memory.boot, struct.pack("<BBHH", *self._memory.latch)
        self._core.famrig_host_reset(
            self._pointer, ctypes.c_uint8(cause), ctypes.c_uint16(boot), latch
        )
        self._core.famrig_host_look(self._pointer, self._looked)
        self._store()

    def feed(self, data: bytes) -> None:
        """As `Device.feed`."""
        self._core.famrig_host_feed(self._pointer, data, ctypes.c_size_t(len(data)))

    def take(self) -> bytes:
        """As `Device.take`."""
        sent = bytes(self._out)
        self._out.clear()
        return sent

    def tick(self, pressure_counts: int, force_counts: int) -> None:
        """As `Device.tick`."""
        number = self._tick(self._pointer, pressure_counts, force_counts, self._sent, self._looked)
        if self._looked[4:8] != self._latched:
            self._store()
        if number:
            self._out += ctypes.string_at(self._sent, number)

    def _store(self) -> None:
        self._latched = self._looked[4:8]
        self._memory.store(self.boot, Latch(*self._latched))

    @property
    def output(self) -> int:
        """As `Device.output`."""
        return self._looked[0]

    @property
    def state(self) -> int:
        """As `Device.state`."""
        return self._looked[1]

    @property
    def sync(self) -> bool:
        """As `Device.sync`."""
        return bool(self._looked[2])

    @property
    def boot(self) -> int:
        """As `Device.boot`."""
        return self._looked[3]

    @property
    def board(self) -> int:
        """As `Device.board`."""
        return self._looked[7]

    @property
    def dump_open(self) -> bool:
        """As `Device.dump_open`."""
        return self.state not in DRIVEN
