"""Every choice that turns a photograph into figures."""

import dataclasses
from typing import Literal

import numpy as np

from .camera.pinhole import Camera
from .camera.tone import Tone
from .quality import QualityLimits
from .ruler.scale import RulerReading, Scale

METHODS = ("limb", "gradient", "half-level", "pixel")
ORIENTATIONS = ("vertical", "horizontal", "auto")
REFERENCE_DISTANCE = 1.524  # m, 60 in
_RESOLUTION = 0.0093  # m, 83 px at 226.63 px/in: a quarter of the smallest feature of a profile


@dataclasses.dataclass(frozen=True)
class Recipe:
    """How photographs of one camera set-up are measured.

    Attributes:
        scale: in the mid-plane.
        distance: camera to the muscle's axis [m]; None takes that of which the tapes' edges are arcs.
        centre: where the optical axis meets the picture (u, v) [px]; None takes the middle of the
            frame, and with it of a picture that is not a crop.
        crop_offset: column and row in the frame of the picture's first pixel [px]; None for an
            uncropped picture, or a crop about the middle of the frame.
        frame_size: width and height of the frame that was cropped [px]; needed with `crop_offset`
            unless `centre` is given.
        k1: radial distortion of the lens, as in `Camera`; None takes what the ruler shows, or 0.
        tone: the camera's tone curve; None takes sRGB, with what another may do in the errors.
        method: "limb" is the default; "gradient" and "half-level" take the steepest point and half
            the local step in linear light; "pixel" is the method of the reference work.
        orientation: of the muscle in the picture; "auto" turns it where needed. A horizontal
            one is turned a quarter turn clockwise before it is measured.
        tape_hue: of the tapes [deg]; None finds it.
        tape_diameter: known diameter of the tapes on the fittings [m]; the scale is checked against it.
        blur_px: of the outline [px]; None estimates it from the picture.
        edge_offset_px: added outward to each side of the outline [px], from a reference cylinder.
        resolution_px: wavelength along the axis that passes at half its height [px]; None takes
            9.3 mm, which is 83 px at 226.63 px/in.
        limits: the worst quality that still is a measurement.
        ruler: how the photograph of a ruler, if the scale comes from one, is read.
        braid_angle: measure it from the weave as well, which takes as long again.
        n_threads: of both families of the braid, if known [-]; None counts them in the picture.
        turns: N of a thread about the axis over the length, if known [-]: what the braid angle is
            compared with is atan(L / (pi N D)).

    Raises:
        ValueError: an option that is not known, a figure outside its range, or half of a crop.
    """

    scale: Scale
    distance: float | None = None
    centre: tuple[float, float] | None = None
    crop_offset: tuple[float, float] | None = None
    frame_size: tuple[int, int] | None = None
    k1: float | None = None
    tone: Tone | None = None
    method: Literal["limb", "gradient", "half-level", "pixel"] = "limb"
    orientation: Literal["vertical", "horizontal", "auto"] = "vertical"
    tape_hue: float | None = None
    tape_diameter: float | None = None
    blur_px: float | None = None
    edge_offset_px: float = 0.0
    resolution_px: float | None = None
    limits: QualityLimits = dataclasses.field(default_factory=QualityLimits)
    ruler: RulerReading = dataclasses.field(default_factory=RulerReading)
    braid_angle: bool = False
    n_threads: int | None = None
    turns: float | None = None

    def __post_init__(self) -> None:
        for name, known in (("method", METHODS), ("orientation", ORIENTATIONS)):
            if getattr(self, name) not in known:
                raise ValueError(f"{name} is one of {known}, got {getattr(self, name)!r}")
        if self.braid_angle and self.method == "pixel":
            raise ValueError(
                'the braid angle needs the body behind the outline, which method "pixel" has not: '
                'measure it with method "limb"'
            )
        if self.n_threads is not None and (self.n_threads < 8 or self.n_threads % 2):
            raise ValueError(
                "n_threads counts both families of the braid, an even number of 8 or more; got "
                f"{self.n_threads}"
            )
        for name in ("distance", "tape_diameter", "blur_px", "resolution_px", "turns"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be finite and > 0, got {value}")
        if self.resolution_px is not None and self.resolution_px < 8:
            raise ValueError(f"resolution_px must be at least 8 px, got {self.resolution_px}")
        if self.tape_hue is not None and not 0 <= self.tape_hue <= 360:
            raise ValueError(f"tape_hue is an angle from 0 to 360 deg, got {self.tape_hue}")
        if self.crop_offset is not None and self.frame_size is None and self.centre is None:
            raise ValueError(
                "a crop_offset needs the frame_size that was cropped, or the centre, to say where "
                f"the optical axis is; got crop_offset = {self.crop_offset} alone"
            )
        for name in ("centre", "crop_offset"):  # floats, as a recipe's file gives them back
            place = getattr(self, name)
            object.__setattr__(self, name, place and tuple(map(float, place)))

    def camera(self, width: int, height: int) -> Camera:
        """The camera for a picture of this size [px].

        Raises:
            ValueError: the crop does not lie in the frame.
        """
        centre = self._centre(width, height)
        return Camera(self.scale.px_per_m, self.camera_distance, centre, self.lens_k1)

    @property
    def camera_distance(self) -> float:
        """The stated distance, or the reference work's 60 in [m]."""
        return REFERENCE_DISTANCE if self.distance is None else self.distance

    @property
    def lens_k1(self) -> float:
        """The stated radial distortion, or what the scale's ruler shows of it."""
        return self.scale.k1 if self.k1 is None else self.k1

    @property
    def tone_curve(self) -> Tone:
        """The stated tone curve, or sRGB."""
        return Tone.srgb() if self.tone is None else self.tone

    @property
    def smoothing_px(self) -> float:
        """Resolution along the axis [px]."""
        if self.resolution_px is not None:
            return self.resolution_px
        return max(8.0, _RESOLUTION * self.scale.px_per_m)

    def _centre(self, width: int, height: int) -> tuple[float, float]:
        if self.centre is not None:
            return self.centre
        if self.crop_offset is None or self.frame_size is None:
            return (width - 1) / 2, (height - 1) / 2
        (u, v), (frame_width, frame_height) = self.crop_offset, self.frame_size
        if u < 0 or v < 0 or u + width > frame_width or v + height > frame_height:
            raise ValueError(
                f"the picture of {width} x {height} px at crop_offset {self.crop_offset} must lie "
                f"in the frame of {frame_width} x {frame_height} px"
            )
        return (frame_width - 1) / 2 - u, (frame_height - 1) / 2 - v
