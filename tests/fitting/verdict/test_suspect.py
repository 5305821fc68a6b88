"""Every fault that a verdict should name, made in a sound map, and sound maps in which there is none."""

import dataclasses
import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from slow_cases import slow_after

import famjax
from fitting import ForceData, Identification, InputError, Parameter, Specimen, identify
from fitting.faults import absolute, attempt, doubtful, least_misfit, plainest, pulls_late, suspect
from fitting.ladder import ladder
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


@pytest.mark.parametrize("cause", slow_after(1, list(FAULTS)))
def test_a_fault_is_named(dmsp10: ForceData, dmsp20: ForceData, cause: str) -> None:
    fault, bore = FAULTS[cause]
    assert cause.strip() in causes(fault(dmsp10 if bore == 10 else dmsp20))


def test_absolute_pressures_that_a_rig_takes_up(dmsp20: ForceData) -> None:
    """A rig that gives way makes a muscle pull late as well: no deadband is at its bound."""
    known = known_muscle(0.03, 0.35, 65.0)
    assert not pulls_late(known)
    data = dataclasses.replace(dmsp20, pressure=dmsp20.pressure + 101.3e3)
    assert pulls_late(data)
    rig = next(one for one in ladder(data)[0] if one.rig)
    here = attempt(data, rig)
    assert here is not None
    assert here.side("deadband_pressure") == 0
    (found,) = absolute(data, here, here.misfit, rig, stopped=False)
    assert found.cause == "the pressures are absolute, not gauge"
    assert found.grave


def test_a_slack_muscle_that_pushes_has_no_wrong_sign() -> None:
    """Held at both ends it pushes, by less than a pull would be: the other sign fits, but worse."""
    data = known_muscle(0.01, 0.2, 65.0, pushes=True)
    assert -0.1 * data.max_force < data.force.min() < -0.03 * data.max_force
    result = fit(data)
    assert suspect(result) == ()
    assert judge(result).passed


def test_readings_at_the_limit_of_the_load_cell_are_no_fault() -> None:
    """A muscle may pull more there: only a pull that is less contradicts them."""
    data = known_muscle(0.014, 0.2, 65.0, lengths=6)
    limit = 0.7 * data.max_force
    capped = dataclasses.replace(data, force=np.minimum(data.force, limit), force_limit=limit)
    assert capped.saturated.sum() > 3
    result = fit(capped)
    assert least_misfit(result) < 0.01
    assert suspect(result) == ()
    assert judge(result).passed
    raised = dataclasses.replace(capped, force=np.where(capped.saturated, 2 * limit, capped.force))
    assert least_misfit(dataclasses.replace(result, data=raised)) > 0.1


def test_one_pressure_does_not_tell_absolute_ones() -> None:
    """Deadband and diameter are one number there, so that a deadband at its bound says nothing."""
    data = known_muscle(0.014, 0.2, 65.0)
    one = data.part(data.pressure == np.unique(data.pressure)[2])
    assert not pulls_late(one)
    candidate = plainest(one)
    assert [*absolute(one, None, 0.003, candidate, stopped=True)] == []


def test_all_forces_negative_are_refused(dmsp20: ForceData) -> None:
    force = -dmsp20.force
    force[0] = 0.3
    with pytest.raises(InputError, match="check the sign of the force column"):
        dataclasses.replace(dmsp20, force=force)


@pytest.mark.slow
def test_a_bore_that_a_rig_takes_up(dmsp10: ForceData) -> None:
    """At the bounds of less force in diameter and angle, with a misfit below 2 %."""
    data = changed(dmsp10, nominal_diameter=18e-3)
    rig = {
        "series_compliance": Parameter(),
        "series_exponent": Parameter(),
        "deadband_pressure": Parameter(value=0.0, vary=False, unit="Pa"),
    }
    result = identify(data, law="saturating", parameters=rig, starts=4)
    assert result.errors.rmse_percent < 2
    found = suspect(result)
    assert not judge(result, found).passed
    assert any("nominal diameter" in one.cause for one in found)


@pytest.mark.slow
def test_one_fault_is_not_explained_by_another(dmsp10: ForceData) -> None:
    """A bore of 1 mm would scale the force by as much, and leaves no room for a wall of 1.8 mm."""
    in_kgf = dataclasses.replace(dmsp10, force=dmsp10.force / 9.80665, units={"force": "N"})
    assert "ten times too large" not in causes(in_kgf)


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
@pytest.mark.parametrize("part", [0.4, 0.7])
def test_a_full_load_cell(dmsp20: ForceData, part: float) -> None:
    limit = part * dmsp20.max_force
    noise = np.random.default_rng(0).normal(0, 2e-4 * limit, dmsp20.force.size)
    force = np.minimum(dmsp20.force, limit + noise)
    (found,) = suspect(fit(dataclasses.replace(dmsp20, force=force)))
    count, shown = re.findall(r"full at (\d+) readings, which stand at ([\d.]+) N", found.cause)[0]
    assert 0 <= int(count) - (dmsp20.force > limit).sum() <= 1
    assert float(shown) == pytest.approx(limit, rel=1e-3)
    declared = float(found.sentence.partition("force_limit_N = ")[2].partition(" ")[0])
    sound = fit(dataclasses.replace(dmsp20, force=force, force_limit=declared))
    assert not suspect(sound)
    assert judge(sound, []).level != "not identified"


def test_the_misfit_counts_pulls_at_slack_readings(dmsp20: ForceData) -> None:
    result = fit(dmsp20)
    force = result.model_force()
    pull = np.fmax(force[~dmsp20.loaded], 0.0)
    expected = math.sqrt((np.sum(result.residuals**2) + np.nansum(pull**2)) / 60) / 1653.5
    assert least_misfit(result) == pytest.approx(expected, rel=1e-12)
