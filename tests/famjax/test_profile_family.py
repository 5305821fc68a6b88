import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.interpolate import CubicSpline
from slow_cases import slow_after

from famjax import Braid
from famjax.braids import AbstractBraid, diameter_from_length
from famjax.measured import Meridian
from famjax.profiles import CircularArcEnds, ConicFrustumEnds, FourierProfile
from famjax.surfaces import AbstractProfileFamily, AssumedShapeFamily, MeasuredFamily

EXACT = 1e-12
ROUNDING = 1e-11  # a small linear system has been solved
X = np.linspace(0, 1, 17)
INELASTIC = Braid(9.89, 1.09, 0.011)


class ClosedFormBraid(AbstractBraid):
    """Elastic threads under Gaylord's force: B = B0 / (1 - B0 P L / (2 pi N^2 n A E))."""

    rest_thread_length: jax.Array
    turns: jax.Array
    thickness: jax.Array

    def thread_length(self, length: jax.Array, pressure: jax.Array) -> jax.Array:
        stiffness = 2 * jnp.pi * self.turns**2 * 144 * 1.332e-4 * 11.6e6
        return self.rest_thread_length / (
            1 - self.rest_thread_length * pressure * length / stiffness
        )


ELASTIC = ClosedFormBraid(jnp.array(9.89), jnp.array(1.09), jnp.array(0.011))


def _profile(contraction: float) -> FourierProfile:
    """A made-up muscle: a wave number that varies with contraction, as measured ones do."""
    bulge = 0.2 + 2.0 * contraction
    return FourierProfile.symmetric(1.0 + bulge / 2, [-bulge / 3, -0.02], 5.6 - 1.5 * contraction)


def _family(contractions: np.ndarray, braid: AbstractBraid = INELASTIC, **kwargs: float):
    profiles = [_profile(contraction) for contraction in contractions]
    return MeasuredFamily(9.28 * (1 - contractions), profiles, 100.0, braid, **kwargs)


EVEN = np.array([0.0, 0.09, 0.18, 0.27, 0.35])


@eqx.filter_jit
def _diameter(family: AbstractProfileFamily, x: object, length: object, pressure: object):
    """Compiled once for each kind of family and shape of the arguments."""
    return family.diameter(x, length, pressure)


@pytest.mark.parametrize("count", slow_after(3, [2, 3, 4, 5, 8]))
@pytest.mark.parametrize("braid", [INELASTIC, ELASTIC], ids=["inelastic", "elastic"])
def test_exact_at_the_measured_states(count: int, braid: AbstractBraid) -> None:
    family = _family(np.linspace(0, 0.35, count), braid)
    own = eqx.filter_jit(lambda profile, length: profile.diameter(X, length))
    for profile, length in zip(family.profiles, np.asarray(family.lengths), strict=True):
        np.testing.assert_allclose(
            _diameter(family, X, length, 100.0), own(profile, length), rtol=ROUNDING
        )


@pytest.mark.parametrize("contractions", [EVEN, np.array([0, 0.02, 0.15, 0.2, 0.33]), EVEN[:4]])
def test_is_scipys_not_a_knot_spline_also_in_the_margin(contractions: np.ndarray) -> None:
    family = _family(contractions)
    table = np.stack([profile.diameter(X, 1.0) for profile in family.profiles])
    oracle = CubicSpline(contractions, table)
    lengths = np.linspace(*(float(end) for end in family.length_range()), 50)
    np.testing.assert_allclose(
        _diameter(family, X, lengths[:, None], 100.0), oracle(1 - lengths / 9.28), rtol=ROUNDING
    )


