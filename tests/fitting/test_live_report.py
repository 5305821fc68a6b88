"""The sliders of a report, moved in a headless browser."""

from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, NO_BROWSER, browser

import fitting
from fitting.report import Live, write_fit


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason=NO_BROWSER)
def test_the_page_says_what_predict_says(fitted20: fitting.Identification, tmp_path: Path) -> None:
    write_fit(fitted20, tmp_path)
    fit, rng = fitting.load_fit(tmp_path / "fit.json"), np.random.default_rng(0)
    with browser(tmp_path / "profile") as page:
        for width in (400, 1100):
            page.show(tmp_path / "report.html", width)
            sizes = [int(page.value(f"document.getElementById('{one}').max"))
                     for one in ("length", "pressure")]  # fmt: skip
            for i, j in zip(*(rng.integers(0, size + 1, 10) for size in sizes), strict=True):
                for name, place in (("length", i), ("pressure", j)):
                    page.value(f"(one => {{one.value = {place}; one.dispatchEvent(new Event('input'))}})"
                               f"(document.getElementById('{name}'))")  # fmt: skip
                length, pressure = (float(page.value(f"document.getElementById('at-{one}').value"))
                                    for one in ("length", "pressure"))  # fmt: skip
                row = fitting.predict(fit, np.array([length * 1e-3]), np.array([pressure * 1e3]))[0]
                force, low, high = (
                    f"{row[key]:.5g}" for key in ("force_N", "low_95_N", "high_95_N")
                )
                said = page.value("document.getElementById('answer').textContent")
                assert said == f"Force {force} N, 95 % band {low} to {high} N"
            assert page.value("document.querySelectorAll('#drawn path').length") == 4
            assert page.value("document.documentElement.scrollWidth") <= width
        assert page.requests() == [(tmp_path / "report.html").resolve().as_uri()]
        assert page.complaints() == []


def test_units_of_the_report_are_those_of_the_sliders(fitted20: fitting.Identification) -> None:
    live = Live.of(fitted20, "us")
    assert live.units == {"length": "in", "pressure": "psi", "force": "lbf"}
    assert "NaN" not in live.json
