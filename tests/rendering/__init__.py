"""Photographs of a muscle with the truth beside them, for tests, benchmarks and `examples/muscle`.

Rays are cast at the surface of a woven body under lamps; the exact outline, length and diameters
come from closed forms that the casting of rays does not use. A program that measures the pictures
shares nothing with it but the pinhole and the sRGB curve. `folder` makes whole characterisation
folders, with the simulated rig; it needs JAX, and is imported by its own name.
"""

from .exposure import (
    LinearPhoto as LinearPhoto,
    Photo as Photo,
    damaged as damaged,
    expose as expose,
)
from .muscle import (
    INCH as INCH,
    PUBLISHED_CONTRACTIONS as PUBLISHED_CONTRACTIONS,
    TAN as TAN,
    Tape as Tape,
    published_shape as published_shape,
)
from .renderer import render as render, render_linear as render_linear, render_ruler as render_ruler
from .ruler import RulerScene as RulerScene, published_ruler as published_ruler
from .scene import (
    PUBLISHED_FRAME as PUBLISHED_FRAME,
    CameraSensor as CameraSensor,
    Jpeg as Jpeg,
    Lamp as Lamp,
    Lens as Lens,
    Light as Light,
    Scene as Scene,
    published_scene as published_scene,
    random_scene as random_scene,
)
from .sequence import (
    render_sequence as render_sequence,
    stroke_log as stroke_log,
    triangle_stroke as triangle_stroke,
)
from .truth import MuscleTruth as MuscleTruth, silhouette_from_profile as silhouette_from_profile
