"""The folder of finished parts: what goes in comes out, other work is refused, damage is repaired."""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import Store, keepable
from famjax.boundary.tasks.part_file import column_of_one

PART = {
    "table": np.array([[1.0, np.nan], [np.inf, -0.0]]),
    "single": np.arange(3, dtype=np.float32),
    "none": np.zeros((0, 3)),
    "point": np.array(3),
    "yes": np.array([True, False]),
    "names": np.array([["a", "long"]]),
    "number": 2.5,
    "nan": float("nan"),
    "count": 7,
    "is": True,
    "text": "muscle",
    "nothing": None,
    "list": ["at a bound", 1],
}


def test_a_part_comes_back_to_the_last_bit_with_its_shapes_and_types(tmp_path: Path) -> None:
    Store(tmp_path, "test", {}, 3).keep(1, PART)
    (back,) = Store(tmp_path, "test", {}, 3)
    assert list(back) == list(PART)
    for name, value in PART.items():
        if isinstance(value, np.ndarray):
            assert back[name].dtype == value.dtype
            assert back[name].shape == value.shape
            assert back[name].tobytes() == value.tobytes()
        else:
            assert type(back[name]) is type(value)
            assert back[name] == value or name == "nan"


def test_a_plain_value_is_the_column_that_arrow_makes_of_it() -> None:
    arrow = pytest.importorskip("pyarrow")
    for value in (True, False, 7, -(2**40), 2.5, float("inf"), "", "Länge", '["a", 1]'):
        made = column_of_one(value, arrow)
        made.validate(full=True)
        assert made.equals(arrow.array([value])), value
    assert np.isnan(column_of_one(float("nan"), arrow)[0].as_py())


def test_others_read_a_part_as_a_table(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    Store(tmp_path, "test", {}, 1).keep(0, {"force_N": np.array([1.0, 2.0]), "name": "a"})
    table = parquet.read_table(tmp_path / "parts" / "000000.parquet")
    assert table.to_pylist() == [{"force_N": [1.0, 2.0], "name": "a"}]


def test_a_folder_of_other_settings_is_refused_with_what_differs(tmp_path: Path) -> None:
    Store(tmp_path, "sweep", {"orders": [1, 2], "seed": 0}, 3, names=["a", "b", "c"])
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert manifest == {
        "format": "famjax parts 1",
        "kind": "sweep",
        "parts": 3,
        "settings": {"orders": [1, 2], "seed": 0},
        "names": ["a", "b", "c"],
    }
    with pytest.raises(
        InputError, match=r"other settings: parts was 3, now 4; settings.seed was 0, now 1; names"
    ):
        Store(tmp_path, "sweep", {"orders": [1, 2], "seed": 1}, 4)
    (tmp_path / "manifest.json").write_text("[")
    with pytest.raises(InputError, match=r"manifest.json is damaged"):
        Store(tmp_path, "sweep", {}, 3)
    (tmp_path / "manifest.json").unlink()
    (tmp_path / "parts" / "000000.parquet").touch()
    with pytest.raises(InputError, match=r"holds parts without a manifest\.json"):
        Store(tmp_path, "sweep", {}, 3)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be used"):
        Store(tmp_path / "file", "sweep", {}, 3)


@pytest.mark.parametrize("damage", ["cut", "empty", "byte"])
def test_a_damaged_part_is_reported_and_done_again(damage: str, tmp_path: Path) -> None:
    store = Store(tmp_path, "test", {}, 2)
    for index in range(2):
        store.keep(index, {"x": np.random.default_rng(index).normal(size=500)})
    file = tmp_path / "parts" / "000001.parquet"
    sound = file.read_bytes()
    middle = len(sound) // 2
    spoilt = sound[:middle] + bytes([sound[middle] ^ 1]) + sound[middle + 1 :]
    file.write_bytes({"cut": sound[:-9], "empty": b"", "byte": spoilt}[damage])
    with pytest.warns(UserWarning, match=r"000001.parquet is damaged \(.+\); it is done again"):
        again = Store(tmp_path, "test", {}, 2)
    assert 0 in again
    assert 1 not in again
    with pytest.raises(IndexError, match="part 1 of the test is not done"):
        again[1]
    again.keep(1, {"x": np.random.default_rng(1).normal(size=500)})
    assert file.read_bytes() == sound


def test_what_was_being_written_is_not_a_part(tmp_path: Path) -> None:
    Store(tmp_path, "test", {}, 2)
    draft = tmp_path / "parts" / "000000.parquet.unfinished"
    draft.write_bytes(b"PAR1")
    assert 0 not in Store(tmp_path, "test", {}, 2)
    assert not draft.exists()


def test_what_a_file_cannot_keep_is_refused(tmp_path: Path) -> None:
    store = Store(tmp_path, "test", {}, 1)
    with pytest.raises(InputError, match="law must be an array of numbers or texts"):
        store.keep(0, {"law": object()})
    assert 0 not in store
    store.remove()
    assert not tmp_path.exists()


def test_memory_needs_no_package_and_a_folder_says_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    Store(None, "test", {}, 1).keep(0, PART)
    with pytest.raises(InputError, match="pyarrow comes with the extra 'tables'"):
        Store(tmp_path, "test", {}, 1)


def test_without_pyarrow_nothing_is_kept_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert keepable(tmp_path) == tmp_path
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.warns(UserWarning, match=r"begins anew: .*famjax\[tables\]"):
        assert keepable(tmp_path) is None
