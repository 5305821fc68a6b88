"""How far a command is, where standard error is a log."""

import re

import pytest

from famjax import console


def test_a_log_gets_a_line_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter([0.0, 1.0, 16.0, 16.0, 20.0])
    monkeypatch.setattr(console, "monotonic", lambda: next(clock))
    with console.progress("fitting") as show:
        for done in (1, 2, 3):
            show(done, 9, f"model {done}")
    printed = capsys.readouterr()
    assert printed.out == ""
    assert re.fullmatch(r"model 2, 2 of 9 done, [\d.e+]+/s, \d+ s left\n", printed.err)


def test_a_log_gets_a_line_for_every_step_where_asked(capsys: pytest.CaptureFixture[str]) -> None:
    with console.progress("fitting", every=0.0) as show:
        for done in (0, 1):
            show(done, 2, f"table {done + 1}")
    assert capsys.readouterr().err == "table 1, 0 of 2 done\ntable 2, 1 of 2 done\n"
