"""The commands of `famjax`, one file for each: calls of the library, printed and saved.

The only folder of this package that imports the others, and only inside its commands.
"""

from . import compare, design, doctor, identify, measure, ramps, reproduce, rig, series, sweep
from .app import app as app

__all__ = [
    "app",
    "compare",
    "design",
    "doctor",
    "identify",
    "measure",
    "ramps",
    "reproduce",
    "rig",
    "series",
    "sweep",
]
