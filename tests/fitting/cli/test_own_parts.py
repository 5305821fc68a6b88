"""Laws, geometries, terms and models of a user's own, by `module:Class`, in every command that fits."""

import json
import sys
from pathlib import Path

import pytest

from famjax.__main__ import main

PARTS = """
import famjax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Foreign(famjax.AbstractMuscle):
    rest_length: Float[Array, ""] = famjax.parameters.number("m")
    section: Float[Array, ""] = famjax.parameter("m2", low=0.0, linear=True)
    shape: Float[Array, ""] = famjax.parameter(low=0.5, high=5.0)

    def force(self, length, pressure):
        contraction = 1 - jnp.asarray(length) / self.rest_length
        return self.section * pressure * (1 - self.shape * contraction) ** 2

    def length_range(self):
        return 0.5 * self.rest_length, 1.1 * self.rest_length


class Rubber(famjax.materials.AbstractHyperelastic):
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

    def force(self, at, pressure):
        return self.spring_rate * (at.length - self.length)


class Capped(famjax.geometries.AbstractGeometry):
    cylinder: famjax.geometries.AbstractGeometry
    cap_length: Float[Array, ""] = famjax.parameter("m", low=0.0, high=0.05, default=0.0)

    def dimensions(self, length, pressure):
        return self.cylinder.dimensions(self.moved(length, self.rest_length), pressure)

    def moved(self, length, rest):
        return rest + (length - rest) * rest / (rest - self.cap_length)

    def length_range(self):
        rest = self.rest_length
        share = (rest - self.cap_length) / rest
        return tuple(rest + (end - rest) * share for end in self.cylinder.length_range())

    rest_length = property(lambda self: self.cylinder.rest_length)
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a module of own parts, from which the command starts."""
    (tmp_path / "own_parts_here.py").write_text(PARTS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "own_parts_here", raising=False)
    return tmp_path


def run(*words: str) -> int:
    with pytest.raises(SystemExit) as stop:
        main(list(words))
    assert isinstance(stop.value.code, int | None)
    return stop.value.code or 0


FIT = (
    "fit",
    "DMSP-20-300",
    "--geometry",
    "own_parts_here:Capped",
    "--term",
    "own_parts_here:Spring",
)


@pytest.mark.slow
def test_parts_take_part_are_saved_and_predict(here: Path, capsys: pytest.CaptureFixture) -> None:
    assert run(*FIT, "--bounds", "cap_length_mm=10", "--json") == 0
    found = json.loads(capsys.readouterr().out)["parameters"]
    assert found["cap_length"]["value"] == pytest.approx(10)  # held
    assert found["spring_rate"]["unit"] == "N/m"
    assert 0 < found["spring_rate"]["value"] < 5e3
    fit = "famjax-fit/fit.json"
    asked = ("--length", "270mm", "--pressure", "5bar", "--json", "--own", "own_parts_here")
    assert run("predict", fit, *asked) == 0
    force = json.loads(capsys.readouterr().out)[0]["force_N"]
    assert run("card", fit, "--own", "own_parts_here") == 0
    capsys.readouterr()
    card = "famjax-fit/card.json"
    assert run("predict", card, *asked) == 0
    assert json.loads(capsys.readouterr().out)[0]["force_N"] == pytest.approx(force, rel=1e-9)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--term", "own_parts_here:Capped"), "derived from famjax.terms.AbstractForceTerm"),
        (("--term", "own_parts_here:Needy"), "cannot be identified by its class"),
        (("--geometry", "own_parts_here:Cone"), "was not found"),
        (("--geometry", "own_parts_here:Capped", "--shape", "m.nc"), "either --shape or --geometry"),
        (("--term", "own_parts_here:Spring", "--free", "spring"), "unknown parameter; available"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_before_any_fit(
    here: Path, words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture
) -> None:
    assert run("fit", "DMSP-20-300", *words) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (here / "famjax-fit" / "fit.json").exists()
