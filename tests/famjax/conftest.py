"""Muscles of `tests/muscles.py`, which are made where a test asks for one."""

import pytest

import famjax


@pytest.fixture
def festo() -> famjax.Muscle:
    import muscles

    return muscles.FESTO


@pytest.fixture
def chambers() -> famjax.Muscle:
    import muscles

    return muscles.CHAMBERS


@pytest.fixture(params=["festo", "chambers"])
def muscle(request: pytest.FixtureRequest) -> famjax.Muscle:
    return request.getfixturevalue(request.param)
