"""Every fault that a verdict should name, made in a sound map, and sound maps in which there is none."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from slow_cases import slow_after

import famjax
from fitting import ForceData, Identification, Parameter, Specimen, identify
from fitting.faults import doubtful, suspect, suspect_refused
from fitting.specimen import any_units
from fitting.verdict import judge


def fit(data: ForceData) -> Identification:
    """One law, a few starts."""
    return identify(data, law="ogden", parameters={"end_factor": Parameter()}, starts=4)


def known_muscle(
    bore: float, rest: float, angle_deg: float, lengths: int = 8, *, pushes: bool = False
) -> ForceData:
    """Readings of a known muscle with 0.3 % of noise; where it is slack, none or how hard it pushes."""
    diameter = bore + 2e-3
    braid = famjax.Braid.from_rest(
        diameter=diameter, braid_angle=math.radians(angle_deg), length=rest
    )
    bladder = famjax.Bladder(rest, diameter, 1.5e-3, embedded=True)
    law = famjax.materials.MooneyRivlinMaterial(0.2e6, 0.05e6)
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 25e3)
    grid = np.meshgrid(rest * np.linspace(1, 0.84, lengths), np.linspace(1.2e5, 6e5, 6))
    L, P = (one.ravel() for one in grid)
    force = np.asarray(muscle.force(L, P))
    noise = 3e-3 * force.max() * np.random.default_rng(1).normal(size=force.size)
    specimen = Specimen("known", rest, 1.5e-3, nominal_diameter=bore, embedded=True)
    read = force + noise if pushes else np.where(force > 0, force + noise, 0.0)
    return ForceData(read, P, L, specimen)


def changed(data: ForceData, **sizes: float) -> ForceData:
    """The map with another specimen."""
    return dataclasses.replace(data, specimen=dataclasses.replace(data.specimen, **sizes))


def causes(data: ForceData) -> str:
    """What is suspected of a map in which nothing is to be identified."""
    result = fit(data)
    assert doubtful(result)
    found = suspect(result)
    assert not judge(result, found).passed
    assert len(found) <= 3
    return "; ".join(one.cause for one in found)


@pytest.mark.slow
def test_nothing_is_suspected_of_sound_maps(dmsp20: ForceData, dmsp10: ForceData) -> None:
    for data in (dmsp20, dmsp10, known_muscle(0.03, 0.35, 65.0)):
        result = fit(data)
        assert suspect(result) == ()
        assert judge(result).passed


def column(name: str, said: str, factor: float) -> Callable[[ForceData], ForceData]:
    """A column in another unit than its header says."""
    units = {"force": "N", "pressure": "kPa", "length": "mm"} | {name: said}
    return lambda data: dataclasses.replace(
        data, units=units, **{name: getattr(data, name) * factor}
    )


def of_arrays_in_psi(data: ForceData) -> ForceData:
    """The usual pressures tell which unit is meant, where no file names one."""
    return dataclasses.replace(data, pressure=data.pressure / 6.894757, units={})


def percent(data: ForceData) -> ForceData:
    rest = data.specimen.rest_length
    return dataclasses.replace(data, length=rest - (rest - data.length) / 100)


def swapped(data: ForceData) -> ForceData:
    return dataclasses.replace(data, force=data.pressure / 1e3, pressure=data.force * 1e3)


def constant(data: ForceData) -> ForceData:
    return dataclasses.replace(data, force=300 + 1e-3 * np.arange(data.force.size))


def one_length_negative(data: ForceData) -> ForceData:
    at = data.length == np.unique(data.length)[-2]
    return dataclasses.replace(data, force=np.where(at, -data.force, data.force))


FAULTS = {
    "the pressures are in psi, not kPa": (column("pressure", "kPa", 1 / 6.894757), 10),
    "the forces are in lbf, not N": (column("force", "N", 1 / 4.44822), 10),
    "the forces are in kN, not N": (column("force", "N", 1e-3), 10),
    "the forces are in N, not kgf": (column("force", "kgf", 9.80665), 10),
    "the pressures are in bar, not MPa": (column("pressure", "MPa", 10.0), 10),
    "the pressures are in psi, not kPa ": (of_arrays_in_psi, 10),
    "the pressures are absolute, not gauge": (
        lambda data: dataclasses.replace(data, pressure=data.pressure + 101.3e3), 10),
    "forces have the wrong sign": (one_length_negative, 20),
    # The force hardly depends on the wall: no misfit shows one of 18 mm in a bore of 20 mm.
    "the wall is too thick, or the diameter too small": (
        lambda data: changed(data, wall_thickness=18e-3), 20),
    "the nominal diameter is a radius, or that of a smaller muscle": (
        lambda data: changed(data, nominal_diameter=10e-3), 20),
    "the nominal diameter is that of a larger muscle": (
        lambda data: changed(data, nominal_diameter=40e-3), 20),
    "the columns of force and pressure are swapped": (swapped, 20),
    "the force does not rise with the pressure": (constant, 20),
    "the contractions are fractions, not percent": (percent, 10),
}  # fmt: skip
"""A fault, and the bundled map in which it is made, by its bore in mm."""


@pytest.mark.parametrize("cause", slow_after(0, list(FAULTS)))
def test_a_fault_is_named(dmsp10: ForceData, dmsp20: ForceData, cause: str) -> None:
    fault, bore = FAULTS[cause]
    assert cause.strip() in causes(fault(dmsp10 if bore == 10 else dmsp20))


@pytest.mark.slow
@pytest.mark.parametrize(("unit", "times"), [("cm", 0.1), ("inches", 1 / 25.4)])
def test_a_map_that_no_model_fits_has_its_lengths_unit_named(
    dmsp20: ForceData, unit: str, times: float
) -> None:
    with any_units():
        units = {**dmsp20.units, "length": "mm"}
        wrong = dataclasses.replace(dmsp20, length=dmsp20.length * times, units=units)
    (found,) = suspect_refused(wrong)
    assert found.cause == f"the lengths were in {unit}, not mm"
    assert "no muscle has a force there" in found.sentence


@pytest.mark.slow
def test_outliers_and_one_giant(dmsp20: ForceData) -> None:
    random = np.random.default_rng(3)
    rows = random.choice(np.flatnonzero(dmsp20.loaded), 5, replace=False)
    force = dmsp20.force.copy()
    force[rows] += 0.35 * dmsp20.max_force
    result = fit(dataclasses.replace(dmsp20, force=force))
    (found,) = suspect(result)
    assert found.cause.startswith("5 readings are outliers")
    assert "--objective huber" in found.sentence
    for row in rows:
        assert str(row + 1) in found.cause
    force = dmsp20.force.copy()
    force[rows[0]] = 99999.0
    assert causes(dataclasses.replace(dmsp20, force=force)).startswith(
        f"1 reading is an outlier (number {rows[0] + 1}"
    )


@pytest.mark.slow
@pytest.mark.parametrize("behind", [True, False])
def test_two_muscles_in_one_file(behind: bool) -> None:
    one = known_muscle(0.02, 0.3, 66.0)
    if behind:
        other = known_muscle(0.034, 0.3, 64.0)
        columns = {name: np.append(getattr(one, name), getattr(other, name)) for name in COLUMNS}
        where = f"from reading {one.force.size + 1} on"
    else:
        columns = {"force": np.where(one.length < 0.27, 1.45 * one.force, one.force)}
        where = "at 252 mm, 258.9 mm, 265.7 mm"
    assert f"there are two muscles in the file, one of them {where}" in causes(
        dataclasses.replace(one, **columns)
    )


COLUMNS = ("force", "pressure", "length")
