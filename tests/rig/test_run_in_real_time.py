"""`famjax rig run` over a port in real time: Enter, words, signals, a pulled cable. Slow."""

import os
import re
import signal
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from benches import Port, calibrated, until

from rig import audit, read_journal
from rig.protocol import RUN

pytestmark = pytest.mark.slow


@pytest.fixture
def port(monkeypatch):
    port = Port()
    monkeypatch.setattr("rig.link.serial_opener", lambda *_: port.open)
    return port


@pytest.mark.parametrize(
    ("how", "code", "words", "reason"),
    [  # whether the silence or a command without an answer is noticed first is a matter of load
        ("cable", 1, "check the pressure before you touch the rig",
         "RigFault: (the device has been silent for|.*the device did not answer for)"),
        pytest.param(
            "signal", 130, "has been vented", "KeyboardInterrupt",
            marks=pytest.mark.skipif(sys.platform == "win32", reason="needs SIGHUP"),
        ),
    ],
)  # fmt: skip
def test_a_run_that_is_cut_short_is_vented(how, code, words, reason, port, tmp_path, command):
    plan = calibrated(tmp_path, pressures="30", settle="60")

    def end():
        until(lambda: port.sim.device.state == RUN, 60)  # the check of the channels drives it, too
        time.sleep(1.0)
        if how == "cable":
            port.cable_out = True
        else:
            os.kill(os.getpid(), signal.SIGHUP)

    thread = threading.Thread(target=end)
    thread.start()
    ended, _, err = command("run", plan, "--port", "p", "--output", tmp_path, "--yes")
    thread.join()
    assert (ended, words in err) == (code, True)
    port.sim.advance(1.05 if port.cable_out else 0.0)
    assert (port.sim.device.output, port.sim.device.dump_open) == (0, True)
    record = read_journal(tmp_path / "test.fam")
    assert audit(record).sound
    (note,) = record.notes_of("end")
    assert re.match(reason, note["reason"])
    assert note["confirmed"] == (how == "signal")


@pytest.mark.parametrize("last", ["", "stop"])
def test_a_person_at_a_terminal_begins_and_stops(last, port, tmp_path, command, monkeypatch):
    plan = calibrated(tmp_path, pressures="20, 30", settle="2", stroke="0.2", rate="0.2")
    journal, (typed, keys) = tmp_path / "test.fam", os.pipe()
    monkeypatch.setattr("rig.cli._at_terminal", lambda: True)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True, fileno=lambda: typed))

    def noted(text):
        os.write(keys, b"\n")  # it counts where the run waits for the first stroke
        time.sleep(0.3)
        return journal.exists() and text in journal.read_text()

    def work():
        until(lambda: noted('"block":1'), 60)
        os.write(keys, f"{last}\n".encode())
        until(lambda: noted('"end"'), 60)
        os.close(keys)

    thread = threading.Thread(target=work)
    thread.start()
    code, out, _ = command("run", plan, "--port", port, "--output", tmp_path, "--yes")
    thread.join()
    assert code == (130 if last else 0)
    assert "Type begin (or Enter alone), pause, skip, repeat or stop" in out
    done = read_journal(journal).notes_of("done")
    assert [note["block"] for note in done] == ([0] if last else [0, 1])
