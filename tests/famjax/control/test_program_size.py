"""What is compiled of an antagonist grows with the copies of its muscles' force: there are few."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from famjax.control import Antagonist, Pulley, pair as room
from famjax.muscle import AbstractMuscle, MeanMuscle

LIMITS = {"_stiffness": 2, "_torque_range": 1, "_stiffness_range": 8, "_pressures_for": 14}
"""Copies of the force; of means of three muscles there were 12, 24, 72 and 111."""

ASKED = {"_stiffness": (0.1, 3e5, 2e5), "_torque_range": (0.1,)}


class Arch(AbstractMuscle):
    """A muscle whose force holds the arc tangent once."""

    area: jax.Array
    rest_length: jax.Array

    def force(self, length: jax.Array, pressure: jax.Array) -> jax.Array:
        return self.area * pressure * (1 - 3 * jnp.arctan(1 - length / self.rest_length))

    def length_range(self) -> tuple[jax.Array, jax.Array]:
        return 0.7 * self.rest_length, self.rest_length


def _mean(area: float) -> MeanMuscle:
    return MeanMuscle([Arch(jnp.asarray(k * area), jnp.asarray(0.3)) for k in (1.0, 1.1, 1.2)])


@pytest.mark.parametrize("name", LIMITS)
def test_copies_of_the_force(name: str) -> None:
    pair = Antagonist(
        _mean(4e-4),
        _mean(3e-4),
        (Pulley(0.02, 0.275), Pulley(-0.02, 0.275)),
        (0.0, 6e5),
        (-0.9, 0.9),
    )
    numbers, rest = eqx.partition(pair, eqx.is_array)
    asked = ASKED.get(name, (0.1, 9.0, 0.5)[: 2 if name == "_stiffness_range" else 3])

    def answer(numbers: object, *given: jax.Array) -> list[jax.Array]:
        found = getattr(room, name)(eqx.combine(numbers, rest), *given)
        return [jnp.asarray(leaf) for leaf in jax.tree.leaves(found)]

    text = jax.jit(answer).lower(numbers, *(jnp.asarray(one) for one in asked)).as_text()
    assert 0 < text.count("atan") <= LIMITS[name]


def test_a_mean_is_the_weighted_sum_of_its_members() -> None:
    mean = MeanMuscle([*_mean(4e-4).members], [0.5, 0.3, 0.2])
    L, P = np.linspace(0.24, 0.3, 4)[:, None], np.linspace(1e5, 6e5, 3)
    by_hand = sum(
        w * np.asarray(one.force(L, P))
        for w, one in zip((0.5, 0.3, 0.2), mean.members, strict=True)
    )
    np.testing.assert_allclose(mean.force(L, P), by_hand, rtol=1e-14)
    np.testing.assert_allclose(
        mean.force(0.28, 4e5), mean.force(np.array([0.28]), 4e5)[0], rtol=1e-14
    )
