"""Posteriors of several identifications: those of each by itself, on any executor."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting
from fitting import Identification, InputError
from fitting.posterior import Posterior, sample_each

pytest.importorskip("blackjax")
pytestmark = pytest.mark.slow

OPTIONS: dict[str, Any] = {"draws": 40, "warmup": 30, "chains": 2, "seed": 5}


@pytest.fixture(scope="module")
def results(fitted20: Identification) -> list[Identification]:
    """Two maps of one form, for which one program is compiled."""
    data = dataclasses.replace(fitted20.data, force=1.02 * fitted20.data.force)
    return [fitted20, fitting.identify(data)]


def same(one: Posterior, other: Posterior) -> bool:
    values, others = vars(one), vars(other)
    return all(np.array_equal(values[name], others[name]) for name in values)


def test_each_is_that_of_sample_however_often_it_is_stopped(
    results: list[Identification], tmp_path: Path, sent: Any
) -> None:
    each = [fitting.sample(one, **OPTIONS) for one in results]

    class StoppedError(Exception):
        pass

    def stop(done: int, total: int) -> None:
        if done == 1:
            raise StoppedError

    with pytest.raises(StoppedError):
        sample_each(results, **OPTIONS, resume=tmp_path / "draws.jsonl", progress=stop)
    found = sample_each(results, **OPTIONS, resume=tmp_path / "draws.jsonl", executor=sent)
    assert sent.count == 1
    assert all(same(one, other) for one, other in zip(each, found, strict=True))
    assert found[1].names == each[1].names
    with pytest.raises(InputError, match=r"a posterior of other data .*settings.seed"):
        sample_each(results, **{**OPTIONS, "seed": 6}, resume=tmp_path / "draws.jsonl")


@pytest.mark.long
def test_two_processes_draw_the_same(results: list[Identification]) -> None:
    here = sample_each(results, **OPTIONS)
    there = sample_each(results, **OPTIONS, executor=2)
    assert all(same(one, other) for one, other in zip(here, there, strict=True))


def test_none_is_refused() -> None:
    with pytest.raises(InputError, match="got none"):
        sample_each([])
