"""The list of promises, what is chosen of it, the data it takes, its verdicts and its lines."""

import dataclasses
import importlib
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("clarabel")

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
MAP = """# specimen: rest_length_mm = 300
# specimen: wall_thickness_mm = 2
pressure_kPa,length_mm,force_N
100,300,30
200,300,70
100,280,20
"""


@pytest.fixture(scope="module", autouse=True)
def on_path() -> Iterator[None]:
    sys.path.insert(0, str(BENCHMARKS))
    yield
    sys.path.remove(str(BENCHMARKS))


@pytest.fixture(scope="module")
def module(on_path: None) -> ModuleType:
    return importlib.import_module("promises")


@pytest.fixture(scope="module")
def promise(on_path: None) -> ModuleType:
    return importlib.import_module("promise")


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    path = tmp_path / "mine.csv"
    path.write_text(MAP)
    return path


@pytest.fixture
def tiny(promise: ModuleType):
    """A promise that at least two readings are loaded."""
    return promise.Promise(
        4, "readings", lambda case: float(case.map.loaded.sum()), "len", "DMSP-10-250", "F > 0",
        "number of readings", 2.0, "at least", cost="quick", figure=True,
    )  # fmt: skip


def test_every_row_is_complete(module: ModuleType) -> None:
    keys = {(one.issue, one.name, one.data) for one in module.PROMISES}
    assert len(keys) == len(module.PROMISES)
    assert {one.issue for one in module.PROMISES} == {2, 3, 4, 5, 6, 12, 14, 15, 16, 17, 18}
    for one in module.PROMISES:
        assert math.isfinite(one.limit), one.name
        assert all((one.command, one.data, one.filter, one.statistic)), one.name
        assert one.cost in module.COSTS["long"], one.name


def test_every_limit_of_the_first_answer_is_a_promise(module: ModuleType) -> None:
    first = importlib.import_module("first_answer")
    limits = [row.limit(regime) for row in first.ROWS for regime in ("cold", "second")]
    rows = [one for one in module.PROMISES if one.name.startswith("first answer")]
    assert len(rows) == sum(not math.isnan(limit) for limit in limits) + len(first.CHECKS)


def test_promises_are_chosen_by_issue_and_name(module: ModuleType) -> None:
    assert {one.issue for one in module.chosen(["issue 4"], "long")} == {4}
    assert {one.cost for one in module.chosen([], "quick")} == {"quick"}
    assert module.chosen([], "long") == list(module.PROMISES)
    with pytest.raises(ValueError, match="no promise fits 'spam'"):
        module.chosen(["spam"], "quick")


def test_data_are_maps_folders_and_places(module: ModuleType, csv: Path, tmp_path: Path) -> None:
    words = [f"bpa10 10cm={csv}", "DMSP-10-250", str(tmp_path)]
    assert module.given_data(words) == ({"bpa10 10cm": str(csv)}, ["DMSP-10-250", str(csv)])
    with pytest.raises(ValueError, match="there is no nowhere"):
        module.given_data(["nowhere"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match="has no CSV file"):
        module.given_data([str(tmp_path / "empty")])


def test_verdicts(promise: ModuleType, tiny, csv: Path) -> None:
    load = importlib.import_module("first_answer_inputs").load
    case = promise.Case(load(str(csv)), "mine")
    found = promise.judge(tiny, case, own_data=True)
    assert (found.verdict, found.value) == ("holds", 3)
    strict = dataclasses.replace(tiny, limit=4)
    assert promise.judge(strict, case, own_data=True).verdict == "does NOT hold"
    own = dataclasses.replace(strict, of_its_data=True)
    assert promise.judge(own, case, own_data=False).verdict == "measured"
    assert promise.judge(own, case, own_data=True).verdict == "does NOT hold"
    no_map = promise.judge(tiny, promise.Case(name="bpa10 10cm"), own_data=True)
    assert no_map.verdict == "not run"
    assert "--data 'bpa10 10cm=MAP.csv'" in no_map.why
    broken = dataclasses.replace(tiny, measure=lambda _: 1 / 0)
    assert promise.judge(broken, case, own_data=True).verdict == "does NOT hold"
    unknown = dataclasses.replace(tiny, measure=lambda _: math.nan)
    assert promise.judge(unknown, case, own_data=True).verdict == "does NOT hold"
    elsewhere = promise.shown(12, "tests", "pytest", "min", 5.0)
    assert promise.judge(elsewhere, case, own_data=True).verdict == "not run"


def test_what_is_computed_once_is_shared(promise: ModuleType) -> None:
    case = promise.Case(name="a")
    assert case.once("key", lambda: 1) == case.once("key", lambda: 2) == 1
    assert dataclasses.replace(case, name="b").once("key", lambda: 3) == 3


def test_other_maps_are_taken_once_and_places_with_their_limits(
    module: ModuleType, promise: ModuleType, tiny, csv: Path
) -> None:
    twin = dataclasses.replace(tiny, data="DMSP-20-300")
    elsewhere = dataclasses.replace(tiny, data="synthetic muscles", name="synthetic")
    rows = [tiny, twin, elsewhere]

    def taken(places: dict[str, str], others: list[str]) -> list[tuple[str, bool]]:
        found = module.cases(rows, places, others, promise.Case())
        return [(case.name, own) for _, case, own in found]

    file = str(csv)
    assert taken({}, []) == [
        ("DMSP-10-250", True), ("DMSP-20-300", True), ("synthetic muscles", True),
    ]  # fmt: skip
    assert taken({}, [file]) == [(file, False), ("synthetic muscles", True)]
    assert taken({"DMSP-20-300": file}, [])[1] == (f"DMSP-20-300={file}", True)


def test_lines_file_and_exit_code(
    module: ModuleType, tiny, csv: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    strict = dataclasses.replace(tiny, name="many readings", limit=1000)
    monkeypatch.setattr(module, "PROMISES", (tiny, strict))
    before = tmp_path / "before.json"
    arguments = ["--data", str(csv), "--json", str(before)]
    assert module.main([*arguments, "--only", "issue 4: readings"]) == 0
    (row,) = json.loads(before.read_text())
    assert (row["value"], row["verdict"], row["limit"]) == (3, "holds", 2)
    assert module.main(["--data", str(csv)]) == 1
    first, second, counts = capsys.readouterr().out.splitlines()[-3:]
    assert first.startswith("holds         issue 4   readings: 3 (at least 2) | number of readings")
    assert second.startswith("does NOT hold issue 4   many readings: 3 (at least 1000)")
    assert counts == "1 holds, 1 does NOT hold, 0 measured, 0 not run"
    before.write_text(json.dumps([row | {"value": 3.001}]))
    again = ["--data", str(csv), "--only", "issue 4: readings", "--reference", str(before)]
    assert module.main(again) == 1
    assert "was 3.001" in capsys.readouterr().out


def test_promises_are_listed(module: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert module.main(["--list"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(module.PROMISES)


@pytest.mark.slow
def test_promises_of_a_fit_hold_on_another_map(module: ModuleType) -> None:
    """Nothing in what is asked of a certificate belongs to one map."""
    assert module.main(["--only", "certificate", "--data", "DMSP-10-250"]) == 0
