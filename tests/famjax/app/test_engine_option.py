"""`--jobs`: of every long command."""

import pytest

from famjax.__main__ import main


@pytest.mark.parametrize("command", ["compare", "assess", "measure", "characterise"])
def test_every_long_command_has_jobs(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main([command, "here", "--jobs", "0"])
    assert stopped.value.code == 2
    assert "--jobs" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([command, "--help"])
    text = capsys.readouterr().out
    assert "--jobs" in text
