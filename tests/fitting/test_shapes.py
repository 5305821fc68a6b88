"""The surface through photographs: near the truth, honest about its distance, in a fit by `--shape`."""

import dataclasses
import json
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
from muscles import TABLE_4_3
from rendering import INCH

import famjax
from famjax.boundary.errors import InputError
from famjax.profiles import FourierProfile
from fitting import ForceData, Specimen, write_csv
from fitting.shapes import Pictures, shape_surface
from imaging import Table

PSI = 6894.757293168361
REST = 9.28125 * INCH
BRAID = famjax.Braid(9.89 * INCH, 1.09, 0.011 * INCH)
LAW = np.array([257.8, -57.9, 32.7]) * PSI


def true_family() -> famjax.surfaces.MeasuredFamily:
    profiles = [
        FourierProfile(one.a0 * INCH, one.a * INCH, one.b * INCH, one.w).symmetrised()
        for one, _ in TABLE_4_3.values()
    ]
    lengths = [length * INCH for _, length in TABLE_4_3.values()]
    return famjax.surfaces.MeasuredFamily(lengths, profiles, 55 * PSI, BRAID)


def true_diameter(x, length, pressure, stretch: float) -> np.ndarray:
    """D [m], shape (states, positions)."""
    shape = np.array(true_family().diameter(x, length[:, None], 55 * PSI))
    return shape * (1 + stretch * (pressure[:, None] / PSI - 55))


def photographed(n=120, noise=0.0006 * INCH, seed=0, *, stretch=0.0) -> Pictures:
    """n pictures; noise [m] of the diameters, correlated over a fiftieth of the length."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 1, 201)
    length = REST * (1 - 0.35 * rng.uniform(size=n))
    pressure = rng.choice(np.arange(10, 101, 10), n) * PSI
    along = np.exp(-0.5 * ((x[:, None] - x) / 0.02) ** 2) + 1e-9 * np.eye(x.size)
    wrong = noise * rng.standard_normal((n, x.size)) @ np.linalg.cholesky(along).T
    names = tuple(f"DSC_{k:04d}.JPG" for k in range(n))
    diameter = true_diameter(x, length, pressure, stretch) + wrong
    return Pictures(names, length, diameter, pressure, 0.0, source="pictures")


X = np.linspace(0, 1, 201)
BLADDER = famjax.Bladder(REST, 0.875 * INCH, 0.0625 * INCH)
SPECIMEN = Specimen(
    name="7/8 in", rest_length=REST, wall_thickness=0.0625 * INCH, braid_thickness=0.011 * INCH,
    bladder_diameter=0.875 * INCH,
)  # fmt: skip
LENGTHS, PRESSURES = REST * (1 - np.linspace(0.01, 0.34, 12)), np.array([20.0, 55.0, 95.0]) * PSI


def force(geometry: famjax.geometries.AbstractGeometry) -> np.ndarray:
    muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(LAW))
    return np.asarray(eqx.filter_jit(muscle.force)(LENGTHS, PRESSURES[:, None]))


@pytest.mark.slow
def test_force_from_photographs_is_that_of_the_true_profiles():
    true = force(famjax.MeasuredGeometry(true_family(), BLADDER))
    found = shape_surface(photographed())
    error = force(found.geometry(SPECIMEN, braid=BRAID)) - true
    assert np.sqrt(np.mean(error**2)) < 1e-4 * true.max()
    assert found.pressures == pytest.approx((np.nan, np.nan), nan_ok=True)
    assert "does not change with pressure" in found.notes[-1]
    assert not found.left_out


@pytest.mark.slow
def test_a_braid_that_gives_is_seen_in_the_shape():
    found = shape_surface(photographed(stretch=2e-4))
    assert found.form.with_pressure >= 0
    family = found.family(BRAID)
    for pressure in PRESSURES:
        true = true_diameter(X, LENGTHS, np.full(12, pressure), 2e-4)
        error = np.asarray(family.diameter(X, LENGTHS[:, None], pressure)) - true
        assert np.sqrt(np.mean(error**2)) < 0.0004 * INCH


@pytest.mark.slow
def test_its_bands_cover_the_truth():
    """Of 24 campaigns, each with its noise."""
    inside = []
    for seed in range(24):
        found = shape_surface(photographed(80, 0.001 * INCH, seed), seed=seed)
        low, high = np.quantile(found.draws[:, 0], [0.025, 0.975], axis=0)
        true = true_diameter(X, found.lengths, np.full(len(found.lengths), 55 * PSI), 0.0)
        inside.append(np.mean((low <= true) & (true <= high)))
    assert 0.88 < np.mean(inside) < 0.99


def test_pictures_held_out_are_as_near_as_expected():
    found = shape_surface(photographed(200)).held_out
    assert found.pictures == 40
    assert found.rms == pytest.approx(0.0006 * INCH, rel=0.15)
    assert found.standardised == pytest.approx(1.0, abs=0.15)


def test_pictures_off_the_surface_are_left_out_and_named_and_two_muscles_are_none():
    sound = photographed()
    diameter = sound.diameter.copy()
    diameter[17] *= 1.02
    diameter[60, 80:120] += 0.02 * INCH
    found = shape_surface(dataclasses.replace(sound, diameter=diameter))
    assert set(found.left_out) == {"DSC_0017.JPG", "DSC_0060.JPG"}
    assert "2 pictures lie off the surface" in found.notes[0]
    other = sound.diameter * np.where(np.arange(120) % 4 == 0, 1.05, 1.0)[:, None]
    with pytest.raises(InputError, match="scatter by 2"):
        shape_surface(dataclasses.replace(sound, diameter=other))


def test_the_triangle_of_true_threads_is_found():
    length = REST * (1 - 0.3 * np.random.default_rng(0).uniform(size=60))
    wide = np.asarray(famjax.braids.diameter_from_length(length, 9.89 * INCH, 1.09))
    shape = np.repeat(wide[:, None], 201, axis=1)
    names = tuple(map(str, range(60)))
    found = shape_surface(Pictures(names, length, shape, np.full(60, np.nan))).threads
    assert found.turns == pytest.approx(1.09, rel=1e-6)
    assert found.length == pytest.approx(9.89 * INCH, rel=1e-6)


# ---- `famjax fit --shape`


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The force map and the photographs of one muscle, measurements.nc as `famjax measure` writes it."""
    folder = tmp_path_factory.mktemp("shape")
    shape = famjax.MeasuredGeometry(true_family(), BLADDER)
    muscle = famjax.Muscle(shape, famjax.PolynomialMaterial(LAW), 8e3)
    grid = np.meshgrid(REST * (1 - np.linspace(0.0, 0.33, 7)), np.arange(20, 101, 20) * PSI)
    L, P = (one.ravel() for one in grid)
    force = np.asarray(eqx.filter_jit(muscle.force)(L, P))
    force = force + np.random.default_rng(0).normal(0, 1.0, force.shape)
    pulls = force > 90
    write_csv(ForceData(force[pulls], P[pulls], L[pulls], SPECIMEN), folder / "map.csv", "us")
    shown = photographed()
    n, unknown = len(shown), np.full(shown.diameter.shape, np.nan)
    Table(
        path=shown.names, error=("",) * n, warnings=("",) * n,
        columns={"length": shown.length, "pressure": shown.pressure},
        diameter=shown.diameter, diameter_stderr=5e-4 * shown.diameter,
        braid_angle=unknown, braid_angle_stderr=unknown,
        rest_length=REST, notes=(), time_origin=np.nan, stamp_resolution=np.nan,
        provenance={"scale_relative_stderr": "0.0003"},
    ).write_netcdf(folder / "measurements.nc")  # fmt: skip
    return folder


