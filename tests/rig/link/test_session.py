"""The session: each record once, none wrong, and nothing lost that could be had."""

import numpy as np
import pytest
from bare_rig import BareRig, Recorder

from rig.errors import RigError
from rig.link import ALIVE, HEARTBEAT, Lost, Reset, Session, Silent, Timing
from rig.protocol import TICKS, Sample, frame


def record_line(seq: int, tick: int, **fields: int) -> bytes:
    sample = Sample(0, seq, tick, 1000, 200, 2500, 0, 0, 0)._replace(**fields)
    return frame("T," + ",".join(map(str, sample)))


def begun(n: int = 3, **kwargs: int) -> Session:
    """A session that has seen records 0 to n - 1."""
    session = Session(**kwargs)
    session.feed(b"".join(record_line(k, 5 * k + 5) for k in range(n)), 0.0)
    return session


def seqs(events: list) -> list[int]:
    return [event.seq for event in events if isinstance(event, Sample)]


def test_every_record_of_a_clean_line_comes_once_and_in_order() -> None:
    recorder = Recorder(BareRig())
    recorder.run(20.0)
    numbers = [sample.seq for sample in recorder.samples]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert len(numbers) > 1990
    assert recorder.wrong() == 0
    assert recorder.link.session.bad_lines == recorder.link.session.recovered == 0


@pytest.mark.parametrize(
    ("seed", "chances"),
    [
        (1, {"damage": 0.01}),
        (2, {"damage": 0.01}),
        (3, {"drop": 0.008}),
        (4, {"duplicate": 0.008}),
        (5, {"damage": 0.004, "drop": 0.003, "duplicate": 0.003}),
    ],
)
def test_a_damaged_line_loses_nothing_and_lets_nothing_wrong_through(
    seed: int, chances: dict[str, float]
) -> None:
    recorder = Recorder(BareRig(seed, **chances))
    recorder.run(40.0)
    order = recorder.link.session
    numbers = sorted(sample.seq for sample in recorder.samples)
    assert recorder.wrong() == 0
    assert not [alarm for alarm in recorder.link.alarms if isinstance(alarm, Lost)]
    assert len(set(numbers)) == len(numbers)
    assert numbers[-1] - numbers[0] + 1 == len(numbers) + len(order.gaps)
    assert order.recovered > 500  # the line was damaged indeed


def test_what_cannot_be_had_is_told() -> None:
    """Three damaged bytes in a hundred are more than 115200 baud can make good."""
    recorder = Recorder(BareRig(7, damage=0.03))
    recorder.run(25.0)
    order = recorder.link.session
    lost = [alarm for alarm in recorder.link.alarms if isinstance(alarm, Lost)]
    numbers = {sample.seq for sample in recorder.samples}
    told = {seq for event in lost for seq in range(event.first, event.first + event.records)}
    made = set(range(min(numbers), order.newest.seq + 1))
    assert recorder.wrong() == 0
    assert len(told) > 100
    assert not told & numbers
    assert made - numbers - told == {seq for seq in made if seq in order.gaps}


@pytest.mark.parametrize(
    "forged",
    [
        record_line(3, 20, pressure_sum=100, pressure_count=20),  # a digit is gone
        record_line(3, 20, force_sum=25000),
        record_line(3, 20, output=200),
        record_line(3, 20, integral=900000),
        record_line(3, 21),  # off the grid
        record_line(40, 20),
        record_line(4_000_000, 20),
        record_line(3, 20, boot=7),
    ],
)
def test_a_line_whose_crc_fits_by_chance_is_not_believed(forged: bytes) -> None:
    session = begun()
    session.feed(b"T,damaged*0000\n", 0.0)
    session.take_lines()
    assert seqs(session.feed(forged, 0.02)) == []
    later = b"".join(record_line(k, 5 * k + 5) for k in (4, 5, 6))
    assert seqs(session.feed(later, 0.06)) == [4, 5, 6]
    assert seqs(session.feed(record_line(3, 20), 0.08)) == [3]
    assert forged[:-1] not in session.take_lines().split(b"\n")


def test_a_jump_is_believed_when_the_next_record_bears_it_out() -> None:
    session = begun()
    session.feed(b"T,damaged*0000\n", 0.0)
    assert seqs(session.feed(record_line(3, 20, pressure_sum=2000, pressure_count=400), 0.1)) == []
    after = record_line(4, 25, pressure_sum=2010, pressure_count=402)
    assert seqs(session.feed(after, 0.11)) == [3, 4]
    assert session.newest is not None
    assert session.newest.seq == 4


def test_a_jump_is_believed_when_it_comes_twice() -> None:
    session = begun()
    session.feed(b"T,damaged*0000\n", 0.0)
    odd = record_line(3, 20, pressure_sum=2000, pressure_count=400)
    assert seqs(session.feed(odd, 0.1)) == []
    assert b"0 rp 3 1*" in session.poll(0.1)
    assert seqs(session.feed(odd, 0.12)) == [3]


