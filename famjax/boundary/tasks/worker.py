"""What runs in a worker: a function that arrives packed, in a process prepared for it once.

The function is unpacked after the process is prepared, so that what it imports finds the
environment set. Nothing of this happens in the process that asks: there the function is called.
"""

import collections
import dataclasses
import functools
import os
import pickle
import platform
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

_ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "VECLIB_MAXIMUM_THREADS": "1",
    "OPENCV_FOR_THREADS_NUM": "1",
    # jaxlib on few cores can hang when two computations share as few threads as there are cores.
    "PJRT_NPROC": "16",
}
_PROGRAMS = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)
_UNPICKLED = (pickle.PicklingError, AttributeError, TypeError)
_FUNCTIONS = 4  # unpacked ones that a worker keeps

_one_at_a_time = threading.RLock()


@dataclasses.dataclass(frozen=True)
class Host:
    """What a worker takes over from the process that asks.

    Attributes:
        jax: settings of JAX there, by name; none where JAX is not loaded.
        programs: where it keeps compiled programs, for workers of the same machine: a program made
            for another processor can end a process.
        machine: its name.
        child: whether workers are its own processes, which end when it ends and leave an
            interrupt to it.
    """

    jax: tuple[tuple[str, Any], ...] = ()
    programs: tuple[tuple[str, Any], ...] = ()
    machine: str = ""
    child: bool = False

    @classmethod
    def here(cls, *, child: bool) -> "Host":
        """The settings of this process."""
        jax = sys.modules.get("jax")
        values = {} if jax is None else jax.config.values
        of_jax, programs = (
            tuple((name, values[name]) for name in names if values.get(name) is not None)
            for names in (("jax_enable_x64",), _PROGRAMS)
        )
        return cls(of_jax, programs, platform.node(), child)


class Call:
    """A function of one item that can be sent to any worker.

    Args:
        function: of the module's own level, or a `functools.partial` of one.
        host: what a worker takes over.
        threads: whether it may run in several threads of a process at once.
    """

    def __init__(self, function: Callable[[Any], Any], host: Host, *, threads: bool) -> None:
        self._function: Callable[[Any], Any] | None = function
        self._host, self._threads = host, threads
        # By which a cluster's dashboard shows it.
        self.__name__ = getattr(getattr(function, "func", function), "__name__", "task")

    @functools.cached_property
    def _packed(self) -> bytes:
        return _pack(self._function)

    def __getstate__(self) -> dict[str, Any]:
        return {
            "_packed": self._packed,
            "_host": self._host,
            "_threads": self._threads,
            "__name__": self.__name__,
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _function=None)

    def __call__(self, item: Any) -> Any:
        """The function's result."""
        function = self._function
        if function is None:
            with _one_at_a_time:
                prepare(self._host)
                function = _unpack(self._packed)
        if self._threads:
            return function(item)
        with _one_at_a_time:
            return function(item)


def can_travel(thing: Any) -> bool:
    """Whether something can be sent to another process; a function of a module's own level can."""
    try:
        pickle.dumps(thing)
    except _UNPICKLED:
        return False
    return True


def _pack(function: Any) -> bytes:
    # What came with a cluster's client sends the code of a script as well.
    by_value = sys.modules.get("cloudpickle")
    try:
        packed = pickle.dumps(function)
    except _UNPICKLED:
        if by_value is None:
            raise
        return by_value.dumps(function)
    return packed if by_value is None or b"__main__" not in packed else by_value.dumps(function)


_unpacked: collections.OrderedDict[bytes, Callable[[Any], Any]] = collections.OrderedDict()


def _unpack(packed: bytes) -> Callable[[Any], Any]:
    """The function, the same one for the same bytes: what it has compiled stays with it."""
    if packed not in _unpacked:
        _unpacked[packed] = pickle.loads(packed)
        while len(_unpacked) > _FUNCTIONS:
            _unpacked.popitem(last=False)
    return _unpacked[packed]


_prepared: list[Host] = []


def prepare(host: Host) -> None:
    """Make this process a worker of that host, if it is not one yet.

    One thread for linear algebra, JAX in the same precision and, on the same machine, with the same
    folder of compiled programs.
    """
    if _prepared[-1:] == [host]:
        return
    os.environ.update({name: os.environ.get(name, value) for name, value in _ONE_THREAD.items()})
    if host.child:
        # It computes one thing at a time, and many idle threads cost it a third of its speed.
        os.environ["PJRT_NPROC"] = "1"
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(1)
    same = platform.node() == host.machine
    for name, value in (*host.jax, *(host.programs if same else ())):
        if "jax" in sys.modules:
            sys.modules["jax"].config.update(name, value)
        else:
            os.environ[name.upper()] = str(int(value) if isinstance(value, bool) else value)
    if host.child and not _prepared:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
        threading.Thread(target=_exit_with_parent, daemon=True).start()
    _prepared.append(host)


def _exit_with_parent() -> None:
    """Exit when the parent is killed; a worker would wait for it indefinitely."""
    import multiprocessing  # noqa: PLC0415 -- loaded in every child, and not elsewhere

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
