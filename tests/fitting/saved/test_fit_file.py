"""What a fit leaves behind: one JSON file that gives the same muscle back, a picture, a page."""

import dataclasses
import html
import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest
from browser import Browser, check_page

import famjax
from famjax.boundary.files import Origin
from famjax.cards import muscle_as_dict, muscle_from_dict
from fitting import (
    Identification,
    InputError,
    load_fit,
    predict,
    validate,
    write_fit,
)
from fitting.evidence import Evidence, evidence_warnings
from fitting.report import Findings, html_report, plot_fit
from fitting.saved import correlations, fit_as_dict, summary_as_dict
from fitting.validation import Bootstrap


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
    page = html_report(Findings(fitted20))
    assert page.startswith("<!doctype html>")
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    for needed in (
        "<svg",
        "braid_diameter",
        "Drucker-stable",
        fitted20.data.sha256,
        "at the bound",
        "sigma = sum over n of E_n sign(eps)",
    ):
        assert needed in page
    order = ("verdict", 'class="summary"', "<svg", "five numbers", "What to do next", ">Model<")
    places = [page.index(one, page.index("<body>")) for one in order]
    assert places == sorted(places)


ORIGIN = Origin("2026-01-31T12:00:00+01:00", "famjax fit 'my map.csv' --seed 3")


def test_report_says_where_it_comes_from_and_what_was_measured(
    fitted20: Identification, tmp_path: Path
) -> None:
    page = html_report(Findings(fitted20), "us", origin=ORIGIN)
    text = html.unescape(page)
    assert ORIGIN.date in text
    assert ORIGIN.command in text
    assert f"seed {fitted20.seed}" in text
    for entry in ("rest length</td><td>11.654</td><td>in", "126, of which 60 pull", "embedded"):
        assert entry in page
    captions = re.findall(r'<p class="caption">(.*?)</p>', page)
    assert len(captions) > 3
    assert all(one.startswith(f"<b>Table {k}.</b> ") for k, one in enumerate(captions, 1))
    assert "<figcaption><b>Figure 1.</b>" in page
    names, matrix = correlations(fitted20)
    assert names == ("braid_angle", "deadband_pressure", "E_1", "E_2", "E_3")  # D0 is at its bound
    assert ORIGIN.date not in html_report(Findings(fitted20))
    document = json.loads(write_fit(fitted20, tmp_path, origin=ORIGIN)[0].read_text())
    assert document["origin"] == {"date": ORIGIN.date, "command": ORIGIN.command}
    saved = document["correlations"]
    assert saved["parameters"] == list(names)
    np.testing.assert_array_equal(saved["matrix"], matrix)


def test_correlations_are_those_of_the_covariance(fitted20: Identification) -> None:
    _, matrix = correlations(fitted20)
    stderr = np.sqrt(np.diag(fitted20.covariance))[[1, 4]]
    assert matrix[0, 3] * stderr[0] * stderr[1] == pytest.approx(fitted20.covariance[1, 4])
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    np.testing.assert_array_equal(matrix, matrix.T)


def test_report_fits_a_narrow_screen(fitted20: Identification) -> None:
    """The page takes the width of the device, and what is wider than it scrolls by itself."""
    page = html_report(Findings(fitted20))
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    assert page.count('<div class="wide"><table') == page.count("<table") > 3
    assert re.search(r"\.wide \{ overflow-x: auto;", page)
    assert "@media (max-width: 40rem)" in page


@pytest.mark.parametrize("width", [390, 1280])
def test_report_stands_on_a_screen(
    headless: Browser, fitted20: Identification, tmp_path: Path, width: int
) -> None:
    path = tmp_path / "report.html"
    path.write_text(html_report(Findings(fitted20)), encoding="utf-8")
    check_page(headless, path, width, ("Model",))


def test_what_is_printed_of_a_result_is_a_line(fitted20: Identification, tmp_path: Path) -> None:
    write_fit(fitted20, tmp_path)
    saved = load_fit(tmp_path / "fit.json")
    drawn = Bootstrap(("a", "b"), np.zeros((2, 2)), 1, np.zeros((2, 60)))
    for one, said in (
        (fitted20, "Identification(DMSP-20-300: polynomial of order 3, constraint drucker"),
        (fitted20.data, "126 readings, 60 of them loaded, 222 to 296 mm, 35 to 675 kPa"),
        (saved, "Identification(DMSP-20-300: polynomial of order 3, constraint drucker"),
        (drawn, "Bootstrap(2 replicates, 1 failed of a, b)"),
    ):
        assert said in repr(one)
        assert len(repr(one)) < 400
    assert "RMSE 7.5" in repr(fitted20)
    assert "E_3=2.57" in repr(fitted20)


