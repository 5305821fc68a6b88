"""Matplotlib, imported without what no command shows."""

import importlib
import sys
from typing import Any


def load_matplotlib() -> None:
    """Import matplotlib's figures, with no tables of properties in their docstrings.

    Matplotlib writes these tables for each of its classes while it is imported, which takes a third
    of the time. A figure is the same without them.
    """
    if "matplotlib.figure" in sys.modules:
        return
    artist: Any = importlib.import_module("matplotlib.artist")
    table = artist.kwdoc
    artist.kwdoc = lambda _: ""
    try:
        importlib.import_module("matplotlib.figure")
    finally:
        artist.kwdoc = table
