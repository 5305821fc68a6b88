"""Choices on any executor: the same bits, the same files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import famjax
from fitting import ForceData, InputError, Specimen, choose
from fitting.choice import Choice, NestedValidation, validate_choice

pytestmark = pytest.mark.slow

PRESSURES = np.linspace(1e5, 4e5, 4)


def measured(rest: float, lengths: int) -> ForceData:
    """A muscle of a linear law, with noise of 1 N."""
    braid = famjax.Braid.from_rest(diameter=0.0215, braid_angle=1.12, length=rest)
    geometry = famjax.EstimatedGeometry(braid, famjax.Bladder(rest, 0.0215, 1.8e-3, embedded=True))
    muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(np.array([1e6])), 3e4)
    length, pressure = (
        grid.ravel() for grid in np.meshgrid(rest * np.linspace(1, 0.85, lengths), PRESSURES)
    )
    force = np.asarray(muscle.force(length, pressure))
    force = force + np.random.default_rng(lengths).normal(size=force.size)
    specimen = Specimen(f"{rest * 1e3:.0f} mm", rest, 1.8e-3, 0.020, embedded=True)
    return ForceData(force, pressure, length, specimen)


SMALL = measured(0.2, 4)
HELD = {"end_factor": (1.0, 1.0), "braid_compliance": (0.0, 0.0), "rest_length": (0.2, 0.2)}
FEW: dict[str, Any] = {"starts": 2, "bounds": HELD}  # laws with and without a deadband


@pytest.fixture(scope="module")
def here() -> Choice:
    return choose(SMALL, **FEW)


def same(one: Choice, other: Choice) -> bool:
    scores, others = ([(t.candidate.name, t.held_out) for t in of.tried] for of in (one, other))
    return (
        scores == others
        and one.dropped == other.dropped
        and one.alike.keys() == other.alike.keys()
        and np.array_equal(one.chosen.residuals, other.chosen.residuals)
        and all(
            np.array_equal(one.left_out[k].error, other.left_out[k].error) for k in one.left_out
        )
    )


def same_errors(one: NestedValidation, other: NestedValidation) -> bool:
    values, others = vars(one), vars(other)
    return all(np.array_equal(values[name], others[name]) for name in values)


def test_a_stopped_validation_of_a_choice_goes_on_to_the_same_bytes(
    here: Choice, tmp_path: Path, sent: Any
) -> None:
    whole, cut = tmp_path / "whole.jsonl", tmp_path / "cut.jsonl"
    found = validate_choice(here, "length", resume=whole, **FEW)

    class StoppedError(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 3:
            raise StoppedError

    with pytest.raises(StoppedError):
        validate_choice(here, "length", resume=cut, **FEW, progress=stop)
    again = validate_choice(here, "length", resume=cut, **FEW, executor=sent)
    assert sent.count == 1  # of four lengths
    assert same_errors(found, again)
    assert cut.read_bytes() == whole.read_bytes()
    with pytest.raises(InputError, match=r"a validation of other data .*groups was"):
        validate_choice(here, "pressure", resume=cut, **FEW)
