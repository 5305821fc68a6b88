"""The sliders of a report, moved in a headless browser."""

from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, NO_BROWSER, shown

import fitting
from fitting.report import Live, write_fit

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
def test_the_page_says_what_predict_says(fitted20: fitting.Identification, tmp_path: Path) -> None:
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


def test_units_of_the_report_are_those_of_the_sliders(fitted20: fitting.Identification) -> None:
    live = Live.of(fitted20, "us")
    assert live.units == {"length": "in", "pressure": "psi", "force": "lbf"}
    assert "NaN" not in live.json
