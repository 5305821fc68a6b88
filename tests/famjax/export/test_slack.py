"""Every export at slack states: no force, and the model's own under its name."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from famjax.export import Subject, export


def module_of(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def states(subject: Subject) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slack lengths and pressures, in the region and beyond, and the model's force there."""
    grid = np.meshgrid([0.15, 0.225, 0.25, 0.28, 0.296], [0.0, 2e4, 1e5, 3e5])
    L, P = (one.ravel() for one in grid)
    model = np.asarray(subject.muscle.model_force(L, P))
    slack = model < 0
    assert slack.sum() >= 10
    assert (L[slack] == 0.296).any()
    return L[slack], P[slack], model[slack]


def test_the_table_and_its_module_for_mujoco(subject: Subject, states, tmp_path: Path) -> None:
    L, P, model = states
    assert (np.asarray(subject.muscle.force(L, P)) == 0).all()
    _, file = export(subject, ["mujoco"], tmp_path)
    near = 1e-6 * subject.errors.largest_force
    for pull in (subject.pull, module_of(file).PULL):
        each = [*zip(L.tolist(), P.tolist(), strict=True)]
        assert [pull.force(*one) for one in each] == [0.0] * L.size
        assert [pull.model_force(*one) for one in each] == pytest.approx(model, abs=10 * near)
