"""The MATLAB functions and the .mat file, run and read by Octave; the tables read by SciPy."""

from pathlib import Path

import numpy as np
import pytest
from processes import needs, ran
from scipy.io import loadmat, savemat
from targets import exported_states

from famjax.export import Subject, export


def octave(folder: Path, commands: str) -> dict[str, np.ndarray]:
    """What is left in `back.mat` by commands of Octave that run in a folder."""
    done = ran("octave-cli", "--norc", "--quiet", "--eval", commands, cwd=folder, timeout=120)
    assert (folder / "back.mat").exists(), done.stderr
    return loadmat(folder / "back.mat", squeeze_me=True)


@needs("octave-cli")
def test_octave_computes_the_equations(dmsp_20: Subject, tmp_path: Path) -> None:
    export(dmsp_20, ["matlab", "python"], tmp_path)
    rng, region = np.random.default_rng(5), dmsp_20.muscle.region
    L, P = (rng.uniform(low, high, 10_000) for low, high in (region.length, region.pressure))
    savemat(tmp_path / "states.mat", {"L": L, "P": P})
    back = octave(
        tmp_path,
        "load states.mat; [F, G] = dmsp_20_force(L, P); Q = dmsp_20_pressure(L(1:200), F(1:200));"
        "X = dmsp_20_force([0.25; 0.28], [1e5, 2e5, 3e5]); S = dmsp_20_force(0.28, 3e5);"
        "N = [dmsp_20_force(0.1, 3e5), dmsp_20_force(0.28, 5e6), dmsp_20_pressure(0.28, 1e6)];"
        "try, dmsp_20_force(28, 3e5); M = ''; catch e, M = e.message; end;"
        "save -v7 back.mat F G Q X S N M",
    )
    force, muscle = np.asarray(dmsp_20.muscle.force(L, P)), dmsp_20.muscle
    np.testing.assert_allclose(back["F"], force, rtol=0, atol=1e-12 * force.max())
    model = np.asarray(muscle.model_force(L, P))
    np.testing.assert_allclose(back["G"], model, rtol=0, atol=1e-12 * force.max())
    pulls = force[:200] > muscle.slack_width
    np.testing.assert_allclose(back["Q"][pulls], P[:200][pulls], rtol=1e-9)
    assert back["X"].shape == (2, 3)
    assert back["X"][1, 2] == back["S"]
    assert np.isnan(back["N"]).all()
    assert "L must be in m and below" in str(back["M"])


@needs("octave-cli")
def test_octave_computes_the_table_to_the_last_digits(
    subject: Subject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("famjax.export.targets.closed_form", lambda _: None)
    export(subject, ["matlab"], tmp_path)
    L, P = exported_states(subject, 100)
    force, stiffness, area = (
        np.array([*map(ask, L.tolist(), P.tolist())])
        for ask in (subject.pull.force, subject.pull.stiffness, subject.pull.area)
    )
    asked = np.append(force, [1e6, -5.0, np.nan]), np.append(L, [0.28, 0.27, 0.27])
    savemat(tmp_path / "states.mat", {"L": L, "P": P, "F": asked[0], "M": asked[1]})
    back = octave(
        tmp_path,
        "load states.mat; [F, K, A] = test_20_force(L, P); S = test_20_force(0.28, P(1:3));"
        "t = load('states.mat'); Q = test_20_pressure(M, t.F);"
        "save -v7 back.mat F K A Q S",
    )
    assert back["F"] == pytest.approx(force, rel=1e-13, abs=1e-10)
    assert back["K"] == pytest.approx(stiffness, rel=1e-12, abs=1e-7)
    assert back["A"] == pytest.approx(area, rel=1e-12, abs=1e-15)
    inverse = [*map(subject.pull.pressure, asked[1].tolist(), asked[0].tolist())]
    assert back["Q"] == pytest.approx(np.array(inverse), abs=1e-5, nan_ok=True)
    assert back["S"][0] == pytest.approx(subject.pull.force(0.28, P[0]), rel=1e-13)


@pytest.mark.slow
@needs("octave-cli")
def test_octave_reads_the_mat_file(subject: Subject, tmp_path: Path) -> None:
    export(subject, ["mat"], tmp_path)
    back = octave(
        tmp_path,
        "t = load('test_20.mat');"
        "f = interp2(t.pressure_Pa, t.length_m, t.force_N, 4.1e5, 0.2801); a = t.about(1:7);"
        "save -v7 back.mat f a",
    )
    assert float(back["f"]) == pytest.approx(subject.pull.force(0.2801, 4.1e5), rel=1e-3)
    assert str(back["a"]) == "Test-20"
