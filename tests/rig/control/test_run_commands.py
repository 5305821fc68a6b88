"""`famjax rig run` as a person types it: what it asks, refuses, says and leaves behind."""

import contextlib
import io
import os
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from rig_commands import calibrated, run, write_plan

from rig import audit, read_journal
from rig.calibration import write_calibration
from rig.journal import stored_calibration
from rig.simulation import PneumaticCircuit, RigServer, SimulatedRig


@pytest.mark.parametrize("circuit", ["air", "water"])
def test_run_prints_what_no_software_can_see(
    circuit: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, err = run(capsys, "run", write_plan(tmp_path, circuit=circuit))
    assert code == 2
    assert "dump valve" in out
    assert ("relief valve" in out) == (circuit == "water")
    assert "which port?" in err


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


@pytest.mark.slow  # real time
@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
def test_a_person_at_a_terminal_starts_pauses_and_skips(tmp_path: Path) -> None:
    """What is typed, and what it is the answer to."""
    script = [
        ("Type yes to pressurise the muscle: ", b"yes\n"), ("block 0: pressure held", b"\n"),
        ("strokes 1 of 1", b"p"), ("paused, the pressure is held", b"p"), ("goes on", b"s"),
        ("leaves this block for good", b"s"), ("block 1: pressure held", b"\n"),
    ]  # fmt: skip
    sim = SimulatedRig(PneumaticCircuit())
    write_calibration(tmp_path / "calibration.toml", sim.calibration())
    plan = write_plan(tmp_path, pressures="20, 30", settle="2", stroke="0.2")
    with RigServer(sim, "tcp") as server:
        ours, theirs = os.openpty()
        command = [
            sys.executable,
            "-m",
            "famjax",
            "rig",
            "run",
            str(plan),
            "--port",
            server.address,
        ]
        surroundings = os.environ | {"TERM": "xterm", "COLUMNS": "100", "LINES": "30"}
        with subprocess.Popen(
            [*command, "--output", str(tmp_path)], stdin=theirs, stdout=theirs, stderr=theirs,
            env=surroundings, start_new_session=True,
        ) as process:  # fmt: skip
            os.close(theirs)
            shown, end = "", time.monotonic() + 150
            while process.poll() is None and time.monotonic() < end:
                if select.select([ours], [], [], 0.1)[0]:
                    with contextlib.suppress(OSError):  # the other side has been closed
                        shown += os.read(ours, 4096).decode(errors="ignore")
                if script and script[0][0] in shown:
                    shown = shown.partition(script[0][0])[2]
                    os.write(ours, script.pop(0)[1])
            process.kill()
        os.close(ours)
    assert not script
    assert process.returncode == 0
    assert "pressure 3" in shown
    assert "of 30 psi" in shown
    record = read_journal(tmp_path / "test.fam")
    kinds = [note["note"] for note in record.notes]
    assert kinds.index("paused") < kinds.index("went_on") < kinds.index("skipped")
    assert [note["block"] for note in record.notes_of("done")] == [1]


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
        (
            "settle_s",
            "photograph_every_s = 1\nsettle_s",
            "photograph_every_s = 1 needs a camera: --camera",
        ),
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
