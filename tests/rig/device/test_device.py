"""What the device does, in Python and in C: states, guards, commands, records."""

import random
from collections.abc import Iterator

import pytest
from bench import Bench
from native import NativeDevice

from rig.device import Device
from rig.protocol import (
    MANUAL,
    RUN,
    SAFE,
    TRIP,
    Ack,
    DeviceSettings,
    DeviceStatus,
    Hello,
    Sample,
    StoredRange,
    drive,
    frame,
    next_integral,
    pressure_error,
)

SILENCE_TICKS = 500


@pytest.fixture(params=["python", "c"])
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    if request.param == "c":
        bench = Bench(NativeDevice(request.getfixturevalue("native_library")))
    else:
        bench = Bench(Device())
    yield bench
    assert bench.torn == []


# ---- states ----


def test_starts_safe_and_says_who_it_is(bench: Bench) -> None:
    bench.ticks(30)
    assert (bench.device.output, bench.device.dump_open, bench.device.state) == (0, True, SAFE)
    assert bench.of(Hello) == [Hello(3, 3, 0, 1, 500, 5, 64, 21, 900, 0)]
    assert bench.of(DeviceStatus)[0].fault == 0
    assert bench.of(DeviceSettings)[0].trip == 0


@pytest.mark.parametrize("verb", [("run",), ("man", 50)])
def test_nothing_runs_without_a_pressure_limit(verb: tuple[str, int], bench: Bench) -> None:
    assert bench.command(*verb).reason == "no trip limit"
    assert bench.device.state == SAFE
    bench.command("trip", 600)
    assert not bench.command(*verb).reason
    assert not bench.device.dump_open


def test_stop_acts_in_the_tick_that_reads_it(bench: Bench) -> None:
    bench.start()
    bench.ticks(1)
    assert bench.device.output > 0
    bench.device.feed(frame("99 stop"))
    bench.ticks(1)
    assert (bench.device.output, bench.device.dump_open, bench.device.state) == (0, True, SAFE)


def test_manual_output_is_what_was_asked_for(bench: Bench) -> None:
    bench.command("trip", 600)
    bench.command("man", 77)
    assert (bench.device.state, bench.device.output) == (MANUAL, 77)
    bench.command("man", 0)
    assert (bench.device.state, bench.device.output, bench.device.dump_open) == (MANUAL, 0, False)


def test_run_again_changes_nothing(bench: Bench) -> None:
    bench.start()
    bench.ticks(50)
    before = bench.samples[-1].integral
    assert before > 0
    bench.command("run")
    assert bench.device.state == RUN
    assert bench.samples[-1].integral >= before


def test_a_start_that_is_stopped_before_its_record_does_not_happen(bench: Bench) -> None:
    bench.command("trip", 600)
    while bench.samples[-1].tick % 5 or bench.device.take():
        bench.ticks(1)
    bench.device.feed(b"run\nstop\n")
    bench.ticks(10)
    assert all(sample.state == SAFE for sample in bench.samples)


# ---- guards ----


def _conversions(bench: Bench, pressures: list[int]) -> int:
    for pressure in pressures:
        bench.ticks(1, pressure)
    return bench.device.state


def test_three_conversions_over_the_limit_trip_and_two_do_not(bench: Bench) -> None:
    bench.start()
    assert _conversions(bench, [600, 600, 599, 1023, 1023, 100]) == RUN
    assert _conversions(bench, [600, 600]) == RUN
    assert _conversions(bench, [600]) == TRIP
    assert (bench.device.output, bench.device.dump_open) == (0, True)
    bench.ticks(20)
    assert bench.of(DeviceStatus)[-1].fault == 2


@pytest.mark.parametrize("guarded", [("run",), ("man", 90)])
def test_a_jump_trips_and_a_single_bad_conversion_does_not(
    guarded: tuple[str, int], bench: Bench
) -> None:
    bench.start()
    bench.command("jump", 77)
    bench.command(*guarded)
    assert _conversions(bench, [0, *[100] * 8]) != TRIP
    assert _conversions(bench, [0, 0, 0]) == TRIP
    bench.ticks(20)
    assert bench.of(DeviceStatus)[-1].fault == 3


