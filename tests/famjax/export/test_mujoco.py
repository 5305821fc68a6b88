"""MuJoCo with the exported callback: the equilibria are ours, and a driven knee comes to rest."""

import importlib.util
import itertools
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from targets import compiled, driven_knee

from famjax.export import CompiledPull, Subject, export, install, uninstall

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")


@pytest.fixture(autouse=True)
def no_callbacks() -> Iterator[None]:
    yield
    uninstall()


@pytest.fixture
def hanging(subject: Subject, tmp_path: Path):
    """The exported model with its callback."""
    xml, _ = export(subject, ["mujoco"], tmp_path)
    model = mujoco.MjModel.from_xml_path(str(xml))
    install(model, {"test_20": subject.pull})
    return model, mujoco.MjData(model)


def test_the_keyframe_is_at_rest(hanging) -> None:
    model, data = hanging
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert abs(data.qacc[0]) < 1e-5


@pytest.mark.parametrize(("load", "pressure"), [(100.0, 2e5), (400.0, 4e5), (700.0, 6e5)])
def test_loads_come_to_rest_where_ours_do(
    load: float, pressure: float, hanging, subject: Subject
) -> None:
    model, data = hanging
    model.body_mass[1] = load / 9.81
    model.dof_damping[0] = 2 * np.sqrt(model.body_mass[1] * subject.pull.stiffness(0.27, pressure))
    data.ctrl[0] = pressure
    mujoco.mj_step(model, data, nstep=3000)
    mujoco.mj_forward(model, data)
    assert abs(data.qvel[0]) < 1e-9
    expected = float(subject.muscle.length_at_load(load, pressure))
    assert data.ten_length[0] == pytest.approx(expected, abs=1e-6)


def test_without_the_callback_and_in_another_model_nothing_pulls(
    hanging, subject: Subject, tmp_path: Path
) -> None:
    model, _ = hanging
    text = (tmp_path / "test_20.xml").read_text()
    other = mujoco.MjModel.from_xml_string(text.replace("slide", "rail", 1))
    built = mujoco.MjSpec.from_string(text.replace("anchor", "hold")).compile()
    for one in (other, built, model):
        data = mujoco.MjData(one)
        data.ctrl[0] = 4.5e5
        mujoco.mj_forward(one, data)
        assert (data.actuator_force[0] < 0) == (one is model)
    uninstall()
    data = mujoco.MjData(model)
    data.ctrl[0] = 4.5e5
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == 0


def test_a_control_that_is_hardly_in_pascal_is_said_once(hanging) -> None:
    model, data = hanging
    data.ctrl[0] = 4.5
    with pytest.warns(UserWarning, match="is it in Pa") as found:
        mujoco.mj_step(model, data, nstep=3)
    assert len(found) == 1


def test_the_module_needs_mujoco_alone(subject: Subject, tmp_path: Path) -> None:
    export(subject, ["mujoco"], tmp_path)
    script = (
        "import sys, mujoco, test_20_mujoco as of\n"
        "model = mujoco.MjModel.from_xml_path('test_20.xml')\n"
        "of.install(model, {'test_20': of.PULL})\n"
        "data = mujoco.MjData(model)\n"
        "mujoco.mj_resetDataKeyframe(model, data, 0)\n"
        "mujoco.mj_forward(model, data)\n"
        "print(abs(data.qacc[0]), 'famjax' in sys.modules, 'jax' in sys.modules)\n"
        "print(repr(of.PULL.force(0.27, 4e5)))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True,
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
    )  # fmt: skip
    (acceleration, famjax, jax), (force,) = (line.split() for line in done.stdout.splitlines())
    assert float(acceleration) < 1e-5
    assert (famjax, jax) == ("False", "False")
    assert float(force) == subject.pull.force(0.27, 4e5)


def test_a_name_and_an_origin_that_python_and_xml_would_read(
    odd_subject: Subject, tmp_path: Path
) -> None:
    xml, module = export(odd_subject, ["mujoco"], tmp_path)
    model = mujoco.MjModel.from_xml_path(str(xml))
    assert odd_subject.name in bytes(model.text_data).decode()
    spec = importlib.util.spec_from_file_location("odd", module)
    assert spec is not None
    assert spec.loader is not None
    odd = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(odd)
    assert odd.PULL.force(0.27, 4e5) == odd_subject.pull.force(0.27, 4e5)


