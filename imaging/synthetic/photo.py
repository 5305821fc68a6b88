"""A photograph with the truth beside it."""

import dataclasses
import datetime
from os import PathLike
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from .jpeg_file import encode_jpeg, stamped
from .scene import Jpeg
from .truth import RulerTruth, Truth

T = TypeVar("T", Truth, RulerTruth)


@dataclasses.dataclass(frozen=True)
class Photo(Generic[T]):
    """A photograph.

    Attributes:
        rgb: what a program reads from the file, uint8, shape (h, w, 3).
        shown: what it shows, None where the cloth is alone; `truth` is the same and never None.
        file: the JPEG file's bytes; None where the scene has no compression.
        time: when it was taken, local time.
    """

    rgb: NDArray[np.uint8]
    shown: T | None
    file: bytes | None
    time: datetime.datetime | None = None

    @property
    def truth(self) -> T:
        """What a perfect measurement of the picture would find.

        Raises:
            ValueError: the cloth is alone in the picture.
        """
        if self.shown is None:
            raise ValueError("the picture shows the cloth alone: there is nothing to be true of")
        return self.shown

    def jpeg(self) -> bytes:
        """The JPEG file, time stamp included; `rgb` is what it decodes to.

        A picture of a scene without compression is written at quality 100, colour in full.
        """
        data = self.file or encode_jpeg(self.rgb, Jpeg(100, "444"))
        return data if self.time is None else stamped(data, self.time)

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the file: JPEG by a name that ends in .jpg or .jpeg, any other form that OpenCV knows.

        A time stamp goes into a JPEG only.

        Returns:
            The path.

        Raises:
            OSError: OpenCV could not write it.
        """
        import cv2  # noqa: PLC0415 - heavy, and needed here only

        path = Path(path)
        if path.suffix.lower() in {".jpg", ".jpeg"}:
            path.write_bytes(self.jpeg())
        elif not cv2.imwrite(str(path), cv2.cvtColor(self.rgb, cv2.COLOR_RGB2BGR)):
            raise OSError(f"OpenCV could not write {path}")
        return path
