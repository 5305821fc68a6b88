"""Every choice that turns a photograph into figures, and the TOML file of them."""

import dataclasses
import functools
from pathlib import Path
from typing import Any, Literal

import numpy as np

from famjax.boundary.toml_file import Form, from_entries, read_toml, to_entries, toml_text

from .camera import Camera, RulerReading, Scale, Tone
from .errors import ImagingError
from .quality import QualityLimits

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
        if self.orientation not in (known := ("vertical", "horizontal", "auto")):
            raise ValueError(f"orientation is one of {known}, got {self.orientation!r}")
        if self.n_threads is not None and (self.n_threads < 8 or self.n_threads % 2):
            raise ValueError(
                "n_threads counts both families of the braid, an even number of 8 or more; got "
                f"{self.n_threads}"
            )
        for name in ("distance", "tape_diameter", "blur_px", "resolution_px", "turns"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be finite and > 0, got {value}")
        for name, least, most in (("resolution_px", 8, np.inf), ("tape_hue", 0, 360)):
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise ValueError(f"{name} must be {least} to {most}, got {value}")
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
        centre = (width - 1) / 2, (height - 1) / 2
        if self.centre is not None:
            centre = self.centre
        elif self.crop_offset is not None and self.frame_size is not None:
            (u, v), (frame_width, frame_height) = self.crop_offset, self.frame_size
            if u < 0 or v < 0 or u + width > frame_width or v + height > frame_height:
                raise ValueError(
                    f"the picture of {width} x {height} px at crop_offset {self.crop_offset} must lie "
                    f"in the frame of {frame_width} x {frame_height} px"
                )
            centre = (frame_width - 1) / 2 - u, (frame_height - 1) / 2 - v
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
        return self.resolution_px or max(8.0, _RESOLUTION * self.scale.px_per_m)


_FORMAT = "famjax recipe 1"


_FORM = Form(
    kinds=dict.fromkeys(("distance", "tape_diameter", "pitch", "placement_stderr"), "length"),
    keys={"tape_hue": "tape_hue_deg", "stderr": "stderr_px_per_m"},
    codecs={
        Tone: (
            lambda tone: "srgb" if tone == Tone.srgb() else tone.table.tolist(),
            lambda entry: Tone.srgb() if entry == "srgb" else Tone(np.array(entry, float)),
        )
    },
)


def recipe_as_dict(recipe: Recipe) -> dict[str, Any]:
    """All choices of a recipe in SI, of types that TOML and JSON know.

    A field that is None is left out if that is its default, and "none" if it is not.
    """
    return {"format": _FORMAT, **to_entries(recipe, _FORM)}


def recipe_text(recipe: Recipe) -> str:
    """The TOML text of a recipe."""
    return toml_text(recipe_as_dict(recipe))


def write_recipe(recipe: Recipe, path: str | Path) -> Path:
    """Write a recipe that `read_recipe` reads back to the same bits.

    Raises:
        ImagingError: the file cannot be written.
    """
    path = Path(path)
    try:
        path.write_text(recipe_text(recipe), encoding="utf-8")
    except OSError as error:
        raise ImagingError(f"the recipe cannot be written: {error}", path=path) from None
    return path


def read_recipe(path: str | Path) -> Recipe:
    """The recipe in a TOML file; lengths may have any known unit, `distance_in = 60`.

    Raises:
        ImagingError: no such file, not TOML, an unknown key, unit or format, a missing scale, or a value
            that cannot be.
    """
    error = functools.partial(ImagingError, path=path)
    given = dict(read_toml(path, "recipe", error, where=""))
    if (found := given.pop("format", _FORMAT)) != _FORMAT:
        raise error(f"a recipe has the format {_FORMAT!r}, got {found!r}")
    return from_entries(Recipe, given, _FORM, error=error)
