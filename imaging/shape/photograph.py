"""A photograph on its way to a measurement: the picture, the camera, and where it is from."""

import dataclasses

import numpy as np

from ..arrays import Image
from ..camera.pinhole import Camera


@dataclasses.dataclass(frozen=True)
class Photograph:
    """A picture in which the muscle stands upright.

    Attributes:
        rgb: shape (h, w, 3).
        camera: its centre in px of this picture.
        path: of the picture; empty for an array.
        time: when it was taken [s]; nan where that is not known.
        turned: the picture was turned a quarter turn clockwise first.
    """

    rgb: Image
    camera: Camera
    path: str
    time: float
    turned: bool = False

    def clockwise(self) -> "Photograph":
        """The same turned a quarter turn clockwise."""
        u, v = self.camera.centre
        return dataclasses.replace(
            self,
            rgb=np.ascontiguousarray(np.rot90(self.rgb, -1)),
            camera=dataclasses.replace(self.camera, centre=(self.rgb.shape[0] - 1 - v, u)),
            turned=True,
        )
