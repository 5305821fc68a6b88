"""The benchmark of the first answer on rows of milliseconds: regimes, caches, counts, table."""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
TOUCH = """import os, pathlib
path = pathlib.Path(os.environ["JAX_COMPILATION_CACHE_DIR"]) / "program"
print("rmse_N", 2.0 if path.exists() else 1.0)
path.touch()
"""


@pytest.fixture(scope="module")
def bench() -> Iterator[ModuleType]:
    sys.path.insert(0, str(BENCHMARKS))
    yield importlib.import_module("first_answer")
    sys.path.remove(str(BENCHMARKS))


@pytest.fixture
def machine(bench: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bench, "UNIT", ("-c", "sum(range(10**6))"))
    return bench.Machine(sys.executable, "DMSP-20-300", tmp_path)


def test_rows_are_chosen_by_name(bench: ModuleType) -> None:
    every = [*bench.ROWS, *bench.CHECKS]
    assert len({row.name for row in every}) == len(every)
    assert bench.chosen([], long=True) == every
    short = bench.chosen([], long=False)
    assert {row.name for row in every} - {row.name for row in short} == {
        row.name for row in bench.ROWS if row.long
    }
    assert [row.name for row in bench.chosen(["famjax reproduce"], long=False)] == [
        "famjax reproduce"
    ]
    assert not [
        row for row in bench.chosen([], long=True, peers=False) if getattr(row, "peer", False)
    ]
    with pytest.raises(ValueError, match="no row is called 'spam'; there are"):
        bench.chosen(["spam"], long=False)


def test_a_process_is_measured_with_its_children(machine) -> None:
    work, more = "sum(range(10**7))", "sum(range(4 * 10**7))"
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', '{more}'])"
    nothing, _ = machine.run(("-c", "pass"), None)
    alone, said = machine.run(("-c", f"print('said'); {work}"), None)
    outside, _ = machine.run(("-c", child), None)
    assert said == "said\n"
    assert alone > nothing
    assert outside > alone


def test_a_process_that_fails_says_so(bench: ModuleType, machine) -> None:
    with pytest.raises(bench.FailedRunError, match="exit code 3: bad"):
        machine.run(("-c", "import sys; print('bad', file=sys.stderr); sys.exit(3)"), None)
    row = bench.Row("fails", ("-c", "1 / 0"), second=1)
    *_, line = bench.measure(machine, [row], repeat=1)
    assert line.holds is False
    assert "ZeroDivisionError" in line.note


def test_the_cache_of_a_user_is_not_seen(machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "/of/the/user")
    monkeypatch.setenv("FAMJAX_CACHE_DIR", "/of/the/user")
    _, said = machine.run(("-c", "import os; print(dict(os.environ))"), None)
    assert "/of/the/user" not in said
    assert "JAX_COMPILATION_CACHE_DIR" not in said


def test_regimes(bench: ModuleType, machine) -> None:
    slow = ("-c", "sum(range(3 * 10**7))")
    row = bench.Row("tiny", ("-c", TOUCH), other=slow, cold=1e6, second=1e-6)
    lines = bench.measure(machine, [row], repeat=2)
    assert [line.regime for line in lines] == ["", "cold", "second", "again", "other"]
    unit, cold, second, again, other = lines
    assert unit.unit == "s"
    assert cold.value == pytest.approx(cold.seconds / unit.seconds)
    assert cold.holds is True
    assert second.holds is False
    assert second.note == "RMSE 2 N"  # the second process finds what the first one has left
    assert again.holds is None
    assert other.seconds > again.seconds
    said = bench.table(lines)
    assert said.count("does NOT hold") == 1
    assert [row["holds"] for row in json.loads(json.dumps(bench.as_dicts(lines)))] == [
        None, True, False, None, None,
    ]  # fmt: skip


def test_a_primed_row_has_no_cold_regime(bench: ModuleType, machine) -> None:
    row = bench.Row("primed", ("-c", TOUCH), prime=("-c", TOUCH), second=1e6)
    lines = bench.measure(machine, [row], repeat=1, regimes=("cold", "second"))
    assert [(line.regime, line.note) for line in lines[1:]] == [("second", "RMSE 2 N")]


@pytest.mark.slow
def test_programs_are_counted(bench: ModuleType, machine) -> None:
    sine = ("-c", "import jax.numpy as jnp; jnp.sin(1.0)")
    imports = ("-c", "import jax")
    first, second = (
        found["programs"] for found in machine.in_one_process([imports, sine, sine], None)[1:]
    )
    assert first >= 1
    assert second == 0
    for before, holds in (((imports,), False), ((imports, sine), True)):
        check = bench.Check("sine", before, sine, programs=0)
        assert bench.measure(machine, [check], repeat=1)[-1].holds is holds


def test_outputs_of_one_step_are_no_results_of_the_next(machine) -> None:
    step = ("-c", "open('made', 'x').close()")
    assert len(machine.in_one_process([step, step], None)) == 2


def test_names_are_listed_and_bad_options_refused(
    bench: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench.main(["--list"]) == 0
    assert "famjax compare" in capsys.readouterr().out.splitlines()
    for arguments in (["--repeat", "0"], ["--rows", "spam"]):
        with pytest.raises(SystemExit):
            bench.main(arguments)


def test_the_script_written_by_hand_reaches_the_optimum(machine) -> None:
    """The RMSE that issue after issue quotes for this map, the same box and no constraint."""
    _, said = machine.run(("{root}/benchmarks/rivals/fit_scipy.py", "{map}"), None)
    assert said.startswith("rmse_N 7.5254")
