"""The light on the scene, and the cloth behind it."""

import dataclasses
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Reflectance = Literal["lambert", "oren-nayar", "sqrt"]
_ROUGHNESS = 0.35  # [rad], Oren and Nayar's spread of the facets


@dataclasses.dataclass(frozen=True)
class Lamp:
    """A soft lamp far away.

    Attributes:
        direction: from the muscle to the lamp (X right, Y down, Z away from the camera); only the
            direction counts.
        strength: light it sends on a white surface that faces it [-], 1 is the picture's white.
        softness: sine of the angle over which its light fades at the terminator [-], > 0.
    """

    direction: tuple[float, float, float]
    strength: float
    softness: float = 0.25

    def __post_init__(self) -> None:
        if not (self.softness > 0 and self.strength >= 0 and np.linalg.norm(self.direction) > 0):
            raise ValueError(f"a lamp has a direction, strength >= 0 and softness > 0; got {self}")

    def irradiance(self, normal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Light on surfaces with these normals, shape (n, 3) -> (n,)."""
        direction = np.array(self.direction) / np.linalg.norm(self.direction)
        x, w = normal @ direction, self.softness
        return self.strength * np.where(x > w, x, np.clip(x + w, 0, None) ** 2 / (4 * w))


@dataclasses.dataclass(frozen=True)
class Light:
    """Lamps, ambient light and what the cloth makes of them.

    Attributes:
        lamps: the lamps.
        ambient: light from everywhere [-].
        reflectance: how the threads scatter: "lambert" as the cosine, "oren-nayar" as a rough
            surface, "sqrt" as the root of the cosine.
        cloth: reflected light of the cloth [-].
        cloth_gradient: its relative change from the left edge of the picture to the right [-].
        stray: light of an out-of-focus reflection on the cloth [-].
        stray_place: its middle, as parts of the picture's width and height.
    """

    lamps: tuple[Lamp, ...]
    ambient: float = 0.10
    reflectance: Reflectance = "oren-nayar"
    cloth: float = 0.006
    cloth_gradient: float = 0.5
    stray: float = 0.012
    stray_place: tuple[float, float] = (0.12, 0.75)

    @classmethod
    def side(cls) -> "Light":
        """Two soft lamps, 60 degrees to the left and 55 to the right: bright limbs, as advised."""
        return cls((Lamp((-0.87, -0.10, -0.50), 0.85), Lamp((0.82, -0.15, -0.57), 0.70)))

    @classmethod
    def frontal(cls) -> "Light":
        """Two lamps beside the camera: the limb a quarter as bright as the middle."""
        return cls((Lamp((-0.2, -0.1, -0.97), 0.5), Lamp((0.2, -0.1, -0.97), 0.5)), ambient=0.28)

    @classmethod
    def harsh(cls) -> "Light":
        """One hard lamp at the camera: the limb at 8 percent, where thresholds fail."""
        return cls((Lamp((0.0, -0.05, -1.0), 1.0, 0.02),), ambient=0.08)

    def on_threads(
        self, normal: NDArray[np.float64], sight: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Light that white threads send to the camera.

        Args:
            normal: of the threads, shape (n, 3).
            sight: from the surface to the camera, unit, shape (n, 3).

        Returns:
            shape (n,).

        References:
            Oren and Nayar 1994, equation 30 (the qualitative model).
        """
        total = np.full(normal.shape[0], self.ambient)
        for lamp in self.lamps:
            lit = lamp.irradiance(normal)
            if self.reflectance == "sqrt":
                lit = np.sqrt(lit * lamp.strength)
            elif self.reflectance == "oren-nayar":
                lit = lit * _oren_nayar(normal, np.array(lamp.direction), sight)
            total += lit
        return total


def _oren_nayar(
    normal: NDArray[np.float64], lamp: NDArray[np.float64], sight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The factor by which a rough surface scatters more than Lambert's, shape (n,)."""
    lamp = lamp / np.linalg.norm(lamp)
    cos_i = np.clip(normal @ lamp, 0.05, 1)
    cos_r = np.clip(np.einsum("ij,ij->i", normal, sight), 0.05, 1)
    along = np.clip(sight @ lamp - cos_i * cos_r, 0, None)  # sin sin cos(delta phi)
    s2 = _ROUGHNESS**2
    A, B = 1 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09)
    return A + B * along / np.maximum(cos_i, cos_r)
