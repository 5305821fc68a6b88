"""How far a command is, where standard error is a log."""

import re

import pytest

from famjax.commands import terminal


def test_a_log_gets_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 1.0, 16.0, 16.0, 20.0])
    monkeypatch.setattr(terminal, "monotonic", lambda: next(clock))
    with terminal.progress_bar() as shown:
        task = shown.add_task("fitting", total=None)
        for done in (1, 2, 3):
            shown.update(task, completed=done, total=9, description=f"model {done}")
    printed = capsys.readouterr()
    assert printed.out == ""
    assert re.fullmatch(r"model 2, 2 of 9 done, [\d.e+]+/s, \d+ s left\n", printed.err)


def test_a_log_gets_a_line_for_every_step_where_asked(capsys: pytest.CaptureFixture[str]) -> None:
    with terminal.progress_bar(every=0.0) as shown:
        task = shown.add_task("fitting", total=None)
        for done in (0, 1):
            shown.update(task, completed=done, total=2, description=f"table {done + 1}")
    assert capsys.readouterr().err == "table 1, 0 of 2 done\ntable 2, 1 of 2 done\n"
