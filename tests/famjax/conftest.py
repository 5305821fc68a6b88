import muscles
import pytest

import famjax


@pytest.fixture
def festo() -> famjax.Muscle:
    return muscles.FESTO


@pytest.fixture
def chambers() -> famjax.Muscle:
    return muscles.CHAMBERS


@pytest.fixture(params=["FESTO", "CHAMBERS"])
def muscle(request: pytest.FixtureRequest) -> famjax.Muscle:
    return getattr(muscles, request.param)
