"""The commands of `famjax rig` as a person types them: exit codes, output, files."""

import io
import itertools
import json
import tomllib

import numpy as np
import pytest
from benches import PSI, calibrated, write_plan

from fitting import read_csv
from rig import read_journal
from rig.calibration import read_calibration, write_calibration
from rig.journal import stored_calibration
from rig.link import VirtualLink
from rig.protocol import SAFE, TRIP
from rig.simulation import HydraulicCircuit, SimulatedRig


def words(option, values):
    """An option that is repeated."""
    return [word for value in values for word in (option, value)]


REFERENCES = ["0psi", "40psi", "80psi", "120psi"]
PRESSURE = ("calibrate-sensor", "pressure", *words("--reference", REFERENCES))
FORCE = ("calibrate-sensor", "force", *words("--reference", ["0N", "1kN", "2kN", "4kN"]))
NONE = ("--port", "none")  # there is a simulated rig at every port


@pytest.fixture
def sim(request, monkeypatch):
    """The rig at whatever port is opened."""
    sim = SimulatedRig(getattr(request, "param", None))
    first = itertools.count(1000, 1000)  # a link numbers its commands from a number of its own
    monkeypatch.setattr("rig.link.Link", lambda opener: VirtualLink(sim, next(first)))
    return sim


@pytest.fixture
def refused(refused):
    """A command of `famjax rig` that ends with 2, and a sentence."""
    return lambda sentence, *typed: refused(sentence, "rig", *typed)


def test_simulate_writes_all_that_a_fit_needs_and_the_same_again(simulated, tmp_path, command):
    names = {"test.fam", "test.csv", "machine.csv", "dataset.csv", "characterisation.json",
             "characterisation.png"}  # fmt: skip
    assert {path.name for path in simulated.iterdir()} == names
    data = read_csv(simulated / "dataset.csv")
    assert data.specimen.rest_length == pytest.approx(9.28125 * 0.0254)
    assert data.specimen.braid_thickness == pytest.approx(0.011 * 0.0254)
    assert data.notes == ()
    found = json.loads((simulated / "characterisation.json").read_text())
    blocked = [row["blocked_force_N"] / 4.4482216 for row in found["isobars"]]
    assert blocked == pytest.approx([400, 832], rel=0.05)  # table 6.11: 403 and 850 lbf tested
    more = "--output", tmp_path / "o", "--seed", 4, "--json"
    code, out, _ = command("simulate", write_plan(tmp_path), *more)
    assert (code, len(json.loads(out)["isobars"])) == (0, 2)
    for name in ("machine.csv", "dataset.csv"):
        assert (tmp_path / "o" / name).read_bytes() == (simulated / name).read_bytes()
    ours, theirs = (read_journal(path / "test.fam") for path in (tmp_path / "o", simulated))
    assert np.array_equal(ours.rows, theirs.rows)  # the journal's first note has today's date


def test_check_recomputes_every_record_and_finds_what_was_edited(simulated, path, command):
    code, out, _ = command("check", simulated / "test.fam", "--json")
    found = json.loads(out)
    assert (code, found["sound"]) == (0, True)
    assert found["checked"] == found["equal"] == found["records"] > 3000
    lines = (simulated / "test.fam").read_bytes().split(b"\n")
    at, line = next((k, x) for k, x in enumerate(lines) if k > 2000 and x.startswith(b"T,"))
    path.write_bytes(b"\n".join([*lines[:at], line.replace(b",", b";"), *lines[at + 1 :]]))
    code, out, _ = command("check", path)
    lost = f"NOT sound: records missing from the file: 1; {len(line) + 1} bytes are damaged"
    assert (code, lost in out) == (1, True)


def test_bad_input_ends_in_a_sentence(simulated, tmp_path, command, refused):
    journal, no_limit = simulated / "test.fam", write_plan(tmp_path, limit="")
    missing = "[rig]: pressure_limit_<Pa|kPa|MPa|bar|psi> is missing: a number >= 0 and finite"
    for typed, sentence in (
        (("check", tmp_path / "none.fam"), "cannot read"),
        (("monitor", tmp_path / "no-port", "--seconds", 1), "cannot open the port"),
        (("convert", journal, tmp_path / "t.xls"), "must end in .csv"),
        (("simulate", calibrated(tmp_path / ".."), "--output", simulated), "test.fam exists"),
        (("run", no_limit, "--output", tmp_path / "o"), missing),
        (("simulate", no_limit, "--output", tmp_path / "o"), missing),
    ):
        refused(sentence, *typed)
    assert not (tmp_path / "o").exists()
    assert command("convert", journal, tmp_path / "t.csv")[0] == 0


