"""The commands of `famjax rig` as a person types them: exit codes, output, files."""

import csv
import io
import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from famjax.__main__ import main
from famjax.boundary.errors import InputError
from famjax.boundary.units import parse_quantity
from famjax.commands.rig import HELP
from fitting import read_csv
from rig import audit, read_journal, read_plan
from rig.calibration import write_calibration
from rig.control import Monitor
from rig.journal import stored_calibration
from rig.protocol import Sample, frame
from rig.simulation import PneumaticCircuit, RigServer, SimulatedRig

PLAN = """
[plan]
pressures_psi = [{pressures}]
cycles = 1
stroke_in = {stroke}
rate_in_per_s = 0.2
settle_s = {settle}

[rig]
circuit = "{circuit}"
{limit}
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
calibration = "calibration.toml"
"""


def run(capsys: pytest.CaptureFixture, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main(["rig", *map(str, arguments)])
    captured = capsys.readouterr()
    return int(stop.value.code or 0), captured.out, captured.err


def write_plan(folder: Path, **changes: str) -> Path:
    fields = {
        "pressures": "40, 80", "circuit": "air", "limit": "pressure_limit_psi = 110", "settle": "3",
        "stroke": "3.2",
    }  # fmt: skip
    path = folder / "plan.toml"
    path.write_text(PLAN.format(**(fields | changes)))
    return path


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    with pytest.raises(SystemExit) as stop:
        main(
            [
                "rig",
                "simulate",
                str(write_plan(folder)),
                "--output",
                str(folder / "out"),
                "--seed",
                "4",
            ]
        )
    assert not stop.value.code
    return folder / "out"


def test_simulate_writes_everything_that_a_fit_needs(simulated: Path) -> None:
    names = {path.name for path in simulated.iterdir()}
    assert names == {
        "test.fam", "machine.csv", "dataset.csv", "characterisation.json", "characterisation.png",
    }  # fmt: skip
    data = read_csv(simulated / "dataset.csv")
    assert data.specimen.rest_length == pytest.approx(9.28125 * 0.0254)
    assert data.specimen.braid_thickness == pytest.approx(0.011 * 0.0254)
    assert data.notes == ()
    found = json.loads((simulated / "characterisation.json").read_text())
    blocked = [row["blocked_force_N"] / 4.4482216 for row in found["isobars"]]
    assert blocked == pytest.approx([400, 832], rel=0.05)  # table 6.11: 403 and 850 lbf tested


def test_simulate_gives_the_same_files_by_the_same_seed(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, _ = run(
        capsys, "simulate", write_plan(tmp_path), "--output", tmp_path / "o", "--seed", 4, "--json"
    )
    assert code == 0
    assert len(json.loads(out)["isobars"]) == 2
    for name in ("machine.csv", "dataset.csv"):
        assert (tmp_path / "o" / name).read_bytes() == (simulated / name).read_bytes()
    ours, theirs = (read_journal(path / "test.fam") for path in (tmp_path / "o", simulated))
    assert np.array_equal(ours.rows, theirs.rows)  # the journal's first note has today's date


def test_simulate_does_not_overwrite_a_journal(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, _, err = run(capsys, "simulate", write_plan(tmp_path), "--output", simulated)
    assert code == 2
    assert "test.fam exists" in err


def test_characterise_repeats_what_simulate_found(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, _ = run(
        capsys, "characterise", simulated / "test.fam", simulated / "machine.csv",
        "--rest-length", "9.28125in", "--specimen", "wall_thickness_in=0.0625",
        "--output", tmp_path, "--units", "metric",
    )  # fmt: skip
    assert code == 0
    assert "set kPa" in out
    ours, theirs = (
        json.loads((folder / "characterisation.json").read_text())["isobars"]
        for folder in (tmp_path, simulated)
    )
    assert ours == theirs
    assert read_csv(tmp_path / "dataset.csv").specimen.wall_thickness == pytest.approx(1.5875e-3)


def test_characterise_takes_columns_that_the_log_does_not_tell(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """A second load is refused by name; the option that the message asks for chooses."""
    lines = (simulated / "machine.csv").read_text().splitlines()
    more = [",Load 2", ",(N)", *[",7.5"] * (len(lines) - 2)]
    log = tmp_path / "two.csv"
    log.write_text("\n".join(a + b for a, b in zip(lines, more, strict=True)))
    words = ("characterise", simulated / "test.fam", log, "--rest-length", "9.28125in",
             "--output", tmp_path)  # fmt: skip
    code, _, err = run(capsys, *words)
    assert code == 2
    assert "2 columns for force (Load, Load 2)" in err
    assert "--log-columns force=" in err
    assert run(capsys, *words, "--log-columns", "force=Load")[0] == 0
    code, _, err = run(capsys, *words, "--log-columns", "force=Load", "--log-units", "force=psi")
    assert code == 2
    assert "unknown unit 'psi'" in err


def test_characterise_aligns_by_the_pulses_of_the_run(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, _ = run(
        capsys, "characterise", simulated / "test.fam", simulated / "machine.csv",
        "--rest-length", "9.28125in", "--sync-column", "Digital input (-)", "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    assert "clocks aligned by pulses: journal = log -12.3" in out
    ours, theirs = (
        json.loads((folder / "characterisation.json").read_text())["alignment"]
        for folder in (tmp_path, simulated)
    )
    assert (ours["method"], theirs["method"]) == ("pulses", "load")
    apart = ours["offset_s"] - theirs["offset_s"]
    assert abs(apart) < 3 * ours["offset_error_s"] + 1e-3


def test_characterise_says_which_stroke_a_torn_journal_costs(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    data = bytearray((simulated / "test.fam").read_bytes())
    middle = len(data) // 4
    data[middle : middle + 4096] = bytes(4096)
    (tmp_path / "torn.fam").write_bytes(data)
    code, out, _ = run(
        capsys, "characterise", tmp_path / "torn.fam", simulated / "machine.csv",
        "--rest-length", "9.28125in", "--output", tmp_path,
    )  # fmt: skip
    assert code == 0
    assert "stroke 1 lacks 0." in out
    (bar,) = json.loads((tmp_path / "characterisation.json").read_text())["isobars"]
    assert bar["set_pressure_Pa"] == pytest.approx(80 * 6894.757, rel=1e-3)


def test_check_recomputes_every_record(simulated: Path, capsys: pytest.CaptureFixture) -> None:
    code, out, _ = run(capsys, "check", simulated / "test.fam", "--json")
    found = json.loads(out)
    assert code == 0
    assert found["sound"]
    assert found["checked"] == found["equal"] == found["records"] > 5000


def test_check_finds_a_record_that_was_edited(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    lines = (simulated / "test.fam").read_bytes().split(b"\n")
    lines[3000] = lines[3000].replace(b",", b";", 1)
    (tmp_path / "edited.fam").write_bytes(b"\n".join(lines))
    code, out, _ = run(capsys, "check", tmp_path / "edited.fam")
    assert code == 1
    size = len(lines[3000]) + 1
    assert f"NOT sound: the file lost 1 records; {size} bytes are damaged" in out


def test_check_finds_a_forged_record_whose_crc_is_right(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    lines = (simulated / "test.fam").read_bytes().split(b"\n")
    at, line = next((k, x) for k, x in enumerate(lines) if k > 2000 and x.startswith(b"T,"))
    fields = line.rpartition(b"*")[0].decode().split(",")
    fields[7] = str(int(fields[7]) ^ 1)  # the output
    lines[at] = frame(",".join(fields))[:-1]
    (tmp_path / "forged.fam").write_bytes(b"\n".join(lines))
    code, out, _ = run(capsys, "check", tmp_path / "forged.fam")
    assert code == 1
    assert f"1 records do not follow the law, the first is record {fields[2]}" in out


def test_convert_keeps_every_record(
    simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, _, _ = run(capsys, "convert", simulated / "test.fam", tmp_path / "t.csv")
    assert code == 0
    with (tmp_path / "t.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(read_journal(simulated / "test.fam").rows)
    assert {"time_s", "pressure_Pa", "force_N", "set_pressure_Pa"} <= rows[0].keys()
    code, _, err = run(capsys, "convert", simulated / "test.fam", tmp_path / "t.xls")
    assert code == 2
    assert "must end in .parquet, .nc or .csv" in err


def test_replay_shows_a_line_for_every_second(
    simulated: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, _ = run(capsys, "replay", simulated / "test.fam", "--speed", 0)
    lines = out.splitlines()
    assert code == 0
    assert len(lines) == pytest.approx(len(read_journal(simulated / "test.fam").rows) / 100, abs=2)
    assert "psi" in lines[len(lines) // 2]
    assert "RUN" in lines[len(lines) // 2]
    assert lines[-1].endswith("SAFE")


@pytest.mark.parametrize("circuit", ["air", "water"])
def test_run_prints_what_no_software_can_see(
    circuit: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, err = run(capsys, "run", write_plan(tmp_path, circuit=circuit))
    assert code == 2
    assert "dump valve" in out
    assert ("relief valve" in out) == (circuit == "water")
    assert "which port?" in err


@pytest.mark.parametrize("command", ["run", "simulate"])
def test_nothing_runs_without_a_pressure_limit(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, _, err = run(capsys, command, write_plan(tmp_path, limit=""), "--output", tmp_path / "o")
    assert code == 2
    assert "[rig]: pressure_limit_<unit> is missing: a number >= 0 and finite, as" in err
    assert not (tmp_path / "o").exists()


def test_ports_and_bad_input_end_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert run(capsys, "ports")[0] == 0
    for arguments, words in (
        (("check", tmp_path / "none.fam"), "cannot read"),
        (("monitor", tmp_path / "no-port", "--seconds", 1), "cannot open the port"),
        (
            ("characterise", tmp_path / "a", tmp_path / "b", "--rest-length", "9"),
            "has no unit",
        ),
    ):
        code, _, err = run(capsys, *arguments)
        assert code == 2
        assert words in err


def test_the_plan_in_the_help_is_one(tmp_path: Path) -> None:
    example = HELP.partition("```toml\n")[2].partition("```")[0]
    (tmp_path / "plan.toml").write_text(example)
    everything = example.replace("# photo", "photo").replace("# jump", "jump")
    (tmp_path / "all.toml").write_text(everything.replace("# integral", "integral"))
    short, full = (read_plan(tmp_path / name) for name in ("plan.toml", "all.toml"))
    assert full.plan.photograph_every == 1.0
    assert (full.jump_limit, full.control) == (short.jump_limit, short.control)


def wait_for_output(sim: SimulatedRig) -> None:
    """Until the valve is driven."""
    end = time.monotonic() + 60
    while not sim.device.output and time.monotonic() < end:
        time.sleep(0.05)
    assert sim.device.output


@pytest.mark.slow  # real time
def test_a_cable_pulled_during_a_run_ends_in_a_sentence_and_a_sound_journal(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    sim = SimulatedRig(PneumaticCircuit(), baud=500000)
    write_calibration(tmp_path / "calibration.toml", sim.calibration())
    plan = write_plan(tmp_path, pressures="30", settle="60", stroke="0.2")
    with RigServer(sim, "tcp") as server:

        def unplug() -> None:
            wait_for_output(sim)
            time.sleep(1.0)
            server.unplug()

        pull = threading.Thread(target=unplug)
        pull.start()
        code, _, err = run(
            capsys,
            "run",
            plan,
            "--port",
            server.address,
            "--baud",
            500000,
            "--output",
            tmp_path,
            "--yes",
        )
        pull.join()
    assert code == 1
    assert "the device is silent for 1" in err
    assert "look at the pressure before you touch the rig" in err
    assert sim.device.output == 0
    found = audit(read_journal(tmp_path / "test.fam"))
    assert found.sound
    assert found.ended is not None
    assert found.ended.startswith("RigFault: the device is silent")


@pytest.mark.slow  # real time
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals and pseudo-terminals")
def test_a_run_that_is_told_to_end_vents_and_says_so(tmp_path: Path) -> None:
    sim = SimulatedRig(PneumaticCircuit())
    write_calibration(tmp_path / "calibration.toml", sim.calibration())
    plan = write_plan(tmp_path, pressures="30", settle="600", stroke="0.2")
    with RigServer(sim, "tcp") as server:
        command = [sys.executable, "-m", "famjax", "rig", "run", str(plan), "--port"]
        with subprocess.Popen(
            [*command, server.address, "--output", str(tmp_path), "--yes"],
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            wait_for_output(sim)
            process.send_signal(signal.SIGHUP)
            _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "has been vented" in err
    assert (sim.device.output, sim.device.dump_open) == (0, True)
    record = read_journal(tmp_path / "test.fam")
    assert record.notes_of("end")[-1]["reason"].startswith("KeyboardInterrupt")
    assert record.notes_of("end")[-1]["confirmed"]


@pytest.mark.slow  # real time
def test_run_and_monitor_against_a_served_rig(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    sim = SimulatedRig(PneumaticCircuit())
    write_calibration(tmp_path / "calibration.toml", sim.calibration())
    plan = write_plan(tmp_path, pressures="30", settle="4", stroke="0.2")
    with RigServer(sim, "tcp") as server:
        code, out, _ = run(capsys, "monitor", server.address, "--seconds", 3)
        assert code == 0
        assert "SAFE" in out
        code, out, _ = run(
            capsys, "run", plan, "--port", server.address, "--output", tmp_path / "o",
            "--yes", "--meta", "operator=A. Name",
        )  # fmt: skip
        assert code == 0
        assert "block 0: pressure held, " in out
        assert "start the strokes: 1 of 5.08 mm" in out
        assert "written:" in out
    assert sim.device.output == 0
    record = read_journal(tmp_path / "o" / "test.fam")
    assert record.notes_of("end")[-1]["reason"] == "complete"
    assert len(record.rows) > 200
    assert record.notes_of("meta")[0]["entries"] == {"operator": "A. Name"}
    code, _, err = run(
        capsys, "run", plan, "--port", "none", "--output", tmp_path / "o", "--resume"
    )
    assert code == 2
    assert "is complete" in err


def calibrated(folder: Path, **changes: str) -> Path:
    write_calibration(folder / "calibration.toml", SimulatedRig(PneumaticCircuit()).calibration())
    return write_plan(folder, **changes)


def test_a_dry_run_prints_the_plan_and_its_duration(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, _ = run(capsys, "run", calibrated(tmp_path), "--dry-run", "--output", tmp_path / "o")
    assert code == 0
    assert "block 1: 551581 Pa" in out
    assert "lasts 70 s (1 min 10 s)" in out  # two of 3 s and 2 x 3.2 in at 0.2 in/s
    assert not (tmp_path / "o").exists()


def test_a_run_waits_for_a_yes(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("run", calibrated(tmp_path), "--port", tmp_path / "none", "--output", tmp_path / "o")
    monkeypatch.setattr("sys.stdin", Typed("yes\n", terminal=False))
    code, _, err = run(capsys, *words)
    assert code == 2
    assert "give --yes" in err
    monkeypatch.setattr("sys.stdin", Typed("y\n", terminal=True))
    code, _, err = run(capsys, *words)
    assert code == 2
    assert "not started" in err
    for stdin, more in (
        (Typed("yes\n", terminal=True), ()),
        (Typed("", terminal=False), ["--yes"]),
    ):
        monkeypatch.setattr("sys.stdin", stdin)
        code, _, err = run(capsys, *words, *more)
        assert code == 2
        assert "cannot open the port" in err  # it went on


class Typed(io.StringIO):
    """Standard input on which something was typed."""

    def __init__(self, text: str, *, terminal: bool) -> None:
        super().__init__(text)
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("settle_s", "photograph_every_s = 1\nsettle_s", "photograph_every_s = 1 does nothing"),
        ("pressure_limit_psi = 110", "pressure_limit_psi = inf", ">= 0 and finite, got inf"),
        ("pressure_limit_psi = 110", "pressure_limit_psi = 1e308", ">= 0 and finite, got inf"),
        ("pressure_limit_psi = 110", "pressure_limit_psi = 60", "the limit is 413685 Pa"),
    ],
)
def test_a_refused_plan_leaves_nothing_behind(
    old: str, new: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    plan = calibrated(tmp_path)
    plan.write_text(plan.read_text().replace(old, new))
    commands = ["run"] if "photo" in new else ["run", "simulate"]
    for command in commands:
        more = ["--yes", "--port", "none"] if command == "run" else []
        code, _, err = run(capsys, command, plan, "--output", tmp_path / "o", *more)
        assert code == 2
        assert words in err
        assert not (tmp_path / "o" / "test.fam").exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[40, 80]", "[40, 90]", "pressures was (275790.29"),
        ("cycles = 1", "cycles = 2", "cycles was 1, is 2"),
        ("pressure_limit_psi = 110", "pressure_limit_psi = 115", "pressure_limit_Pa was 758423"),
        ("psi = 4", "psi = 5", "control: proportional was"),
        ("", "", "calibration: "),
    ],
)
def test_only_the_same_test_is_resumed(
    old: str, new: str, words: str, simulated: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    plan = calibrated(tmp_path)
    lines = (simulated / "test.fam").read_bytes().splitlines(keepends=True)
    second = next(k for k, line in enumerate(lines) if b'"block":1' in line)
    (tmp_path / "test.fam").write_bytes(b"".join(lines[: second + 1]))
    words_of = ("run", plan, "--output", tmp_path, "--resume", "--yes", "--port", "none")
    if old:
        began = stored_calibration(read_journal(tmp_path / "test.fam"))
        write_calibration(tmp_path / "calibration.toml", began)
        assert "cannot open the port" in run(capsys, *words_of)[2]  # it would go on
        assert "lasts 35 s" in run(capsys, *words_of, "--dry-run")[1]  # one of two pressures
    plan.write_text(plan.read_text().replace(old, new))
    code, _, err = run(capsys, *words_of)
    assert code == 2
    assert "cannot be resumed with another test" in err
    assert words in err


def test_quantities_need_their_unit() -> None:
    assert parse_quantity("9.28125in", "length") == pytest.approx(0.23574375)
    assert parse_quantity("-3 ms", "time") == pytest.approx(-0.003)
    for wrong in ("9", "in", "9 furlong", "9 psi"):
        with pytest.raises(InputError):
            parse_quantity(wrong, "length")


def test_monitor_draws_what_it_was_given() -> None:
    view = Monitor(width=4, height=2, every=1)
    assert view.line() == "no record yet"
    assert view.plot() == ""
    for pressure in (0, 50, 100, 200):
        view.add(Sample(1, 1, 5, 5 * pressure, pressure, 10, 9, 0, 3 + 16 * 2))
    assert view.plot().splitlines() == ["       200 │   █", "         0 │ ▄██"]
    assert view.line().endswith("TRIP  fault: over-pressure")
