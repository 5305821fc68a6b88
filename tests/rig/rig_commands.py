"""Commands of `famjax rig` as a person types them, and plans for them."""

import io
from pathlib import Path

import pytest

from famjax.__main__ import main
from rig.calibration import write_calibration
from rig.simulation import PneumaticCircuit, SimulatedRig

PLAN = """
[plan]
pressures_psi = [{pressures}]
cycles = 1
stroke_in = {stroke}
rate_in_per_s = 0.2
settle_s = {settle}

[rig]
circuit = "{circuit}"
{limit}
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
calibration = "calibration.toml"
"""


def run(capsys: pytest.CaptureFixture, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main(["rig", *map(str, arguments)])
    captured = capsys.readouterr()
    return int(stop.value.code or 0), captured.out, captured.err


def words(option: str, values: list) -> list:
    """An option that is repeated."""
    return [word for value in values for word in (option, value)]


def write_plan(folder: Path, **changes: str) -> Path:
    fields = {"pressures": "40, 80", "circuit": "air", "limit": "pressure_limit_psi = 110",
              "settle": "3", "stroke": "3.2"}  # fmt: skip
    path = folder / "plan.toml"
    path.write_text(PLAN.format(**(fields | changes)))
    return path


def calibrated(folder: Path, **changes: str) -> Path:
    write_calibration(folder / "calibration.toml", SimulatedRig(PneumaticCircuit()).calibration())
    return write_plan(folder, **changes)


class Typed(io.StringIO):
    """Standard input on which something was typed."""

    def __init__(self, text: str, *, terminal: bool) -> None:
        super().__init__(text)
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal
