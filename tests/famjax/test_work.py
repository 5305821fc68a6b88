import numpy as np
import pytest
from muscles import INELASTIC as BRAID, LATEX, SPECIMEN as TUBE

import famjax
from famjax import Braid, ElasticBraid, EquilibriumMuscle, EstimatedGeometry, Muscle
from famjax.braids import LinearThread
from famjax.work import WorkBudget, work_budget

SOFT = ElasticBraid(9.89, 1.09, 0.011, 96.0, LinearThread(2e5, 4e-4))


def stroke(muscle: Muscle | EquilibriumMuscle, pressure: float = 100.0) -> WorkBudget:
    return work_budget(muscle, pressure, 9.28125, 6.5)


def test_the_shape_from_mechanics_loses_nothing() -> None:
    budget = stroke(EquilibriumMuscle(BRAID, TUBE, LATEX, end_diameter=0.863))
    assert float(abs(budget.left_over / budget.fluid)) < 1e-9
    assert 0.7 < float(budget.efficiency) < 1


@pytest.mark.parametrize("braid", [BRAID, SOFT])
def test_a_bare_cylinder_closes(braid: Braid) -> None:
    """Gaylord's term on a cylinder is virtual work, also where the threads stretch."""
    bare = Muscle(EstimatedGeometry(braid, TUBE), famjax.PolynomialMaterial([0.0]))
    budget = stroke(bare)
    assert float(abs(budget.left_over / budget.fluid)) < 1e-9
    assert (float(abs(budget.stored)) > 1) == (braid is SOFT)


def test_a_stroke_that_cannot_be_has_no_work() -> None:
    latex = Muscle(EstimatedGeometry(BRAID, TUBE), LATEX)
    assert np.isnan(work_budget(latex, 1.0, 9.0, 12.0).load)
