"""What the device does, in Python and in C: states, guards, commands, records; and that both agree."""

import random
import subprocess
from pathlib import Path

import pytest
from benches import Bench
from native import NativeDevice, build_native
from processes import needs, ran
from session_fuzz import Fuzz

from rig import audit, protocol, read_journal
from rig.device import Device, firmware_folder
from rig.protocol import MANUAL, RUN, SAFE, TRIP, DeviceSettings, DeviceStatus, Hello, frame

SILENCE_TICKS = 500
TICKS = 12_000  # of two executions side by side; the benchmark does millions


def pins(bench):
    return bench.device.state, bench.device.output, bench.device.dump_open


def test_starts_safe_and_runs_only_under_a_pressure_limit(bench):
    bench.ticks(30)
    assert pins(bench) == (SAFE, 0, True)
    assert bench.of(Hello) == [Hello(3, 3, 0, 1, 500, 5, 64, 21, 900, 0)]
    assert (bench.of(DeviceStatus)[0].fault, bench.of(DeviceSettings)[0].trip) == (0, 0)
    for verb in (("run",), ("man", 77)):
        assert bench.command(*verb).reason == "no trip limit"
    assert bench.device.state == SAFE
    bench.command("trip", 600)
    for output in (77, 0):
        assert not bench.command("man", output).reason
        assert pins(bench) == (MANUAL, output, False)


def test_stop_acts_in_the_tick_that_reads_it_and_cancels_a_start(bench):
    bench.start()
    bench.ticks(1)
    assert bench.device.output > 0
    bench.device.feed(frame("99 stop"))
    bench.ticks(1)
    assert pins(bench) == (SAFE, 0, True)
    for _ in range(5):  # wherever in a record it comes
        bench.ticks(11)
        bench.said.clear()
        bench.device.feed(b"run\nstop\n")
        bench.ticks(20)
        assert all(sample.state == SAFE for sample in bench.samples[1:])


@pytest.mark.parametrize(
    ("commands", "sound", "wrong", "fault"),
    [
        ((), (600, 600, 599, 1023, 1023, 100, 600, 600), (600,), 2),
        ((("jump", 77),), (0, *[100] * 8), (0, 0, 0), 3),
        ((("jump", 77), ("man", 90)), (0, *[100] * 8), (0, 0, 0), 3),
        ((("floor", 80),), (79, 79, 80, 79, 79), (79,), 6),
        ((("ceiling", 500),), (501, 501, 500, 501, 501), (501,), 6),
        ((("jump", 75),), range(115, 590, 15), (), 0),  # 75 counts in five ticks
        ((("jump", 74),), range(115, 190, 15), range(190, 240, 15), 3),
    ],
)
def test_a_guard_trips_at_the_third_conversion_and_not_before(commands, sound, wrong, fault, bench):
    bench.start()
    for verb, *values in commands:
        bench.command(verb, *values)
    for pressure in sound:
        bench.ticks(1, pressure)
    assert bench.device.state in (RUN, MANUAL)
    for pressure in wrong:
        bench.ticks(1, pressure)
    tripped = pins(bench) == (TRIP, 0, True)
    assert tripped == bool(fault)
    assert not tripped or bench.status.fault == fault


def test_a_start_on_its_way_does_not_outlive_a_trip(bench):
    """`man` waits for the next record; a guard that acts before cancels it."""
    bench.start()
    bench.command("tele", 50)
    bench.beat(100)
    bench.device.feed(frame("900 man 200"))
    bench.ticks(1)
    bench.ticks(103, 700)
    assert pins(bench) == (TRIP, 0, True)


@pytest.mark.parametrize(
    ("gains", "set_psi", "limits", "output"),
    [
        ((20, 0), 40.0, (-128, 128), 255),  # 20 counts per psi, 20 psi low: full output
        ((0, 20), 40.0, (-50, 50), 178),  # an integral at its limit, below full output
        ((0, 127), 20.0, (-128, 128), 255),  # at 100 counts, 19.53 psi: no error is too small
    ],
)
def test_full_output_without_rise_trips_after_the_stall_time(gains, set_psi, limits, output, bench):
    bench.start(gains=gains, set_psi=set_psi)
    bench.command("ilim", *limits)
    while bench.device.output < output:
        bench.beat(1)
    bench.command("stall", 1000)
    bench.beat(400)
    assert bench.device.state == RUN
    bench.beat(200)
    assert (bench.device.state, bench.status.fault) == (TRIP, 4)