@pytest.mark.parametrize(("limit", "state"), [(75, RUN), (74, TRIP)])
def test_only_changes_beyond_the_limit_are_jumps(limit: int, state: int, bench: Bench) -> None:
    bench.start()
    bench.command("jump", limit)
    for pressure in range(115, 590, 15):  # 75 counts in five ticks
        bench.beat(1, pressure)
    assert bench.device.state == state


def test_full_output_without_rise_trips_after_the_stall_time(bench: Bench) -> None:
    bench.start(gains=(20, 0))  # 20 counts per psi, 20 psi low: full output
    bench.command("stall", 1000)
    assert bench.device.output == 255
    bench.beat(450)
    assert bench.device.state == RUN
    bench.beat(50)
    assert bench.device.state == TRIP
    bench.ticks(20)
    assert bench.of(DeviceStatus)[-1].fault == 4


@pytest.mark.parametrize("set_psi", [20.0, 24.5, 90.0])
def test_stall_needs_no_error_of_a_certain_size(set_psi: float, bench: Bench) -> None:
    """At 100 counts, 19.53 psi: a sensor stuck a little below the set pressure is a stall too."""
    bench.start(gains=(0, 127), set_psi=set_psi)
    bench.command("stall", 1000)
    bench.beat(3000)
    assert (bench.device.state, bench.of(DeviceStatus)[-1].fault) == (TRIP, 4)


def test_an_integral_at_its_limit_is_a_stall_below_full_output(bench: Bench) -> None:
    bench.start(gains=(0, 20))
    bench.command("ilim", -50, 50)
    bench.command("stall", 1000)
    bench.beat(400)
    assert (bench.device.state, bench.device.output) == (RUN, 178)
    bench.beat(400)
    assert (bench.device.state, bench.of(DeviceStatus)[-1].fault) == (TRIP, 4)


