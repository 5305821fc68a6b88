from .exposure import (
    LinearPhoto as LinearPhoto,
    Photo as Photo,
    damaged as damaged,
    expose as expose,
)
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
