"""Traces that are kept: found again, made anew where they are torn, and none of other code."""

from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest

from famjax.compile_options import quick_options
from fitting.programs import kept

AT = np.array([0.0, 1.0])


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """Where JAX keeps programs meanwhile."""
    pytest.importorskip("flatbuffers")
    before = jax.config.values.get("jax_compilation_cache_dir")
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def doubled(calls: list[int]):
    """x -> 2 x, which counts how often it is traced."""

    def function(x: jax.Array) -> tuple[jax.Array]:
        calls.append(1)
        return (2 * x,)

    return kept(function, "doubled", (0,), quick_options())


def test_a_trace_is_found_again(folder: Path) -> None:
    calls: list[int] = []
    for _ in range(2):
        (found,) = doubled(calls)(AT)
        np.testing.assert_array_equal(found, [0.0, 2.0])
    assert len(calls) == 1
    assert len([*folder.glob("trace-*-cache")]) == 1


def test_other_shapes_have_a_trace_of_their_own(folder: Path) -> None:
    calls: list[int] = []
    twice = doubled(calls)
    for size in (2, 3, 2):
        assert twice(np.ones(size))[0].shape == (size,)
    assert len(calls) == 2


def test_a_torn_trace_is_made_anew(folder: Path) -> None:
    calls: list[int] = []
    doubled(calls)(AT)
    (file,) = folder.glob("trace-*-cache")
    file.write_bytes(file.read_bytes()[:20])
    np.testing.assert_array_equal(doubled(calls)(AT)[0], [0.0, 2.0])
    assert len(calls) == 2
