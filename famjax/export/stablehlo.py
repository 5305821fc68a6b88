"""The model itself as StableHLO with its derivative, by `jax.export`: JAX alone can call it."""

import importlib.util

import jax
import jax.numpy as jnp

from ..boundary.errors import InputError
from .subject import Subject
from .tabulate import check_float64
from .templated import docstring


def jax_files(subject: Subject) -> dict[str, bytes]:
    """Programs for any number of states on CPU and CUDA, and `NAME_jax.py`, which loads them.

    `NAME.stablehlo` is the force, `NAME_model.stablehlo` what the model says, not cut at zero.

    Raises:
        InputError: the package flatbuffers is missing, or JAX is in float32.
    """
    if importlib.util.find_spec("flatbuffers") is None:
        raise InputError("exporting to JAX needs flatbuffers: pip install 'famjax[simulators]'")
    check_float64()
    from jax import export  # noqa: PLC0415 -- needs flatbuffers

    name, muscle = subject.identifier, subject.muscle
    states = jax.ShapeDtypeStruct(export.symbolic_shape("states"), jnp.float64)
    programs = {
        of: export.export(jax.jit(lambda *at, ask=ask: ask(*at)), platforms=("cpu", "cuda"))(
            states, states
        )
        for of, ask in ((name, muscle.force), (f"{name}_model", muscle.model_force))
    }
    module = f'''"""{docstring(subject.about)}

The model itself: the difference is rounding. Needs jax and flatbuffers.
"""

from pathlib import Path

import jax
from jax import export

jax.config.update("jax_enable_x64", True)



def _program(name):
    """The function of a file beside this one."""
    return export.deserialize(bytearray(Path(__file__).with_name(name).read_bytes())).call


force = _program("{name}.stablehlo")
"""Static pull [N] at active lengths [m] and gauge pressures [Pa], arrays of one shape (n,), float64.

Differentiable once, by `jax.grad`, `jax.vjp` or `jax.jacrev`.
"""

model_force = _program("{name}_model.stablehlo")
"""What the model says [N], not cut at zero: below zero where the muscle is slack and the force is 0."""
'''
    return {
        **{
            f"{of}.stablehlo": bytes(program.serialize(vjp_order=1))
            for of, program in programs.items()
        },
        f"{name}_jax.py": module.encode(),
    }
