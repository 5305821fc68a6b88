"""The benchmark of the first answer on steps of milliseconds: regimes, caches, counts."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
bench = pytest.importorskip("first_answer")
sys.path.pop(0)

TOUCH = """import os, pathlib
path = pathlib.Path(os.environ["FAMJAX_CACHE_DIR"]) / "program"
print(path.exists())
sum(range(10**7)) if path.exists() else sum(range(4 * 10**7))
path.touch()
"""


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bench, "UNIT", ("-c", "sum(range(10**6))"))
    return bench.Machine(sys.executable, "DMSP-20-300", tmp_path)


def test_a_process_is_measured_with_its_children(machine) -> None:
    work, more = "sum(range(10**7))", "sum(range(4 * 10**7))"
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', '{more}'])"
    nothing, _ = machine.run(("-c", "pass"), None)
    alone, said = machine.run(("-c", f"print('said'); {work}"), None)
    outside, _ = machine.run(("-c", child), None)
    assert said == "said\n"
    assert outside > alone > nothing


def test_a_process_that_fails_says_so(machine) -> None:
    with pytest.raises(bench.FailedRunError, match="exit code 3: bad"):
        machine.run(("-c", "import sys; print('bad', file=sys.stderr); sys.exit(3)"), None)


def test_the_cache_of_a_user_is_not_seen(machine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "/of/the/user")
    monkeypatch.setenv("FAMJAX_CACHE_DIR", "/of/the/user")
    _, said = machine.run(("-c", "import os; print(dict(os.environ))"), None)
    assert "/of/the/user" not in said


def test_regimes(machine) -> None:
    found = bench.waited(machine, bench.Wait(("-c", TOUCH)), repeat=1)
    assert found["cold, CPU time / import"] > found["second, CPU time / import"] > 0
    primed = bench.waited(machine, bench.Wait(("-c", TOUCH), prime=("-c", TOUCH)), repeat=1)
    assert primed["cold, CPU time / import"] == float("inf")


@pytest.mark.slow
def test_programs_are_counted(machine) -> None:
    sine = ("-c", "import jax.numpy as jnp; jnp.sin(1.0)")
    first, second = (
        found["programs"]
        for found in machine.in_one_process([("-c", "import jax"), sine, sine])[1:]
    )
    assert first >= 1
    assert second == 0


def test_outputs_of_one_step_are_no_results_of_the_next(machine) -> None:
    step = ("-c", "open('made', 'x').close()")
    assert len(machine.in_one_process([step, step])) == 2
