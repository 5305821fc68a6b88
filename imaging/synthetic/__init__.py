"""Photographs of a muscle with the truth beside them: for tests, and to try out a set-up.

Rays are cast at the surface of a woven body under lamps; the exact outline, length and diameters
come from closed forms that the casting of rays does not use. A program that measures the pictures
shares nothing with it but the pinhole.

Examples:
    How far does a lens that is out of focus move the outline? Take the picture, measure it, and
    compare with the truth beside it:

    >>> import dataclasses
    >>> scene = published_scene(contraction=0.175, size=(500, 220))
    >>> photo = render(dataclasses.replace(scene, lens=Lens(defocus_px=2.0)), seed=1)
    >>> photo.rgb.shape, round(photo.truth.length / INCH, 3), len(photo.truth.rows)
    ((500, 220, 3), 7.657, 328)
"""

from ._damage import damaged as damaged
from ._expose import expose as expose
from ._light import Lamp as Lamp, Light as Light, Reflectance as Reflectance
from ._linear import LinearPhoto as LinearPhoto
from ._muscle import (
    BLUE_HUE as BLUE_HUE,
    INCH as INCH,
    TAN as TAN,
    MuscleScene as MuscleScene,
    Tape as Tape,
)
from ._photo import Photo as Photo
from ._profiles import (
    PUBLISHED_CONTRACTIONS as PUBLISHED_CONTRACTIONS,
    REST_LENGTH as REST_LENGTH,
    FourierShape as FourierShape,
    published_shape as published_shape,
    stroke_shape as stroke_shape,
)
from ._random_scene import random_scene as random_scene
from ._render import (
    render as render,
    render_linear as render_linear,
    render_ruler as render_ruler,
)
from ._ruler import (
    STEEL as STEEL,
    WOOD as WOOD,
    RulerScene as RulerScene,
    published_ruler as published_ruler,
)
from ._scene import (
    PUBLISHED_CROP as PUBLISHED_CROP,
    PUBLISHED_DISTANCE as PUBLISHED_DISTANCE,
    PUBLISHED_FRAME as PUBLISHED_FRAME,
    PUBLISHED_PX_PER_IN as PUBLISHED_PX_PER_IN,
    Jpeg as Jpeg,
    Lens as Lens,
    Scene as Scene,
    Sensor as Sensor,
    published_scene as published_scene,
)
from ._sequence import (
    StrokeLog as StrokeLog,
    render_sequence as render_sequence,
    stroke_log as stroke_log,
    triangle_stroke as triangle_stroke,
)
from ._truth import RulerTruth as RulerTruth, Truth as Truth
