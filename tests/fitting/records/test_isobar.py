"""Characterisation of loops whose ends, areas and differences are known in closed form."""

import dataclasses

import numpy as np
import pytest

import fitting
from fitting import InputError, read_csv
from fitting.records import IsobaricRecord, MachineLog, characterise, combine, write_dataset

L0, STROKE, RATE, DT = 0.24, 0.06, 1e-3, 0.02
HALF = 12.0  # N, half of the loop's width
NOISE = 2.0  # N
GRID_ERROR = 3 * NOISE / np.sqrt(30)  # about 60 rows stand behind each value of a branch's grid


def pull(length: np.ndarray, pressure: float) -> np.ndarray:
    """A force that falls linearly to zero at 5 cm: blocked P / 100 N, at every pressure."""
    return pressure / 100 * (1 - (L0 - length) / 0.05)


def record(cycles: int = 3, pressures: tuple = (1e5, 3e5), rest: float = 5.0) -> IsobaricRecord:
    """Strokes with rests of `rest` before each pressure; force = pull -+ HALF, pressure +-, noise."""
    rng = np.random.default_rng(0)
    parts = []
    for pressure in pressures:
        ramp = np.arange(0, STROKE / RATE, DT) * RATE
        once = np.concatenate([ramp, STROKE - ramp])
        still = np.zeros(round(rest / DT))
        shortened = np.concatenate([still, *[once] * cycles, still])
        moving = np.gradient(shortened)
        side = HALF * np.where(np.abs(moving) > 1e-9, np.sign(-moving), 0.0)
        length = L0 - shortened
        force = pull(length, pressure) + side + rng.normal(0, NOISE, length.size)
        held = pressure + 200.0 + rng.normal(0, 500.0, length.size)
        parts.append(np.column_stack([length, force, held, np.full(length.size, pressure)]))
    table = np.concatenate(parts)
    return IsobaricRecord(DT * np.arange(len(table)), *table.T, rest_length=L0)


def test_curves_ends_and_loop_are_those_of_the_closed_form():
    found = characterise(record())
    assert [bar.set_pressure for bar in found.isobars] == [1e5, 3e5]
    for bar in found.isobars:
        exact = pull(bar.length, bar.set_pressure)
        inner = slice(2, -2)  # the loop's corners are sharper than the grid
        assert np.abs(bar.shortening - (exact - HALF))[inner].max() < GRID_ERROR
        assert np.abs(bar.lengthening - (exact + HALF))[inner].max() < GRID_ERROR
        assert bar.cycles == 3
        blocked = bar.set_pressure / 100
        assert bar.blocked_force == pytest.approx(blocked, abs=4 * NOISE / np.sqrt(100))
        slope = bar.set_pressure / 100 / 0.05
        assert bar.free_contraction == pytest.approx((0.05 - HALF / slope) / L0, abs=2 / slope / L0)
        assert bar.hysteresis == pytest.approx(2 * HALF * STROKE, rel=0.01)


def test_pressure_statistics_are_those_of_the_strokes():
    (bar,) = characterise(record(pressures=(2e5,), rest=20.0)).isobars
    n = 3 * 2 * STROKE / RATE / DT
    assert bar.pressure == pytest.approx(2e5 + 200, abs=4 * 500 / np.sqrt(n))
    assert bar.pressure_std == pytest.approx(500, rel=4 / np.sqrt(2 * n))
    assert 3 * 500 < bar.largest_pressure_error < 6 * 500 + 200


def part_of(whole: IsobaricRecord, kept: np.ndarray) -> IsobaricRecord:
    names = ("time", "length", "force", "pressure", "set_pressure")
    return IsobaricRecord(*(getattr(whole, n)[kept] for n in names), rest_length=L0)


def test_an_incomplete_stroke_is_named_and_left_out():
    whole = record(pressures=(2e5,))
    found = characterise(part_of(whole, np.arange(whole.time.size - round((5.0 + 30.0) / DT))))
    assert found.isobars[0].cycles == 2
    assert any("is not a complete stroke" in note for note in found.notes)


@pytest.mark.parametrize("second", [150.0, 200.0])  # as it shortens, as it lengthens
def test_a_stroke_with_a_hole_is_named_and_left_out(second):
    """A torn journal has no pressure for a while; the other strokes remain."""

    def torn(whole: IsobaricRecord) -> IsobaricRecord:
        return part_of(whole, (whole.time < second) | (whole.time > second + 4.0))

    whole = record(pressures=(2e5,))
    found = characterise(torn(whole))
    assert found.isobars[0].cycles == 2
    assert any("stroke 2 was left out because 4.0" in note for note in found.notes)
    (bar,), (other,) = characterise(whole).isobars, found.isobars
    assert np.abs(bar.force - other.force).max() < GRID_ERROR
    with pytest.raises(InputError, match=r"no complete stroke.*stroke 1 was left out because 4.0"):
        characterise(torn(record(pressures=(2e5,), cycles=1, rest=130.0)))


