from collections.abc import Callable

import jax.numpy as jnp
import pytest

import famjax

REST_LENGTH = 9.28125  # in, of the reference work's specimen


@pytest.fixture(scope="session")
def table_4_3() -> dict[float, tuple[famjax.profiles.FourierProfile, float]]:
    """Chambers 2021, table 4.3 as corrected, 100 psi: by contraction, profile and length [in]."""
    rows = [  # contraction, a0, a_n, b_n, w
        (0.0, 1.02, [-0.09, -0.07, -0.01], [0.03, 0.06, 0.02], 5.596),
        (0.0875, 1.37, [-0.35, -0.15, -0.01], [-0.17, -0.19, -0.06], -5.371),
        (0.175, 1.51, [-0.56, -0.10, 0.04], [0.43, 0.41, 0.10], 4.961),
        (0.2625, 1.27, [-0.83, 0.29, 0.18], [1.20, 0.75, 0.04], 4.347),
        (0.35, -32.74, [24.82, 12.82, -3.90], [47.44, -18.47, -0.5], 2.176),
    ]
    return {
        contraction: (famjax.profiles.FourierProfile(*series), REST_LENGTH * (1 - contraction))
        for contraction, *series in rows
    }


@pytest.fixture(scope="session")
def measured_family(
    table_4_3: dict,
) -> Callable[[famjax.braids.AbstractBraid], famjax.surfaces.MeasuredFamily]:
    """The family of table 4.3's profiles, made symmetric, about a braid."""

    def about(braid: famjax.braids.AbstractBraid) -> famjax.surfaces.MeasuredFamily:
        profiles, lengths = zip(*table_4_3.values(), strict=True)
        even = [profile.symmetrised() for profile in profiles]
        return famjax.surfaces.MeasuredFamily(lengths, even, 100.0, braid)

    return about


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
