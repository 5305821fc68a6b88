"""Families by the program that they share: the same numbers as by programs of their own."""

import dataclasses

import jax
import numpy as np
import pytest
from slow_cases import slow_after

import famjax
from fitting import ForceData
from fitting.engine import solve
from fitting.ladder import Candidate, in_shared_program, ladder, sharing_one_program
from fitting.posing import pose
from fitting.problem import Problem
from fitting.race import posed_of
from fitting.summary import muscle_at

ROUNDING = 1e-9  # relative: another program, and the forces of a rig to their own tolerance
NAMES = (
    "ogden", "mooney-rivlin", "linear", "saturating", "cubic", "ogden, compliant rig",
)  # fmt: skip


class Stiffer(famjax.materials.NeoHookeanMaterial):
    """A law of one's own whose parameter has the name of another's."""

    def energy(self, axial_stretch: famjax.Real, hoop_stretch: famjax.Real) -> jax.Array:
        return 3 * super().energy(axial_stretch, hoop_stretch)


def candidate(data: ForceData, name: str) -> Candidate:
    return next(one for one in ladder(data)[0] if one.name == name)


def alone(problem: Problem) -> Problem:
    parts = tuple(dataclasses.replace(part, within=None) for part in problem.parts)
    return dataclasses.replace(problem, parts=parts)


@pytest.fixture
def weighed(dmsp10: ForceData) -> ForceData:
    return dataclasses.replace(dmsp10, force_std=np.full(dmsp10.force.shape, 2.0))


@pytest.mark.parametrize("name", slow_after(1, NAMES))
def test_a_family_has_the_same_fit_by_its_own_program(weighed: ForceData, name: str) -> None:
    problem = posed_of(weighed, candidate(weighed, name), "drucker").problem
    assert problem.parts[0].within is not None
    u = np.full(len(problem.free), 0.4)
    shared, own = (solve(one, one.parameters(u)) for one in (problem, alone(problem)))
    for of in ("x", "residual", "offset", "columns", "G"):
        found, wanted = getattr(shared, of), getattr(own, of)
        size = np.abs(wanted).max()
        np.testing.assert_allclose(found, wanted, rtol=0, atol=ROUNDING * size, err_msg=of)


@pytest.mark.parametrize("name", slow_after(1, NAMES))
def test_its_muscle_has_the_same_force(weighed: ForceData, name: str) -> None:
    problem = posed_of(weighed, candidate(weighed, name), "drucker").problem
    point = solve(problem, problem.parameters(np.full(len(problem.free), 0.4)))
    mounted = problem.parts[0].mounted(muscle_at(problem, point, 0), point.parameters)
    shared = in_shared_program(mounted)
    assert shared is not mounted
    L, P = weighed.length[weighed.loaded], weighed.pressure[weighed.loaded]
    wanted = np.asarray(mounted.force(L, P))
    np.testing.assert_allclose(
        shared.force(L, P), wanted, rtol=0, atol=ROUNDING * np.abs(wanted).max()
    )


def test_a_law_of_ones_own_keeps_its_own_program(dmsp20: ForceData) -> None:
    problem = pose((dmsp20,), law=Stiffer).problem
    assert sharing_one_program(problem).parts[0].within is None


def test_a_muscle_with_other_terms_is_left_as_it_is() -> None:
    braid = famjax.Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3, thickness=0.0)
    bladder = famjax.Bladder(rest_length=0.3, rest_diameter=0.02, rest_thickness=0.002)
    geometry = famjax.EstimatedGeometry(braid, bladder)
    wall = famjax.terms.BladderWall(famjax.PolynomialMaterial([1e6]))
    mounted = famjax.MountedMuscle(famjax.Muscle(geometry, wall + famjax.terms.VirtualWork()), 0.0)
    assert in_shared_program(mounted) is mounted
