"""What a fit leaves behind: a file that gives the same muscle back, a live page, a card."""

import dataclasses
import html
import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest
from browser import CHROMIUM, NO_BROWSER, shown
from maps import cylinder
from processes import command

import famjax
import fitting
from famjax.boundary.files import Origin
from famjax.cards import read_card
from fitting import Identification, InputError, load_fit, predict, validate, write_fit
from fitting.evidence import Evidence
from fitting.report import Findings, html_report, live
from fitting.saved import correlations, fit_as_dict


def test_fit_file_gives_the_same_muscle(fitted20, tmp_path):
    paths = write_fit(fitted20, tmp_path / "deep" / "er")
    assert sorted(p.name for p in paths) == ["fit.json", "fit.png", "report.html"]
    assert sorted(p.name for p in paths[0].parent.iterdir()) == sorted(p.name for p in paths)
    saved = load_fit(paths[0])
    for one in dataclasses.fields(Identification):
        if one.name not in {"solved", "outlook", "document", "mounted", "law", "data"}:
            mine, theirs = getattr(saved, one.name), getattr(fitted20, one.name)
            assert repr(mine) == repr(theirs), one.name
    assert repr(saved.data) == repr(fitted20.data)
    assert saved.warnings == fitted20.warnings
    assert jax.tree.structure(saved.muscle) == jax.tree.structure(fitted20.muscle)
    leaves = (jax.tree.leaves(one.muscle) for one in (saved, fitted20))
    for mine, theirs in zip(*leaves, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert saved.document["data"]["sha256"] == fitted20.data.sha256
    assert saved.document["rmse_N"] == fitted20.errors.rmse
    readings = saved.document["data"]["readings"]
    np.testing.assert_array_equal(readings["force_N"], fitted20.data.force)
    assert saved.document["parameters"]["braid_diameter"]["stderr"] is None
    assert (tmp_path / "deep" / "er" / "fit.png").read_bytes()[:4] == b"\x89PNG"
    np.testing.assert_allclose(saved.end.u, fitted20.end.u, atol=1e-7)
    assert saved.end.cost == pytest.approx(fitted20.end.cost, rel=1e-9)
    rows = [predict(one, np.array([0.27]), np.array([4e5]))[0] for one in (saved, fitted20)]
    for key in ("force_N", "low_95_N", "high_95_N"):
        assert rows[0][key] == pytest.approx(rows[1][key], rel=1e-6)
    errors = [validate(one, "length", starts=1).rmse for one in (saved, fitted20)]
    assert errors[0] == pytest.approx(errors[1], rel=1e-4)


ORIGIN = Origin("2026-01-31T12:00:00+01:00", "famjax fit 'my map.csv' --seed 3")


def test_the_report_is_one_page_that_says_whence_it_comes_and_what_was_measured(fitted20, tmp_path):
    page = html_report(Findings(fitted20), "us", origin=ORIGIN)
    assert page.startswith("<!doctype html>")
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    order = ("verdict", 'class="summary"', "<svg", "five numbers", "What to do next", ">Model<")
    places = [page.index(one, page.index("<body>")) for one in order]
    assert places == sorted(places)
    text = html.unescape(page)
    for needed in (
        "braid_diameter", "Drucker stability margin", "at a bound", "sigma = sum over n of E_n sign(eps)",
        fitted20.data.sha256, ORIGIN.date, ORIGIN.command, f"seed {fitted20.seed}",
        "rest length 11.654 in", "126 readings, 60 of them loaded",
        "assess fit.json --validate --profile --bootstrap 200",
    ):  # fmt: skip
        assert needed in text
    captions = re.findall(r'<p class="caption">(.*?)</p>', page)
    assert len(captions) > 1
    assert all(one.startswith(f"<b>Table {k}.</b> ") for k, one in enumerate(captions, 1))
    tested = Evidence(validations=(validate(fitted20, "length", starts=1),))
    assert Findings(fitted20, tested).untested == "--profile --bootstrap 200"
    assert ORIGIN.date not in html_report(Findings(fitted20))
    names, matrix = correlations(fitted20)
    assert names == ("braid_angle", "deadband_pressure", "E_1", "E_2", "E_3")  # D0 is at its bound
    document = json.loads(write_fit(fitted20, tmp_path, origin=ORIGIN)[0].read_text())
    assert document["origin"] == {"date": ORIGIN.date, "command": ORIGIN.command}
    assert matrix.shape == (5, 5)
    sliders = live(fitted20, "us")
    assert sliders["units"] == {"length": "in", "pressure": "psi", "force": "lbf"}
    assert "NaN" not in sliders["json"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda fit: fit.pop("muscle"), "entry 'muscle' is missing"),
        (lambda fit: fit.update(muscle=3), ""),
        (lambda fit: fit["spread"].update(directions=[[1.0, 2.0]]), "cannot reshape"),
        (lambda fit: fit["spread"].update(directions=[[1.0], [1.0, 2.0]]), "inhomogeneous"),
        (lambda fit: fit.update(spread=3), "not subscriptable"),
        (lambda fit: fit.pop("data"), "entry 'data' is missing"),
        (lambda fit: fit["data"]["readings"].update(pressure_Pa=[]), "have the same length"),
        (lambda fit: fit.update(series_compliance_m_per_N=[1.0]), "float"),
    ],
)
def test_damaged_fits_are_refused_when_they_are_read(fitted20, tmp_path, spoil, message):
    document = json.loads(json.dumps(fit_as_dict(fitted20)))
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(document))
    load_fit(path)
    spoil(document)
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=f"fit.json is damaged: .*{message}"):
        load_fit(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "cannot read"), ("{", "is not a JSON file"), ("{}", "a fit with schema 'famjax-fit/2'")],
)  # fmt: skip
def test_files_that_are_no_fit(tmp_path, content, message):
    if content:
        (tmp_path / "fit.json").write_text(content)
    with pytest.raises(InputError, match=message):
        load_fit(tmp_path / "fit.json")


