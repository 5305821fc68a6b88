"""The model as StableHLO and inside MJX: values and derivatives are the model's."""

import os
from pathlib import Path

import numpy as np
import pytest
from processes import python
from targets import rollout, rollout_derivatives

import famjax
from famjax.export import Subject, export

STEPS = 50


@pytest.mark.slow
def test_a_process_without_famjax_computes_force_and_gradient(
    subject: Subject, tmp_path: Path
) -> None:
    pytest.importorskip("flatbuffers", reason="flatbuffers is not installed")
    export(subject, ["jax"], tmp_path)
    L, P = np.array([0.24, 0.28, 0.31, 0.4]), np.array([3e5, 5e5, 9e5, 1e5])
    script = (
        "import sys, jax, numpy as np, test_20_jax as of\n"
        f"L, P = np.array({L.tolist()}), np.array({P.tolist()})\n"
        "print(*of.force(L, P).tolist())\n"
        "print(*jax.grad(lambda L: of.force(L, P).sum())(L).tolist())\n"
        "print('famjax' in sys.modules)\n"
    )
    env = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = python("-c", script, cwd=tmp_path, env=env)
    assert done.returncode == 0, done.stderr
    force, stiffness, famjax_there = (line.split() for line in done.stdout.splitlines())
    assert [*map(float, force)] == pytest.approx(np.asarray(subject.muscle.force(L, P)), rel=1e-12)
    expected = np.asarray(subject.muscle.stiffness(L, P))
    assert [*map(float, stiffness)] == pytest.approx(expected, rel=1e-10)
    assert famjax_there == ["False"]


@pytest.mark.slow
def test_an_mjx_rollout_is_mujoco_s_and_its_derivative_that_of_differences(
    subject: Subject, tmp_path: Path
) -> None:
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    pytest.importorskip("mujoco.mjx", reason="MuJoCo's MJX is not installed")
    exact, difference = rollout_derivatives(tmp_path, STEPS)
    assert exact == pytest.approx(difference, rel=1e-6)
    end, first = rollout(tmp_path, STEPS)
    assert abs(exact) * first > 1e-5  # m: E_1 moves the load

    export(subject, ["mujoco"], tmp_path)
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "test_20.xml"))
    data = mujoco.MjData(plain)
    data.qpos[0], data.ctrl[0] = 0.01, 4e5
    famjax.export.install(plain, {"test_20": subject.pull})
    try:
        mujoco.mj_step(plain, data, nstep=STEPS)
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_gain(None)
    assert float(end(first)) == pytest.approx(data.qpos[0], abs=1e-8)
