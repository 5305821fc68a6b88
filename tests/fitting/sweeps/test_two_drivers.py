"""One problem, two drivers: the fits on the host and those of a batch are the same numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from fitting import ForceData, Specimen
from fitting.convex import Status
from fitting.sweeps.design import Design
from fitting.sweeps.fits import solve
from fitting.sweeps.forms import OBJECTIVES, Forms
from fitting.sweeps.linear_model import LinearModel
from fitting.sweeps.readings import Readings, arrange

AGREEMENT = 1e-9  # relative: of objectives, and of forces to the largest
EXACT = 1e-12  # certificate of a batch's fit that is known well enough to be compared
REST, DEADBAND = 0.2, 1e4
SOFTENING = np.array([2.5e6, -4.5e6, 2.4e6, 1e5])  # its tangent falls below zero and rises again
FORMS = Forms((1, 2, 3, 4))


def geometries() -> dict[str, famjax.geometries.AbstractGeometry]:
    """One whose strains keep their sign along the paths, and one whose bladder is slack at rest."""
    braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=1.2, length=REST, thickness=2e-4)
    return {
        "smooth": famjax.EstimatedGeometry(braid, famjax.Bladder(REST, 0.0195, 1.5e-3)),
        "corner": famjax.EstimatedGeometry(braid, famjax.Bladder(REST, 0.0235, 1.5e-3)),
    }


def measured(geometry: famjax.geometries.AbstractGeometry, seed: int) -> ForceData:
    length, pressure = (
        grid.ravel() for grid in np.meshgrid(REST * np.linspace(1, 0.8, 15), [1e5, 2e5, 3e5, 4e5])
    )
    muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(SOFTENING), DEADBAND)
    rng = np.random.default_rng(seed)
    force = np.asarray(muscle.force(length, pressure)) + 3 * rng.standard_t(3, size=length.size)
    return ForceData(force, pressure, length, Specimen("softening", REST, 1.5e-3))


@pytest.fixture(scope="module", params=["smooth", "corner"])
def posed(request: pytest.FixtureRequest) -> tuple[famjax.geometries.AbstractGeometry, Readings]:
    geometry = geometries()[request.param]
    return geometry, arrange(measured(geometry, 1), REST, FORMS.orders[-1])


def designed(geometry: famjax.geometries.AbstractGeometry, readings: Readings) -> Design:
    order = FORMS.orders[-1]
    model = LinearModel(geometry, DEADBAND, order, readings.pressure, readings.path_end)
    return Design.of(model, readings)


@pytest.mark.slow
@pytest.mark.parametrize("objective", OBJECTIVES)
def test_drivers_agree(objective: str) -> None:
    geometry = geometries()["smooth"]
    readings = arrange(measured(geometry, 1), REST, FORMS.orders[-1])
    of = designed(geometry, readings)
    mine, left_out = solve(of, FORMS, objective, leave_out=True)
    batch = jax.jit(lambda of: solve(of, FORMS, objective, leave_out=True))
    theirs, beyond = jax.tree.map(np.asarray, batch(jax.tree.map(jnp.asarray, of)))
    both = (theirs.status == int(Status.OPTIMAL)) & (theirs.kkt_residual < EXACT)
    assert (mine.status == int(Status.OPTIMAL)).all()
    assert both.mean() > 0.9
    assert mine.active.sum() > 50  # constraints are at work, or agreement shows little
    assert mine.kkt_residual.max() < EXACT
    np.testing.assert_allclose(mine.objective[both], theirs.objective[both], rtol=AGREEMENT)
    np.testing.assert_allclose(mine.condition, theirs.condition, rtol=AGREEMENT)
    forces = [
        (of.A @ (fits.coefficients / of.unit)[..., None])[both][..., 0] for fits in (mine, theirs)
    ]
    largest = np.abs(readings.force).max()
    np.testing.assert_allclose(*forces, atol=AGREEMENT * largest, rtol=0)
    # Without a pressure Huber's optimum is flat in places: other points have the same objective.
    if objective != "huber":
        beside = both & np.isfinite(beyond).all(axis=-1)
        without = (np.sqrt(square[beside]) for square in (left_out, beyond))
        np.testing.assert_allclose(*without, atol=AGREEMENT * largest, rtol=0)


@pytest.mark.parametrize("which", ["smooth", "corner"])
def test_nothing_is_violated_between_the_stations(which: str) -> None:
    """On a grid that has nothing to do with the fit's, by the physics itself."""
    geometry = geometries()[which]
    readings = arrange(measured(geometry, 1), REST, FORMS.orders[-1])
    found, _ = solve(designed(geometry, readings), FORMS, "sum_of_squares")
    held = found.coefficients[:, :, FORMS.constraints.index("drucker")]
    size, touching = np.abs(held).max(axis=(-2, -1)), []
    for p, (pressure, end) in enumerate(zip(readings.pressure, readings.path_end, strict=True)):
        length = REST + np.linspace(0, 1, 3001) * (end - REST)
        strains = famjax.stability.path_strains(geometry, length, pressure)
        rows = np.stack(
            [np.asarray(strains.modulus(famjax.PolynomialMaterial(E))) for E in np.eye(4)], axis=-1
        )
        least = (held[:, :, p] @ rows.T).min(axis=-1) / size
        assert least.min() > -1e-9
        touching.append(least)
    assert (np.min(touching, axis=0) < 1e-6).sum() > 2


def test_corners_of_the_paths_are_found_where_the_hoop_strain_is_zero() -> None:
    """So no piece is halved for them: each path has the corner as an edge, and few pieces."""
    geometry = geometries()["corner"]
    readings = arrange(measured(geometry, 1), REST, FORMS.orders[-1])
    functions = designed(geometry, readings).functions
    paths = len(readings.pressure)
    start, width = functions.start[0, paths:], functions.width[0, paths:]
    assert (start < 1).sum(axis=1).max() <= 8
    assert width.min() > 1e-3
    for own, pressure, end in zip(start, readings.pressure, readings.path_end, strict=True):
        length = REST + np.minimum(own, 1) * (end - REST)
        hoop = famjax.stability.path_strains(geometry, length, pressure).hoop
        assert np.abs(hoop).min() < 1e-13
