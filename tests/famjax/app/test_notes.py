"""Warnings as the command line prints them."""

import subprocess
import sys

WARNS = """
import sys, warnings
import famjax.app.cli as command
def run(words):
    warnings.warn("not kept", UserWarning)
    warnings.warn("for developers", DeprecationWarning)
command._run = run
sys.argv = ["famjax", "doctor"]
command.main()
"""


def test_a_warning_is_a_note_and_one_for_developers_is_none() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WARNS], capture_output=True, text=True, check=False
    )
    assert done.stderr == "note: not kept\n"