def test_the_saved_band_is_that_of_the_parameters(fitted20, tmp_path):
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
        geometry = cylinder(diameter, np.degrees(angle), 0.296, 1.8e-3)
        muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(values[3:]), deadband)
        return np.asarray(muscle.force(L, P[0]))

    np.testing.assert_allclose([row["force_N"] for row in rows], force(at), rtol=1e-9)
    steps = np.diag(1e-6 * at)
    slopes = np.array([(force(at + step) - force(at - step)) / (2 * step.sum()) for step in steps])
    covariance = np.nan_to_num(fitted20.covariance)  # the diameter does not vary: at its bound
    expected = np.sqrt(np.einsum("pk,pq,qk->k", slopes, covariance, slopes))
    np.testing.assert_allclose([row["force_std_N"] for row in rows], expected, rtol=1e-5)
    assert {row["band"] for row in rows} == {"linear"}


# ---- the card of a saved fit


@pytest.fixture(scope="module")
def fit_json(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fit")
    command("fit", "DMSP-10-250", "--law", "neo-hookean", "--output", folder)
    return folder / "fit.json"


@pytest.mark.slow
def test_the_card_command_writes_what_predict_says(fit_json, tmp_path, run):
    path = tmp_path / "muscle.json"
    code, out, _ = run("card", fit_json, "-o", path, "--name", "mine")
    assert (code, f"written: {path}" in " ".join(out.split())) == (0, True)
    card, fit = read_card(path), load_fit(fit_json)
    rows = predict(fit, np.array([0.21, 0.24]), np.array([3e5, 5e5]))
    wanted = [max(row["force_N"], 0.0) for row in rows]  # predict does not cut a slack muscle
    states = (np.array([row[key] for row in rows]) for key in ("length_m", "pressure_Pa"))
    np.testing.assert_allclose(card.safe().force(*states), wanted, rtol=1e-9)
    assert (card.name, card.draws.seed, len(card.draws.rows)) == ("mine", 0, 32)
    assert card.provenance.data_sha256 == fit.document["data"]["sha256"]
    assert card.provenance.command.startswith("famjax")
    assert " && famjax" in card.provenance.command


MOVE = """page => {
  const of = id => page.document.getElementById(id);
  const found = PLACES.map(parts => {
    ["length", "pressure"].forEach((name, k) => {
      of(name).value = Math.round(parts[k] * of(name).max);
      of(name).dispatchEvent(new page.Event("input"));
    });
    return [+of("at-length").value, +of("at-pressure").value, of("answer").textContent];
  });
  const drawn = page.document.querySelectorAll("#drawn path").length;
  return [found, drawn, page.innerWidth - page.document.documentElement.scrollWidth];
}"""


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason=NO_BROWSER)
def test_the_page_says_what_predict_says(fitted20, tmp_path):
    write_fit(fitted20, tmp_path)
    fit, rng = fitting.load_fit(tmp_path / "fit.json"), np.random.default_rng(0)
    for width in (400, 1100):
        move = MOVE.replace("PLACES", str(rng.random((10, 2)).tolist()))
        answer, fetched, complaints = shown(tmp_path / "report.html", width, move, tmp_path)
        found, drawn, to_spare = answer
        assert (drawn, fetched, complaints) == (4, [], [])
        assert to_spare >= 0
        for length, pressure, said in found:
            row = fitting.predict(fit, np.array([length * 1e-3]), np.array([pressure * 1e3]))[0]
            force, low, high = (f"{row[key]:.5g}" for key in ("force_N", "low_95_N", "high_95_N"))
            assert said == f"Force {force} N, 95 % band {low} to {high} N"
