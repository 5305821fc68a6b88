"""Parts of a user's own, by `module:Class`; a file of somebody else imports no module that it names."""

import copy
import json
import sys
from pathlib import Path
from typing import Any

import pytest

import famjax
import fitting
from famjax.boundary.errors import InputError
from famjax.cards import read_card
from fitting.cli.problem import asked_of
from fitting.saved import fit_as_dict

PARTS = """
import pathlib
import famjax
from jaxtyping import Array, Float

pathlib.Path("imported").write_text("")


class Law(famjax.materials.AbstractHyperelastic):
    shear_modulus: Float[Array, ""] = famjax.parameter("Pa", kind="stress", low=0.0, linear=True)

    def energy(self, axial_stretch, hoop_stretch):
        squares = axial_stretch**2 + hoop_stretch**2 + (axial_stretch * hoop_stretch) ** -2
        return self.shear_modulus / 2 * (squares - 3)

    initial_shear_modulus = property(lambda self: self.shear_modulus)


class Spring(famjax.terms.AbstractForceTerm):
    spring_rate: Float[Array, ""] = famjax.parameter("N/m", low=0.0, high=5e3)

    def force(self, at, pressure):
        return self.spring_rate * (at.length - 0.2)


class Needy(Spring):
    length: float


class Capped(famjax.geometries.AbstractGeometry):
    cylinder: famjax.geometries.AbstractGeometry
    cap_length: Float[Array, ""] = famjax.parameter("m", low=0.0, high=0.05, default=0.0)

    def dimensions(self, length, pressure):
        rest = self.rest_length
        moved = rest + (length - rest) * rest / (rest - self.cap_length)
        return self.cylinder.dimensions(moved, pressure)

    def length_range(self):
        rest = self.rest_length
        share = (rest - self.cap_length) / rest
        return tuple(rest + (end - rest) * share for end in self.cylinder.length_range())

    rest_length = property(lambda self: self.cylinder.rest_length)
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that the command starts from, with a module that says when it is imported."""
    (tmp_path / "spy.py").write_text(PARTS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.delitem(sys.modules, "spy", raising=False)
    return tmp_path


@pytest.mark.slow
def test_parts_take_part_are_saved_and_predict(here, said):
    parts = "--geometry", "spy:Capped", "--term", "spy:Spring"
    told = said("fit", "DMSP-20-300", *parts, "--bounds", "cap_length_mm=10", "--json")
    numbers = json.loads(told)["parameters"]
    assert numbers["cap_length"]["value"] == pytest.approx(0.01)  # held
    assert numbers["spring_rate"]["unit"] == "N/m"
    assert 0 < numbers["spring_rate"]["value"] < 5e3
    fit, card = "famjax-fit/fit.json", "famjax-fit/card.json"
    asked = ("--length", "270mm", "--pressure", "5bar", "--json", "--own", "spy")
    said("card", fit, "--own", "spy")
    (one,), (other,) = (json.loads(said("predict", file, *asked)) for file in (fit, card))
    assert other["force_N"] == pytest.approx(one["force_N"], rel=1e-9)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--term", "spy:Capped"), "derived from famjax.terms.AbstractForceTerm"),
        (("--term", "spy:Needy"), "cannot be created from its class alone"),
        (("--geometry", "spy:Cone"), "cannot be imported"),
        (("--term", "spy:Spring", "--free", "spring"), "unknown parameter; available"),
    ],
)
def test_what_cannot_be_used_is_refused_before_any_fit(here, words, message, refused):
    refused(message, "fit", "DMSP-20-300", *words)
    assert not (here / "famjax-fit" / "fit.json").exists()


# ---- files of somebody else

LAW = {"type": "spy:Law", "shear_modulus_Pa": 2e5}
GOLDEN = Path(__file__).parents[2] / "famjax" / "cards" / "golden" / "card-1.json"
SERIES = {
    "between_N": 1.0, "rest_lengths_m": [0.3, 0.2], "length_ratios": [0.8, 1.0],
    "pressures_Pa": [1e5, 5e5],
}  # fmt: skip


@pytest.fixture
def files(fitted20: fitting.Identification) -> dict[str, Any]:
    card = json.loads(GOLDEN.read_text()) | {"sample": None}
    plain = card["members"][1]
    foreign = copy.deepcopy(plain) | {"family": "foreign", "weight": 0.5}
    foreign["muscle"]["material"] = LAW
    of_card = {key: value for key, value in foreign.items() if key != "family"} | {"weight": 0.0}
    fit = json.loads(json.dumps(fit_as_dict(fitted20)))
    fit["spread"]["directions"] = []
    return {
        "card": card | {"members": [plain | {"weight": 1.0}, of_card]},
        "fit": fit | foreign,
        "series": fit | {"series": SERIES, "averaged_with": [foreign]},
        "alike": fit | {"alike": [foreign]},
        "lengths": fit | {"other_lengths": {"between_N": 1.0, "members": [foreign]}},
        "problem": fit | {"problem": {"asked": {"law": "spy:Law"}}},
    }


@pytest.mark.parametrize("kind", ["card", "fit", "series", "alike", "lengths", "problem"])
def test_a_file_imports_nothing_unless_the_module_is_named(kind, files, here, refused):
    path = here / f"{kind}.json"
    path.write_text(json.dumps(files[kind]))
    predict = ["predict", path, "--length", "270mm", "--pressure", "5bar"]
    words = ["assess", path, "--validate"] if kind == "problem" else predict
    told = refused("'spy:Law', which is not part of famjax", *words)
    assert "--own spy, or own=('spy',) in Python" in told
    assert "spy" not in sys.modules
    assert not (here / "imported").exists()


def test_a_module_that_is_named_is_imported(files, here):
    for kind, document in files.items():
        (here / f"{kind}.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="not part of famjax"):
        read_card("card.json", own=("other", famjax.materials.YeohMaterial))
    assert not (here / "imported").exists()
    law = type(read_card("card.json", own=("spy",)).members[1].muscle.material)
    assert (law.__module__, law.__name__) == ("spy", "Law")
    assert (here / "imported").exists()
    assert type(fitting.load_fit("fit.json", own=(law,)).muscle.material) is law
    assert len(fitting.load_fit("series.json", own=("spy:Law",)).outlook.others) == 1
    with pytest.raises(InputError, match="the law is 'spy:Law'"):  # whoever was imported before
        asked_of(fitting.load_fit("problem.json"))
