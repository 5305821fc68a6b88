"""The benchmark of the first answer on steps of milliseconds: regimes, caches, counts."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
bench = pytest.importorskip("first_answer")
sys.path.pop(0)


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
