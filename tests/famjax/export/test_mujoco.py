"""MuJoCo with the exported callback: the equilibria are ours, and a driven knee comes to rest."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from processes import needs
from targets import compiled, driven_knee

from famjax.export import CompiledPull, Subject, export, install, uninstall

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")


@pytest.fixture(autouse=True)
def no_callbacks() -> Iterator[None]:
    yield
    uninstall()


@pytest.fixture
def hanging(subject: Subject, tmp_path: Path):
    xml, _ = export(subject, ["mujoco"], tmp_path)
    model = mujoco.MjModel.from_xml_path(str(xml))
    install(model, {"test_20": subject.pull})
    return model, mujoco.MjData(model)


def pulled(model, pressure: float) -> float:
    data = mujoco.MjData(model)
    data.ctrl[0] = pressure
    mujoco.mj_forward(model, data)
    return data.actuator_force[0]


@pytest.mark.parametrize(("load", "pressure"), [(100.0, 2e5), (400.0, 4e5), (700.0, 6e5)])
def test_loads_come_to_rest_where_ours_do(load, pressure, hanging, subject):
    model, data = hanging
    model.body_mass[1] = load / 9.81
    model.dof_damping[0] = 2 * np.sqrt(model.body_mass[1] * subject.pull.stiffness(0.27, pressure))
    data.ctrl[0] = pressure
    mujoco.mj_step(model, data, nstep=3000)
    mujoco.mj_forward(model, data)
    assert abs(data.qvel[0]) < 1e-9
    expected = float(subject.muscle.length_at_load(load, pressure))
    assert data.ten_length[0] == pytest.approx(expected, abs=1e-6)


def test_without_the_callback_and_in_another_model_nothing_pulls(hanging, subject, tmp_path):
    model, _ = hanging
    text = (tmp_path / "test_20.xml").read_text()
    other = mujoco.MjModel.from_xml_string(text.replace("slide", "rail", 1))
    built = mujoco.MjSpec.from_string(text.replace("anchor", "hold")).compile()
    for one in (other, built, model):
        assert (pulled(one, 4.5e5) < 0) == (one is model)
    uninstall()
    assert pulled(model, 4.5e5) == 0


JOINT = """<mujoco><worldbody><body><joint name="elbow"/><geom size="0.1"/></body></worldbody>
<tendon><fixed name="t"><joint joint="elbow" coef="-0.02"/></fixed></tendon>
<actuator><general name="flexor" tendon="t" gainprm="0" biastype="BIAS"/></actuator></mujoco>"""


def test_an_actuator_by_which_a_muscle_would_not_pull_is_refused(subject):
    pulls = {"flexor": subject.pull}
    with pytest.raises(ValueError, match='must have biastype="user"'):
        install(mujoco.MjModel.from_xml_string(JOINT.replace("BIAS", "affine")), pulls)
    model = mujoco.MjModel.from_xml_string(JOINT.replace("BIAS", "user"))
    with pytest.raises(
        ValueError, match="pass the length of the muscle at that angle as an offset"
    ):
        install(model, pulls)
    install(model, pulls, {"flexor": 0.27})
    assert pulled(model, 3e5) == pytest.approx(-subject.pull.force(0.27, 3e5))


def test_a_control_that_is_hardly_in_pascal_is_said_once(hanging):
    model, data = hanging
    data.ctrl[0] = 4.5
    with pytest.warns(UserWarning, match="must be a gauge pressure in Pa") as found:
        mujoco.mj_step(model, data, nstep=3)
    assert len(found) == 1


def test_a_control_beyond_its_range_is_limited_and_that_is_said(hanging):
    model, data = hanging
    data.ctrl[0] = highest = model.actuator_ctrlrange[0, 1]
    mujoco.mj_forward(model, data)
    pull, data.ctrl[0] = float(data.actuator_force[0]), 1.5 * highest
    with pytest.warns(UserWarning, match="ctrlrange"):
        mujoco.mj_forward(model, data)
    assert float(data.actuator_force[0]) == pull < 0


def test_the_pressure_may_be_a_state_of_the_actuator(subject, tmp_path):
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
    expected = subject.pull.force(float(data.ten_length[0]), float(data.act[0]))
    assert -data.actuator_force[0] == pytest.approx(expected)


@needs("gcc")
def test_the_compiled_callback_is_the_table(hanging, subject, tmp_path):
    model, data = hanging
    compiled(subject, tmp_path, "double")
    install(model, {"test_20": CompiledPull(tmp_path / "double.so", "test_20")})
    data.ctrl[0] = 4e5
    mujoco.mj_forward(model, data)
    expected = subject.pull.force(float(data.ten_length[0]), 4e5)
    assert -data.actuator_force[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["subject", "dmsp_20"])
def test_a_knee_driven_past_the_stroke_comes_to_rest(name, request):
    found = driven_knee(request.getfixturevalue(name).pull)
    assert found.finite
    assert found.overrun > 0.3
    assert found.fastest < 30
    assert found.at_rest < 0.1
