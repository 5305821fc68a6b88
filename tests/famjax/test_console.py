"""How far a command is, on a terminal and elsewhere."""

import io
import time

import pytest
from rich.console import Console

from famjax import console


def shown(monkeypatch: pytest.MonkeyPatch, *, terminal: bool, patience: float) -> str:
    """What a work of two parts shows on standard error."""
    monkeypatch.setattr(console, "_PATIENCE", patience)
    file = io.StringIO()
    monkeypatch.setattr(
        console, "Console", lambda **_: Console(file=file, force_terminal=terminal, width=100)
    )
    with console.progress("fitting") as show:
        show(1, 4)
        time.sleep(0.1)
        show(2, 4)
        show(1, 9, "leaving out")
    return file.getvalue()


def test_a_terminal_has_a_bar_of_each_part(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, terminal=True, patience=0.0)
    assert "leaving out" in text
    assert "1/9" in text
    assert "-:--:--" in text  # the time left


def test_short_work_and_logs_have_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(monkeypatch, terminal=True, patience=60.0) == ""
    assert shown(monkeypatch, terminal=False, patience=0.0).strip() == ""
