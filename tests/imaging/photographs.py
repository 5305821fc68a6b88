"""Photographs of rendered scenes, the rays of each followed once, and what they are measured by."""

import dataclasses
import functools

from rendering import CameraSensor, Lens, LinearPhoto, Photo, Scene, expose, render_linear
from rendering.exposure import through_lens

from imaging import ImagingError, Recipe, Scale, measure


@functools.lru_cache(maxsize=12)
def _unblurred(scene: Scene) -> LinearPhoto:
    return render_linear(scene)


def photograph(scene: Scene, seed: int) -> Photo:
    """As `rendering.render`, to the last bit."""
    open_ = {"lens": Lens(blur_px=0.0), "sensor": CameraSensor(), "jpeg": None}
    taken = _unblurred(dataclasses.replace(scene, **open_, time=None, lying=False))
    light = through_lens(taken.light, scene.lens)
    return expose(dataclasses.replace(taken, scene=scene, light=light), seed)


def changed(scene, muscle=None, camera=None, **fields):
    """A scene with other figures of its muscle and camera."""
    body = dataclasses.replace(scene.muscle, **(muscle or {}))
    seen_by = dataclasses.replace(scene.camera, **(camera or {}))
    return dataclasses.replace(scene, muscle=body, camera=seen_by, **fields)


def recipe_of(scene, **options):
    """The recipe of a user who knows the camera."""
    camera = scene.camera
    stated = {"distance": camera.distance, "centre": camera.centre}
    return Recipe(options.pop("scale", Scale.manual(camera.px_per_m)), **stated | options)


def sigmas(found, truth):
    """The larger error of length and mean diameter over its standard error."""
    length = (found.length - truth.length) / found.length_stderr
    diameter = (found.mean_diameter - truth.mean_diameter) / found.mean_diameter_stderr
    return max(abs(length), abs(diameter))


def measured_or_refused(picture, recipe):
    try:
        return measure(picture, recipe)
    except ImagingError as error:
        return error
