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

from famjax.boundary.public_names import attach_rooms

_MOVED = {"famjax.chain": ("StrokeLog", "stroke_log")}

__getattr__, __dir__, __all__ = attach_rooms(__name__, __file__, _MOVED)
