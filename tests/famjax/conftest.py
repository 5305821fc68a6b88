"""Muscles of `tests/muscles.py`, made where a test asks for one: making them compiles."""

import pytest


@pytest.fixture
def festo():
    from muscles import FESTO

    return FESTO
