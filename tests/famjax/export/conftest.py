from collections.abc import Callable

import numpy as np
import pytest

import famjax
from famjax.cards import MuscleCard
from famjax.export import Subject
from famjax.muscle import Region

States = Callable[[Subject, int], tuple[np.ndarray, np.ndarray]]
LENGTHS, PRESSURES = (0.225, 0.3), (0.0, 6e5)
ODD_NAME = "20 mm */ /* \"quick\" & <muscle>"


def festo_card(name: str = "Test-20") -> MuscleCard:
    """A card of a muscle like the DMSP-20: a cubic law, so that E_1 is a coefficient."""
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=1.082, length=0.296)
    bladder = famjax.Bladder(0.296, 23e-3, 1.8e-3, embedded=True)
    law = famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6])
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 40e3)
    mounted = famjax.MountedMuscle(muscle, np.array(0.0))
    return MuscleCard(name, (mounted,), np.ones(1), Region(LENGTHS, PRESSURES))


@pytest.fixture(scope="session")
def subject() -> Subject:
    return Subject.of_card(festo_card())


@pytest.fixture(scope="session")
def odd_subject(subject: Subject) -> Subject:
    """The same muscle under a name that no language takes."""
    return Subject(ODD_NAME, subject.muscle, None, (f"of {ODD_NAME}\\",))


@pytest.fixture(scope="session")
def dmsp_20() -> Subject:
    """A mean of three models, one with a compliant braid."""
    return famjax.export.read_subject("dmsp-20")


@pytest.fixture(scope="session")
def states() -> States:
    """Lengths and pressures, a half in the region and a half up to twice its ends."""

    def drawn(subject: Subject, count: int) -> tuple[np.ndarray, np.ndarray]:
        rng = np.random.default_rng(3)
        length, pressure = (
            np.concatenate(
                [
                    rng.uniform(axis[0], axis[-1], count // 2),
                    rng.uniform(0, 2 * axis[-1], count // 2),
                ]
            )
            for axis in (subject.pull.lengths, subject.pull.pressures)
        )
        return length, pressure

    return drawn
