"""Headers and rows of reports are explained in the glossary, unless they are plain words."""

import html
import re
from pathlib import Path

import fitting
from famjax.boundary.units import UNITS
from fitting.evidence import Evidence, SharedErrors, carry, moves_of
from fitting.report import Findings


def normal(label: str) -> str:
    """A label without its unit, its numbers as signs: "contraction 0.250" is "contraction #"."""
    return re.sub(r"\d+(\.\d+)?", "#", re.sub(r"\s*\[[^]]*\]$", "", label)).strip().lower()


def terms() -> list[tuple[str, str]]:
    page = Path(__file__).parents[1] / "docs" / "glossary.md"
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", page.read_text(), re.MULTILINE)
    return [(one, said) for names, said in rows if names != "term" for one in names.split("; ")]


TERMS = {normal(one): said for one, said in terms()}
PLAIN = {
    *("name", "value", "unit", "quantity", "parameter", "entry", "what", "how", "which", "found"),
    *("expected", "measured", "model", "readings", "n", "mean", "std", "set", "file", "command"),
    *("versions", "cycles", "photographs", "volume", "strains visited", "gauge pressures"),
    *("lengths measured", "pressures measured", "forces measured", "braid thickness"),
}
"""Headers that every reader knows."""


def unexplained(labels: list[str]) -> set[str]:
    """Labels that stand nowhere. A label of five words or more, or a ratio, explains itself."""
    units = {unit.lower() for kind in UNITS.values() for unit in kind}
    words = {normal(one) for one in labels if re.search(r"[A-Za-z]", one)}
    known = units | TERMS.keys() | PLAIN
    return {one for one in words - known if len(one.split()) < 5 and " over " not in one}


def test_terms_are_said_once_and_each_is_explained() -> None:
    assert len({one for one, _ in terms()}) == len(terms()) > 150
    assert all(10 < len(said) < 200 for said in TERMS.values())
    assert unexplained(["RMSE", "no word of it", "N", "12.5"]) == {"no word of it"}


def test_tables_of_a_fit_with_all_evidence() -> None:
    data = fitting.load_bundled("DMSP-20-300")
    found = fitting.identify(data, order=3, starts=2)
    errors = SharedErrors(
        rest_length=1e-4, shortening=1e-3, pressure_reading=2e-3, pressure_zero=200.0,
        force_reading=2e-3, force_zero=0.1, wall_thickness=2e-5,
    )  # fmt: skip
    evidence = Evidence(
        validations=(fitting.validate(found, "pressure"), fitting.validate(found, "length")),
        profiles=fitting.profile(found, ["deadband_pressure"]),
        bootstrap=fitting.bootstrap(found, 3),
        shared=carry(found, moves_of(data, errors)),
    )
    tables = [*Findings(found, evidence).tables(), Findings(found, evidence).numbers("metric")]
    assert len(tables) == 4
    assert not unexplained([c for _, head, rows in tables for c in (*head, *(r[0] for r in rows))])


def labels_of_page(page: str) -> list[str]:
    """Headings, headers and first cells of a report, but for file names."""
    found = []
    for table in re.findall(r"<table.*?</table>", page, re.DOTALL):
        header = [html.unescape(one) for one in re.findall(r"<th(?: [^>]*)?>(.*?)</th>", table)]
        found += header
        if "SHA-256" not in header:
            rows = re.findall(r"<tr><td[^>]*>(.*?)</td>", table)
            found += [html.unescape(one) for one in rows]
            if "verdict" in header:  # which are plain words
                found += re.findall(r"<td>([a-z ]+)</td></tr>", table)
    return found
