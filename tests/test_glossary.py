"""Headers and rows of reports are explained in the glossary, unless they are plain words."""

import html
import re
from pathlib import Path

import numpy as np
import pytest

import fitting
from famjax.boundary.units import UNITS
from fitting.evidence import Evidence, SharedErrors, carry, moves_of
from fitting.families import known_laws
from fitting.posterior import Posterior, posterior_table
from fitting.records import BranchPairs, fit_hysteresis, hysteresis_table, leave_out
from fitting.report import Findings, specimen_table

GLOSSARY = Path(__file__).parents[1] / "docs" / "glossary.md"
_UNITS = {unit for kind in UNITS.values() for unit in kind}


def normal(label: str) -> str:
    """A label without its unit, its numbers as signs: "contraction 0.250" is "contraction #"."""
    return re.sub(r"\d+(\.\d+)?", "#", re.sub(r"\s*\[[^]]*\]$", "", label)).strip().lower()


def terms() -> list[tuple[str, str]]:
    """What the glossary explains, and how."""
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", GLOSSARY.read_text(), re.MULTILINE)
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
    units = {unit.lower() for unit in _UNITS}
    words = {normal(one) for one in labels if re.search(r"[A-Za-z]", one)}
    known = units | TERMS.keys() | PLAIN
    return {one for one in words - known if len(one.split()) < 5 and " over " not in one}


def labels_of(tables: list) -> list[str]:
    """Headers and first cells."""
    return [cell for _, header, rows in tables for cell in (*header, *(row[0] for row in rows))]


def test_terms_are_said_once_and_each_is_explained() -> None:
    assert len({one for one, _ in terms()}) == len(terms()) > 150
    assert all(10 < len(said) < 200 for said in TERMS.values())
    for one in ("KKT residual", "duality gap", "ridge", "stability margin", "deadband", "verdict",
                "sandwich error", "left out", "band", "shared errors", "condition"):  # fmt: skip
        assert normal(one) in TERMS


def test_what_is_not_there_is_found() -> None:
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
    tables = [
        *Findings(found, evidence).tables(),
        Findings(found, evidence).numbers("metric"),
        specimen_table(found, "metric"),
    ]
    assert len(tables) == 8
    assert not unexplained(labels_of(tables))
    cells = [cell for _, _, rows in tables for row in rows for cell in row[3:]]
    assert "identified" in TERMS
    assert not unexplained([cell for cell in cells if re.fullmatch(r"[a-z -]+", cell)])


@pytest.mark.slow
def test_parameters_of_every_law_and_the_table_of_families() -> None:
    data = fitting.load_bundled("DMSP-20-300")
    for law in known_laws():
        found = fitting.identify(data, law=law, starts=1, parameters={
            "end_factor": fitting.Parameter(), "rest_length": fitting.Parameter(),
            "braid_compliance": fitting.Parameter(),
        })  # fmt: skip
        assert not unexplained(labels_of(Findings(found).tables()[:1]))
    chosen = fitting.choose(data)
    table = fitting.choice.choice_table(chosen, "metric")
    assert not unexplained([*table[1], *(row[-1] for row in table[2])])
    assert not unexplained([word for row in table[2] for word in row[0].split(", ")])


@pytest.mark.slow
def test_tables_of_a_posterior_and_of_hysteresis() -> None:
    draws = np.random.default_rng(0).normal(size=(4, 40, 1))
    none = np.zeros((4, 40))
    posterior = Posterior(
        ("braid_angle",), ("angle",), draws, none > 0, none, none, None, 1.0, 0, False, "one"
    )
    length, half = np.linspace(0.25, 0.22, 12), np.linspace(1.0, 4.0, 12)
    pairs = BranchPairs.joined([
        BranchPairs.ramp(
            L, np.linspace(1e5, 5e5, 12), half, turn_pressure=6e5, rest_length=0.25, name=f"{L}"
        )
        for L in length[2::4]
    ])  # fmt: skip
    slips = leave_out(fit_hysteresis(pairs))
    labels = labels_of([posterior_table(posterior, "metric"), hysteresis_table(slips, "metric")])
    assert "R-hat" in labels
    assert "error with one length left out" in labels
    assert not unexplained([*labels, "error with one pressure left out"])


def labels_of_page(page: str) -> list[str]:
    """Headings, headers and first cells of a report, but for file names."""
    found = []
    for table in re.findall(r"<table.*?</table>", page, re.DOTALL):
        header = [html.unescape(one) for one in re.findall(r"<th(?: [^>]*)?>(.*?)</th>", table)]
        found += header
        if "SHA-256" not in header:
            rows = re.findall(r"<tr><td[^>]*>(.*?)</td>", table)
            found += [html.unescape(one) for one in rows]
            if "verdict" in header:
                found += [
                    html.unescape(one) for one in re.findall(r"<td>([a-z ]+)</td></tr>", table)
                ]
    return found
