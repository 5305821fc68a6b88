"""Optima on the boundary of stability: exact between stations, certified, with errors as they are."""

import math

import numpy as np
import pytest
from slow_cases import slow_after

import famjax
import fitting
from fitting import ForceData, Specimen, identify

SPECIMEN = Specimen("softening", 0.25, 0.0018, nominal_diameter=0.02, embedded=True)
BRAID = famjax.Braid.from_rest(diameter=0.0225, braid_angle=math.radians(63), length=0.25)
SHAPE = famjax.EstimatedGeometry(BRAID, famjax.Bladder(0.25, 0.0225, 0.0018, embedded=True))
# It softens so far that it is not stable: every fit ends on the constraint.
TRUTH = famjax.Muscle(SHAPE, famjax.PolynomialMaterial([6e6, -26e6, 26e6]), 30e3)
NOISE = 8.0  # N
L, P = (g.ravel() for g in np.meshgrid(np.linspace(0.25, 0.18, 9), np.linspace(2e5, 6e5, 5)))


def readings(muscle: famjax.Muscle, seed: int, noise: float = NOISE) -> ForceData:
    force = np.asarray(muscle.force(L, P)) + np.random.default_rng(seed).normal(0, noise, L.size)
    return ForceData(force, P, L, SPECIMEN)


@pytest.mark.parametrize("seed", slow_after(1, [3, 4, 5]))
@pytest.mark.parametrize("options", [{"order": 3}, {"order": 6}, {"order": 3, "dependence": "linear"},
                                     {"law": "yeoh"}, {"order": 3, "constraint": "slope"}])  # fmt: skip
def test_it_is_certified_where_the_law_touches_the_constraint(seed: int, options: dict) -> None:
    found = identify(readings(TRUTH, seed), starts=2, **options)
    largest = float(np.abs(found.coefficients).max())
    assert found.converged
    assert -1e-9 * largest <= found.certificate.constraint_margin <= 1e-6 * largest  # it is active
    if options.get("constraint", "drucker") == "drucker":
        paths = found.problem.parts[0].inputs.path_pressure
        lowest = min(
            float(famjax.path_modulus(found.muscle.material, found.muscle.geometry,
                                      np.linspace(0.25, L.min(), 4000), P).min())
            for P in paths
        )  # fmt: skip
        assert lowest == pytest.approx(found.certificate.stability_margin, abs=1e-6 * largest)


@pytest.mark.slow
def test_standard_errors_are_those_of_repeated_tests() -> None:
    """The point that is touched moves with the noise: held where it is, E_3 seems twice as uncertain."""
    found = identify(readings(TRUTH, 3), starts=4, order=3)
    assert found.certificate.constraint_margin < 1.0  # Pa: the constraint is active
    refits = [identify(readings(TRUTH, seed), starts=1, order=3) for seed in range(100, 160)]
    spread = np.std([one.coefficients.ravel() for one in refits], axis=0, ddof=1)
    # The fit takes its misfit for noise: what is compared is how noise is carried.
    seen = found.errors.rmse * math.sqrt(found.errors.n_points / found.degrees_of_freedom)
    carried = np.sqrt(np.diag(found.covariance))[-3:] * NOISE / seen
    # Sixty of them tell a standard deviation to a tenth.
    np.testing.assert_allclose(carried[1:], spread[1:], rtol=0.3)


@pytest.mark.slow
def test_no_law_at_all_is_an_optimum_of_a_sweep() -> None:
    """Forces above those of the braid alone: whatever must not pull the muscle back is zero."""
    above = famjax.Muscle(SHAPE, famjax.PolynomialMaterial([-1e6]), 0.0)
    data = readings(above, 0, noise=0.0)
    found = fitting.sweep(data, SHAPE)
    assert all(row.status is fitting.convex.Status.OPTIMAL for row in found.rows)
    zero = [row for row in found.rows if row.constraint != "none" and row.order == 1]
    assert max(float(np.abs(row.coefficients).max()) for row in zero) < 1e-3  # Pa
    assert identify(data, order=1, constraint="positive", starts=2).converged
