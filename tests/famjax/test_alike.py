"""Models that differ in their numbers alone: asked as one, with the same answers and derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax._arrays import of_each


class Spring(eqx.Module):
    rate: jax.Array
    order: int = 1

    def force(self, x: jax.Array) -> jax.Array:
        return self.rate * jnp.arctan(x) ** self.order


ALIKE = tuple(Spring(jnp.asarray(rate)) for rate in (2.0, 3.0, 5.0))
MODELS = {
    "alike": ALIKE,
    "of another order": (*ALIKE[:2], Spring(jnp.asarray(5.0), 2)),
    "of another shape": (*ALIKE[:2], Spring(jnp.asarray([5.0]))),
}


def _asked(models: tuple[Spring, ...], x: jax.Array) -> jax.Array:
    return of_each(lambda one, x: jnp.sum(one.force(x)), models, [x * k for k in (1, 2, 3)])


@pytest.mark.parametrize("kind", MODELS)
def test_values_and_derivatives_are_those_of_the_models_in_turn(kind: str) -> None:
    models, x = MODELS[kind], jnp.asarray(0.4)
    expected = [np.sum(one.force(k * x)) for k, one in enumerate(models, 1)]
    np.testing.assert_allclose(_asked(models, x), expected, rtol=1e-14)
    slopes = eqx.filter_jacfwd(_asked)(models, x)
    for k, one in enumerate(models, 1):
        own = eqx.filter_grad(lambda one, k=k: jnp.sum(one.force(k * x)))(one)
        np.testing.assert_allclose(slopes[k - 1].rate[k - 1], own.rate, rtol=1e-14)


@pytest.mark.parametrize(("kind", "copies"), [("alike", 1), ("of another order", 3)])
def test_alike_models_are_in_the_program_once(kind: str, copies: int) -> None:
    text = str(jax.make_jaxpr(lambda x: _asked(MODELS[kind], x))(0.4))
    assert text.count("= atan ") == copies
