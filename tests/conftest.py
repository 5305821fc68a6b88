"""Set up before anything imports JAX: threads, float64, and run-time checks of every annotation."""

import os
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("PJRT_NPROC", "16")  # see docs: batched LAPACK on few cores
# Most of the time of these tests is XLA compiling, and LLVM's passes cost more than they save.
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=0"

import jax
import pytest
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)

# What one worker has compiled no worker compiles again.
CACHE = Path(__file__).parents[1] / ".pytest_cache" / "jax"
jax.config.update("jax_compilation_cache_dir", str(CACHE))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)

# Commands that tests start as processes keep theirs there, too, and not in the user's cache.
os.environ["FAMJAX_CACHE_DIR"] = str(CACHE)

HOOK = install_import_hook(["famjax", "fitting"], "beartype.beartype")


MAPPINGS = Path("/proc/self/maps")
MANY = 20_000  # of the 65 530 mappings that Linux gives a process


@pytest.fixture(scope="module", autouse=True)
def _forget_programs() -> Iterator[None]:
    """Give back what was compiled before thousands of programs exhaust the process's mappings."""
    yield
    if not MAPPINGS.exists() or MAPPINGS.read_bytes().count(b"\n") > MANY:
        jax.clear_caches()
