"""The session: each record once, none wrong, nothing lost that could be had; and the thread of a port."""

import numpy as np
import pytest
from benches import Port, Recorder, record_line, records, until

from rig.errors import RigError
from rig.journal import Journal, read_journal
from rig.link import ALIVE, HEARTBEAT, Link, Lost, Reset, Session, Silent, Timing, serial_opener
from rig.protocol import TICKS, Sample, frame


def begun(*, damaged=False):
    """A session that has seen records 0 to 2."""
    session = Session()
    session.feed(records(0, 1, 2), 0.0)
    session.take_lines()
    if damaged:
        session.feed(b"T,damaged*0000\n", 0.0)
    return session


def seqs(events):
    return [event.seq for event in events if isinstance(event, Sample)]


@pytest.mark.parametrize(
    ("seed", "chances"),
    [
        (1, {}),
        (2, {"damage": 0.01}),
        (3, {"drop": 0.008}),
        (4, {"duplicate": 0.008}),
        (5, {"damage": 0.004, "drop": 0.003, "duplicate": 0.003}),
    ],
)
def test_a_damaged_line_loses_nothing_and_lets_nothing_wrong_through(seed, chances):
    recorder = Recorder(seed, **chances)
    session = recorder.link.session
    recorder.run(20.0)
    clean = session.bad_lines == session.recovered == 0
    recorder.link.command("tele", 10)  # records of another rate are believed
    recorder.run(5.0)
    recorder.link.command("tele", 5)
    recorder.run(5.0)
    numbers = [sample.seq for sample in recorder.samples]
    assert recorder.wrong() == 0
    assert not [alarm for alarm in recorder.link.alarms if isinstance(alarm, Lost)]
    assert len(set(numbers)) == len(numbers) > 2700
    assert max(numbers) - min(numbers) + 1 == len(numbers) + len(session.gaps)
    assert clean if not chances else session.recovered > 300  # it was damaged indeed


@pytest.mark.parametrize(
    "forged",
    [
        record_line(3, pressure_sum=100, pressure_count=20),  # a digit is gone
        *(record_line(3, **{name: value}) for name, value in
          (("force_sum", 25000), ("output", 200), ("integral", 900000), ("boot", 7))),
        record_line(3, 21), record_line(40, 20), record_line(4_000_000, 20),  # off the grid
    ],
)  # fmt: skip
def test_a_line_whose_crc_fits_by_chance_is_not_believed(forged):
    session = begun(damaged=True)
    assert seqs(session.feed(forged, 0.02)) == []
    assert seqs(session.feed(records(4, 5, 6), 0.06)) == [4, 5, 6]
    assert seqs(session.feed(records(3), 0.08)) == [3]
    assert forged[:-1] not in session.take_lines().split(b"\n")


def test_a_jump_is_believed_when_the_next_record_bears_it_out_or_it_comes_twice():
    odd = record_line(3, pressure_sum=2000, pressure_count=400)
    session = begun(damaged=True)
    assert seqs(session.feed(odd, 0.1)) == []
    after = record_line(4, pressure_sum=2010, pressure_count=402)
    assert seqs(session.feed(after, 0.11)) == [3, 4]
    assert session.newest.seq == 4
    session = begun(damaged=True)
    assert seqs(session.feed(odd, 0.1)) == []
    assert b"0 rp 3 1*" in session.poll(0.1)
    assert seqs(session.feed(odd, 0.12)) == [3]


def test_a_gap_longer_than_the_ring_is_lost_at_once_and_the_rest_is_asked_for():
    session = begun()
    events = session.feed(records(303), 3.0)
    assert events[0] == Lost(0, 3, 300 - 63)
    assert len(session.gaps) == 63
    assert session.poll(3.0) == frame(f"0 rp 240 {2**63 - 1:x}")


def test_records_stay_in_order_where_the_ticks_wrap():
    """After 99 days: the first record beyond is not doubtful, whatever comes next."""
    session = Session()
    lines = [record_line(7000 + k, (TICKS - 50 + 5 * k) % TICKS) for k in range(12)]
    assert seqs(session.feed(b"".join(lines), 0.1)) == list(range(7000, 7012))


