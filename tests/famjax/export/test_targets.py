"""Exports in their targets: C here and on an AVR, Octave, MJX: equal to the model."""

import dataclasses
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from processes import needs, ran
from scipy.io import loadmat, savemat
from targets import code_sections, compiled, exported_states, rollout, rollout_derivatives, telling

import famjax
from famjax.export import Subject, export


@pytest.mark.slow
@needs("gcc")
@pytest.mark.parametrize(
    ("real", "force_error", "pressure_error"), [("double", 1e-6, 1.0), ("float", 1e-4, 200.0)]
)
def test_c_is_the_model(real, force_error, pressure_error, dmsp_20, tmp_path):
    function = compiled(dmsp_20, tmp_path, real)
    L, P = exported_states(dmsp_20, 2000)
    force = np.asarray(dmsp_20.muscle.force(L, P))
    assert np.abs(function("force")(L, P) - force).max() < force_error * force[:1000].max()
    stiffness = np.array([*map(dmsp_20.pull.stiffness, L.tolist(), P.tolist())])
    off = np.abs(function("stiffness")(L, P) - stiffness)
    inside = off[:1000].max() / stiffness[:1000].max()
    assert inside < {"double": 1e-12, "float": 1e-3}[real]
    told = telling(dmsp_20, L, P)
    assert told[:1000].sum() > 500  # the others are slack
    back = function("pressure")(L[told], force[told])
    assert np.abs(back - P[told]).max() < pressure_error


@needs("avr-gcc")
@needs("simavr")
def test_an_avr_computes_the_same(dmsp_20, tmp_path):
    export(dmsp_20, ["c"], tmp_path)
    options = {"compiler": "avr-gcc", "size": "avr-size"}
    sizes = code_sections(tmp_path / "dmsp_20.c", "-mmcu=atmega328p", **options)
    assert sizes[".text"] < 5500
    assert sizes[".rodata"] + sizes[".data"] + sizes[".bss"] < 64  # tables stay in the flash
    program = tmp_path / "pull.elf"
    sources = [Path(__file__).with_name("avr_pull.c"), tmp_path / "dmsp_20.c"]
    built = ran("avr-gcc", "-mmcu=atmega328p", "-Os", "-Wall", "-Wextra", "-Werror",
                f"-I{tmp_path}", "-o", program, *sources)  # fmt: skip
    assert built.returncode == 0, built.stderr
    done = ran("simavr", "-m", "atmega328p", "-f", "16000000", program, timeout=60)
    rows = re.findall(r"([0-9a-f]{8}) ([0-9a-f]{8}) (\d+) (\d+)", done.stdout + done.stderr)
    lengths = [0.24, 0.28, 0.31, 0.35]
    assert len(rows) == len(lengths)
    for length, (force, pressure, counts, more) in zip(lengths, rows, strict=True):
        (pull,), (back,) = (struct.unpack(">f", bytes.fromhex(one)) for one in (force, pressure))
        assert pull == pytest.approx(dmsp_20.pull.force(length, 4e5), rel=1e-5)
        assert back == pytest.approx(4e5, abs=200)
        assert int(counts) < 60  # 4 ms at 16 MHz
        assert int(more) < 400


def octave(folder: Path, commands: str) -> dict[str, np.ndarray]:
    """What is left in `back.mat` by commands of Octave that run in a folder."""
    done = ran("octave-cli", "--norc", "--quiet", "--eval", commands, cwd=folder, timeout=120)
    assert (folder / "back.mat").exists(), done.stderr
    return loadmat(folder / "back.mat", squeeze_me=True)


@needs("octave-cli")
@pytest.mark.parametrize("compliance", [0.0, 3e-5], ids=["rigid", "compliant rig"])
def test_octave_computes_the_equations(compliance, dmsp_20, tmp_path):
    mounted = famjax.MountedMuscle(dmsp_20.card.members[0].muscle, compliance, 0.8)
    dmsp_20 = Subject.of_card(dataclasses.replace(dmsp_20.card, members=(mounted,)))
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
    assert "L must be in m" in str(back["M"])
    assert dmsp_20.errors.force < 5e-3  # of the table, which is coarser with a compliant rig


@needs("octave-cli")
def test_octave_computes_the_table_to_the_last_digits(subject, tmp_path, monkeypatch):
    monkeypatch.setattr("famjax.export.targets.closed_form", lambda _: None)
    export(subject, ["matlab"], tmp_path)
    L, P = exported_states(subject, 100)
    asks = subject.pull.force, subject.pull.stiffness, subject.pull.area
    force, stiffness, area = (np.array([*map(ask, L.tolist(), P.tolist())]) for ask in asks)
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
def test_octave_reads_the_mat_file(subject, tmp_path):
    export(subject, ["mat"], tmp_path)
    back = octave(
        tmp_path,
        "t = load('test_20.mat');"
        "f = interp2(t.pressure_Pa, t.length_m, t.force_N, 4.1e5, 0.2801); a = t.about(1:7);"
        "save -v7 back.mat f a",
    )
    assert float(back["f"]) == pytest.approx(subject.pull.force(0.2801, 4.1e5), rel=1e-3)
    assert str(back["a"]) == "Test-20"


STEPS = 50


@pytest.mark.slow
def test_an_mjx_rollout_is_mujoco_s_and_its_derivative_that_of_differences(subject, tmp_path):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    pytest.importorskip("mujoco.mjx", reason="MuJoCo's MJX is not installed")
    exact, difference = rollout_derivatives(tmp_path, STEPS)
    assert exact == pytest.approx(difference, rel=1e-6)
    end, first = rollout(tmp_path, STEPS)
    assert abs(exact) * first > 1e-5  # m: E_1 moves the load
    export(subject, ["mujoco"], tmp_path)
    plain = mujoco.MjModel.from_xml_path(str(tmp_path / "test_20.xml"))
    data = mujoco.MjData(plain)
    data.qpos[0], data.ctrl[0] = 0.01, 4e5
    famjax.export.install(plain, {"test_20": subject.pull})
    try:
        mujoco.mj_step(plain, data, nstep=STEPS)
    finally:
        mujoco.set_mjcb_act_bias(None)
        mujoco.set_mjcb_act_gain(None)
    assert float(end(first)) == pytest.approx(data.qpos[0], abs=1e-8)
