"""Cases of a test that stand for one another: the first are done always, the others with the slow tests."""

from collections.abc import Iterable
from typing import Any

import pytest


def slow_after(count: int, cases: Iterable[Any]) -> list[Any]:
    """The cases for `pytest.mark.parametrize`, all but the first few marked as slow."""
    every = list(cases)
    return every[:count] + [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
        for case in every[count:]
    ]
