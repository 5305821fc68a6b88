"""The README is run: its examples, its length, its commands."""

import re
from pathlib import Path

import pytest

README = (Path(__file__).parents[2] / "README.md").read_text()
EXAMPLES = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_readme_is_short_and_holds_the_two_commands() -> None:
    assert len(README.splitlines()) < 150
    assert (
        'python3 -m venv .venv && .venv/bin/python -m pip install -e ".[all]" '
        "&& .venv/bin/famjax fit\n"
    ) in README
    assert (
        'python3 -m venv .venv && .venv/bin/python -m pip install -e ".[all,test]" '
        "&& .venv/bin/python -m pytest\n"
    ) in README


@pytest.mark.parametrize("number", range(len(EXAMPLES)))
def test_examples_run(
    number: int, capsys: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(Path(__file__).parents[2] / "examples")
    exec(compile(EXAMPLES[number], f"README example {number}", "exec"), {})
    printed = capsys.readouterr().out
    assert printed.strip()
    assert "nan" not in printed
