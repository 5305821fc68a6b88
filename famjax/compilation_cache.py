"""Keep compiled programs on disk for later commands, in JAX's persistent cache.

Only the commands switch the cache on. Set the environment variable `FAMJAX_CACHE_DIR` to another folder,
or to `off` to disable the cache. If the user has already set a cache folder in JAX, that folder and its
settings are kept.
"""

import contextlib
import hashlib
import importlib.metadata
import itertools
import os
import platform
import stat
import sys
import warnings
from pathlib import Path

from .boundary.errors import InputError

VARIABLE = "FAMJAX_CACHE_DIR"
LARGEST = 256 * 2**20
"""Maximum total size [bytes] of all cache folders; the oldest entries are removed first."""
_FEATURES = ("model name", "flags", "Features", "CPU implementer", "CPU part")
_SETTINGS = {
    # Without these JAX keeps only what took a second to compile.
    "jax_persistent_cache_min_compile_time_secs": 0.0,
    "jax_persistent_cache_min_entry_size_bytes": -1,
}


def start_jax() -> str:
    """Import JAX for a command, set it to float64, and switch the cache of compiled programs on.

    Returns:
        The cache folder, as returned by `switch_on`.

    Raises:
        InputError: JAX finds no device.
    """
    import jax

    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_numpy_rank_promotion", "allow")
    asked = os.environ.get("JAX_PLATFORMS", "")
    try:
        jax.devices()
    except (AssertionError, RuntimeError):  # JAX raises either for a platform without a device
        raise InputError(
            f"JAX finds no device: JAX_PLATFORMS is {asked!r}. Set JAX_PLATFORMS=cpu, or unset it"
        ) from None
    return switch_on()


def switch_on() -> str:
    """Switch on JAX's cache of compiled programs, if possible.

    Returns:
        The cache folder; "" if the cache is off or a private folder cannot be created.
    """
    import jax

    # A broken or rejected entry is compiled again; a full disk keeps nothing.
    warnings.filterwarnings(
        "ignore", message="Error (reading|writing) persistent compilation cache"
    )
    if given := jax.config.values.get("jax_compilation_cache_dir"):
        return str(given)
    root = cache_root()
    if root is None or not _private_folder(folder := root / machine()):
        return ""
    _bound(root)
    for name, value in {"jax_compilation_cache_dir": str(folder), **_SETTINGS}.items():
        if hasattr(jax.config, name) and name.upper() not in os.environ:
            jax.config.update(name, value)
    return str(folder)


def cache_root() -> Path | None:
    """Return the folder for compiled programs: `FAMJAX_CACHE_DIR`, or one in the user's cache folder.

    Returns:
        An absolute path, which need not exist; None if the cache is off or there is no home folder.
    """
    given = os.environ.get(VARIABLE)
    if given is not None:
        return None if given.strip().lower() in {"", "off"} else Path(given).expanduser().absolute()
    try:
        usual = Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    except RuntimeError:
        return None
    caches = Path(os.environ.get("XDG_CACHE_HOME") or usual)
    return caches / "famjax" / "programs" if caches.is_absolute() else None


def machine() -> str:
    """Return a folder name for this host, processor and jaxlib.

    A program compiled for a different processor may crash. JAX's own cache key does not include the
    features of the processor, and several machines may share a home folder.
    """
    processor = platform.machine() + platform.processor()
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as file:
        first = itertools.takewhile(str.strip, file)  # Linux lists all; they are alike
        processor += "".join(line for line in first if line.startswith(_FEATURES))
    digest = hashlib.sha256((platform.node() + processor).encode()).hexdigest()[:16]
    return f"{digest}-jaxlib-{importlib.metadata.version('jaxlib')}"


def _private_folder(folder: Path) -> bool:
    """Create the folder if it is missing; return True if it is writable, and only by this user.

    Compiled programs from this folder are executed, so other users must not be able to write to it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
        if hasattr(os, "getuid") and found.st_uid != os.getuid():
            return False
        mode = stat.S_IMODE(found.st_mode)
        if mode & 0o022:  # others may have put programs there
            return False
        if mode & 0o055:
            folder.chmod(0o700)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _bound(root: Path) -> None:
    """Remove the oldest programs until the total size is within the limit.

    JAX's own limit, `jax_compilation_cache_max_size`, requires an additional package, filelock.
    """
    with contextlib.suppress(OSError):  # another process may be removing files as well
        files = [(path.stat(), path) for path in root.glob("*-jaxlib-*/*-cache")]
        total = sum(one.st_size for one, _ in files)
        for one, path in sorted(files, key=lambda file: file[0].st_mtime):
            if total <= LARGEST:
                break
            path.unlink(missing_ok=True)
            total -= one.st_size
