"""`famjax rig calibrate-sensor` and `calibrate-pump` as a person types them."""

import tomllib
from pathlib import Path

import pytest
from rig_commands import run, write_plan

from rig.calibration import read_calibration, write_calibration
from rig.link import VirtualLink
from rig.simulation import HydraulicCircuit, SimulatedRig

PSI = 6894.757293168361


def words(option: str, values: list) -> list:
    return [word for value in values for word in (option, value)]


REFERENCES = ["0psi", "40psi", "80psi", "120psi"]
PRESSURE = ("calibrate-sensor", "pressure", *words("--reference", REFERENCES))
FORCE = ("calibrate-sensor", "force", *words("--reference", ["0N", "1kN", "2kN", "4kN"]))
COUNTS = words("--reading", [509, 1329, 2148, 2967])


def test_a_calibration_is_made_one_sensor_after_the_other(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    file = tmp_path / "calibration.toml"
    code, out, _ = run(capsys, *PRESSURE, *COUNTS, "--calibration", file)
    assert code == 0
    assert "measured [psi]" in out
    assert "zero at 509." in out
    assert set(tomllib.loads(file.read_text())) == {"pressure"}
    counts = words("--reading", [704, 1289, 1874, 3043])
    assert run(capsys, *FORCE, *counts, "--calibration", file)[0] == 0
    found = read_calibration(file)
    assert float(found.pressure.value(1329)) == pytest.approx(40 * PSI, rel=2e-3)
    assert float(found.force.value(1289)) == pytest.approx(1000, rel=2e-3)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (words("--reading", [509, 1329, 2148]), "must have one shape"),
        (words("--reading", [509, 1329, 2148, 5115]), "the end of the converter's range"),
        (words("--reading", [2967, 2148, 1329, 509]), "gain must be positive"),
        ([], "which port?"),
    ],
)
def test_what_is_no_calibration_leaves_the_file_as_it_was(
    more: list, message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    file = tmp_path / "calibration.toml"
    write_calibration(file, SimulatedRig().calibration())
    before = file.read_bytes()
    code, _, err = run(capsys, *PRESSURE, *more, "--calibration", file)
    assert code == 2
    assert message in err
    assert file.read_bytes() == before


def test_counts_are_read_while_a_person_applies_the_references(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    sim, at = SimulatedRig(), iter([102, 266, 430, 593])
    asked: list[str] = []

    def answer(question: str) -> str:
        asked.append(question)
        sim.sensor_fault = next(at)  # what the transducer shows then
        return ""

    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr("rig.link.Link", lambda opener: VirtualLink(sim))
    file = tmp_path / "calibration.toml"
    code, out, _ = run(capsys, *PRESSURE, "--port", "none", "--calibration", file)
    assert code == 0
    assert asked == [f"Apply {text} and press Enter: " for text in REFERENCES]
    assert "40psi: 1330.00 counts" in out
    assert sim.device.output == 0


def test_a_pump_is_stepped_under_the_limits_of_its_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    sim = SimulatedRig(HydraulicCircuit())
    true = sim.calibration()
    write_calibration(tmp_path / "calibration.toml", true)
    monkeypatch.setattr("rig.link.Link", lambda opener: VirtualLink(sim))
    plan = write_plan(tmp_path, circuit="water")
    code, out, _ = run(capsys, "calibrate-pump", plan, "--port", "none", "--yes")
    assert code == 0
    assert "relief valve" in out
    assert "output 200: " in out
    assert (sim.device.output, sim.device.dump_open) == (0, True)
    found = read_calibration(tmp_path / "calibration.toml")
    assert found.pressure == true.pressure
    for psi in (20, 80):
        steady = sim.circuit.steady_output(psi * PSI)
        assert found.feed_forward.output(psi * PSI) == pytest.approx(steady, abs=2.0)


@pytest.mark.parametrize(
    ("circuit", "more", "message"),
    [
        ("air", [], "whose valve neither"),
        ("water", words("--steps", [40, 300]), "0 to 255 counts, got 300"),
    ],
)
def test_a_pump_that_cannot_be_stepped_is_refused(
    circuit: str, more: list, message: str, tmp_path: Path, capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    sim = SimulatedRig(HydraulicCircuit())
    write_calibration(tmp_path / "calibration.toml", sim.calibration())
    monkeypatch.setattr("rig.link.Link", lambda opener: VirtualLink(sim))
    plan = write_plan(tmp_path, circuit=circuit)
    code, _, err = run(capsys, "calibrate-pump", plan, "--port", "none", "--yes", *more)
    assert code == 2
    assert message in err
    assert sim.now == 0
