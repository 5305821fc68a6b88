"""The exported C on this machine, and for an AVR: equal to the model, without warnings, small."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from processes import needs, ran
from targets import code_sections, compiled, exported_states, telling

from famjax.export import Subject, export


@pytest.mark.slow
@needs("gcc")
@pytest.mark.parametrize(
    ("real", "force_error", "pressure_error"), [("double", 1e-6, 1.0), ("float", 1e-4, 200.0)]
)
def test_c_is_the_model(
    real: str, force_error: float, pressure_error: float, dmsp_20: Subject, tmp_path: Path
) -> None:
    function = compiled(dmsp_20, tmp_path, real)
    L, P = exported_states(dmsp_20, 2000)
    force = np.asarray(dmsp_20.muscle.force(L, P))
    largest = force[:1000].max()
    assert np.abs(function("force")(L, P) - force).max() < force_error * largest
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
def test_an_avr_computes_the_same(dmsp_20: Subject, tmp_path: Path) -> None:
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
