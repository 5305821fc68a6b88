"""Puts `examples/chambers2021` on `sys.path`: the dissertation's tables are computed there, once."""

import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "chambers2021"
if str(FOLDER) not in sys.path:
    sys.path.insert(0, str(FOLDER))