@pytest.mark.parametrize(("count", "degree"), [(2, 1), (3, 2), (4, 3), (6, 3)])
def test_reproduces_polynomials_of_its_degree(count: int, degree: int) -> None:
    def diameter(length: float) -> float:
        return 1 + 0.05 * (10 - length) ** degree

    lengths = np.linspace(9, 6, count)
    profiles = [FourierProfile(diameter(length), [], [], 1.0) for length in lengths]
    family = MeasuredFamily(lengths, profiles, 100.0, INELASTIC)
    between = np.linspace(5.9, 9.1, 30)
    np.testing.assert_allclose(
        _diameter(family, 0.5, between, 100.0), diameter(between), rtol=ROUNDING
    )


def test_second_derivative_is_continuous() -> None:
    family = _family(EVEN)
    bend = jax.jit(jax.vmap(jax.grad(jax.grad(lambda L: family.diameter(0.3, L, 100.0)))))
    lengths = np.asarray(family.lengths)
    for length in lengths[1:-1]:
        before, after = bend(length + np.array([-1e-9, 1e-9]))
        assert float(before) == pytest.approx(float(after), rel=1e-6)  # third derivative x 1e-9
    assert abs(float(bend(lengths[[1, 1]])[0])) > 1e-3  # a curve, not a line


def test_range_and_beyond() -> None:
    family = _family(EVEN, margin=0.1)
    shortest, longest = (float(end) for end in family.length_range())
    span = 9.28 * 0.35
    assert (shortest, longest) == pytest.approx((9.28 - 1.1 * span, 9.28 + 0.1 * span))
    known = np.isfinite(
        _diameter(
            family, 0.5, np.array([shortest - 1e-3, shortest, longest, longest + 1e-3]), 100.0
        )
    )
    assert known.tolist() == [False, True, True, False]


def test_pressure_scales_by_the_triangle() -> None:
    family = _family(EVEN, ELASTIC)
    L, P = jnp.array([6.5, 9.0])[:, None], 30.0
    scale = [
        diameter_from_length(L, ELASTIC.thread_length(L, jnp.array(pressure)), 1.09)
        for pressure in (P, 100.0)
    ]
    low, high = (np.asarray(_diameter(family, X, L, np.array(at))) for at in (P, 100.0))
    np.testing.assert_allclose(low, high * np.asarray(scale[0]) / np.asarray(scale[1]), rtol=EXACT)
    assert (low < high).all()


def test_inelastic_braid_knows_no_pressure() -> None:
    family = _family(EVEN)
    low, high = (_diameter(family, X, 8.0, np.array(pressure)) for pressure in (0.0, 200.0))
    np.testing.assert_array_equal(low, high)


@pytest.mark.slow
def test_derivatives_in_length_and_pressure() -> None:
    family = _family(EVEN, ELASTIC)
    check_grads(
        eqx.filter_jit(lambda L, P: family.diameter(X, 10 * L, 100 * P)),
        (jnp.array(0.77), jnp.array(0.6)),
        order=2,
        atol=1e-4,  # second differences keep about five digits
        rtol=1e-4,
    )


def test_derivatives_in_the_measured_lengths_and_profiles() -> None:
    def diameter(lengths: jax.Array, middle: jax.Array) -> jax.Array:
        profiles = [FourierProfile(a0, [-0.1], [0.0], 6.0) for a0 in middle]
        return MeasuredFamily(lengths, profiles, 100.0, INELASTIC).diameter(0.3, 7.7, 100.0)

    values = (jnp.array([9.0, 8.0, 7.0, 6.0]), jnp.array([1.0, 1.5, 1.9, 2.0]))
    check_grads(jax.jit(diameter), values, order=1, atol=1e-6, rtol=1e-6)


def test_jit_and_vmap_equal_eager() -> None:
    family = _family(EVEN, ELASTIC)
    L, P = np.linspace(6.1, 9.2, 9), np.linspace(0, 120, 9)
    eager = family.diameter(0.4, L, P)
    np.testing.assert_allclose(_diameter(family, 0.4, L, P), eager, rtol=EXACT)
    batched = jax.jit(jax.vmap(lambda L, P: family.diameter(0.4, L, P)))(L, P)
    np.testing.assert_allclose(batched, eager, rtol=EXACT)


