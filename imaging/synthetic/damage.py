"""Files as they come from a failing card or a broken transfer."""

from typing import Literal

import numpy as np

_KEPT = 0.6  # part of a truncated file that is left
_STRETCH = 400  # bytes that are spoilt


def damaged(
    data: bytes, kind: Literal["truncated", "scrambled", "blanked", "flipped"], seed: int = 0
) -> bytes:
    """A JPEG file with a fault.

    Args:
        data: the file.
        kind: "truncated" lacks its last part; "scrambled" has noise and "blanked" has zeros in a
            stretch somewhere in the middle half, where most decoders carry on in silence; "flipped"
            has one wrong bit there.
        seed: of the place and the noise.
    """
    if kind == "truncated":
        return data[: int(_KEPT * len(data))]
    random = np.random.default_rng(seed)
    start = int(random.integers(len(data) // 4, 3 * len(data) // 4 - _STRETCH))
    if kind == "flipped":
        wrong = data[start] ^ (1 << int(random.integers(8)))
        return data[:start] + bytes([wrong]) + data[start + 1 :]
    # 0xff begins a marker: leaving it out keeps this a fault of the data, not of the structure.
    noise = random.integers(0, 0xFF, _STRETCH, np.uint8).tobytes()
    stretch = noise if kind == "scrambled" else bytes(_STRETCH)
    return data[:start] + stretch + data[start + _STRETCH :]
