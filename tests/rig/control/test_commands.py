"""The commands of `famjax rig` as a person types them: exit codes, output, files."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from rig_commands import run, write_plan

from famjax.boundary.errors import InputError
from famjax.boundary.units import parse_quantity
from famjax.commands.rig import HELP
from famjax.commands.rig.monitor import Monitor
from fitting import read_csv
from rig import read_journal, read_plan
from rig.protocol import Sample, frame


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
