"""Matplotlib and SciPy, imported without what no command shows or uses."""

import contextlib
import importlib
import sys
from collections.abc import Iterator
from typing import Any

_UNUSED = frozenset({"f2py", "testing"})
"""Parts of NumPy that take a tenth of a second to import, and that it imports when they are asked for."""


def load_matplotlib() -> None:
    """Import matplotlib's figures, with no tables of properties in their docstrings.

    Matplotlib writes these tables for each of its classes while it is imported, which takes a third
    of the time. A figure is the same without them.
    """
    if "matplotlib.figure" in sys.modules:
        return
    with _replaced("matplotlib.artist", kwdoc=lambda _: ""):
        importlib.import_module("matplotlib.figure")


def load_scipy() -> None:
    """Import SciPy's filters, without NumPy's translator of Fortran and its tools for tests.

    While it is imported SciPy copies every public name of NumPy, which loads these two.
    """
    if "scipy.ndimage" in sys.modules:
        return
    numpy: Any = importlib.import_module("numpy")
    listed = [name for name in dir(numpy) if name not in _UNUSED]
    public = [name for name in numpy.__all__ if name not in _UNUSED]
    with _replaced("numpy", __dir__=lambda: listed, __all__=public):
        importlib.import_module("scipy.ndimage")


@contextlib.contextmanager
def _replaced(module: str, **names: Any) -> Iterator[None]:
    """A module with other values of some names, as long as something else is imported."""
    of = vars(importlib.import_module(module))
    before = {name: of[name] for name in names}
    of.update(names)
    try:
        yield
    finally:
        of.update(before)