def test_the_pressure_may_be_a_state_of_the_actuator(subject: Subject, tmp_path: Path) -> None:
    xml, _ = export(subject, ["mujoco"], tmp_path)
    text = xml.read_text().replace('gainprm="0"', 'dyntype="filter" dynprm="0.1" gainprm="0"')
    model = mujoco.MjModel.from_xml_string(text.replace('ctrl="', 'act="0" ctrl="'))
    install(model, {"test_20": subject.pull})
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    slack = subject.pull.force(data.ten_length[0], 0.0)
    assert -data.actuator_force[0] == pytest.approx(slack, abs=1e-9)
    mujoco.mj_step(model, data, nstep=1500)
    assert data.act[0] == pytest.approx(data.ctrl[0], rel=1e-6)
    mujoco.mj_forward(model, data)
    assert -data.actuator_force[0] == pytest.approx(
        subject.pull.force(float(data.ten_length[0]), float(data.act[0]))
    )


def test_the_compiled_callback_is_the_table(hanging, subject: Subject, tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("no gcc on this machine")
    model, data = hanging
    compiled(subject, tmp_path, "double")
    install(model, {"test_20": CompiledPull(tmp_path / "double.so", "test_20")})
    data.ctrl[0] = 4e5
    mujoco.mj_forward(model, data)
    expected = subject.pull.force(float(data.ten_length[0]), 4e5)
    assert -data.actuator_force[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["subject", "dmsp_20"])
def test_a_knee_driven_past_the_stroke_comes_to_rest(
    name: str, request: pytest.FixtureRequest
) -> None:
    found = driven_knee(request.getfixturevalue(name).pull)
    assert found.finite
    assert found.overrun > 0.3
    assert found.fastest < 30
    assert found.at_rest < 0.1


def test_callbacks_serve_several_muscles(subject: Subject, dmsp_20: Subject) -> None:
    parts = "".join(
        f'<body pos="{k} 0 -0.27"><joint type="slide" axis="0 0 1"/><geom size="0.05" mass="9"/>'
        f'<site name="b{k}"/></body><site name="a{k}" pos="{k} 0 0"/>'
        for k in range(2)
    )
    tendons, actuators = (
        "".join(form.format(k=k) for k in range(2))
        for form in (
            '<spatial name="t{k}"><site site="a{k}"/><site site="b{k}"/></spatial>',
            '<general name="m{k}" tendon="t{k}" gainprm="0" biastype="user"/>',
        )
    )
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{parts}</worldbody><tendon>{tendons}</tendon>"
        f"<actuator>{actuators}</actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    pulls = [subject.pull, dmsp_20.pull]
    install(model, {"m0": pulls[0], "m1": pulls[1]})
    for pressures in itertools.product((2e5, 5e5), repeat=2):
        data.ctrl[:] = pressures
        mujoco.mj_forward(model, data)
        expected = [pull.force(0.27, at) for pull, at in zip(pulls, pressures, strict=True)]
        assert -data.actuator_force == pytest.approx(np.array(expected))


def test_a_fixed_tendon_has_an_offset(subject: Subject, tmp_path: Path) -> None:
    """The length of a `fixed` tendon is 0 where its joint is; the muscle's is 0.31 m there."""
    xml, _ = export(subject, ["mujoco"], tmp_path)
    fixed = '<fixed name="test_20"><joint joint="slide" coef="-1"/></fixed>'
    text = re.sub(r"<spatial.*?</spatial>", fixed, xml.read_text(), flags=re.DOTALL)
    model = mujoco.MjModel.from_xml_string(text)
    install(model, {"test_20": subject.pull}, {"test_20": 0.31})
    data = mujoco.MjData(model)
    load, pressure = 400.0, 4e5
    model.body_mass[1] = load / 9.81
    model.dof_damping[0] = 2 * np.sqrt(model.body_mass[1] * subject.pull.stiffness(0.27, pressure))
    data.ctrl[0] = pressure
    mujoco.mj_step(model, data, nstep=3000)
    mujoco.mj_forward(model, data)
    expected = float(subject.muscle.length_at_load(load, pressure))
    assert data.ten_length[0] + 0.31 == pytest.approx(expected, abs=1e-6)