def test_requests_are_masks_and_ask_for_what_is_not_on_its_way() -> None:
    session = begun()
    session.feed(b"".join(record_line(k, 5 * k + 5) for k in (4, 6, 7, 10)), 0.1)
    assert session.poll(0.1) == frame("0 rp 3 65")  # 3, 5, 8, 9
    assert session.poll(0.104) == b""
    assert session.poll(0.1125) == frame("0 rp 8 3")  # 3 and 5 are on their way
    session.feed(b"".join(record_line(k, 5 * k + 5) for k in (3, 5, 8, 9)), 0.12)
    assert session.poll(1.0) == b""


def test_a_gap_longer_than_the_ring_is_lost_at_once_and_the_rest_is_asked_for() -> None:
    session = begun()
    events = session.feed(record_line(303, 1520), 3.0)
    assert events[0] == Lost(0, 3, 300 - 63)
    assert len(session.gaps) == 63
    assert session.poll(3.0) == frame(f"0 rp 240 {2**63 - 1:x}")


def test_records_of_another_rate_are_believed() -> None:
    recorder = Recorder(BareRig(9, damage=0.005))
    recorder.run(1.0)
    recorder.link.command("tele", 10)
    recorder.run(5.0)
    recorder.link.command("tele", 5)
    recorder.run(2.0)
    numbers = sorted(sample.seq for sample in recorder.samples)
    assert recorder.wrong() == 0
    assert len(numbers) + len(recorder.link.session.gaps) == numbers[-1] - numbers[0] + 1


def test_a_reset_is_told_and_what_waited_is_not_done_afterwards() -> None:
    recorder = Recorder(BareRig())
    recorder.run(1.0)
    recorder.rig.to_device.cut = True  # the command never arrives
    waiting = recorder.link.session.command("trip", 800)
    recorder.link.sleep(0.1)
    recorder.rig.reset(cause=2)
    recorder.rig.to_device.cut = False
    recorder.run(1.0)
    resets = [alarm for alarm in recorder.link.alarms if isinstance(alarm, Reset)]
    assert resets == [Reset(0, 1, 2)]
    assert waiting.failure == "the device was reset"
    assert [s.seq for s in recorder.samples if s.boot == 1][:3] == [0, 1, 2]


def test_a_command_is_sent_until_it_is_answered() -> None:
    recorder = Recorder(BareRig(11, damage=0.05))
    governed = [recorder.link.command("trip", 500 + n).seq for n in range(40)]
    assert governed == sorted(governed)
    assert recorder.link.session.bad_lines > 100
    while not recorder.link.session.settings_known:
        recorder.link.sleep(0.01)
    assert recorder.link.session.settings.trip == 539


def test_a_command_whose_answer_was_lost_is_obeyed_once() -> None:
    recorder = Recorder(BareRig())
    recorder.run(1.0)
    recorder.rig.to_host.cut = True
    command = recorder.link.session.command("sync", 7)
    recorder.link.sleep(0.3)  # sent five times
    assert not command.done
    recorder.rig.to_host.cut = False
    recorder.run(1.0)
    assert command.answer.seq is not None
    assert sum(sample.sync for sample in recorder.samples) == 7


def test_what_the_device_refuses_is_said_and_nonsense_is_not_sent() -> None:
    recorder = Recorder(BareRig())
    with pytest.raises(RigError, match=r"the device refuses 'run': no trip limit"):
        recorder.link.command("run")
    with pytest.raises(RigError, match=r"finite"):
        recorder.link.command("set", float("nan"))


def test_settings_that_were_damaged_are_asked_for_again() -> None:
    recorder = Recorder(BareRig(2, damage=0.02))
    for k in range(30):
        answer = recorder.link.command("set", 10 + k, 100)
        while not recorder.link.session.settings_known:
            recorder.link.sleep(0.01)
        assert recorder.link.session.settings.since >= answer.seq
        assert recorder.link.session.settings.law.set_point_psi == 10 + k


def test_heartbeats_go_on_only_for_a_while_after_a_kick() -> None:
    session = begun()
    assert session.poll(0.0) == b""
    session.keep_alive(0.0)
    times = [t for t in np.arange(0, 2 * ALIVE, 0.004) if b"hb" in session.poll(t)]
    assert len(times) == round(ALIVE / HEARTBEAT)
    assert max(np.diff(times)) < HEARTBEAT + 0.005
    session.keep_alive(20.0)
    session.rest()
    assert session.poll(20.0) == b""


def test_silence_is_told_once() -> None:
    session = begun()
    assert [e for e in session.feed(b"", 0.9) if isinstance(e, Silent)] == []
    assert session.feed(b"", 1.1) == [Silent(1.1)]
    assert session.feed(b"", 2.0) == []
    session.feed(record_line(3, 20), 2.1)
    assert session.feed(b"", 3.2) == [Silent(pytest.approx(1.1))]


def test_the_earliest_arrival_of_each_quarter_second_is_told() -> None:
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


def test_records_stay_in_order_where_the_ticks_wrap() -> None:
    """After 99 days: the first record beyond is not doubtful, whatever comes next."""
    session = Session()
    lines = [record_line(7000 + k, (TICKS - 50 + 5 * k) % TICKS) for k in range(12)]
    assert seqs(session.feed(b"".join(lines), 0.1)) == list(range(7000, 7012))
