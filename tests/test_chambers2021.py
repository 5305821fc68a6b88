"""The dissertation as one example: its scripts run as a user would run them, and its answer is honest."""

import dataclasses
import importlib
import itertools
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from processes import said

import fitting

FOLDER = Path(__file__).parents[1] / "examples" / "chambers2021"


@pytest.fixture(scope="module")
def chapter7() -> Iterator[ModuleType]:
    before = sys.path[:]
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("chapter7_identification")
    sys.path[:] = before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "line"),
    [
        ("chapter2_design", "inner fitting under the braid 0.838 0.83874 in"),
        ("chapter5_braid", "largest thread tension"),
    ],
)
def test_chapters_from_the_print(script: str, line: str) -> None:
    assert line in " ".join(said(FOLDER / f"{script}.py").split())


@pytest.mark.slow
def test_least_squares_are_the_identification(chapter7: ModuleType) -> None:
    question = importlib.import_module("open_question")
    data = question.ends_of_isobars()
    shapes = importlib.import_module("specimen").four_geometries(0.0254, 6894.757293168361)
    model = (shapes[0], question.PressurisedBraid(0.0))
    rmse, left_out, unknowns = question.System.of(data, model).judged("constant", deadband=False)
    held = {"deadband_pressure": (0.0, 0.0)}
    fit = fitting.identify(data, geometry=shapes[0], constraint="none", bounds=held, starts=1)
    np.testing.assert_allclose(unknowns[:3], fit.coefficients[0], rtol=1e-6)
    assert rmse * data.max_force == pytest.approx(fit.errors.rmse, rel=1e-9)
    assert left_out > rmse
    modulus = question.least_modulus(data, model, unknowns)
    assert modulus == pytest.approx(fit.certificate.stability_margin, rel=0.02)  # 50 stations


def test_answer_follows_from_the_numbers(chapter7: ModuleType) -> None:
    question = importlib.import_module("open_question")
    models = ("estimated inelastic", "measured", question.WORK)
    base = [
        question.Trial(truth, model, deadband, form, 0.001, 0.001, 1e6)
        for truth, model, deadband, form in itertools.product(
            ("one", "other", "own"), models, (False, True), question.FORMS
        )
    ]
    first, second = chapter7.answer(base)
    assert "E_n suffice: they are enough for 2 of 2" in first
    assert "they suffice:" in second

    def changed(truth: str, **to: float) -> list:
        return [
            dataclasses.replace(one, **to) if one.truth == truth and one.form == "constant" else one
            for one in base
        ]

    first, second = chapter7.answer(changed("other", modulus=-1.0))
    assert "do not suffice for every muscle: they are enough for 1 of 2" in first
    assert "they suffice:" in second
    first, second = chapter7.answer(changed("own", left_out=0.02))
    assert "they are enough for 2 of 2" in first
    assert "they do not: the best constant law (estimated inelastic, deadband zero)" in second
    assert "has an error of 2 %" in second


@pytest.mark.slow
@pytest.mark.long
def test_chapters_on_a_twin(tmp_path: Path) -> None:
    """All from one folder; chapter by chapter what the twin is known to be."""
    folder = ("--folder", str(tmp_path / "twin"))
    told = said(FOLDER / "chapter3_rig.py", *folder)
    assert "TWIN, water, 100 psi, mean pressure" in told
    told = said(FOLDER / "chapter4_shape.py", *folder)
    assert "TWIN, 35 of 36 pictures" in told
    assert "TWIN, measured, 100 psi" in said(FOLDER / "chapter6_force.py", *folder)
    told = said(FOLDER / "chapter7_identification.py", *folder)
    assert "TWIN, order 3, fixed, E_1" in told
    # What was made of a constant law needs no other where shape, deadband and pull are right.
    assert "they are enough for 4 of 4 muscles with known truth" in told
    assert "For the work's own muscle, judged by ten printed readings, they do not" in told


@pytest.mark.slow
def test_threads_of_the_shape_from_mechanics() -> None:
    """Its diameters and forces beside the print are rows of the benchmarks."""
    rows = json.loads(said(FOLDER / "equilibrium_shape.py", "--json"))
    threads = [row for row in rows if "pinned_thread_in" in row]
    pinned = [row["pinned_thread_in"] for row in threads]
    assert pinned == pytest.approx([9.960, 9.983, 10.032, 10.051, 10.074], abs=2e-3)
    assert [row["geodesic_thread_in"] for row in threads[3:]] == [None, None]
