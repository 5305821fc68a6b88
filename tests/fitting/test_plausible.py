"""Numbers of another unit than they say, and arguments of another type, are refused in a sentence."""

import json
import re
import subprocess
import sys

import jax
import numpy as np
import pytest

import fitting
from fitting import ForceData, Parameter, Specimen, identify
from fitting.parameters import complete_table


def specimen(**given) -> Specimen:
    return Specimen(**{"name": "m", "rest_length": 0.25, "wall_thickness": 1.8e-3, **given})


def loads(**given) -> ForceData:
    """A map of two readings; numbers in lists become arrays."""
    known = {"force": [300.0, 100.0], "pressure": [3e5, 3e5], "length": [0.25, 0.23]}
    every = {**known, "specimen": specimen(), **given}
    return ForceData(**{k: np.array(v) if isinstance(v, list) else v for k, v in every.items()})


def table(bounds=None, parameters=None):
    law = fitting.families.law_named("polynomial", 3)
    bore = specimen(nominal_diameter=20e-3)
    return complete_table(bore, law.coefficients, bounds or {}, parameters or {})


SLIPS = {
    "lengths in mm": (lambda: loads(length=[270.0, 250.0]), "looks? like mm, not m"),
    "lengths in a column of cm": (
        lambda: loads(length=[2.5, 2.3], units={"length": "cm"}), "like mm, not cm"),
    "pressures in bar": (lambda: loads(pressure=[3.0, 3.0]), "like bar, not Pa"),
    "pressures of Pa in kPa": (
        lambda: loads(pressure=[6e8, 5e8], units={"pressure": "kPa"}), "like Pa, not kPa"),
    "forces of N in kN": (
        lambda: loads(force=[1.6e6, 1e5], units={"force": "kN"}), "like N, not kN"),
    "rest length": (lambda: specimen(rest_length=250.0), "like mm, not m"),
    "bore": (lambda: specimen(nominal_diameter=20.0), "like mm, not m"),
    "wall": (lambda: specimen(wall_thickness=1.8), "like mm, not m"),
    "bounds in mm": (lambda: table({"braid_diameter": (20, 23)}), "like mm, not m"),
    "bounds in degrees": (lambda: table({"braid_angle": (60, 70)}), "like deg, not rad"),
    "coefficients in MPa": (lambda: table({"E_1": (0, 5)}), "like MPa, not Pa"),
    "prior of a coefficient in MPa": (
        lambda: table(parameters={"E_1": Parameter(prior=(5, 1), unit="Pa")}), "like MPa, not Pa"),
    "held value in mm": (
        lambda: table(parameters={"braid_diameter": Parameter(20, vary=False, unit="m")}),
        "like mm, not m"),
    "prior narrower than a fit tells": (
        lambda: table(parameters={"braid_diameter": Parameter(prior=(21, 1e-6), unit="mm")}),
        "must have a standard deviation of"),
    "prior of what its bounds hold": (
        lambda: table({"braid_diameter": (0.021, 0.021)},
                      {"braid_diameter": Parameter(prior=(21, 1), unit="mm")}),
        "the bounds on braid_diameter fix it"),
    "starts": (lambda: identify(loads(), starts=2.5), "starts must be a whole number"),
    "no geometry": (lambda: fitting.sweep(loads(), None), "geometry"),
    "order": (lambda: identify(loads(), order=[1, 3]), "order of the law must be"),
    "one map together": (lambda: fitting.identify_together(loads()), "in a list, got a single map"),
    "bounds of text": (lambda: identify(loads(), bounds={"braid_angle": "a"}), "must be .low, high."),
    "parameters in a list": (lambda: identify(loads(), parameters=[1]), "must be a mapping"),
    "texts as forces": (lambda: loads(force=["a", "b"]), "force must contain numbers"),
    "a dictionary as specimen": (lambda: loads(specimen={}), "must be a fitting.Specimen"),
    "a number to read": (lambda: fitting.read_csv(3), "must be a file path or an open text"),
    "no file": (lambda: fitting.read_csv("none.csv"), "no such file"),
    "a folder": (lambda: fitting.read_csv("/"), "Is a directory"),
    "a number to load": (lambda: fitting.load_fit(3), "must be a path"),
    "bootstrap of a map": (lambda: fitting.bootstrap(loads()), "result of fitting.identify"),
    "prediction of a map": (lambda: fitting.predict(loads(), 0.2, 1e5), "result of fitting.identify"),
}  # fmt: skip


def outcomes() -> dict[str, str]:
    found = {}
    for slip, (call, _) in SLIPS.items():
        try:
            call()
        except Exception as error:
            found[slip] = f"{type(error).__name__}: {error}"
    return found


@pytest.fixture(scope="module")
def ends() -> dict[str, str]:
    """The outcomes in a process in which annotations are not checked, as a user's is."""
    done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_ends_in_one_sentence(slip, ends):
    assert re.match(f"InputError: .*{SLIPS[slip][1]}", ends.get(slip, "nothing"))


@pytest.mark.parametrize("size", [2e-3, 150e-3])
@pytest.mark.parametrize("length", [10e-3, 3.0])
def test_real_muscles_are_not_refused(size, length):
    sizes = {"rest_length": length, "nominal_diameter": size, "wall_thickness": size / 10}
    muscle = specimen(**sizes, embedded=True)
    lengths = [length, 0.9 * length]
    data = loads(force=[1e5, 10.0], pressure=[1e7, 1e7], length=lengths, specimen=muscle)
    assert data.max_force == 1e5


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    print(json.dumps(outcomes()))
