"""What the command line does where its output cannot go as it is."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from famjax.cards import write_card
from famjax.muscles import bundled_card


def start(*arguments: object, **streams: object) -> subprocess.Popen:
    command = [sys.executable, "-m", "famjax", *map(str, arguments)]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    return subprocess.Popen(command, env=environment, **streams)  # type: ignore[call-overload]


@pytest.mark.slow
def test_a_name_that_the_terminal_cannot_show_is_no_reason_to_end(tmp_path: Path) -> None:
    card = dataclasses.replace(bundled_card("DMSP-10"), name="M\u00fcller \u2116 7")
    path = write_card(card, tmp_path / "card.json")
    done = start(
        "predict", path, "--length", "240mm", "--pressure", "3bar",
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    out, told = done.communicate(timeout=120)
    assert (done.returncode, told) == (0, b"")
    assert rb"Force of M\xfcller \u2116 7" in out


def test_a_reader_that_has_left_is_no_error() -> None:
    """As in `famjax doctor | head -1`."""
    read, write = os.pipe()
    os.close(read)
    done = start("doctor", stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    _, told = done.communicate(timeout=120)
    assert (done.returncode, told) == (141, b"")
