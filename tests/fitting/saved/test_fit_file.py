"""What a fit leaves behind: one JSON file that gives the same muscle back, a picture, a page."""

import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest

import famjax
from famjax.cards import muscle_as_dict, muscle_from_dict
from fitting import Identification, InputError, load_fit, predict, write_fit
from fitting.evidence import Bootstrap, Evidence
from fitting.evidence.gathered import evidence_warnings
from fitting.saved import html_report, plot_fit, summary_as_dict


def test_fit_file_gives_the_same_muscle(fitted20: Identification, tmp_path: Path) -> None:
    paths = write_fit(fitted20, tmp_path / "deep" / "er")
    assert sorted(p.name for p in paths) == ["fit.json", "fit.png", "report.html"]
    assert sorted(p.name for p in paths[0].parent.iterdir()) == sorted(p.name for p in paths)
    saved = load_fit(paths[0])
    assert jax.tree.structure(saved.muscle) == jax.tree.structure(fitted20.muscle)
    for mine, theirs in zip(
        jax.tree.leaves(saved.muscle), jax.tree.leaves(fitted20.muscle), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)
    assert saved.document["data"]["sha256"] == fitted20.data.sha256
    assert saved.document["rmse_N"] == fitted20.errors.rmse
    readings = saved.document["data"]["readings"]
    np.testing.assert_array_equal(readings["force_N"], fitted20.data.force)
    assert saved.document["parameters"]["braid_diameter"]["stderr"] is None
    assert (tmp_path / "deep" / "er" / "fit.png").read_bytes()[:4] == b"\x89PNG"


def test_saving_twice_gives_the_same_bytes(fitted20: Identification, tmp_path: Path) -> None:
    first = [p.read_bytes() for p in write_fit(fitted20, tmp_path / "a")]
    assert first == [p.read_bytes() for p in write_fit(fitted20, tmp_path / "b")]


def test_pressure_dependent_muscle_round_trips(fitted20: Identification) -> None:
    law = famjax.materials.PressurePolynomialMaterial([1e5, 5e5], [[1e6, -2e6], [3e6, 0.1e6]])
    muscle = famjax.Muscle(fitted20.muscle.geometry, law, 1e4)
    again = muscle_from_dict(json.loads(json.dumps(muscle_as_dict(muscle))))
    assert float(again.force(0.27, 3e5)) == float(muscle.force(0.27, 3e5))


def test_unit_systems_agree(fitted20: Identification) -> None:
    si, us, metric = (summary_as_dict(fitted20, system) for system in ("si", "us", "metric"))
    for name, to_psi in (("E_1", 6894.757293168361), ("E_3", 6894.757293168361)):
        assert us["parameters"][name]["unit"] == "psi"
        assert us["parameters"][name]["value"] * to_psi == pytest.approx(
            si["parameters"][name]["value"], rel=1e-14
        )
        assert metric["parameters"][name]["value"] * 1e6 == pytest.approx(
            si["parameters"][name]["value"], rel=1e-14
        )
    assert us["parameters"]["braid_diameter"]["value"] * 0.0254 == pytest.approx(0.0236)
    assert us["coefficients_Pa"] == si["coefficients_Pa"]


def test_report_is_one_self_contained_page(fitted20: Identification) -> None:
    page = html_report(fitted20)
    assert page.startswith("<!doctype html>")
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    for needed in ("<svg", "braid_diameter", "Drucker-stable", fitted20.data.sha256, "At a bound"):
        assert needed in page


def test_picture_shows_points_isobars_and_the_unstable_part(fitted20: Identification) -> None:
    import dataclasses

    axes = {axis.get_xlabel(): axis for axis in plot_fit(fitted20, "us").axes}
    law = axes["engineering strain"]
    assert law.get_ylabel() == "true stress, psi"
    dashed = [line for line in law.lines if line.get_linestyle() == "--"]
    assert all(np.isnan(np.asarray(line.get_ydata())).all() for line in dashed)
    known = fitted20.muscle
    law = famjax.PolynomialMaterial([2e6, -4e6, 1e6])
    muscle = famjax.Muscle(known.geometry, law, known.deadband_pressure)
    falling = dataclasses.replace(fitted20, muscle=muscle)
    law = {axis.get_xlabel(): axis for axis in plot_fit(falling).axes}["engineering strain"]
    dashed = [line for line in law.lines if line.get_linestyle() == "--"]
    assert any(np.isfinite(np.asarray(line.get_ydata())).any() for line in dashed)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not a JSON file"),
        ("{}", "must be a fit of schema 'famjax-fit/1', got None"),
        ('{"schema": "famjax-fit/1", "muscle": {}}', "no entry 'geometry'"),
    ],
)
def test_files_that_are_no_fit(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "fit.json"
    with pytest.raises(InputError, match="cannot read"):
        load_fit(path)
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        load_fit(path)


def test_error_bars_that_disagree_are_told(fitted20: Identification) -> None:
    """Replicates that spread four times as far as linear theory says."""
    angle = fitted20.estimate("braid_angle")

    def drawn(factor: float) -> Evidence:
        values = angle.value + factor * angle.stderr * np.array([[-1.0], [1.0]]) / np.sqrt(2)
        return Evidence(bootstrap=Bootstrap(("braid_angle",), values, 0, np.zeros((2, 60))))

    (told,) = evidence_warnings(drawn(4.0), fitted20)
    assert "braid_angle by bootstrap is 4 times that of the linear theory" in told
    assert evidence_warnings(drawn(1.1), fitted20) == ()


def test_the_saved_band_is_that_of_the_parameters(fitted20: Identification, tmp_path: Path) -> None:
    """The delta method by central differences of the muscle built by hand."""
    document = json.loads(write_fit(fitted20, tmp_path)[0].read_text())
    assert document["spread"]["band"] == "linear"
    saved = load_fit(tmp_path / "fit.json")
    L, P = np.array([0.27, 0.29]), np.array([4e5])
    rows = predict(saved, L, P)
    names = [*fitted20.problem.names, *fitted20.law.coefficients]
    at = np.array([fitted20.estimate(name).value for name in names])

    def force(values: np.ndarray) -> np.ndarray:
        diameter, angle, deadband = values[:3]
        braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle, length=0.296)
        bladder = famjax.Bladder(0.296, diameter, 1.8e-3, embedded=True)
        geometry = famjax.EstimatedGeometry(braid, bladder)
        muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(values[3:]), deadband)
        return np.asarray(muscle.force(L, P[0]))

    np.testing.assert_allclose([row["force_N"] for row in rows], force(at), rtol=1e-9)
    steps = np.diag(1e-6 * at)
    slopes = np.array([(force(at + step) - force(at - step)) / (2 * step.sum()) for step in steps])
    covariance = np.nan_to_num(
        fitted20.covariance
    )  # the diameter is at its bound: it does not vary
    expected = np.sqrt(np.einsum("pk,pq,qk->k", slopes, covariance, slopes))
    np.testing.assert_allclose([row["force_std_N"] for row in rows], expected, rtol=1e-5)
    assert {row["band"] for row in rows} == {"linear"}
    assert "muscle_force_N" not in rows[0]
