"""Options of the compiler: the same numbers, and an option that XLA does not know is left out."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax import compile_options
from famjax.compile_options import quick_jit, quick_options


class Spring(eqx.Module):
    stiffness: jax.Array
    kind: str

    @quick_jit
    def force(self, length: jax.Array) -> jax.Array:
        return self.stiffness * jnp.sin(length) if self.kind == "soft" else self.stiffness * length


def test_quickly_compiled_results_are_the_same() -> None:
    length = jnp.linspace(0.0, 1.0, 7)
    soft, hard = Spring(jnp.asarray(3.0), "soft"), Spring(jnp.asarray(3.0), "hard")
    assert np.asarray(soft.force(length)) == pytest.approx(
        3.0 * np.sin(np.asarray(length)), rel=1e-14
    )
    assert np.asarray(hard.force(length=length)) == pytest.approx(
        3.0 * np.asarray(length), rel=1e-14
    )
    assert Spring.force.__name__ == "force"


def test_the_options_compile_and_hold_the_level() -> None:
    options = quick_options()
    assert options["xla_backend_optimization_level"] == 0
    assert float(jax.jit(jnp.cos, compiler_options=options)(0.0)) == 1.0


def test_an_unknown_option_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    known = {"xla_backend_optimization_level": 0}
    monkeypatch.setattr(compile_options, "_QUICK", known | {"xla_spam": False})
    fresh = functools.cache(quick_options.__wrapped__)
    assert fresh() == known


def test_a_wrong_value_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_options, "_QUICK", {"xla_backend_optimization_level": True})
    with pytest.raises(jax.errors.JaxRuntimeError, match="not a valid"):
        functools.cache(quick_options.__wrapped__)()
