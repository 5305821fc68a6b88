"""`famjax export` as a person types it."""

import json
from pathlib import Path

import pytest

from famjax.__main__ import main


def run(capsys: pytest.CaptureFixture, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main([*map(str, arguments)])
    captured = capsys.readouterr()
    return int(stop.value.code or 0), captured.out, captured.err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["dmsp-30", "--to", "c"], "dmsp-30"),
        (["dmsp-10", "--to", "fortran"], "fortran"),
        (["dmsp-10", "--to", "c", "--length", "300"], "unit"),
        (["dmsp-10", "--to", "c", "--length", "0mm"], "must be > 0"),
        (["dmsp-10"], "--to"),
    ],
)
def test_what_cannot_be_exported_is_refused(
    arguments: list[str],
    says: str,
    capsys: pytest.CaptureFixture,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "export", *arguments)
    assert code != 0
    assert says in out + err
    assert not [*tmp_path.iterdir()]


@pytest.mark.slow
def test_a_fit(capsys: pytest.CaptureFixture, tmp_path: Path) -> None:
    code, _, _ = run(capsys, "fit", "DMSP-10-250", "--order", "2", "--output", tmp_path / "fit")
    assert code == 0
    file = tmp_path / "fit" / "fit.json"
    code, _, _ = run(capsys, "export", file, "--to", "c", "-o", tmp_path / "c")
    assert code == 0
    assert json.loads(file.read_text())["schema"].startswith("famjax-fit/")
    (head,) = (tmp_path / "c").glob("*.h")
    assert "of fit.json, sha256 " in head.read_text()
