"""A member of a batch that cannot be spoils no derivative of the others, in models of one's own either."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from muscles import CYLINDER_10 as CYLINDER, MUSCLES, RUBBER as PLAIN

import famjax


class Tapered(famjax.geometries.AbstractGeometry):
    """A cylinder that grows thin as it shortens: written as one would, with no thought of nan."""

    cylinder: famjax.geometries.AbstractGeometry
    taper: Float[Array, ""] = famjax.parameter(low=0.0, high=0.5, default=0.1)

    def dimensions(self, length, pressure):
        at = self.cylinder.dimensions(length, pressure)
        return dataclasses.replace(at, radius=at.radius * (1 - self.taper * (1 - length / 0.25)))

    def length_range(self):
        return self.cylinder.length_range()

    rest_length = property(lambda self: self.cylinder.rest_length)


OWN = famjax.Muscle(Tapered(CYLINDER, 0.1), PLAIN.material, 3e4)
MODELS = {
    "a geometry of one's own": OWN,
    "one's own in a rig": famjax.MountedMuscle(OWN, 1e-5),
    **{name: MUSCLES[name] for name in ("sarosi", "bolen", "hunt", "gaylord", "tondu_lopez")},
}
LENGTHS = jnp.array([0.24, jnp.nan, -0.1, 0.9, 0.23, 0.24])
PRESSURES = jnp.array([4e5, 4e5, 4e5, 4e5, 5e5, jnp.nan])


def _gradients(model, lengths, pressures):
    def total(model, lengths, pressures):
        force = model.force(lengths, pressures)
        return jnp.nansum(force)

    return jax.grad(total, argnums=(0, 1))(model, lengths, pressures)


@pytest.mark.parametrize("name", MODELS)
def test_force(name: str) -> None:
    model = MODELS[name]
    force = np.asarray(model.force(LENGTHS, PRESSURES))
    assert np.isfinite(force[[0, 4]]).all()
    assert np.isnan(force[[1, 2, 5]]).all()
    of_all, at_all = _gradients(model, LENGTHS, PRESSURES)
    here = jnp.array([0, 4] + ([3] if np.isfinite(force[3]) else []))
    of_good, at_good = _gradients(model, LENGTHS[here], PRESSURES[here])
    np.testing.assert_allclose(np.asarray(at_all)[here], at_good, rtol=2e-5)
    for spoiled, right in zip(jax.tree.leaves(of_all), jax.tree.leaves(of_good), strict=True):
        np.testing.assert_allclose(spoiled, right, rtol=2e-4, atol=1e-6 * np.abs(right).max())


def test_free_contraction_and_volume() -> None:
    muscle = PLAIN
    pressures = jnp.array([4e5, -1e9, 5e5])

    def total(muscle, pressures):
        return jnp.nansum(muscle.free_contraction(pressures, throw=False))

    spoiled = jax.grad(total)(muscle, pressures).geometry.bladder.rest_length
    right = jax.grad(total)(muscle, pressures[::2]).geometry.bladder.rest_length
    assert float(spoiled) == pytest.approx(float(right), rel=1e-4)
    rig = famjax.MountedMuscle(muscle, 1e-5)
    ends = famjax.geometries.EndEffectGeometry(CYLINDER, 1.1)
    lengths = jnp.array([0.24, -0.1, 0.9, 0.23])
    for model, number in (
        (rig, "compliance"),
        (famjax.Muscle(ends, PLAIN.material, 3e4), "geometry"),
    ):
        of = jax.grad(lambda m: jnp.nansum(m.volume(lengths, 4e5)))(model)
        found = getattr(of, number)
        found = found.end_factor if number == "geometry" else found
        assert np.isfinite(found), number


class Bad(famjax.terms.AbstractForceTerm):
    """What it returns is said by its number."""

    what: int = 0

    def force(self, at, pressure):
        return [at.hoop_strain, None][self.what]


@pytest.mark.parametrize(("what", "came"), [(0, "the shape"), (1, "a NoneType")])
def test_a_term_returns_one_force_for_each_state(what: int, came: str) -> None:
    with pytest.raises(
        ValueError, match=rf"force\(at, pressure\) of Bad must return one.*got {came}"
    ):
        famjax.Muscle(CYLINDER, Bad(what)).force(jnp.array([0.24, 0.23]), 4e5)


class OwnAngle(Tapered):
    """A number of its own by the name of one of the cylinder's."""

    braid_angle: Float[Array, ""] = famjax.parameter("rad", low=0.0, high=1.0, default=0.5)


def test_of_two_numbers_of_one_name_none_is_lost() -> None:
    values = OwnAngle(CYLINDER, 0.1, 0.4).parameters()
    assert float(values["braid_angle"]) == pytest.approx(1.12, rel=1e-5)
    assert float(values["braid_angle.braid_angle"]) == pytest.approx(0.4)
    again = OwnAngle(CYLINDER, 0.1, 0.4).with_parameters({"braid_angle.braid_angle": 0.7})
    assert float(again.braid_angle) == pytest.approx(0.7)