def test_a_calibration_is_made_one_sensor_after_the_other(tmp_path, command):
    file, counts = tmp_path / "calibration.toml", words("--reading", [509, 1329, 2148, 2967])
    code, out, _ = command(*PRESSURE, *counts, "--calibration", file)
    assert code == 0
    assert "pressure at the references [psi]" in out
    assert "zero at 509." in out
    assert set(tomllib.loads(file.read_text())) == {"pressure"}
    counts = words("--reading", [704, 1289, 1874, 3043])
    assert command(*FORCE, *counts, "--calibration", file)[0] == 0
    found = read_calibration(file)
    assert float(found.pressure.value(1329)) == pytest.approx(40 * PSI, rel=2e-3)
    assert float(found.force.value(1289)) == pytest.approx(1000, rel=2e-3)


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        ([509, 1329, 2148], "must have the same shape"),
        ([509, 1329, 2148, 5115], "the limit of the converter"),
        ([2967, 2148, 1329, 509], "gain must be > 0"),
        ([509, 2148, 509, 2148], "do not follow the references"),
        ([], "a port is required"),
    ],
)
def test_what_is_no_calibration_leaves_the_file_as_it_was(counts, message, tmp_path, refused):
    file = tmp_path / "calibration.toml"
    write_calibration(file, SimulatedRig().calibration())
    before = file.read_bytes()
    refused(message, *PRESSURE, *words("--reading", counts), "--calibration", file)
    assert file.read_bytes() == before


