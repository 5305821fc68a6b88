"""From a scene to the light on the sensor, and to the photograph."""

import numpy as np
from numpy.typing import NDArray

from .exposure import LinearPhoto, Photo, expose
from .ruler import Ruler, RulerScene
from .scene import Lens, Scene, Setting
from .truth import RulerTruth, Truth, true_figures
from .world import World


def through_lens(light: NDArray[np.floating], lens: Lens) -> NDArray[np.floating]:
    """Light behind the lens: each of its faults a convolution, the picture's border mirrored."""
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    seen = np.asarray(light, np.float32)
    if lens.motion_px > 0:
        seen = cv2.filter2D(seen, -1, _way(lens.motion_px, np.deg2rad(lens.motion_deg)))
    if lens.defocus_px > 0:
        seen = cv2.filter2D(seen, -1, _disk(lens.defocus_px))
    if lens.blur_px > 0:
        seen = cv2.GaussianBlur(seen, (0, 0), lens.blur_px)
    if lens.halo > 0:
        glow = cv2.GaussianBlur(seen, (0, 0), lens.halo_px)
        seen = (1 - lens.halo) * seen + lens.halo * glow
    return np.asarray(seen, np.float32)


def _way(length: float, angle: float) -> NDArray[np.floating]:
    """A straight way [px] at an angle [rad] to the vertical, by the part of it that each pixel has."""
    reach = int(np.ceil(length / 2)) + 1
    at = ((np.arange(512 * reach) + 0.5) / (512 * reach) - 0.5) * length
    part = np.zeros((2 * reach + 1, 2 * reach + 1))
    u, v = (np.rint(reach + at * turn).astype(int) for turn in (np.sin(angle), np.cos(angle)))
    np.add.at(part, (v, u), 1.0)
    return (part / part.sum()).astype(np.float32)


def _disk(radius: float) -> NDArray[np.floating]:
    """A disk of any radius [px], sampled by the part of each pixel that it covers."""
    reach = int(np.ceil(radius + 0.5))
    fine = (np.arange(16 * (2 * reach + 1)) + 0.5) / 16 - reach - 0.5
    inside = np.hypot(fine[:, None], fine[None, :]) <= radius
    part = inside.reshape(2 * reach + 1, 16, 2 * reach + 1, 16).mean(axis=(1, 3))
    return (part / part.sum()).astype(np.float32)


_BLOCK_ROWS = 64
_SAMPLES, _SHIFT = 55, 34  # neighbours in Fibonacci's sequence: an even lattice in a pixel
_CHUNK = 512  # pixels sampled at once: what is computed of them stays in the cache
_CLOTH_COLOUR = (0.95, 1.0, 1.08)
_NEUTRAL = (1.0, 1.0, 1.0)
_FIBRES, _FIBRE_LIGHT = (0.0005, 0.003), 0.6  # lengths [m], light that they send
_STAIN = 0.15  # relative standard deviation of the cloth's folds


Sight = World | Ruler
"""What rays can meet: both know their `span` in some rows, and what is `seen` at some places."""


def draw(sight: Sight, scene: Setting) -> NDArray[np.floating]:
    """The light on the sensor of something in front of the scene's cloth, behind its lens."""
    background = cloth(scene)
    light = background.copy()
    parts = _draw_once(sight, light)
    _refine(sight, light, parts, background)
    if isinstance(sight, World) and sight.muscle.fray:
        _draw_fibres(sight, light)
    if scene.light.colour != _NEUTRAL:
        light = light * np.array(scene.light.colour, np.float32)
    return through_lens(light, scene.lens)


def _draw_fibres(world: World, light: NDArray[np.floating]) -> None:
    """Loose fibres, each an arc that leaves the outline."""
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    random = np.random.default_rng(world.muscle.weave_seed)
    outline = world.outline()
    colour = np.array(world.muscle.albedo, np.float32) * _FIBRE_LIGHT
    along = np.linspace(0, 1, 24)
    for _ in range(world.muscle.fray):
        side = int(random.integers(2))
        k = int(random.integers(outline[side][0].size))
        length = random.uniform(*_FIBRES) * world.camera.px_per_m
        angle = random.uniform(-1.1, 1.1) + random.uniform(-1.5, 1.5) * along
        step = length / along.size * np.stack([(2 * side - 1) * np.cos(angle), np.sin(angle)])
        points = np.stack([side_of[k] for side_of in outline[side]])[:, None] + np.cumsum(
            step, axis=1
        )
        cover = np.zeros(light.shape[:2], np.uint8)
        shifted = np.round(points.T * 16).astype(np.int32)
        cv2.polylines(cover, [shifted], False, 255, 1, cv2.LINE_AA, 4)
        part = cover[..., None] / np.float32(255) * np.float32(random.uniform(0.3, 0.9))
        light += part * (colour - light)


