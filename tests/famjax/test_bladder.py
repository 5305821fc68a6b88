import jax.numpy as jnp
import numpy as np
import pytest

import famjax

EXACT = 1e-12


def test_reference_bladder_volume() -> None:
    """Chambers 2021 prints 1.481 in3 for 7/8 in x 1/16 in x 9-9/32 in."""
    assert float(famjax.Bladder(9.28125, 0.875, 0.0625).volume) == pytest.approx(1.481, abs=5e-4)


@pytest.mark.parametrize("embedded", [False, True])
def test_rest_state_has_no_strain_and_the_rest_thickness(*, embedded: bool) -> None:
    bladder = famjax.Bladder(0.3, 0.02, 0.0018, embedded=embedded)
    assert float(bladder.axial_strain(0.3)) == 0
    assert float(bladder.hoop_strain(0.3, 0.01)) == pytest.approx(0, abs=1e-15)
    assert float(bladder.thickness(0.3, 0.01)) == pytest.approx(0.0018, rel=EXACT)


@pytest.mark.parametrize("embedded", [False, True])
def test_rubber_volume_is_constant(*, embedded: bool) -> None:
    bladder = famjax.Bladder(0.3, 0.02, 0.0018, embedded=embedded)
    length, radius = jnp.linspace(0.2, 0.33, 20), jnp.linspace(0.016, 0.009, 20)
    t = bladder.thickness(length, radius)
    mid = radius if embedded else radius - t / 2
    np.testing.assert_allclose(2 * jnp.pi * mid * t * length, bladder.volume, rtol=EXACT)


def test_rubber_that_does_not_fit_is_nan() -> None:
    assert np.isnan(famjax.geometries.bladder_thickness(0.3, 0.001, 4e-5))
