"""Set up before anything imports JAX: threads, float64, and run-time checks of every annotation."""

import os

os.environ.setdefault("PJRT_NPROC", "16")  # see docs: batched LAPACK on few cores

import jax
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)

HOOK = install_import_hook(["famjax", "fitting"], "beartype.beartype")