def test_the_earliest_arrival_of_each_quarter_second_is_told():
    session, rng = Session(), np.random.default_rng(5)
    made = {5 * k + 5: 0.01 * k + rng.exponential(0.004) for k in range(200)}
    arrivals = dict(zip(made, np.maximum.accumulate(list(made.values())), strict=True))
    told = []
    for k, (tick, at) in enumerate(arrivals.items()):
        told += [e for e in session.feed(record_line(k, tick), at) if isinstance(e, Timing)]
    late = {tick: at - tick / 500 for tick, at in arrivals.items()}
    for event in told:
        quarter = [tick for tick in late if tick // 125 == event.tick // 125 and tick > 5]
        assert late[event.tick] == pytest.approx(min(late[t] for t in quarter), abs=1e-12)
    assert len(told) == 8


def test_a_reset_is_told_and_what_waited_is_not_done_afterwards():
    recorder = Recorder()
    recorder.run(1.0)
    recorder.sim.to_device.cut = True  # the command never arrives
    waiting = recorder.link.session.command("trip", 800)
    recorder.link.sleep(0.1)
    recorder.sim.device.reset(2)
    recorder.sim.to_device.cut = False
    recorder.run(1.0)
    resets = [alarm for alarm in recorder.link.alarms if isinstance(alarm, Reset)]
    assert resets == [Reset(0, 1, 2)]
    assert waiting.failure == "the device was reset"
    assert [s.seq for s in recorder.samples if s.boot == 1][:3] == [0, 1, 2]


def test_commands_are_sent_and_settings_asked_for_until_they_are_answered():
    recorder = Recorder(11, damage=0.03)
    session, last = recorder.link.session, 0
    for n in range(30):
        governed = recorder.link.command("set", 10 + n, 100).seq
        assert governed >= last
        while not session.settings_known:
            recorder.link.sleep(0.01)
        assert session.settings.since >= governed
        assert session.settings.law.set_point_psi == 10 + n
        last = governed
    assert session.bad_lines > 50
    with pytest.raises(RigError, match=r"the device refused 'run': no trip limit"):
        recorder.link.command("run")
    with pytest.raises(RigError, match=r"finite"):
        recorder.link.command("set", float("nan"))


def test_a_command_whose_answer_was_lost_is_obeyed_once():
    recorder = Recorder()
    recorder.run(1.0)
    recorder.sim.to_host.cut = True
    command = recorder.link.session.command("sync", 7)
    recorder.link.sleep(0.3)  # sent five times
    assert not command.done
    recorder.sim.to_host.cut = False
    recorder.run(1.0)
    assert command.answer.seq is not None
    assert sum(sample.sync for sample in recorder.samples) == 7


def test_a_stop_does_not_wait_for_what_is_in_progress():
    session = begun()
    before = session.command("set", 40)
    assert b" set 40*" in session.poll(0.0)
    session.command("stop")
    assert before.failure is not None
    assert b" stop*" in session.poll(0.001)


def test_heartbeats_go_on_only_for_a_while_after_keep_alive():
    session = begun()
    assert session.poll(0.0) == b""
    session.keep_alive(0.0)
    times = [t for t in np.arange(0, 2 * ALIVE, 0.004) if b"hb" in session.poll(t)]
    assert len(times) == round(ALIVE / HEARTBEAT)
    assert max(np.diff(times)) < HEARTBEAT + 0.005
    session.keep_alive(20.0)
    session.rest()
    assert session.poll(20.0) == b""


def test_silence_is_told_once():
    session = begun()
    told = [session.feed(b"", at) for at in (0.9, 1.1, 2.0)]
    assert told == [[], [Silent(1.1)], []]
    session.feed(records(3), 2.1)
    assert session.feed(b"", 3.2) == [Silent(pytest.approx(1.1))]


def test_a_conversation_over_a_port_that_goes_away_and_is_opened_again(path):
    port = Port()
    with Link(port.open) as link, Journal(path, lambda: link.now) as journal:
        link.attach(journal)
        link.command("hello")
        assert link.command("trip", 600).seq is not None
        with pytest.raises(RigError, match=r"refused 'man 300': number"):
            link.command("man", 300)
        until(lambda: link.newest is not None and link.newest.seq > 100)
        link.attach(None)
        port.cable_out = True
        until(lambda: link.port is None)
        port.cable_out = False
        until(lambda: link.port is not None)
        assert link.command("status").seq is not None
    assert port.closed == 2
    found = read_journal(path)
    assert found.missing == ()
    assert len(found.rows) > 50


def test_a_serial_port_is_opened_for_this_program_alone(monkeypatch):
    serial = pytest.importorskip("serial")
    with pytest.raises(RigError, match=r"cannot open the port.*no other program is using"):
        Link(serial_opener("/dev/no-such-port"))
    opened: list[tuple[str, int, bool | None]] = []
    monkeypatch.setattr(
        serial, "serial_for_url",
        lambda path, baud, **options: opened.append((path, baud, options.get("exclusive"))),
    )  # fmt: skip
    for path in ("/dev/ttyACM0", "socket://127.0.0.1:1"):  # which pyserial cannot lock
        serial_opener(path, 500_000)()
    assert opened == [("/dev/ttyACM0", 500_000, True), ("socket://127.0.0.1:1", 500_000, None)]
