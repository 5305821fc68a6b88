"""`famjax fit --shape`: a fit with the shape that photographs show, and what it says where it cannot."""

import json
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest

import famjax
from famjax.__main__ import main
from imaging import Table
from tests.fitting.pictured import BRAID, INCH, PSI, REST, photographed, true_family

# For the folder that all of these read, which then only one stage of CI makes.
pytestmark = pytest.mark.slow

HEADER = """# specimen: name = twin
# specimen: rest_length_in = 9.28125
# specimen: wall_thickness_in = 0.0625
# specimen: bladder_diameter_in = 0.875
# specimen: braid_thickness_in = 0.011
pressure_psi,length_in,force_lbf
"""
LAW = np.array([257.8, -57.9, 32.7]) * PSI
LBF = 4.4482216152605


def write_table(folder: Path, contractions: float = 0.35) -> Path:
    """measurements.nc as `famjax measure` writes it, of pictures up to a contraction."""
    shown = photographed(120, 0.0006 * INCH)
    shown = shown.part(shown.length >= REST * (1 - contractions))
    n, unknown = len(shown), np.full(shown.diameter.shape, np.nan)
    return Table(
        path=shown.names, error=("",) * n, warnings=("",) * n,
        columns={"length": shown.length, "pressure": shown.pressure},
        diameter=shown.diameter, diameter_stderr=5e-4 * shown.diameter,
        braid_angle=unknown, braid_angle_stderr=unknown, sha256=("",) * n,
        rest_length=REST, notes=(), time_origin=np.nan, stamp_resolution=np.nan,
        provenance={"scale_relative_stderr": "0.0003"},
    ).write_netcdf(folder / "measurements.nc")  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The force map and the photographs of one muscle."""
    folder = tmp_path_factory.mktemp("shape")
    geometry = famjax.MeasuredGeometry(
        true_family(), famjax.Bladder(REST, 0.875 * INCH, 0.0625 * INCH)
    )
    muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(LAW), 8e3)
    length, pressure = REST * (1 - np.linspace(0.0, 0.33, 7)), np.arange(20, 101, 20) * PSI
    force = np.asarray(eqx.filter_jit(muscle.force)(length, pressure[:, None]))
    force = force + np.random.default_rng(0).normal(0, 1.0, force.shape)
    rows = [
        f"{P / PSI:.4f},{L / INCH:.5f},{F / LBF:.4f}"
        for P, line in zip(pressure, force, strict=True)
        for L, F in zip(length, line, strict=True)
        if F > 20
    ]
    (folder / "map.csv").write_text(HEADER + "\n".join(rows) + "\n")
    write_table(folder)
    return folder


def fit(folder: Path, capsys: pytest.CaptureFixture, *words: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main(
            ["fit", str(folder / "map.csv"), "--output", str(folder / "out"), "--verbose",
             *map(str, words)]
        )  # fmt: skip
    said = capsys.readouterr()
    return int(stop.value.code or 0), said.out, said.err


def test_the_law_and_the_turns_come_back(folder: Path, capsys: pytest.CaptureFixture) -> None:
    code, out, _ = fit(folder, capsys, "--shape", folder / "measurements.nc")
    assert code == 0
    assert "The shape is measured: 120 pictures from 153.5 to" in out
    found = json.loads((folder / "out" / "fit.json").read_text())["parameters"]
    assert found["turns"]["value"] == pytest.approx(float(BRAID.turns), rel=1e-3)
    for name, true in zip(("E_1", "E_2", "E_3"), LAW, strict=True):
        assert abs(found[name]["value"] - true) < 4 * found[name]["stderr"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a measurements.nc file"),
        (b"pressure_psi\n1\n", "not a measurements.nc file"),
        (None, "no such file"),
    ],
)
def test_a_file_that_is_no_table_is_refused(
    content: bytes | None, words: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    path = tmp_path / "shape.nc"
    if content is not None:
        path.write_bytes(content)
    code, _, err = fit(folder, capsys, "--shape", path)
    assert code == 2
    assert words in err


def test_the_errors_of_the_shape_and_those_stated_widen_the_parameters(
    folder: Path, capsys: pytest.CaptureFixture
) -> None:
    code, out, _ = fit(
        folder, capsys, "--shape", folder / "measurements.nc", "--error", "wall_thickness_mm=0.05"
    )
    assert code == 0
    assert "Standard errors by source" in out
    by_source = json.loads((folder / "out" / "fit.json").read_text())["shared_errors"]
    # 0.05 mm of 1.5875 mm, of a volume that goes with t (D - t); the strain at mid-wall takes part, too.
    part = 0.05e-3 * (0.875 - 2 * 0.0625) / (0.0625 * INCH) / (0.875 - 0.0625)
    assert by_source["wall_thickness"]["E_1"] / (LAW[0]) == pytest.approx(part, rel=0.15)
    assert by_source["shape"]["turns"] > 0
