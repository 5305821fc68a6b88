"""A muscle with its circuit in C and as an FMU: the plant's own pressure and force."""

import dataclasses
from typing import Any

import pytest
from processes import command, needs, ran
from targets import STRICT, Course

from famjax.boundary.errors import InputError
from famjax.export import Subject, export
from famjax.plant import DahlFriction, HydraulicCircuit, Plant, PneumaticCircuit
from famjax.slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements

SLIP = MaxwellSlip(SlipElements([0.01, 0.03], [20, 10]), SlipElements([0.005], [30]), 0.296, 1e6)
RAMP = ReferenceCycle("ramp", 0.0, 5e5, cycled=True)
STROKE = ReferenceCycle("stroke", 0.296, 0.25, cycled=False)
PLANTS: dict[str, tuple[Any, Any]] = {
    "air, Dahl": (PneumaticCircuit(), DahlFriction(dry=5.0)),
    "air, slip about a stroke": (PneumaticCircuit(), CentredSlip(SLIP, STROKE)),
    "water, slip about a ramp": (HydraulicCircuit(), CentredSlip(SLIP, RAMP)),
    "water without relief, slip": (HydraulicCircuit(relief=None), SLIP),
}


def with_plant(subject: Subject, of: str) -> Subject:
    circuit, friction = PLANTS[of]
    plant = Plant(circuit, subject.muscle, friction=friction, viscosity=20.0)
    return dataclasses.replace(subject, plant=plant)


@needs("gcc")
@pytest.mark.parametrize("of", PLANTS)
def test_the_step_in_c_is_the_plants(of, subject, tmp_path):
    errors = Course.of(with_plant(subject, of), 4.0).errors_in_c(tmp_path)
    assert errors["pressure"] < 1e-8
    assert errors["force"] < 1e-6


@needs("gcc")
@pytest.mark.parametrize(
    ("of", "fits"), [("air, Dahl", True), ("water without relief, slip", False)]
)
def test_single_precision_is_for_air(of, fits, subject, tmp_path):
    export(with_plant(subject, of), ["c"], tmp_path)
    words = ["gcc", *STRICT, "-DTEST_20_REAL=float", "-fsyntax-only", str(tmp_path / "test_20.c")]
    done = ran(*words)
    assert (done.returncode == 0) == fits
    assert fits or "water_needs_double" in done.stderr


@needs("gcc")
@pytest.mark.parametrize("of", ["air, Dahl", "water, slip about a ramp"])
def test_the_fmu_is_valid_and_the_plant_in_both_modes(of, subject, tmp_path):
    validation = pytest.importorskip("fmpy.validation", reason="FMPy is not installed")
    course = Course.of(with_plant(subject, of), 4.0)
    (file,) = export(course.subject, ["fmu"], tmp_path)
    assert not validation.validate_fmu(str(file))
    assert max(course.errors_in_fmu(tmp_path, "CoSimulation").values()) < 1e-6
    assert max(course.errors_in_fmu(tmp_path, "ModelExchange").values()) < 1e-3


@needs("gcc")
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_the_fmu_starts_at_what_is_set(kind, subject, tmp_path):
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    (file,) = export(subject, ["fmu"], tmp_path)  # the default circuit
    start = {"pressure": 3e5, "length": 0.27, "signal": 128 / 255}
    found = fmpy.simulate_fmu(str(file), stop_time=0.002, start_values=start, fmi_type=kind,
                              output=["force", "pressure"], output_interval=0.002)  # fmt: skip
    assert found["pressure"][0] == 3e5
    assert found["force"][0] == pytest.approx(float(subject.muscle.force(0.27, 3e5)), rel=1e-6)


def test_a_plan_gives_circuit_and_friction(tmp_path):
    plan = tmp_path / "plan.toml"
    plan.write_text('[circuit]\nfluid = "water"\nrelief_kPa = 700\n[friction]\nshare = 0.03\n')
    command("export", "dmsp-20", "--to", "c", "--plant", plan, "-o", tmp_path)
    source = (tmp_path / "dmsp_20.c").read_text()
    for line in ("#define c_relief R(700000.0)", "#define f_share R(0.03)"):
        assert line in source


def test_a_law_of_ones_own_is_refused(subject, tmp_path):
    class Own(PneumaticCircuit):
        pass

    for circuit, friction in ((Own(), None), (PneumaticCircuit(), 1)):
        plant = Plant(circuit, subject.muscle, friction=friction)
        with pytest.raises(InputError, match="cannot be exported"):
            export(dataclasses.replace(subject, plant=plant), ["c"], tmp_path)


@needs("gcc")
@pytest.mark.parametrize("of", ["air, slip about a stroke", "water without relief, slip"])
def test_the_actuator_in_mujoco_is_the_plant(of, subject, tmp_path):
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    errors = Course.of(with_plant(subject, of), 2.0).errors_in_mujoco(tmp_path)
    assert max(errors.values()) < 1e-3
