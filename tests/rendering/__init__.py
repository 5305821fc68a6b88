"""Photographs of a muscle with the truth beside them, for tests, benchmarks and `examples/muscle`.

Rays are cast at the surface of a woven body under lamps; the exact outline, length and diameters
come from closed forms that the casting of rays does not use. A program that measures the pictures
shares nothing with it but the pinhole and the sRGB curve. `folder` makes whole characterisation
folders, with the simulated rig; it needs JAX, and is imported by its own name.
"""
# ruff: noqa: F401 -- these are the names of the package

from .exposure import LinearPhoto, Photo, damaged, expose
from .muscle import INCH, PUBLISHED_CONTRACTIONS, TAN, Tape, published_shape
from .renderer import render, render_linear, render_ruler
from .ruler import RulerScene, published_ruler
from .scene import PUBLISHED_FRAME, CameraSensor, Jpeg, Lamp, Lens, Light, Scene

from .scene import published_scene, random_scene  # isort: skip
from .sequence import render_sequence, stroke_log, triangle_stroke
from .truth import MuscleTruth, silhouette_from_profile
