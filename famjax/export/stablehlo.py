"""The model itself as StableHLO with its derivative, by `jax.export`: JAX alone can call it."""

import importlib.util

import jax
import jax.numpy as jnp

from ..boundary.errors import InputError
from .subject import Subject
from .tabulate import check_float64
from .templated import docstring


def jax_files(subject: Subject) -> dict[str, bytes]:
    """`NAME.stablehlo` for any number of states on CPU and CUDA, and `NAME_jax.py`, which loads it.

    Raises:
        InputError: the package flatbuffers is missing, or JAX is in float32.
    """
    if importlib.util.find_spec("flatbuffers") is None:
        raise InputError("exporting to JAX needs flatbuffers: pip install 'famjax[simulators]'")
    check_float64()
    from jax import export  # noqa: PLC0415 -- needs flatbuffers

    name, muscle = subject.identifier, subject.muscle
    states = jax.ShapeDtypeStruct(export.symbolic_shape("states"), jnp.float64)
    program = export.export(jax.jit(muscle.force), platforms=("cpu", "cuda"))(states, states)
    module = f'''"""{docstring(subject.about)}

The model itself: the difference is rounding. Needs jax and flatbuffers.
"""

from pathlib import Path

import jax
from jax import export

jax.config.update("jax_enable_x64", True)

_PROGRAM = Path(__file__).with_name("{name}.stablehlo").read_bytes()

force = export.deserialize(bytearray(_PROGRAM)).call
"""Static pull [N] at active lengths [m] and gauge pressures [Pa], arrays of one shape (n,), float64.

Differentiable once, by `jax.grad`, `jax.vjp` or `jax.jacrev`.
"""
'''
    return {
        f"{name}.stablehlo": bytes(program.serialize(vjp_order=1)),
        f"{name}_jax.py": module.encode(),
    }
