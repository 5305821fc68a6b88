import jax.numpy as jnp
import pytest

import famjax


@pytest.fixture
def festo() -> famjax.Muscle:
    """A muscle like the DMSP-20-300: braid inside the wall, stable cubic law, deadband."""
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=jnp.deg2rad(62.0), length=0.296)
    bladder = famjax.Bladder(0.296, 23e-3, 1.8e-3, embedded=True)
    law = famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6])
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 40e3)


@pytest.fixture
def chambers() -> famjax.Muscle:
    """The reference work's 7/8 in specimen in inch, psi, lbf: bladder under an inelastic braid."""
    braid = famjax.Braid(9.89, 1.09, 0.011)
    bladder = famjax.Bladder(9.28125, 0.875, 0.0625)
    law = famjax.PolynomialMaterial([257.8, -57.9, 32.7])
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law)


@pytest.fixture(params=["festo", "chambers"])
def muscle(request: pytest.FixtureRequest) -> famjax.Muscle:
    return request.getfixturevalue(request.param)