def test_the_dataset_is_one_that_a_fit_reads(tmp_path):
    found = characterise(record())
    specimen = {"wall_thickness_mm": 1.5, "embedded": False, "name": "F 1"}
    path = write_dataset(found, tmp_path / "set.csv", specimen=specimen)
    data = read_csv(path)
    assert data.specimen.rest_length == L0
    assert data.specimen.wall_thickness == pytest.approx(1.5e-3)
    assert data.specimen.name == "F 1"
    assert data.force.size == 60
    exact = pull(data.length, 1) * data.pressure
    assert np.abs(data.force - exact).max() < 2 * GRID_ERROR  # the turns are left out
    assert data.pressure_std is not None
    assert np.median(data.pressure_std) == pytest.approx(500, rel=0.1)
    with pytest.raises(InputError, match="must not repeat the rest length"):
        write_dataset(found, path, specimen={"rest_length_mm": 240})
    with pytest.raises(InputError, match="cannot write"):
        write_dataset(found, tmp_path / "none" / "set.csv")


def test_every_reading_has_the_pressure_that_was_measured_there(tmp_path):
    """The pressure falls by a fifth along the stroke: the force is that of the pressure there."""
    steady = record()
    share = 1 - 0.2 * (L0 - steady.length) / STROKE
    half = steady.force - pull(steady.length, 1) * steady.set_pressure
    force = pull(steady.length, 1) * steady.set_pressure * share + half
    dipping = dataclasses.replace(steady, force=force, pressure=steady.pressure * share)
    data = read_csv(write_dataset(characterise(dipping), tmp_path / "set.csv"))
    assert np.ptp(data.pressure[data.pressure > 2e5]) > 0.15 * 3e5
    assert np.abs(data.force - pull(data.length, 1) * data.pressure).max() < 2 * GRID_ERROR
    assert np.unique(data.pressures.level).size == 2  # by the tolerance in the file
    assert np.unique(data.length).size == 30  # common to both


def log_of(found: IsobaricRecord, **changes: object) -> MachineLog:
    fields = {
        "time": found.time + 50.0, "displacement": found.length - L0, "force": found.force,
    }  # fmt: skip
    return MachineLog(**(fields | changes))  # pyright: ignore[reportArgumentType]


AHEAD = fitting.records.Alignment(-50.0, 0.0, 0.0, 1e-3, 1e-6)


def test_signs_and_zero_of_the_machine_are_honoured():
    truth = record()
    log = log_of(truth, displacement=0.1 + L0 - truth.length, force=-truth.force)
    t = np.arange(-1.0, truth.time[-1] + 1, 0.01)
    found = combine(
        log, AHEAD, t, np.full(t.size, 1e5), [(-1.0, 1e5)], rest_length=L0, shortening_positive=True,
        zero_displacement=0.1, pushing_positive=True,
    )  # fmt: skip
    assert np.allclose(found.length, truth.length)
    assert np.allclose(found.force, truth.force)
    with pytest.raises(InputError, match="check the unit and sign of the displacement"):
        combine(
            log, AHEAD, t, np.full(t.size, 1e5), [(-1.0, 1e5)], rest_length=0.05,
            shortening_positive=True,
        )  # fmt: skip


def test_where_the_journal_is_silent_there_is_no_row():
    truth = record()
    t = np.arange(-1.0, truth.time[-1] + 1, 0.01)
    t = t[(t < 60) | (t > 70)]
    log = log_of(truth, missing_rows=3)
    found = combine(log, AHEAD, t, np.full(t.size, 1e5), [(-1.0, 1e5)], rest_length=L0)
    missing = (truth.time > 60.06) & (truth.time < 69.94)
    assert not np.isin(np.round(truth.time[missing], 6), np.round(found.time, 6)).any()
    assert truth.time.size - found.time.size == pytest.approx(missing.sum(), abs=6)
    assert any("have no matching pressure" in note for note in found.notes)
    assert any("3 rows are missing" in note for note in found.notes)
    with pytest.raises(InputError, match="no row of the machine log has a matching pressure"):
        combine(log_of(truth), AHEAD, t + 1e6, np.full(t.size, 1e5), [(0.0, 1e5)], rest_length=L0)
    with pytest.raises(InputError, match="at least one set point"):
        combine(log_of(truth), AHEAD, t, np.full(t.size, 1e5), [], rest_length=L0)
