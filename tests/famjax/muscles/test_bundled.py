"""The muscles that come with famjax."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from famjax.cards import read_card
from famjax.muscles import bundled_card, dmsp_10, dmsp_20
from fitting import load_bundled

REMADE = 1e-6  # of the largest force: where a search ends on another machine


@pytest.mark.parametrize(
    ("make", "data"), [(dmsp_10, "DMSP-10-250"), (dmsp_20, "DMSP-20-300")]
)  # fmt: skip
def test_a_bundled_muscle_pulls_as_was_measured(make, data: str) -> None:
    muscle, readings = make(), load_bundled(data)
    loaded = readings.force > 0
    found = np.asarray(muscle.force(readings.length, readings.pressure))
    error = np.sqrt(np.mean((found - readings.force)[loaded] ** 2))
    assert error < 0.004 * readings.force.max()
    assert np.abs(found - readings.force).max() < 0.025 * readings.force.max()  # slack ones too


def test_a_bundled_muscle_can_be_cut_and_taken_anywhere() -> None:
    muscle = dmsp_20(length=0.1)
    np.testing.assert_allclose(muscle.rest_length, 0.1)
    L, P = np.meshgrid(np.linspace(0, 0.2, 41), np.linspace(0, 1.4e6, 15))
    found = np.asarray(muscle.force(L, P))
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    assert (np.diff(found, axis=1) >= 0).all()
    assert (np.diff(found, axis=0) >= 0).all()
    with pytest.raises(InputError, match="rest length must be > 0"):
        dmsp_10(length=-0.1)
    with pytest.raises(InputError, match=r"cannot be cut to 0\.001 m"):
        dmsp_20(length=0.001)
    with pytest.raises(InputError, match="no card of a muscle 'DMSP-40'"):
        bundled_card("DMSP-40")


@pytest.mark.slow
def test_the_script_makes_the_bundled_cards_anew(tmp_path: Path) -> None:
    script = runpy.run_path(str(Path(__file__).with_name("make_cards.py")))
    for path in script["make_cards"](tmp_path):
        new, old = read_card(path), bundled_card(path.stem)
        np.testing.assert_allclose(new.region.pressure, old.region.pressure)
        L = np.linspace(*np.asarray(old.region.length), 9)[:, None]
        P = np.linspace(*np.asarray(old.region.pressure), 9)
        wanted = np.asarray(old.muscle.force(L, P))
        atol = REMADE * np.abs(wanted).max()
        np.testing.assert_allclose(new.muscle.force(L, P), wanted, rtol=0, atol=atol)
