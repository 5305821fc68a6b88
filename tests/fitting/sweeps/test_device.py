"""Replicates on a GPU, where there is one: the same numbers."""

import contextlib

import jax
import numpy as np
import pytest

import famjax
from fitting import load_bundled
from fitting.sweeps import Sweep, sweep

AGREEMENT = 1e-6  # of a law's largest standard deviation
MUSCLE = load_bundled("DMSP-20-300")
REST = MUSCLE.specimen.rest_length
BRAID = famjax.Braid.from_rest(diameter=0.0215, braid_angle=1.13, length=REST)
GEOMETRY = famjax.EstimatedGeometry(BRAID, famjax.Bladder(REST, 0.0195, 1.5e-3))


def gpus() -> list[jax.Device]:
    with contextlib.suppress(RuntimeError):  # JAX knows of no such kind
        return jax.devices("gpu")
    return []


def swept() -> Sweep:
    return sweep(MUSCLE, GEOMETRY, deadband=1e4, orders=(3,), bootstrap=250)


def assert_same(one: Sweep, other: Sweep, within: float) -> None:
    known = 0
    for mine, theirs in zip(one.rows, other.rows, strict=True):
        scale = np.abs(mine.coefficients_std).max()
        np.testing.assert_allclose(
            theirs.coefficients_std, mine.coefficients_std, atol=within * scale
        )
        known += np.isfinite(scale)
    assert known > 6


@pytest.mark.skipif(not gpus(), reason="JAX sees no GPU on this machine")
def test_on_a_gpu() -> None:
    with jax.default_device(jax.devices("cpu")[0]):
        host = swept()
    with jax.default_device(gpus()[0]):
        assert_same(host, swept(), AGREEMENT)
