"""Programs whose trace is kept beside JAX's compiled programs: JAX's own cache spares compiling alone.

A trace is kept where that cache is on, and found again by the sources of famjax and fitting, the
version of JAX, the name and the shapes. One that cannot be read is made anew.
"""

import contextlib
import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

from famjax.compile_options import Options


def kept(
    function: Callable[..., Any], name: str, like: Any, options: Options
) -> Callable[..., Any]:
    """The compiled function, traced once for all processes.

    Args:
        function: of pytrees of arrays, which returns one.
        name: by which its trace is found again; functions that differ have different names, and none
            runs code from outside famjax and fitting.
        like: a pytree of the structure that it returns.
        options: of the compiler.

    Returns:
        What `jax.jit(function, compiler_options=options)` returns, but for derivatives: a kept trace
        has none.
    """
    structure = jax.tree.structure(like)
    known: dict[tuple, Callable[..., Any]] = {}

    def called(*args: Any) -> Any:
        leaves, treedef = jax.tree.flatten(args)
        shapes = tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        if (treedef, shapes) not in known:

            def flat(*leaves: Any) -> list[Any]:
                return jax.tree.leaves(function(*jax.tree.unflatten(treedef, leaves)))

            known[treedef, shapes] = _found(flat, f"{name} {shapes}", shapes, options)
        return jax.tree.unflatten(structure, known[treedef, shapes](*leaves))

    called.known = known  # type: ignore[attr-defined]
    return called


def _found(
    flat: Callable[..., Any], name: str, shapes: tuple, options: Options
) -> Callable[..., Any]:
    """The compiled function of leaves, by the trace that was kept if there is one."""
    folder = jax.config.values.get("jax_compilation_cache_dir")
    if not folder:
        return jax.jit(flat, compiler_options=options)
    from jax import export  # noqa: PLC0415 -- where nothing is kept nobody waits for it

    digest = hashlib.sha256(f"{_sources()} {name}".encode()).hexdigest()[:32]
    file = Path(folder) / f"trace-{digest}-cache"
    trace = None
    with contextlib.suppress(Exception):  # of another version of JAX, or torn
        trace = export.deserialize(bytearray(file.read_bytes()))
    if trace is None:
        given = [jax.ShapeDtypeStruct(shape, dtype) for shape, dtype in shapes]
        trace = export.export(jax.jit(flat))(*given)
        with contextlib.suppress(OSError, ImportError):  # a full disk keeps nothing
            torn = file.with_suffix(f".{os.getpid()}")
            torn.write_bytes(trace.serialize())
            torn.replace(file)
    return jax.jit(trace.call, compiler_options=options)


@functools.cache
def _sources() -> str:
    """Digest of the version of JAX and of all code that may be traced."""
    import famjax  # noqa: PLC0415
    import fitting  # noqa: PLC0415

    digest = hashlib.sha256(f"{jax.__version__} {jax.config.read('jax_enable_x64')}".encode())
    for package in (famjax, fitting):
        for file in sorted(Path(str(package.__file__)).parent.rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()
