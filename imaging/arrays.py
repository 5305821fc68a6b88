"""The kinds of arrays that pass from hand to hand, by the names that signatures give them."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Positions, brightnesses, errors."""

Single = NDArray[np.float32]
"""The same in half the memory, where a whole picture or many windows are worked on."""

Image = NDArray[np.uint8]
"""A picture: RGB, shape (h, w, 3), or one value for each pixel, shape (h, w)."""

Flags = NDArray[np.bool_]
"""Which of some things are meant."""

Indices = NDArray[np.int64]
"""Rows of a picture, numbers of marks."""