def test_float32() -> None:
    family = _family(EVEN)
    single = jax.tree.map(lambda leaf: leaf.astype(np.float32), family)
    shortest, longest = single.length_range()
    L = np.linspace(shortest, longest, 9)
    assert L.dtype == np.float32
    diameter = _diameter(single, np.float32(0.4), L, np.float32(100))
    assert diameter.dtype == np.float32
    inside = L.astype(float) + 1e-5 * np.array([1, 0, 0, 0, 0, 0, 0, 0, -1])
    np.testing.assert_allclose(diameter, _diameter(family, 0.4, inside, 100.0), rtol=1e-5)


@pytest.mark.slow
def test_kinks_are_those_of_every_profile() -> None:
    shapes = [ConicFrustumEnds(1.2, 0.9, 1.0), ConicFrustumEnds(1.9, 0.9, 1.5)]
    family = MeasuredFamily([10.0, 6.0], shapes, 100.0, Braid(12.0, 1.0))
    np.testing.assert_allclose(family.kinks, [0.1, 0.25, 0.75, 0.9], rtol=EXACT)
    # Each is a cylinder less two triangles of its end's share; half-way D is the mean of the two.
    mean = (1.2 - (1.2 - 0.9) * 0.1 + 1.9 - (1.9 - 0.9) * 0.25) / 2
    at_8 = float(Meridian.of(family.at(100.0), 8.0, order=4).mean_diameter)
    assert at_8 == pytest.approx(mean, rel=EXACT)


def test_assumed_shape_follows_the_triangle() -> None:
    family = AssumedShapeFamily(ELASTIC, CircularArcEnds(9.9, 0.863))
    L, P = jnp.array([6.5, 7.0, 8.0]), 80.0
    triangle = diameter_from_length(L, ELASTIC.thread_length(L, jnp.array(P)), 1.09)
    np.testing.assert_allclose(_diameter(family, 0.5, L, P), triangle, rtol=EXACT)
    np.testing.assert_allclose(_diameter(family, 0.0, L, P), 0.863, rtol=EXACT)
    volume = eqx.filter_jit(lambda profile, length: Meridian.of(profile, length).volume)
    one = volume(CircularArcEnds(triangle[1], 0.863), 7.0)
    assert float(volume(family.at(P), 7.0)) == pytest.approx(float(one), rel=EXACT)
    batch = volume(family.at(P), L)
    assert float(batch[1]) == pytest.approx(float(one), rel=EXACT)


def test_bad_input() -> None:
    two = [_profile(0.0), _profile(0.3)]
    with pytest.raises(ValueError, match="two or more profiles"):
        MeasuredFamily([9.0], two[:1], 100.0, INELASTIC)
    with pytest.raises(ValueError, match=r"2 profiles and lengths of shape \(3,\)"):
        MeasuredFamily([9.0, 8.0, 7.0], two, 100.0, INELASTIC)
    with pytest.raises(ValueError, match="must decrease"):
        MeasuredFamily([6.0, 9.0], two, 100.0, INELASTIC)
    with pytest.raises(ValueError, match="margin is a part"):
        MeasuredFamily([9.0, 6.0], two, 100.0, INELASTIC, margin=0.5)


def test_interpolation_that_goes_negative_is_refused_with_its_place() -> None:
    thin = [FourierProfile(a0, [], [], 1.0) for a0 in (0.02, 0.02, 2.0, 0.02)]
    with pytest.raises(ValueError, match=r"must be > 0 at every length.* it is -.* at L = "):
        MeasuredFamily([9.0, 8.0, 7.0, 6.0], thin, 100.0, INELASTIC)


@pytest.mark.slow
def test_lengths_beyond_the_threads_are_refused() -> None:
    with pytest.raises(ValueError, match="threads are longer"):
        MeasuredFamily([10.0, 7.0], [_profile(0.0), _profile(0.3)], 100.0, INELASTIC)
