"""`famjax export` as a person types it."""

import json
from pathlib import Path
from typing import get_args

import pytest

import famjax
from famjax.__main__ import main
from famjax.export import TARGETS
from famjax.muscles import bundled_card
from fitting.cli.muscle import Target, export


def run(capsys: pytest.CaptureFixture, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as stop:
        main([*map(str, arguments)])
    captured = capsys.readouterr()
    return int(stop.value.code or 0), captured.out, captured.err


def test_the_help_has_every_target() -> None:
    assert get_args(Target) == tuple(TARGETS)
    paragraphs = (export.__doc__ or "").split("\n\n")
    for name in TARGETS:
        assert any(name in line.partition(":")[0] for line in paragraphs), name


@pytest.mark.slow
def test_a_bundled_muscle_cut_to_length(capsys: pytest.CaptureFixture, tmp_path: Path) -> None:
    code, out, _ = run(
        capsys, "export", "dmsp-10", "--to", "c", "--to", "csv", "--length", "300mm",
        "-o", tmp_path / "c",
    )  # fmt: skip
    assert code == 0
    assert out.count("written: ") == 3
    text = (tmp_path / "c" / "dmsp_10.h").read_text()
    rest = float(bundled_card("DMSP-10").muscle.geometry.rest_length)
    assert f"cut from {rest:.6g} to 0.3 m" in text
    assert "by `famjax" in text


@pytest.mark.slow
def test_a_card(capsys: pytest.CaptureFixture, tmp_path: Path) -> None:
    card = famjax.muscles.bundled_card("dmsp-10")
    famjax.cards.write_card(card, tmp_path / "mine.json")
    code, _, _ = run(
        capsys, "export", tmp_path / "mine.json", "--to", "mujoco", "-o", tmp_path / "out"
    )
    assert code == 0
    assert "of mine.json, sha256 " in (tmp_path / "out" / "dmsp_10_mujoco.py").read_text()


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