def fit_of(folder: Path) -> tuple[object, ...]:
    return "fit", folder / "map.csv", "--output", folder / "out", "--verbose", "--shape"


@pytest.mark.slow
def test_the_law_and_the_turns_come_back(folder, said):
    out = said(*fit_of(folder), folder / "measurements.nc")
    assert "The shape was measured in 120 pictures at lengths from 153.5 to" in out
    found = json.loads((folder / "out" / "fit.json").read_text())["parameters"]
    assert found["turns"]["value"] == pytest.approx(float(BRAID.turns), rel=1e-3)
    for name, true in zip(("E_1", "E_2", "E_3"), LAW, strict=True):
        assert abs(found[name]["value"] - true) < 4 * found[name]["stderr"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a measurements.nc file"),
        (b"pressure_psi\n1\n", "not a measurements.nc file"),
        (None, "no such file"),
    ],
)
def test_a_file_that_is_no_table_is_refused(content, words, folder, refused, tmp_path):
    path = tmp_path / "shape.nc"
    if content is not None:
        path.write_bytes(content)
    refused(words, *fit_of(folder), path)


@pytest.mark.slow
def test_the_errors_of_the_shape_and_those_stated_widen_the_parameters(folder, said):
    table = folder / "measurements.nc"
    out = said(*fit_of(folder), table, "--error", "wall_thickness_mm=0.05")
    assert "total" in out
    by_source = json.loads((folder / "out" / "fit.json").read_text())["shared_errors"]
    # 0.05 mm of 1.5875 mm, of a volume that goes with t (D - t); the strain at mid-wall takes part, too.
    part = 0.05e-3 * (0.875 - 2 * 0.0625) / (0.0625 * INCH) / (0.875 - 0.0625)
    assert by_source["wall_thickness"]["E_1"] / (LAW[0]) == pytest.approx(part, rel=0.15)
    assert by_source["shape"]["turns"] > 0