@pytest.mark.parametrize("milliseconds", [100, 1000, 3000])
def test_silence_ends_a_run_after_the_time_set(milliseconds: int, bench: Bench) -> None:
    bench.start()
    bench.command("hbms", milliseconds)
    bench.device.feed(frame("0 hb"))
    bench.ticks(1)
    bench.ticks(milliseconds // 2 - 1)
    assert bench.device.state == RUN
    bench.ticks(1)
    assert (bench.device.state, bench.device.output, bench.device.dump_open) == (SAFE, 0, True)
    bench.ticks(20)
    assert bench.of(DeviceStatus)[-1].fault == 1


@pytest.mark.parametrize(
    ("line", "alive"),
    [
        (frame("0 hb"), True),
        (frame("0 rp 0 1"), True),
        (frame("77 status"), True),
        (frame("77 nonsense"), True),  # its CRC is right: a host is there
        (frame("0 hb")[:-2] + b"X\n", False),
        (b"0 hb\n", True),  # a person types
        (b"7f#@!\n", False),
        (b"\n\n\r\n", False),
        (b"x" * 100 + b"\n", False),
        (b"\xff\xfe hb\n", False),
    ],
)
def test_what_counts_as_a_sign_of_life(line: bytes, alive: bool, bench: Bench) -> None:
    bench.start()
    bench.ticks(1)
    bench.device.feed(frame("0 hb"))
    bench.ticks(SILENCE_TICKS - 50)
    bench.device.feed(line)
    bench.ticks(60)
    assert bench.device.state == (RUN if alive else SAFE)


def test_strict_takes_nothing_without_its_crc(bench: Bench) -> None:
    bench.start()
    bench.command("strict", 1)
    bench.send(b"0 hb\n")
    bench.send(b"stop\n")
    bench.ticks(20)
    assert bench.device.state == RUN
    bench.command("status")
    assert bench.of(DeviceStatus)[-1].bad == 2


def test_a_start_on_its_way_does_not_outlive_a_trip(bench: Bench) -> None:
    """`man` waits for the next record; a guard that acts before cancels it."""
    bench.start()
    bench.command("tele", 50)
    bench.beat(100)
    bench.device.feed(frame("900 man 200"))
    bench.ticks(1)
    assert _conversions(bench, [700] * 3) == TRIP
    bench.ticks(100)
    assert (bench.device.state, bench.device.output) == (TRIP, 0)


def test_clear_is_refused_under_pressure_and_while_running(bench: Bench) -> None:
    bench.start()
    assert bench.command("clear").reason == "running: stop first"
    bench.ticks(3, pressure=700)
    bench.pressure = 700
    assert bench.command("clear").reason == "pressure above trip"
    assert bench.command("run").reason == "tripped: clear first"
    bench.pressure = 599
    assert not bench.command("clear").reason
    assert bench.device.state == SAFE
    assert not bench.command("run").reason


# ---- commands ----


@pytest.mark.parametrize(
    ("verb", "values"),
    [
        ("set", (-1,)),
        ("set", (1024,)),
        ("cal", (1024, 200)),
        ("set", (40, 255.01)),
        ("set", ()),
        ("set", (1, 2, 3)),
        ("set", ("4O",)),
        ("set", ("1e2",)),
        ("set", ("0x10",)),
        ("set", (".5",)),
        ("set", ("1.00001",)),
        ("set", ("1234567",)),
        ("gain", (128, 0)),
        ("gain", (1,)),
        ("ilim", (1, 2)),
        ("ilim", (-256, 0)),
        ("man", (256,)),
        ("man", ("1.5",)),
        ("trip", (0,)),
        ("trip", (1024,)),
        ("floor", (1023,)),
        ("ceiling", (0,)),
        ("still", (499,)),
        ("frozen", (4,)),
        ("frozen", (256, 750)),
        ("tele", (51,)),
        ("hbms", (99,)),
        ("hbms", (10001,)),
        ("stall", (499,)),
        ("strict", (2,)),
        ("run", (1,)),
        ("board", (0,)),
        ("board", (65535,)),
    ],
)
def test_numbers_out_of_range_are_refused_and_nothing_changes(
    verb: str, values: tuple[float | str, ...], bench: Bench
) -> None:
    bench.ticks(20)
    before = bench.of(DeviceSettings)[-1]
    assert bench.command(verb, *values).reason == "number missing or out of range"
    bench.command("status")
    assert bench.of(DeviceSettings)[-1] == before


def test_rates_that_the_line_cannot_carry_are_refused(bench: Bench) -> None:
    assert bench.command("tele", 3).reason == "too fast for this baud"
    assert not bench.command("tele", 4).reason
    assert not Bench(Device(bytes_per_tick=91)).command("tele", 1).reason


def test_a_repeated_command_is_answered_again_and_not_obeyed_again(bench: Bench) -> None:
    bench.start()
    line = frame("500 man 20")
    for _ in range(2):
        bench.send(line)
        bench.ticks(20)
    answers = [a for a in bench.of(Ack) if a.id == 500]
    assert len(answers) == 2
    assert answers[0] == answers[1]
    bench.command("stop")
    bench.send(frame("500 man 21"))  # the id again, but another command
    bench.ticks(20)
    assert bench.device.output == 21


def test_hello_is_always_obeyed(bench: Bench) -> None:
    bench.ticks(10)
    for _ in range(2):
        bench.send(frame("1 hello"))
        bench.ticks(40)
    assert len(bench.of(Hello)) == 3


def test_a_person_may_type(bench: Bench) -> None:
    for text in (b"trip 600\r\n", b"set 40.5\n", b"  gain   4  2 \r"):
        bench.send(text)
        bench.ticks(10)
    settings = bench.of(DeviceSettings)[-1]
    assert (settings.trip, settings.law.set_point_psi, settings.law.gains) == (600, 40.5, (4, 2))


def test_more_bytes_than_there_is_room_for_are_counted(bench: Bench) -> None:
    bench.device.feed(b"0 hb\n" * 40)
    bench.ticks(100)
    bench.send(b"\n")
    bench.command("status")
    assert bench.of(DeviceStatus)[-1].overrun == 200 - 127


# ---- records ----


def test_records_are_sums_over_their_ticks_and_say_when_they_ended(bench: Bench) -> None:
    r = random.Random(1)
    counts = []
    for _ in range(200):
        counts.append((r.randint(0, 1023), r.randint(0, 1023)))
        bench.force = counts[-1][1]
        bench.ticks(1, counts[-1][0])
    assert len(bench.samples) >= 38
    for sample in bench.samples:
        window = counts[sample.tick - 5 : sample.tick]
        assert sample.pressure_sum == sum(p for p, _ in window)
        assert sample.force_sum == sum(f for _, f in window)
        assert sample.pressure_count == window[-1][0]
        assert sample.tick == 5 * (sample.seq + 1)


def _recomputed(bench: Bench) -> int:
    """Check u and I of every record of a run from the record alone; how many there were."""
    checked, before = 0, None
    for message in bench.said:
        if not isinstance(message, Sample):
            continue
        if message.state == RUN:
            settings = [s for s in bench.of(DeviceSettings) if s.since <= message.seq][-1]
            law = settings.law
            error = pressure_error(law, message.pressure_sum, settings.ticks_per_record)
            start = before.integral if before is not None and before.state == RUN else 0
            assert message.integral == next_integral(law, start, error)
            count_error = pressure_error(law, message.pressure_count)
            assert message.output == drive(law, message.integral, count_error)
            checked += 1
        elif message.state in (SAFE, TRIP):
            assert (message.output, message.integral) == (0, 0)
        before = message
    return checked


@pytest.mark.parametrize("seed", range(3))
def test_every_record_of_a_run_can_be_recomputed(seed: int, bench: Bench) -> None:
    """Commands at any moment: each record is governed by one law from its first tick on."""
    r = random.Random(seed)
    bench.start()
    for _ in range(120):
        commands: tuple[tuple[str, tuple[float, ...]], ...] = (
            ("set", (round(r.uniform(5, 60), 3), round(r.uniform(0, 255), 2))),
            ("gain", (round(r.uniform(0, 9), 3), round(r.uniform(0, 9), 3))),
            ("ilim", (r.randint(-200, 0), r.randint(0, 200))),
            ("tele", (r.choice((4, 5, 7, 20)),)),
            ("stop", ()),
            ("run", ()),
            ("run", ()),
        )
        verb, values = r.choice(commands)
        assert not bench.command(verb, *values).reason
        for _ in range(r.randint(0, 60)):
            bench.ticks(1, r.randint(40, 300))
    bench.ticks(100)
    assert _recomputed(bench) > 300
    seqs = [sample.seq for sample in bench.samples]
    assert seqs == list(range(len(seqs)))  # and not one was dropped


def test_answers_say_from_which_record_on_they_hold(bench: Bench) -> None:
    bench.start()
    for wait in range(7):
        bench.ticks(wait)
        since = bench.command("set", 20 + wait).seq
        bench.ticks(30)
        assert bench.of(DeviceSettings)[-1].since == since
        assert bench.of(DeviceSettings)[-1].law.set_point_psi == 20 + wait


def test_records_are_repeated_on_request(bench: Bench) -> None:
    bench.ticks(500)
    before = bench.samples
    newest = before[-1].seq
    base = newest - 50
    bench.said.clear()
    bench.send(frame(f"0 rp {base} {0b1011:x}"))
    bench.ticks(50)
    wanted = [s for s in bench.samples if s.seq in (base, base + 1, base + 2, base + 3)]
    assert wanted == [s for s in before if s.seq in (base, base + 1, base + 3)]
    assert not bench.of(StoredRange)


def test_what_is_too_old_is_told_once_and_the_rest_repeated(bench: Bench) -> None:
    bench.ticks(1000)
    bench.said.clear()
    next_ = 200  # records so far
    oldest = next_ - 64
    bench.send(frame(f"0 rp {oldest - 8} ffffffffffffffff"))
    bench.ticks(400)
    (limits,) = bench.of(StoredRange)
    assert limits.oldest <= oldest + 2  # the ring went on while the line arrived
    assert limits.next - limits.oldest == 64
    repeated = [s.seq for s in bench.samples if s.seq < next_]
    assert repeated[0] >= limits.oldest
    assert repeated[-1] == oldest - 8 + 63
    assert len(repeated) > 40


@pytest.mark.parametrize(
    "request_",
    ["0 rp", "0 rp 5", "0 rp x 1", "0 rp 5 g", "0 rp 4294967296 1", "0 rp 5 1 1", "0 rp 1000 ffff"],
)
def test_requests_that_make_no_sense_are_not_answered(request_: str, bench: Bench) -> None:
    bench.ticks(200)
    bench.said.clear()
    bench.send(frame(request_))
    bench.ticks(30)
    assert [s.seq for s in bench.samples] == sorted({s.seq for s in bench.samples})
    assert not bench.of(StoredRange)


def test_sync_pin_is_high_for_whole_records_and_they_say_so(bench: Bench) -> None:
    bench.ticks(11)
    since = bench.command("sync", 3).seq
    assert since is not None
    bench.ticks(60)
    assert [s.seq for s in bench.samples if s.sync] == [since, since + 1, since + 2]


def test_boot_counter_moves_and_stands_in_every_record() -> None:
    eeprom = bytearray(b"\x0e\x00")
    bench = Bench(Device(eeprom))
    bench.ticks(10)
    bench.device.reset(8)
    bench.ticks(30)
    assert {sample.boot for sample in bench.samples} == {15, 0}
    assert [(h.boot, h.cause) for h in bench.of(Hello)] == [(15, 1), (16, 8)]
    assert bench.of(DeviceStatus)[-1].fault == 5
    assert eeprom == b"\x10\x00"
    assert len(bench.torn) == 1


def test_a_reset_forgets_all_settings_and_keeps_the_number_of_the_board(bench: Bench) -> None:
    bench.command("board", 4711)
    bench.start()
    bench.device.reset(2)
    assert (bench.device.output, bench.device.dump_open) == (0, True)
    assert bench.command("run").reason == "no trip limit"
    bench.ticks(30)
    assert [hello.board for hello in bench.of(Hello)] == [4711, 4711]
    bench.torn.clear()


def test_no_line_is_dropped_under_a_full_load(bench: Bench) -> None:
    """A command in every line, re-requests without end, records at the highest rate."""
    bench.start()
    bench.command("tele", 4)
    for number in range(400):
        bench.device.feed(frame(f"0 rp {max(number - 40, 0)} ffffffff")[:21])
        bench.ticks(1)
        bench.device.feed(frame(f"0 rp {max(number - 40, 0)} ffffffff")[21:])
        bench.ticks(1)
        bench.device.feed(frame(f"{number + 100} set 30"))
        bench.ticks(1)
    bench.command("status")
    status = bench.of(DeviceStatus)[-1]
    assert (status.dropped, status.overrun, status.bad) == (0, 0, 0)


@pytest.mark.parametrize(("ring", "bytes_per_tick"), [(0, 21), (1025, 21), (64, 1), (64, 201)])
def test_options_out_of_range_are_refused(ring: int, bytes_per_tick: int) -> None:
    with pytest.raises(ValueError, match="must be"):
        Device(ring=ring, bytes_per_tick=bytes_per_tick)


def test_counts_that_no_converter_gives_are_refused() -> None:
    with pytest.raises(ValueError, match="0 to 1023, got -1, 0"):
        Device().tick(-1, 0)
