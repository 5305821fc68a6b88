"""Another muscle of the series, from the same construction."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax

REST, OTHER = 0.3, 0.083
EXACT = 1e-12  # proportional numbers, rounded once or twice
BLADDER = famjax.Bladder(REST, 0.0098, 0.0016)
BRAID = famjax.Braid.from_rest(diameter=0.0112, braid_angle=1.1, length=REST, thickness=3e-4)
THREAD = famjax.braids.LinearThread(8e10, 8.6e-8)
BRAIDS = {
    "inextensible": BRAID,
    "compliant": famjax.braids.CompliantBraid.of(BRAID, 4e-6),
    "elastic": famjax.ElasticBraid(
        BRAID.rest_thread_length, BRAID.turns, BRAID.thickness, 144, THREAD
    ),
}
LAW = famjax.PolynomialMaterial([1.2e6, -0.4e6, 0.3e6])


def muscle(kind: str, end_factor: float | None = None) -> famjax.Muscle:
    geometry: famjax.geometries.AbstractGeometry = famjax.EstimatedGeometry(BRAIDS[kind], BLADDER)
    if end_factor is not None:
        geometry = famjax.geometries.EndEffectGeometry(geometry, end_factor)
    return famjax.Muscle(geometry, LAW, 2e4)


@pytest.mark.parametrize("kind", BRAIDS)
def test_without_ends_the_force_depends_on_contraction_alone(kind: str) -> None:
    long, c = muscle(kind), jnp.linspace(0, 0.25, 6)
    short = famjax.cut_to_length(long, OTHER)
    assert float(short.geometry.rest_length) == OTHER
    np.testing.assert_allclose(
        short.force(OTHER * (1 - c), 4e5), long.force(REST * (1 - c), 4e5), rtol=1e-9
    )  # the elastic root is found to 1e-10


def test_the_ends_keep_their_dead_length() -> None:
    long = muscle("inextensible", 1.05)
    short = famjax.cut_to_length(long, OTHER)
    dead = REST * (1 - 1 / 1.05)
    factor = short.geometry.end_factor
    assert float(OTHER * (1 - 1 / factor)) == pytest.approx(dead, rel=EXACT)
    again = famjax.cut_to_length(short, REST)
    for one, other in zip(jax.tree.leaves(again), jax.tree.leaves(long), strict=True):
        np.testing.assert_allclose(one, other, rtol=EXACT)


class Wrapped(famjax.geometries.AbstractGeometry):
    """A geometry of a modeller's own, which says how it is cut."""

    inner: famjax.geometries.AbstractGeometry

    def dimensions(self, length, pressure):
        return self.inner.dimensions(length, pressure)

    def length_range(self):
        return self.inner.length_range()

    def cut_to_length(self, rest_length):
        return Wrapped(self.inner.cut_to_length(rest_length))

    rest_length = property(lambda self: self.inner.rest_length)


def test_a_geometry_of_ones_own_is_cut_and_has_a_volume() -> None:
    plain = muscle("inextensible")
    own = famjax.cut_to_length(famjax.Muscle(Wrapped(plain.geometry), LAW, 2e4), OTHER)
    short = famjax.cut_to_length(plain, OTHER)
    at = 0.9 * OTHER, 4e5
    assert float(own.force(*at)) == float(short.force(*at))
    assert float(own.volume(*at)) == float(short.volume(*at))
    np.testing.assert_array_equal(own.stops(), own.length_range())  # it names no braid
    lock, straight = short.stops()
    assert float(lock) < OTHER < float(straight) == float(short.geometry.braid.rest_thread_length)
