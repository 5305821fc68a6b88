"""Photographs of a muscle with the truth beside them, for tests, benchmarks and `examples/muscle`."""
# ruff: noqa: F401 -- these are the names of the package

from .exposure import LinearPhoto, Photo, damaged, expose
from .muscle import INCH, PUBLISHED_CONTRACTIONS, TAN, Tape, published_shape
from .renderer import render, render_linear, render_ruler
from .ruler import RulerScene, published_ruler
from .scene import PUBLISHED_FRAME, CameraSensor, Jpeg, Lamp, Lens, Light, Scene

from .scene import published_scene, random_scene  # isort: skip
from .sequence import render_sequence, stroke_log, triangle_stroke
from .truth import MuscleTruth, silhouette_from_profile
