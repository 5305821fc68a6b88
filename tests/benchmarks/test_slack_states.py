"""Slack readings of the bundled maps, as the benchmark of slack states counts them."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import fitting

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def benchmark_module() -> Iterator[ModuleType]:
    sys.path.insert(0, str(BENCHMARKS))
    yield importlib.import_module("slack_states")
    sys.path.remove(str(BENCHMARKS))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "readings"), [("DMSP-10-250", 45), ("DMSP-20-300", 66)])
def test_bands_of_slack_readings_contain_no_force(
    name: str, readings: int, benchmark_module: ModuleType
) -> None:
    data = fitting.load_bundled(name)
    fit = benchmark_module.saved(fitting.choose(data, starts=16, seed=0))
    found = benchmark_module.slack_states(fit, data)
    assert found.contained == found.readings == readings
    assert found.zero >= readings - 1  # by the model alone, which pulls at one of them
    assert found.at_rest == 0
    assert found.far == 0
