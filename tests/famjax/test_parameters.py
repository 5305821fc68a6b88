"""Declared parameters: names, ranges and units, muscles with other values, and taking one apart."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from jaxtyping import Array, Float
from muscles import FESTO

import famjax

EXACT = 1e-12
MUSCLE = FESTO.with_parameters({"braid_angle": 1.1})
EMBEDDED = MUSCLE.geometry

LAWS: dict[type[famjax.materials.AbstractMaterial], tuple[str, ...]] = {
    famjax.PolynomialMaterial: ("E_1", "E_2", "E_3"),
    famjax.materials.OgdenMaterial: ("shear_modulus", "ogden_exponent"),
    famjax.materials.MooneyRivlinMaterial: ("C10", "C01"),
    famjax.materials.NeoHookeanMaterial: ("shear_modulus",),
    famjax.materials.YeohMaterial: ("C_1", "C_2", "C_3"),
    famjax.materials.SaturatingMaterial: ("final_modulus", "saturation_stress", "strain_scale"),
}  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_is_named_by_its_class_alone(law):
    material = law.template()
    assert tuple(material.declared()) == LAWS[law]
    assert law.law_name
    linear = {name for name, one in material.declared().items() if one.linear}
    assert {one.kind for one in material.declared().values() if one.linear} == {"stress"}

    def axial(scale: float) -> jax.Array:
        values = {name: material.parameters()[name] * scale for name in linear}
        return material.with_parameters(values).stresses(-0.2, 0.6, 1e5)[0]

    np.testing.assert_allclose(axial(3.0), 3 * axial(1.0), rtol=EXACT)
    for name, one in material.declared().items():
        assert one.low <= float(material.parameters()[name]) <= one.high


def test_a_muscle_has_the_parameters_of_an_identification():
    soft = famjax.braids.CompliantBraid.of(EMBEDDED.braid, 1e-6)
    shape = famjax.EstimatedGeometry(soft, EMBEDDED.bladder)
    ends = famjax.geometries.EndEffectGeometry(shape, 1.1)
    mounted = famjax.MountedMuscle(famjax.Muscle(ends, MUSCLE.material, 0.0), 1e-6)
    assert [(name, one.unit, one.kind, one.high) for name, one in mounted.declared().items()] == [
        ("braid_diameter", "m", "length", 0.08),
        ("braid_angle", "rad", "angle", pytest.approx(np.radians(80))),
        ("braid_compliance", "1/N", "strain compliance", 3e-5),
        ("rest_length", "m", "length", math.inf),
        ("wall_thickness", "m", "length", math.inf),
        ("end_factor", "", "number", 1.4),
        *((f"E_{n}", "Pa", "stress", math.inf) for n in (1, 2, 3)),
        ("deadband_pressure", "Pa", "pressure", 2e5),
        ("series_compliance", "m/N", "compliance", 5e-5),
    ]


class Spring(famjax.terms.AbstractForceTerm):
    stiffness: Float[Array, ""] = famjax.parameter("N/m", low=0.0)
    rest_length: Float[Array, ""] = famjax.parameter("m", low=0.0, name="spring_length")

    def force(self, at: famjax.geometries.Dimensions, pressure: famjax.Real) -> jax.Array:
        return self.stiffness * (at.length - self.rest_length)


class Hose(famjax.terms.AbstractForceTerm):
    """Of somebody else: one declared number, one that is known, and springs within."""

    pull: Float[Array, ""] = famjax.parameter("N", low=-50.0, high=50.0, linear=True)
    width: Float[Array, ""] = famjax.parameters.number("m", default=0.01)
    springs: tuple[Spring, ...] = ()

    def force(self, at: famjax.geometries.Dimensions, pressure: famjax.Real) -> jax.Array:
        return self.pull + sum(spring.force(at, pressure) for spring in self.springs)


def test_names_that_clash_say_where_they_stand():
    springs = (Spring(10.0, 0.3), Spring(20.0, 0.2))
    muscle = famjax.Muscle(EMBEDDED, MUSCLE.terms + Hose(5.0, springs=springs))
    names = [*muscle.declared()]
    assert names[-5:] == [
        "pull",
        "stiffness", "spring_length", "springs_2.stiffness", "springs_2.spring_length",
    ]  # fmt: skip
    changed = muscle.with_parameters({"springs_2.stiffness": 7.0, "stiffness": 3.0, "pull": 1.0})
    hose = changed.terms.terms[-1]
    assert [float(spring.stiffness) for spring in hose.springs] == [3.0, 7.0]
    assert (float(hose.pull), float(hose.width)) == (1.0, 0.01)


# ---- taken apart

FREE = ("braid_diameter", "braid_angle", "deadband_pressure", "E_1", "E_2")


def test_apart_and_together():
    apart = famjax.take_apart(MUSCLE, FREE, bounds={"braid_angle": (1.0, 1.2)})
    assert apart.names == FREE
    assert apart.scaled.shape == apart.low.shape == apart.high.shape == (5,)
    assert (np.abs(apart.scaled) < 30).all()
    np.testing.assert_allclose(apart.low[:3], 0)
    np.testing.assert_allclose(apart.high[:3], 1)
    np.testing.assert_array_equal(apart.high[3:], math.inf)
    assert float(apart.scaled[1]) == pytest.approx(0.5)
    np.testing.assert_allclose(apart.si, [*apart.values(apart.scaled).values()], rtol=1e-15)
    again = apart.muscle(apart.scaled)
    for mine, theirs in zip(jax.tree.leaves(again), jax.tree.leaves(MUSCLE), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-13)
    low = apart.values(apart.low)
    assert float(low["braid_diameter"]) == pytest.approx(3e-3)
    assert float(low["braid_angle"]) == pytest.approx(1.0)


def test_the_box_and_the_whole_space():
    bounds = {"E_1": (0.0, math.inf), "E_2": (-math.inf, 1e7), "E_3": (-math.inf, math.inf)}
    apart = famjax.take_apart(MUSCLE, (*FREE, "E_3"), bounds=bounds)
    back = apart.scaled_from_unbounded(apart.unbounded)
    np.testing.assert_allclose(back, apart.scaled, rtol=1e-12)
    z = np.linspace(-6.0, 6.0, 6) * np.array([[1.0], [-1.0]])
    inside = np.asarray(jax.jit(jax.vmap(apart.scaled_from_unbounded))(z))
    assert ((inside > np.asarray(apart.low)) & (inside < np.asarray(apart.high))).all()
    moved = eqx.tree_at(lambda a: a.scaled, apart, jnp.asarray(inside[0]))
    np.testing.assert_allclose(moved.unbounded, z[0], rtol=1e-9, atol=1e-12)
    slopes = jax.jit(jax.vmap(jax.jacfwd(apart.scaled_from_unbounded)))(z)
    assert (np.diagonal(slopes, axis1=1, axis2=2) > 0).all()
    bounded = eqx.filter_jit(apart.scaled_from_unbounded)
    check_grads(bounded, (z[0],), order=1, atol=1e-6, rtol=1e-6)
