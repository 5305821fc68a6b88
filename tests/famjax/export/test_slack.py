"""Every export at slack states: no force, and the model's own under its name."""

import importlib.util
import json
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.io import loadmat
from targets import compiled

import famjax
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


def test_tables(subject: Subject, tmp_path: Path) -> None:
    csv, mat = export(subject, ["csv", "mat"], tmp_path)
    head = sum(line.startswith("#") for line in csv.read_text().splitlines())
    rows = np.genfromtxt(csv, delimiter=",", names=True, skip_header=head)
    table = loadmat(mat, squeeze_me=True)
    for force, model in (
        (rows["force_N"], rows["model_force_N"]), (table["force_N"], table["model_force_N"]),
    ):  # fmt: skip
        slack = model <= 0
        assert slack.sum() > 100
        assert (force[slack] == 0).all()
        taut = model > float(subject.muscle.slack_width)
        np.testing.assert_array_equal(force[taut], model[taut])


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc on this machine")
def test_c(subject: Subject, states, tmp_path: Path) -> None:
    L, P, _ = states
    function = compiled(subject, tmp_path, "double")
    assert (function("force")(L, P) == 0).all()
    told = [subject.pull.model_force(*one) for one in zip(L.tolist(), P.tolist(), strict=True)]
    assert function("model_force")(L, P) == pytest.approx(told, rel=1e-12)


@pytest.mark.slow
def test_stablehlo(subject: Subject, states, tmp_path: Path) -> None:
    pytest.importorskip("flatbuffers", reason="flatbuffers is not installed")
    L, P, model = states
    files = export(subject, ["jax"], tmp_path)
    of = module_of(next(file for file in files if file.suffix == ".py"))
    assert (np.asarray(of.force(L, P)) == 0).all()
    assert np.asarray(of.model_force(L, P)) == pytest.approx(model, rel=1e-10)


@pytest.mark.slow
def test_the_card_that_mjx_runs(subject: Subject, states, tmp_path: Path) -> None:
    pytest.importorskip("mujoco.mjx", reason="MuJoCo's MJX is not installed")
    L, P, model = states
    export(subject, ["mjx"], tmp_path)
    assert json.loads((tmp_path / "test_20_card.json").read_text())["schema"] == "famjax-card/1"
    safe = famjax.cards.read_card(tmp_path / "test_20_card.json").safe()
    assert (np.asarray(safe.force(L, P)) == 0).all()
    assert np.asarray(safe.model_force(L, P)) == pytest.approx(model, rel=1e-10)