@pytest.mark.parametrize("milliseconds", [100, 3000])
def test_silence_ends_a_run_after_the_time_set(milliseconds, bench):
    bench.start()
    bench.command("hbms", milliseconds)
    bench.device.feed(frame("0 hb"))
    bench.ticks(milliseconds // 2)
    assert bench.device.state == RUN
    bench.ticks(1)
    assert pins(bench) == (SAFE, 0, True)
    assert bench.status.fault == 1


@pytest.mark.parametrize(
    ("line", "alive"),
    [
        (frame("0 rp 0 1"), True),
        (frame("77 nonsense"), True),  # its CRC is right: a host is there
        (frame("0 hb")[:-2] + b"X\n", False),
        (b"0 hb\n", True),  # a person types
        *[(line, False) for line in (b"\n\n\r\n", b"x" * 100 + b"\n", b"\xff\xfe hb\n")],
    ],
)
def test_what_counts_as_a_sign_of_life(line, alive, bench):
    bench.start()
    bench.ticks(1)
    bench.device.feed(frame("0 hb"))
    bench.ticks(SILENCE_TICKS - 50)
    bench.device.feed(line)
    bench.ticks(60)
    assert bench.device.state == (RUN if alive else SAFE)


def test_strict_takes_nothing_without_its_crc(bench):
    bench.start()
    bench.command("strict", 1)
    bench.send(b"0 hb\nstop\n")
    bench.ticks(20)
    assert bench.device.state == RUN
    bench.command("status")
    assert bench.of(DeviceStatus)[-1].bad == 2


def test_a_trip_is_told_and_ended_by_clear_alone_and_not_under_pressure(make):
    """Opening the port resets an Uno: that must not acknowledge."""
    eeprom = bytearray(6)
    bench = Bench(make(eeprom))
    bench.start()
    assert bench.command("clear").reason == "running: stop first"
    bench.ticks(2, 700)
    driven = bench.device.output
    bench.ticks(1, 705)
    told = bench.status
    assert (told.state, told.fault) == (TRIP, 2)
    assert (told.tripped_count, told.tripped_output) == (705, driven)
    assert 0 <= told.tick - told.tripped_at <= 30
    bench.pressure = 700
    assert bench.command("clear").reason == "pressure above trip"
    bench.pressure = 599
    for verb in (("run",), ("man", 50), ("stop",), ("hello",), ("strict", 0), ("trip", 800)):
        refused = bench.command(*verb).reason
        assert refused == ("tripped: clear first" if verb[0] in ("run", "man") else "")
        assert bench.device.state == TRIP
    for cause in (1, 2, 8):
        bench.device.reset(cause)
        assert bench.device.state == TRIP
    again = Bench(make(eeprom))
    told = again.status
    assert (told.state, told.fault, told.tripped_count) == (TRIP, 2, 705)
    again.command("trip", 600)
    assert not again.command("clear").reason
    told = again.status
    assert (told.state, told.fault, told.tripped_count) == (SAFE, 0, 705)  # for the record
    assert not again.command("run").reason
    assert make(eeprom).state == SAFE
    for fill in (b"\xff" * 6, b"\x05\x00\x05\x00\x00\x00", b"\x05\x00\x63\x00\x00\x00"):
        assert make(bytearray(fill)).state == SAFE  # memory that was never written


OUT_OF_RANGE = """set -1|set 1024|cal 1024 200|set 40 255.01|set|set 1 2 3|set 4O|set 1e2|set 0x10
set .5|set 1.00001|set 1234567|gain 128 0|gain 1|ilim 1 2|ilim -256 0|man 256|man 1.5|trip 0|trip 1024
floor 1023|ceiling 0|still 499|frozen 4|frozen 256 750|tele 51|hbms 99|hbms 10001|stall 499|strict 2
run 1|board 0|board 65535""".replace("\n", "|").split("|")


def test_numbers_out_of_range_are_refused_and_nothing_changes(bench):
    bench.ticks(20)
    before = bench.of(DeviceSettings)[-1]
    for text in OUT_OF_RANGE:
        assert bench.command(*text.split()).reason == "number missing or out of range", text
    assert bench.command("tele", 3).reason == "too fast for this baud"
    for counts in (901, 1023):
        assert bench.command("trip", counts).reason == "above the compiled-in ceiling"
    bench.command("status")
    assert bench.of(DeviceSettings)[-1] == before
    assert not bench.command("tele", 4).reason
    assert not bench.command("trip", 900).reason
    assert not Bench(Device(bytes_per_tick=91)).command("tele", 1).reason


def test_a_repeated_command_is_answered_again_and_not_obeyed_again(bench):
    bench.start()
    for _ in range(2):
        bench.send(frame("500 man 20"))
        bench.ticks(20)
    first, second = (a for a in bench.of(protocol.Ack) if a.id == 500)
    assert first == second
    bench.command("stop")
    bench.send(frame("500 man 21"))  # the id again, but another command
    bench.ticks(20)
    assert bench.device.output == 21
    for _ in range(2):  # but a hello is always obeyed
        bench.send(frame("1 hello"))
        bench.ticks(40)
    assert len(bench.of(Hello)) == 3


@pytest.mark.parametrize("seed", range(2))
def test_every_record_of_a_run_can_be_recomputed(seed, bench, path):
    """Commands at any moment: each record is governed by one law from its first tick on."""
    r = random.Random(seed)
    bench.start()
    for _ in range(120):
        verb, *values = r.choice((
            ("set", round(r.uniform(5, 60), 3), round(r.uniform(0, 255), 2)),
            ("gain", round(r.uniform(0, 9), 3), round(r.uniform(0, 9), 3)),
            ("ilim", r.randint(-200, 0), r.randint(0, 200)),
            ("tele", r.choice((4, 5, 7, 20))),
            ("stop",), ("run",), ("run",),
        ))  # fmt: skip
        answer = bench.command(verb, *values)
        assert not answer.reason
        if verb == "set":  # the answer says from which record on it holds
            bench.ticks(60)
            held = bench.of(DeviceSettings)[-1]
            assert held.since == answer.seq
            assert held.law.set_point_psi == pytest.approx(values[0], abs=1 / 256)
        for _ in range(r.randint(0, 60)):
            bench.ticks(1, r.randint(40, 300))
    bench.ticks(100)
    path.write_bytes(b"\n".join(bench.lines))
    found = audit(read_journal(path))
    assert (found.equal, found.unchecked) == (found.checked, 0)
    assert sum(sample.state == RUN for sample in bench.samples) > 300
    seqs = [sample.seq for sample in bench.samples]
    assert seqs == list(range(len(seqs)))  # and not one was dropped


def test_records_are_sums_over_their_ticks_and_say_when_they_ended(bench):
    r = random.Random(1)
    counts = []
    for _ in range(200):
        counts.append((r.randint(0, 1023), r.randint(0, 1023)))
        bench.force = counts[-1][1]
        bench.ticks(1, counts[-1][0])
    assert len(bench.samples) >= 38
    for sample in bench.samples:
        window = counts[sample.tick - 5 : sample.tick]
        assert (sample.pressure_sum, sample.force_sum) == tuple(map(sum, zip(*window, strict=True)))
        assert sample.pressure_count == window[-1][0]
        assert sample.tick == 5 * (sample.seq + 1)


def test_records_are_repeated_on_request_and_what_is_too_old_is_told_once(bench):
    bench.ticks(1000)
    before = bench.samples
    base = before[-1].seq - 50
    bench.said.clear()
    bench.send(frame(f"0 rp {base} {0b1011:x}"))
    bench.ticks(50)
    wanted = [s for s in bench.samples if s.seq in (base, base + 1, base + 2, base + 3)]
    assert wanted == [s for s in before if s.seq in (base, base + 1, base + 3)]
    assert not bench.of(protocol.StoredRange)
    next_ = bench.samples[-1].seq + 1
    oldest = next_ - 64
    bench.said.clear()
    bench.send(frame(f"0 rp {oldest - 8} ffffffffffffffff"))
    bench.ticks(400)
    (limits,) = bench.of(protocol.StoredRange)
    assert limits.oldest <= oldest + 2  # the ring went on while the line arrived
    assert limits.next - limits.oldest == 64
    repeated = [s.seq for s in bench.samples if s.seq < next_]
    assert repeated[0] >= limits.oldest
    assert repeated[-1] == oldest - 8 + 63
    assert len(repeated) > 40


def test_sync_pin_is_high_for_whole_records_and_they_say_so(bench):
    bench.ticks(11)
    since = bench.command("sync", 3).seq
    bench.ticks(60)
    assert [s.seq for s in bench.samples if s.sync] == [since, since + 1, since + 2]


def test_a_reset_counts_up_forgets_settings_and_keeps_the_number_of_the_board():
    eeprom = bytearray(b"\x0e\x00" + b"\xff" * 6)
    bench = Bench(Device(eeprom))
    bench.command("board", 4711)
    bench.start()
    bench.device.reset(8)
    assert pins(bench) == (SAFE, 0, True)
    assert bench.command("run").reason == "no trip limit"
    bench.ticks(30)
    assert {sample.boot for sample in bench.samples} == {15, 0}
    hello = bench.of(Hello)[-1]
    assert (hello.boot, hello.cause, hello.board, bench.status.fault) == (16, 8, 4711, 5)
    assert eeprom[:2] == b"\x10\x00"


def test_no_line_is_dropped_under_a_full_load(bench):
    """A command in every line, re-requests without end, records at the highest rate."""
    bench.start()
    bench.command("tele", 4)
    for number in range(400):
        request = frame(f"0 rp {max(number - 40, 0)} ffffffff")
        for piece in (request[:21], request[21:], frame(f"{number + 100} set 30")):
            bench.device.feed(piece)
            bench.ticks(1)
    bench.command("status")
    status = bench.of(DeviceStatus)[-1]
    assert (status.dropped, status.overrun, status.bad) == (0, 0, 0)


RINGS = (7, {"ring": 7}), (8, {"ring": 500, "bytes_per_tick": 91}), (9, {"bytes_per_tick": 200})


@needs("cc")
@pytest.mark.parametrize(("seed", "options"), [*((seed, {}) for seed in range(4)), *RINGS])
def test_port_and_core_agree(seed, options, tmp_path):
    port, core = Device(**options), NativeDevice(build_native(tmp_path, **options))
    fuzz, sent = Fuzz(seed), 0
    for number, tick in enumerate(fuzz.ticks(TICKS)):
        for device in (port, core):
            if tick.reset:
                device.reset(tick.reset)
            device.feed(tick.bytes_in if number or not options else frame("1 tele 1"))
            device.tick(tick.pressure, tick.force)
        said = port.take()
        assert said == core.take(), f"tick {number}"
        assert (port.output, port.state, port.sync) == (core.output, core.state, core.sync)
        fuzz.hear(said)
        sent += len(said)
    assert sent > TICKS


@needs("cc")
def test_they_agree_at_the_edges_of_every_number(tmp_path):
    """The controller in RUN, its settings at their limits: no product may overflow 32 bits."""
    r, library = random.Random(0), build_native(tmp_path, trip_ceiling=1020)
    port, core = Device(trip_ceiling=1020), NativeDevice(library)

    def both(line, pressure):
        for device in (port, core):
            device.feed(line)
            device.tick(pressure, 0)
        assert (port.output, port.take()) == (core.output, core.take())

    rest = "floor 0", "ceiling 1023", "still 60000", "frozen 255 2000", "stall 30000"
    for body in ("trip 1020", "jump 1023", "hbms 10000", *rest, "run"):
        both(frame(body), 0)
    for _ in range(500):
        body = r.choice((
            f"set {r.choice((0, 0.0039, 500, 1023.9921))} {r.choice((0, 0.002, 128, 255))}",
            f"gain {r.choice((0, 0.0039, 0.5, 4, 127.9960))} {r.choice((0, 0.0039, 2, 127.9960))}",
            f"ilim {r.choice((-255, -128, 0))} {r.choice((0, 128, 255))}",
            f"tele {r.choice((4, 5, 49, 50))}",
            "stop",
        ))  # fmt: skip
        both(frame(body), 0)
        if body == "stop":
            zero = r.choice((0, 0.0625, 102.4, 1023.9375))
            both(frame(f"cal {zero} {r.choice((0.0157, 1, 200, 1023.9843))}"), 0)
        both(frame("run"), 0)
        pressure = r.choice((0, 4, 511, 1018, 1019))
        for _ in range(r.randint(1, 120)):
            both(b"", min(max(pressure + r.choice((-1, 0, 0, 1)), 0), 1019))
    assert port.state == core.state == RUN


@needs("cc")
def test_nothing_is_undefined_or_unsafe_whatever_comes_in(tmp_path):
    """The C core with the compiler's sanitizers: random hosts, and bytes as a fuzzer makes them."""
    program, firmware = tmp_path / "fuzz", firmware_folder()
    names = "famrig_core.c", "famrig_plausibility.c", "famrig_text.c"
    sources = [Path(__file__).with_name("fuzz_core.c"), *(firmware / name for name in names)]
    options = ["-std=c99", "-g", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{firmware}",
               "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]  # fmt: skip
    built = ran("cc", *options, *sources, "-o", program)
    if "cannot find" in built.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert built.returncode == 0, built.stderr

    def said(data, *arguments):
        command = [program, *map(str, arguments)]
        run = subprocess.run(command, input=data, capture_output=True, check=False)
        assert (run.returncode, run.stderr) == (0, b"")
        return run.stdout

    for seed in (1, 2, 3):
        assert int(said(b"", seed, 250_000).rsplit(b" ", 1)[1]) > 1000  # lines that it has heard
    r = random.Random(5)
    bodies = "trip 900", "jump 1023", "gain 127.9 127.9", "set 1023.9 255", "run", "board 77"
    lines = b"".join(frame(f"{k} {body}") for k, body in enumerate(bodies, 1))
    for _ in range(20):
        data = bytearray(lines + r.randbytes(2000))
        for _ in range(r.randint(0, 4)):
            data[r.randrange(len(lines))] = r.randrange(256)
        said(bytes(b for byte in data for b in (byte, r.choice((0x10, 0x0F, r.randrange(256))))))
