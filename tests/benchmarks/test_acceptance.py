"""The acceptance table, what is chosen of it, the data it takes, its verdicts and its lines."""

import dataclasses
import json
import math
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
acceptance = pytest.importorskip("acceptance")
row = pytest.importorskip("row")

MAP = """# specimen: rest_length_mm = 300
# specimen: wall_thickness_mm = 2
pressure_kPa,length_mm,force_N
100,300,30
200,300,70
100,280,20
"""


def measured(case):
    return {"readings": float(case.map.loaded.sum()), "nan": math.nan}


def failing(_):
    raise ZeroDivisionError("no\nmore")


@pytest.fixture
def csv(tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text(MAP)
    return path


@pytest.fixture
def tiny(monkeypatch):
    """A row that at least two readings are loaded."""
    monkeypatch.setitem(sys.modules, "stand_in", sys.modules[__name__])
    (found,) = row.rows(
        "a map", "stand_in:measured", ("readings", ">=", 2.0, "it is tiny"), command="len",
        data="DMSP-10-250", part="F > 0", cost="quick",
    )  # fmt: skip
    return found


def test_every_row_is_complete():
    keys = {(one.title, one.direction, one.data) for one in acceptance.ROWS}
    assert len(keys) == len(acceptance.ROWS) > 130
    for one in acceptance.ROWS:
        assert math.isfinite(one.limit), one.title
        assert one.direction in ("<=", ">="), one.title
        assert all((one.command, one.data, one.filter, one.statistic, one.reason)), one.title
        assert one.cost in acceptance.COSTS["long"], one.title
        module, _, function = one.measure.partition(":")
        source = (Path(acceptance.__file__).parent / f"{module}.py").read_text()
        assert f"\ndef {function}(" in source, one.measure


def test_data_are_maps_folders_and_places(csv, tmp_path):
    words = [f"bpa10 10cm={csv}", "DMSP-10-250", str(tmp_path)]
    assert acceptance.given_data(words) == ({"bpa10 10cm": str(csv)}, ["DMSP-10-250", str(csv)])
    (tmp_path / "empty").mkdir()
    for bad, why in (("nowhere", "no nowhere"), (str(tmp_path / "empty"), "no CSV file")):
        with pytest.raises(ValueError, match=why):
            acceptance.given_data([bad])


def test_verdicts(tiny, csv):
    case = row.Case("mine", str(csv))

    def verdict(own_data=True, **changes):
        return row.judge(dataclasses.replace(tiny, **changes), case, own_data=own_data).verdict

    assert row.judge(tiny, case, own_data=True).value == 3
    assert verdict() == "holds"
    assert verdict(limit=4) == "does NOT hold"
    assert verdict(own_data=False, limit=4, of_its_data=True) == "measured"
    assert verdict(limit=4, of_its_data=True) == "does NOT hold"
    assert verdict(measure="stand_in:failing") == "does NOT hold"
    assert verdict(statistic="nan") == "does NOT hold"
    assert verdict(statistic="of another machine") == "not run"
    absent = row.judge(tiny, row.Case("bpa10 10cm"), own_data=True)
    assert absent.verdict == "not run"
    assert "--data 'bpa10 10cm=PATH'" in absent.why


def test_lines_file_and_exit_code(tiny, csv, tmp_path, monkeypatch, capsys):
    strict = dataclasses.replace(tiny, name="another map", limit=1000)
    monkeypatch.setattr(acceptance, "ROWS", (tiny, strict))
    out = tmp_path / "found.json"
    arguments = ["--data", str(csv)]
    assert acceptance.main([*arguments, "--json", str(out), "--only", "a map"]) == 0
    (found,) = json.loads(out.read_text())
    assert list(found) == ["name", "command", "data", "filter", "statistic", "direction", "limit",
                           "reason", "seed", "cost", "value", "verdict", "why"]  # fmt: skip
    assert (found["value"], found["verdict"], found["limit"]) == (3, "holds", 2)
    assert acceptance.main(arguments) == 1
    first, second, counts = capsys.readouterr().out.splitlines()[-3:]
    assert first.startswith("holds         a map: readings 3 (>= 2: it is tiny)")
    assert second.startswith("does NOT hold another map: readings 3 (>= 1000: it is tiny)")
    assert counts == "1 holds, 1 does NOT hold"
    assert acceptance.main(["--list"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2
    with pytest.raises(SystemExit):
        acceptance.main(["--only", "spam"])


@pytest.mark.slow
def test_certificates_hold_on_another_map():
    assert acceptance.main(["--only", "certificate", "--data", "DMSP-10-250"]) == 0
