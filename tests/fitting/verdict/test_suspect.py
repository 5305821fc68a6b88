"""Every fault that a verdict should name, made in a sound map, and sound maps in which there is none."""

import dataclasses
import math
import re

import numpy as np
import pytest

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


@pytest.mark.parametrize(
    ("column", "factor", "cause"),
    [
        pytest.param("force", 1 / 4.44822, "the forces are in lbf, not N", marks=pytest.mark.slow),
        pytest.param("force", 1e-3, "the forces are in kN, not N", marks=pytest.mark.slow),
        pytest.param("force", 9.80665, "the forces are in N, not kgf", marks=pytest.mark.slow),
        ("pressure", 1 / 6.894757, "the pressures are in psi, not kPa"),
        pytest.param("pressure", 1e3, "the pressures are in Pa, not kPa", marks=pytest.mark.slow),
        pytest.param("pressure", 10.0, "the pressures are in bar, not MPa", marks=pytest.mark.slow),
    ],
)
def test_units(dmsp10: ForceData, column: str, factor: float, cause: str) -> None:
    said = cause.rpartition(" ")[2]
    units = {"force": "N", "pressure": "kPa", "length": "mm"} | {column: said}
    column_as_said = getattr(dmsp10, column) * factor
    data = dataclasses.replace(dmsp10, units=units, **{column: column_as_said})
    assert cause in causes(data)


@pytest.mark.slow
def test_units_of_arrays_are_guessed_from_the_pressures_that_are_usual(dmsp10: ForceData) -> None:
    in_psi = dataclasses.replace(dmsp10, pressure=dmsp10.pressure / 6.894757, units={})
    assert causes(in_psi).startswith("the pressures are in psi, not kPa")


@pytest.mark.slow
def test_absolute_pressures(dmsp10: ForceData) -> None:
    absolute = dataclasses.replace(dmsp10, pressure=dmsp10.pressure + 101.3e3)
    assert causes(absolute) == "the pressures are absolute, not gauge"


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


@pytest.mark.slow
def test_signs_of_a_length(dmsp20: ForceData) -> None:
    at = dmsp20.length == np.unique(dmsp20.length)[-2]
    negative = dataclasses.replace(dmsp20, force=np.where(at, -dmsp20.force, dmsp20.force))
    assert causes(negative) == "forces have the wrong sign"


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
def test_a_thick_wall(dmsp20: ForceData) -> None:
    """The force hardly depends on the wall: no misfit shows one of 18 mm in a bore of 20 mm."""
    thick = changed(dmsp20, wall_thickness=18e-3)
    assert fit(thick).errors.rmse_percent < 1
    assert causes(thick) == "the wall is too thick, or the diameter too small"


@pytest.mark.slow
def test_bores(dmsp20: ForceData) -> None:
    assert "nominal diameter" in causes(changed(dmsp20, nominal_diameter=40e-3))
    assert "nominal diameter" in causes(changed(dmsp20, nominal_diameter=10e-3))


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


@pytest.mark.slow
def test_one_length_off_is_named_with_what_it_should_be() -> None:
    sound = known_muscle(0.03, 0.35, 65.0)
    lengths = np.unique(sound.length)
    off = np.where(sound.length == lengths[3], sound.length + 0.009, sound.length)
    result = fit(dataclasses.replace(sound, length=off))
    (found,) = suspect(result)
    assert found.cause.startswith(f"the length {1e3 * (lengths[3] + 0.009):.4g} mm is ")
    said = float(found.cause.split(" mm is ")[1].split(" mm")[0])
    assert said == pytest.approx(1e3 * lengths[3], abs=1.0)
    assert judge(result, [found]).level == "identified with doubts"
    # By twice as much no model explains them, and to know why does not make it one.
    off = np.where(sound.length == lengths[3], sound.length + 0.018, sound.length)
    result = fit(dataclasses.replace(sound, length=off))
    (found,) = suspect(result)
    assert found.cause.startswith("the length ")
    assert judge(result, [found]).level == "not identified"


@pytest.mark.slow
def test_swapped_columns(dmsp20: ForceData) -> None:
    swapped = dataclasses.replace(dmsp20, force=dmsp20.pressure / 1e3, pressure=dmsp20.force * 1e3)
    assert causes(swapped) == "the columns of force and pressure are swapped"


@pytest.mark.slow
def test_a_force_that_does_not_rise(dmsp20: ForceData) -> None:
    constant = 300 + 1e-3 * np.arange(dmsp20.force.size)
    assert causes(dataclasses.replace(dmsp20, force=constant)) == (
        "the force does not rise with the pressure"
    )


@pytest.mark.slow
def test_contractions_a_hundred_times_too_small(dmsp10: ForceData) -> None:
    rest = dmsp10.specimen.rest_length
    length = rest - (rest - dmsp10.length) / 100
    assert causes(dataclasses.replace(dmsp10, length=length)) == (
        "the contractions are fractions, not percent"
    )


def test_the_misfit_counts_pulls_at_slack_readings(dmsp20: ForceData) -> None:
    result = fit(dmsp20)
    force = result.model_force()
    pull = np.fmax(force[~dmsp20.loaded], 0.0)
    expected = math.sqrt((np.sum(result.residuals**2) + np.nansum(pull**2)) / 60) / 1653.5
    assert least_misfit(result) == pytest.approx(expected, rel=1e-12)
