"""Programs that tests run, and what is skipped where there are none."""

import shutil
import subprocess
import sys
from typing import Any

import pytest


def ran(*command: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """A program that has ended, whatever its code, with all that it printed."""
    words = [*map(str, command)]
    return subprocess.run(words, capture_output=True, text=True, check=False, **options)


def python(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    return ran(sys.executable, *arguments, **options)


def said(*arguments: object, **options: Any) -> str:
    """What a program of Python prints that must end well."""
    done = python(*arguments, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def needs(program: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(shutil.which(program) is None, reason=f"no {program} on this machine")


def command(*words: object) -> None:
    """A command of famjax in this process, which must end well."""
    from famjax.__main__ import main

    with pytest.raises(SystemExit) as stop:
        main([*map(str, words)])
    assert not stop.value.code
