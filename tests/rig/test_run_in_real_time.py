"""`famjax rig run` on a served rig: words, signals, a pulled cable. Slow: it runs in real time."""

import contextlib
import os
import re
import select
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from benches import run, write_plan
from server import RigServer

from rig import audit, read_journal
from rig.calibration import write_calibration
from rig.protocol import RUN
from rig.simulation import SimulatedRig

pytestmark = pytest.mark.slow
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs signals and pseudo-terminals")
COMMAND = [sys.executable, "-m", "famjax", "rig", "run"]


def bench(folder: Path, **plan: str) -> tuple[SimulatedRig, Path]:
    sim = SimulatedRig()
    write_calibration(folder / "calibration.toml", sim.calibration())
    return sim, write_plan(folder, **{"pressures": "30", "stroke": "0.2", "rate": "0.2"} | plan)


def wait_for_run(sim: SimulatedRig) -> None:
    """Until the controller runs; the check of the channels before it drives the valve, too."""
    end = time.monotonic() + 60
    while sim.device.state != RUN and time.monotonic() < end:
        time.sleep(0.05)
    assert sim.device.state == RUN


# pyserial leaves a socket open whose peer has reset it.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_cable_pulled_during_a_run_ends_in_a_sentence_and_a_sound_journal(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    sim, plan = bench(tmp_path, settle="60")
    with RigServer(sim) as server:

        def unplug() -> None:
            wait_for_run(sim)
            time.sleep(1.0)
            server.unplug()

        pull = threading.Thread(target=unplug)
        pull.start()
        words = ("run", plan, "--port", server.address, "--output", tmp_path, "--yes")
        code, _, err = run(capsys, *words)
        pull.join()
    assert code == 1
    assert "look at the pressure before you touch the rig" in err
    assert sim.device.output == 0
    record = read_journal(tmp_path / "test.fam")
    assert audit(record).sound
    # Whether the silence or a command without an answer is noticed first is a matter of load.
    (end,) = record.notes_of("end")
    fault, confirmed = end["reason"], end["confirmed"]
    assert re.match(r"RigFault: (the device is silent for|.*the device did not answer for)", fault)
    assert (fault.removeprefix("RigFault: ") in err, confirmed) == (True, False)


@posix
def test_a_run_that_is_told_to_end_vents_and_says_so(tmp_path: Path) -> None:
    sim, plan = bench(tmp_path, settle="600")
    with RigServer(sim) as server:
        words = [str(plan), "--port", server.address, "--output", str(tmp_path), "--yes"]
        with subprocess.Popen(
            [*COMMAND, *words], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        ) as process:
            wait_for_run(sim)
            process.send_signal(signal.SIGHUP)
            _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "has been vented" in err
    assert (sim.device.output, sim.device.dump_open) == (0, True)
    (end,) = read_journal(tmp_path / "test.fam").notes_of("end")
    assert end["reason"].startswith("KeyboardInterrupt")
    assert end["confirmed"]


def test_run_and_monitor_against_a_served_rig(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    sim, plan = bench(tmp_path, settle="4")
    with RigServer(sim) as server:
        code, out, _ = run(capsys, "monitor", server.address, "--seconds", 3)
        assert (code, "SAFE" in out) == (0, True)
        words = ("run", plan, "--output", tmp_path / "o", "--yes")
        code, out, _ = run(capsys, *words, "--port", server.address)
        assert code == 0
        assert "block 0: pressure held, " in out
        assert "1 strokes of 5.08 mm" in out
        assert "start the strokes" in out
        assert "RMS error" in out
    assert sim.device.output == 0
    record = read_journal(tmp_path / "o" / "test.fam")
    assert record.notes_of("end")[-1]["reason"] == "complete"
    code, _, err = run(capsys, *words, "--port", "none", "--resume")
    assert (code, "is complete" in err) == (2, True)


@posix
@pytest.mark.parametrize("last", ["begin", "stop"])
def test_a_person_at_a_terminal_begins_and_stops(last: str, tmp_path: Path) -> None:
    """What is typed, and what it is the answer to."""
    script = [
        ("Type yes to pressurise the muscle: ", "yes"), ("block 0: pressure held", ""),
        ("strokes 1 of 1", ""), ("block 1: pressure held", last),
    ]  # fmt: skip
    sim, plan = bench(tmp_path, pressures="20, 30", settle="2", stroke="2")
    with RigServer(sim) as server:
        ours, theirs = os.openpty()
        words = [str(plan), "--port", server.address, "--output", str(tmp_path)]
        with subprocess.Popen(
            [*COMMAND, *words], stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True
        ) as process:
            os.close(theirs)
            shown, end = "", time.monotonic() + 200
            while process.poll() is None and time.monotonic() < end:
                if select.select([ours], [], [], 0.1)[0]:
                    with contextlib.suppress(OSError):  # the other side has been closed
                        shown += os.read(ours, 4096).decode(errors="ignore")
                if script and script[0][0] in shown:
                    shown = shown.partition(script[0][0])[2]
                    os.write(ours, f"{script.pop(0)[1]}\n".encode())
            process.kill()
        os.close(ours)
    assert not script
    assert process.returncode == (0 if last == "begin" else 130)
    record = read_journal(tmp_path / "test.fam")
    assert [note["block"] for note in record.notes_of("done")] == (
        [0, 1] if last == "begin" else [0]
    )