def cloth(scene: Setting) -> NDArray[np.floating]:
    """The black cloth: gradient, folds and an out-of-focus reflection."""
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    h, w = scene.size
    light, (px, py) = scene.light, scene.light.stray_place
    x = (np.arange(w, dtype=np.float32) / w)[None, :]
    y = (np.arange(h, dtype=np.float32) / h)[:, None]
    folds = np.random.default_rng(0).standard_normal((12, 9)).astype(np.float32)
    stain = 1 + _STAIN * cv2.resize(folds, (w, h), interpolation=cv2.INTER_CUBIC)
    base = (light.cloth * (1 + light.cloth_gradient * (x - 0.5))) * np.maximum(stain, 0.2)
    stray = np.exp(-(((x - px) / 0.08) ** 2)) * np.exp(-(((y - py) / 0.15) ** 2))
    if light.other_cloth is not None:
        beyond = (y if light.border_down else x) > light.border
        base = np.where(beyond, light.other_cloth / light.cloth, np.float32(1)) * base
    return (base + light.stray * stray)[..., None] * np.array(_CLOTH_COLOUR, np.float32)


def _draw_once(sight: Sight, light: NDArray[np.floating]) -> NDArray[np.int8]:
    """One ray per pixel into `light`; returns which part each pixel shows, -1 for the cloth."""
    h, w = light.shape[:2]
    parts = np.full((h, w), -1, np.int8)
    for top in range(0, h, _BLOCK_ROWS):
        bottom = min(h, top + _BLOCK_ROWS)
        left, right = sight.span(top, bottom)
        left, right = max(0, int(left)), min(w, int(np.ceil(right)))
        if left >= right:
            continue
        v, u = np.mgrid[top:bottom, left:right].astype(float)
        which, seen = sight.seen(u.ravel(), v.ravel())
        parts[top:bottom, left:right] = which.reshape(u.shape)
        patch = light[top:bottom, left:right]
        hit = which.reshape(u.shape) >= 0
        patch[hit] = seen[hit.ravel()]
    return parts


def _refine(
    sight: Sight,
    light: NDArray[np.floating],
    parts: NDArray[np.int8],
    background: NDArray[np.floating],
) -> None:
    """The mean of many rays in every pixel next to an edge."""
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    part = parts.astype(np.int16)
    next_to, near = (
        cv2.erode(part, np.ones((n, n))) != cv2.dilate(part, np.ones((n, n))) for n in (3, 5)
    )
    rows, columns = np.nonzero(next_to | (near & (parts >= 0)))
    k = np.arange(_SAMPLES)
    du = (k + 0.5) / _SAMPLES - 0.5
    dv = (k * _SHIFT % _SAMPLES + 0.5) / _SAMPLES - 0.5
    for start in range(0, rows.size, _CHUNK):
        at = slice(start, start + _CHUNK)
        u = columns[at, None] + du
        v = rows[at, None] + dv
        which, seen = sight.seen(u.ravel(), v.ravel())
        missed = (which < 0).reshape(u.shape).mean(axis=1)
        mean = seen.reshape(*u.shape, 3).mean(axis=1)
        light[rows[at], columns[at]] = mean + missed[:, None] * background[rows[at], columns[at]]


def render(scene: Scene, seed: int) -> Photo[Truth]:
    """The photograph of a scene, with the truth beside it.

    Args:
        scene: the scene; its muscle's own `weave_seed` draws the braid.
        seed: of the noise.
    """
    return expose(render_linear(scene), seed)


def render_linear(scene: Scene) -> LinearPhoto[Truth]:
    """The light on the sensor. Take it once where only sensor, file or noise are to vary.

    Every pixel is one ray; those near an edge are the mean of 55, so that the light in them is that
    of the surface in them to 0.01 px.
    """
    if scene.muscle is None:
        return LinearPhoto(scene, through_lens(cloth(scene), scene.lens), None)
    world = World(scene.muscle, scene.light, scene.camera)
    return LinearPhoto(scene, draw(world, scene), true_figures(world))


def render_ruler(scene: RulerScene, seed: int) -> Photo[RulerTruth]:
    """The photograph of a ruler, with the truth beside it.

    Args:
        scene: the ruler.
        seed: of the noise.
    """
    ruler = Ruler(scene)
    return expose(LinearPhoto(scene, draw(ruler, scene), ruler.truth()), seed)
