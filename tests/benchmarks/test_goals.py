"""The figures that the identification is measured by, reached by the shipped code."""

import dataclasses
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from fitting import ForceData, load_bundled

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def _load(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


GOALS = _load("goals", ROOT / "benchmarks" / "goals.py")
BPA10 = _load("bpa10", ROOT / "tests" / "fitting" / "bpa10.py")


@pytest.mark.parametrize("place", [0, 2], ids=["A1", "A2"])
def test_martens_maps_in_the_physical_box(place: int) -> None:
    """At most 7 parameters, Drucker-stable, in sample and on what was left out."""
    goal = GOALS.GOALS[place]
    assert goal.options.get("box", "physical") == "physical"
    row = GOALS.reach(goal, load_bundled(GOALS.MUSCLES[goal.data]))
    assert row["met"], row
    assert row["converged"]
    assert row["n_parameters"] <= 7
    assert row["stability_margin_Pa"] > 0


@pytest.fixture(scope="module")
def ramps() -> dict[str, ForceData]:
    if not BPA10.FOLDER.is_dir():
        pytest.skip(BPA10.ABSENT)
    data = BPA10.bpa10_data(BPA10.bpa10_maps())
    return {f"bpa10 {name}": dataclasses.replace(one, force_std=None) for name, one in data.items()}


@pytest.mark.parametrize("place", [0, 1], ids=["10cm", "30cm"])
def test_raw_ramps_are_fitted(place: int, ramps: dict[str, ForceData]) -> None:
    goal = GOALS.RAMPS[place]
    row = GOALS.reach(goal, ramps[goal.data])
    assert row["met"], row
    assert row["n_parameters"] <= 7
    assert row["stability_margin_Pa"] > 0