def test_counts_are_read_at_each_reference(sim, tmp_path, command, refused, monkeypatch):
    at, asked = itertools.cycle([102, 266, 430, 593]), []

    def answer(question):
        asked.append(question)
        sim.sensor_fault = next(at)  # what the transducer shows then
        return ""

    monkeypatch.setattr("builtins.input", answer)
    file = tmp_path / "calibration.toml"
    code, out, _ = command(*PRESSURE, *NONE, "--calibration", file)
    assert (code, "40psi: 1330.00 counts" in out, sim.device.output) == (0, True, 0)
    assert asked == [f"Apply {text} and press Enter: " for text in REFERENCES]
    assert tomllib.loads(file.read_text())["board"] == sim.device.board != 0
    file.write_text(file.read_text().replace(str(sim.device.board), str(sim.device.board // 2 + 1)))
    other = f"this is board {sim.device.board}: use another file"
    refused(other, *PRESSURE, *NONE, "--calibration", file)


@pytest.mark.parametrize("sim", [HydraulicCircuit()], indirect=True)
def test_a_pump_is_stepped_under_the_limits_of_its_plan(sim, tmp_path, command, refused):
    true = sim.calibration()
    write_calibration(tmp_path / "calibration.toml", true)
    refused("requires a water circuit", "calibrate-pump", write_plan(tmp_path), *NONE, "--yes")
    assert sim.now == 0
    plan = write_plan(tmp_path, circuit="water")
    code, out, _ = command("calibrate-pump", plan, *NONE, "--yes")
    assert (code, "relief valve" in out, "output 200: " in out) == (0, True, True)
    assert (sim.device.output, sim.device.dump_open) == (0, True)
    found = read_calibration(tmp_path / "calibration.toml")
    assert found.pressure == true.pressure
    steady = 255 * sim.circuit.steady_signal(80 * PSI)
    assert found.feed_forward.output(80 * PSI) == pytest.approx(steady, abs=2.0)


def test_a_person_s_yes_clears_a_trip_whose_cause_has_gone(sim, tmp_path, command, refused):
    link = VirtualLink(sim)
    for verb, *values in (("trip", 600), ("man", 50)):
        link.command(verb, *values)
    sim.sensor_fault = 1023
    sim.advance(0.1)
    assert sim.device.state == TRIP
    calibrated(tmp_path)
    typed = ("acknowledge", "none", "--calibration", tmp_path / "calibration.toml")
    refused("refused 'clear'", *typed, "--yes")
    sim.sensor_fault = None
    sim.advance(5.0)
    code, out, err = command(*typed)
    assert (code, "at 1023 counts (" in out, "add --yes" in err) == (2, True, True)
    assert sim.device.state == TRIP
    code, out, _ = command(*typed, "--yes")
    assert (code, "acknowledged" in out, sim.device.state) == (0, True, SAFE)
    assert "is not tripped" in command(*typed)[1]


def test_a_run_prints_the_plan_and_waits_for_a_yes(tmp_path, command, refused, monkeypatch):
    typed = ("run", calibrated(tmp_path), "--port", tmp_path / "none", "--output", tmp_path / "o")
    code, out, _ = command(*typed, "--dry-run")
    assert (code, "block 1: 80 psi" in out) == (0, True)
    assert "duration 38 s" in out  # two of 3 s and 2 x 3.2 in at 0.4 in/s
    assert not (tmp_path / "o").exists()
    for text, terminal, more, sentence in (
        ("yes\n", False, (), "add --yes"),
        ("y\n", True, (), "not started"),
        ("", True, (), "standard input closed"),
        ("yes\n", True, (), "cannot open the port"),  # it went on
        ("", False, ("--yes",), "cannot open the port"),
        ("", False, ("--yes", "--start", "asked"), "requires a terminal: use --start at-once or"),
    ):
        stdin = io.StringIO(text)
        stdin.isatty = lambda at=terminal: at
        monkeypatch.setattr("sys.stdin", stdin)
        refused(sentence, *typed, *more)


def test_a_run_is_recorded_once_and_can_be_monitored(sim, tmp_path, command, refused):
    plan = calibrated(tmp_path, pressures="30", settle="4", stroke="0.2", rate="0.2")
    code, out, _ = command("monitor", "none", "--seconds", 0.01)
    assert (code, "SAFE" in out) == (0, True)
    typed = ("run", plan, "--output", tmp_path / "o", "--yes", *NONE)
    code, out, _ = command(*typed)
    assert (code, sim.device.output) == (0, 0)
    for text in ("1 strokes of 5.08 mm", "block 0: pressure held, ", "start the strokes", "RMS"):
        assert text in out
    assert read_journal(tmp_path / "o" / "test.fam").notes_of("end")[-1]["reason"] == "complete"
    refused("is complete", *typed, "--resume")


@pytest.mark.parametrize(
    ("limit", "sentence"),
    [
        ("inf", ">= 0 and finite, got inf"),
        ("1e308", "the pressure limit must be finite, got inf"),
        ("60", "the plan sets 80 psi, but the limit is 60 psi"),
    ],
)
def test_a_refused_plan_leaves_nothing_behind(limit, sentence, tmp_path, refused):
    calibrated(tmp_path)
    plan = write_plan(tmp_path, limit=f"pressure_limit_psi = {limit}")
    for verb, *more in (("run", "--yes", *NONE), ("simulate",)):
        refused(sentence, verb, plan, "--output", tmp_path / "o", *more)
        assert not (tmp_path / "o" / "test.fam").exists()


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("[40, 80]", "[40, 90]", "plan"),
        ("psi = 110", "psi = 115", "pressure_limit_Pa"),
        ("psi = 4", "psi = 5", "control"),
        ("", "", "calibration"),
    ],
)
def test_only_the_same_test_is_resumed(old, new, what, simulated, tmp_path, command, refused):
    plan, journal = calibrated(tmp_path), tmp_path / "test.fam"
    lines = (simulated / "test.fam").read_bytes().splitlines(keepends=True)
    second = next(k for k, line in enumerate(lines) if b'"block":1' in line)
    journal.write_bytes(b"".join(lines[: second + 1]))
    typed = ("run", plan, "--output", tmp_path, "--resume", "--yes", *NONE)
    if old:
        began = stored_calibration(read_journal(journal))
        write_calibration(tmp_path / "calibration.toml", began)
        _, out, err = command(*typed)
        assert ("cannot open the port" in err, "duration 19 s" in out) == (True, True)  # one of two
    plan.write_text(plan.read_text().replace(old, new))
    refused(f"it was started with a different {what}.", *typed)
    journal.write_bytes(b"".join(line for line in lines[: second + 1] if b"Isobaric(" not in line))
    refused("note of the plan or the settings is damaged", *typed)
