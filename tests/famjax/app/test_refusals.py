"""What the commands say where they cannot go on, or were stopped."""

from pathlib import Path

import pytest

from famjax.__main__ import main
from famjax.app.cli import farewell

MAP = "pressure_kPa,length_mm,force_N\n100,300,50\n200,300,120\n100,290,20\n200,290,80\n"


def test_what_is_left_of_a_stopped_command() -> None:
    text = farewell(["characterise", "folder"])
    assert text.endswith("kept in results, and the same command goes on from there")
    assert farewell(["fit"]).endswith("nothing was written")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("fit", "DMSP-20-30"), "did you mean DMSP-20-300?"),
        (("fit", "MAP", "MAP"), "Several muscles of one series: famjax series"),
        (("fit", "MAP", "--geometry", "a:B", "--shape", "m.nc"), "either --shape or --geometry"),
        (("assess", "MAP"), "say what to assess: --validate"),
        (("assess", "MAP", "--validate"), "give a fit.json"),
        (("assess", "MAP", "--hysteresis", "MAP"), "is not the branches.csv that famjax ramps"),
        (("fit", "MAP", "--law", "ogden", "--order", "2"), "got 2 for ogden: leave the order out"),
        (
            ("fit", "MAP", "--specimen", "braid_angle_deg=65"),
            "or held by --bounds braid_angle_deg=65",
        ),
        (("predict", "MAP", "--length", "270mm", "--pressure", "3bar"), "give a fit.json"),
        (
            ("predict", "MAP", "--length", "270mm", "--pressure", "-3bar"),
            "A value with a minus sign is written --pressure=-3bar",
        ),
        (
            ("fit", "--rest-length", "300mm"),
            "Unknown option: --rest-length. Try 'famjax fit --help'",
        ),
        (("rig", "simulat"), "Try 'famjax rig --help'"),
        (("series", "MAP"), "predict --rest-length"),
        (("export", "DMSP-20", "--to", "csv", "--length", "1mm"), "shorter than its rounded ends"),
        (("measure", "--scale", "90+-0.1 px/in"), "famjax: there are no pictures to measure"),
    ],
)
def test_a_refusal_says_what_to_do(
    capsys: pytest.CaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "map.csv"
    path.write_text(MAP)
    with pytest.raises(SystemExit) as stop:
        main([*(str(path) if one == "MAP" else one for one in arguments)])
    err = capsys.readouterr().err
    assert stop.value.code == 2
    assert message in " ".join(err.split())
    assert "class '" not in err
    assert "Equinox" not in err
    assert sorted(tmp_path.iterdir()) == [path]
