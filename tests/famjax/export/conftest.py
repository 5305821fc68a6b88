import sys
from pathlib import Path

import pytest

import famjax
from famjax.export import Subject

sys.path.insert(0, str(Path(__file__).parent))

from targets import cubic_card


@pytest.fixture(scope="session")
def subject() -> Subject:
    """A muscle like the DMSP-20 with a cubic law, whose pull is affine in the pressure."""
    return Subject.of_card(cubic_card())


@pytest.fixture(scope="session")
def dmsp_20() -> Subject:
    """A mean of three models, one with a compliant braid."""
    return famjax.export.read_subject("dmsp-20")