def test_picture_shows_points_isobars_and_the_unstable_part(fitted20: Identification) -> None:
    axes = {axis.get_xlabel(): axis for axis in plot_fit(fitted20, "us").axes}
    law = axes["engineering strain"]
    assert law.get_ylabel() == "true stress, psi"
    dashed = [line for line in law.lines if line.get_linestyle() == "--"]
    assert all(np.isnan(np.asarray(line.get_ydata())).all() for line in dashed)
    known = fitted20.muscle
    law = famjax.PolynomialMaterial([2e6, -4e6, 1e6])
    muscle = famjax.Muscle(known.geometry, law, known.deadband_pressure)
    falling = dataclasses.replace(fitted20, mounted=fitted20.mounted.with_muscle(muscle))
    law = {axis.get_xlabel(): axis for axis in plot_fit(falling).axes}["engineering strain"]
    dashed = [line for line in law.lines if line.get_linestyle() == "--"]
    assert any(np.isfinite(np.asarray(line.get_ydata())).any() for line in dashed)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not a JSON file"),
        ("{}", "must be a fit of schema 'famjax-fit/2', got None"),
        ('{"schema": "famjax-fit/2", "muscle": {}}', "no entry 'data'"),
    ],
)
def test_files_that_are_no_fit(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "fit.json"
    with pytest.raises(InputError, match="cannot read"):
        load_fit(path)
    path.write_text(content)
    with pytest.raises(InputError, match=message):
        load_fit(path)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda fit: fit.pop("muscle"), "no entry 'muscle'"),
        (lambda fit: fit.update(muscle=3), ""),
        (lambda fit: fit["spread"].update(directions=[[1.0, 2.0]]), "cannot reshape"),
        (lambda fit: fit["spread"].update(directions=[[1.0], [1.0, 2.0]]), "inhomogeneous"),
        (lambda fit: fit.update(spread=3), "not subscriptable"),
        (lambda fit: fit.pop("data"), "no entry 'data'"),
        (lambda fit: fit["data"]["readings"].update(pressure_Pa=[]), "equally long"),
        (lambda fit: fit.update(series_compliance_m_per_N=[1.0]), "float"),
    ],
)
def test_damaged_fits_are_refused_when_they_are_read(
    fitted20: Identification, tmp_path: Path, spoil: Callable[[dict], object], message: str
) -> None:
    document = fit_as_dict(fitted20)
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(document))
    load_fit(path)
    spoil(document)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=f"fit.json is damaged: .*{message}"):
        load_fit(path)


def test_a_saved_fit_is_what_was_identified(fitted20: Identification, tmp_path: Path) -> None:
    """It validates, profiles and predicts as the fit does that was saved."""
    saved = load_fit(write_fit(fitted20, tmp_path)[0])
    for one in dataclasses.fields(Identification):
        if one.name not in {"solved", "outlook", "document", "mounted", "law", "data"}:
            mine, theirs = getattr(saved, one.name), getattr(fitted20, one.name)
            assert repr(mine) == repr(theirs), one.name
    assert repr(saved.data) == repr(fitted20.data)
    assert saved.warnings == fitted20.warnings
    np.testing.assert_allclose(saved.end.u, fitted20.end.u, atol=1e-7)
    assert saved.end.cost == pytest.approx(fitted20.end.cost, rel=1e-9)
    rows = [predict(one, np.array([0.27]), np.array([4e5]))[0] for one in (saved, fitted20)]
    for key in ("force_N", "low_95_N", "high_95_N"):
        assert rows[0][key] == pytest.approx(rows[1][key], rel=1e-6)
    errors = [validate(one, "length", starts=1).rmse for one in (saved, fitted20)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-4)


def test_a_fit_without_a_certificate_can_be_written(fitted20: Identification) -> None:
    nothing = dict.fromkeys(
        ("kkt_residual", "duality_gap", "gradient_residual", "condition"), math.nan
    )
    certificate = dataclasses.replace(fitted20.certificate, **nothing)
    result = dataclasses.replace(fitted20, converged=False, certificate=certificate)
    assert json.loads(json.dumps(summary_as_dict(result), allow_nan=False))["converged"] is False


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
