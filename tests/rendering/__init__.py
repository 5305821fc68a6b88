"""Photographs of a muscle with the truth beside them, for tests, benchmarks and `examples/muscle`.

Rays are cast at the surface of a woven body under lamps; the exact outline, length and diameters
come from closed forms that the casting of rays does not use. A program that measures the pictures
shares nothing with it but the pinhole and the sRGB curve. `folder` makes whole characterisation
folders, with the simulated rig; it needs JAX, and is imported by its own name.

Examples:
    How far does a lens that is out of focus move the outline? Take the picture, measure it, and
    compare with the truth beside it:

    >>> import dataclasses
    >>> scene = published_scene(contraction=0.175, size=(500, 220))
    >>> photo = render(dataclasses.replace(scene, lens=Lens(defocus_px=2.0)), seed=1)
    >>> photo.rgb.shape, round(photo.truth.length / INCH, 3), len(photo.truth.rows)
    ((500, 220, 3), 7.657, 328)
"""

from .exposure import (
    LinearPhoto as LinearPhoto,
    Photo as Photo,
    damaged as damaged,
    expose as expose,
)
from .log_of_stroke import StrokeLog as StrokeLog, stroke_log as stroke_log
from .muscle import (
    BLUE_HUE as BLUE_HUE,
    INCH as INCH,
    PUBLISHED_CONTRACTIONS as PUBLISHED_CONTRACTIONS,
    REST_LENGTH as REST_LENGTH,
    TAN as TAN,
    FourierShape as FourierShape,
    MuscleScene as MuscleScene,
    Tape as Tape,
    published_shape as published_shape,
    stroke_shape as stroke_shape,
)
from .outlines import (
    apparent_diameter as apparent_diameter,
    silhouette_from_profile as silhouette_from_profile,
)
from .renderer import (
    render as render,
    render_linear as render_linear,
    render_ruler as render_ruler,
)
from .ruler import (
    STEEL as STEEL,
    WOOD as WOOD,
    RulerScene as RulerScene,
    published_ruler as published_ruler,
)
from .scene import (
    PUBLISHED_CROP as PUBLISHED_CROP,
    PUBLISHED_DISTANCE as PUBLISHED_DISTANCE,
    PUBLISHED_FRAME as PUBLISHED_FRAME,
    PUBLISHED_PX_PER_IN as PUBLISHED_PX_PER_IN,
    CameraSensor as CameraSensor,
    Jpeg as Jpeg,
    Lamp as Lamp,
    Lens as Lens,
    Light as Light,
    Reflectance as Reflectance,
    Scene as Scene,
    Setting as Setting,
    published_scene as published_scene,
    random_scene as random_scene,
)
from .sequence import (
    render_sequence as render_sequence,
    triangle_stroke as triangle_stroke,
)
from .truth import MuscleTruth as MuscleTruth, RulerTruth as RulerTruth
