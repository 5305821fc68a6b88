"""Compilation of what runs once and briefly, see `famjax.compile_options`."""

from famjax.compile_options import quick_jit as quick_jit

QUICK_COMPILATION = {"xla_backend_optimization_level": 0}
"""The option that every XLA knows."""
