"""From a scene to the light on the sensor, and to the photograph: rays, what they see, the mean of many."""

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from imaging.camera import Array

from .exposure import Floats, LinearPhoto, Photo, expose, through_lens
from .ruler import Ruler, RulerScene
from .scene import Light, Scene, Setting
from .truth import true_figures
from .world import Hits, Shoulder, World, unit_vectors

_BLOCK_ROWS = 64
_SAMPLES, _SHIFT = 55, 34  # neighbours in Fibonacci's sequence: an even lattice in a pixel
_CHUNK = 512  # pixels sampled at once: what is computed of them stays in the cache
_CLOTH_COLOUR = (0.95, 1.0, 1.08)
_FIBRES, _FIBRE_LIGHT = (0.0005, 0.003), 0.6  # lengths [m], light that they send
_STAIN = 0.15  # relative standard deviation of the cloth's folds
_GLOSS = {"tape": (0.05, 25.0), "rod": (0.10, 60.0)}  # strength and exponent of the glare
_FIBRE_GLOSS = 0.10
_ROUGHNESS = 0.35  # [rad], Oren and Nayar's spread of the facets


@dataclasses.dataclass(frozen=True)
class LitWorld:
    """The bodies of a world in a light: as a `Ruler`, it knows its span and what is seen of it."""

    world: World
    light: Light

    def span(self, v_first: float, v_last: float) -> tuple[float, float]:
        return self.world.span(v_first, v_last)

    def seen(self, u: Array, v: Array) -> tuple[NDArray[np.int8], Array]:
        """Number of the body at picture positions u, v [px], -1 for the cloth; and its linear RGB."""
        which, a, b, depth = self.world.met(u, v)
        light = np.zeros((u.size, 3))
        for number, (kind, body, albedo) in enumerate(self.world.bodies):
            at = np.flatnonzero(which == number)
            if at.size == 0:
                continue
            if isinstance(body, Shoulder):
                light[at] = self.light.ambient * albedo
                continue
            hits = body.hits(a[at], b[at], depth[at])
            sight = unit_vectors(-np.stack([a[at], b[at], np.ones(at.size)], axis=1))
            if kind == "braid":
                light[at] = self._on_braid(hits, sight)
            else:
                light[at] = self._glossy(hits, sight, albedo, *_GLOSS[kind])
        return which, light

    def _on_braid(self, hits: Hits, sight: Array) -> Array:
        at = self.world.weave.crossings(hits.azimuth, hits.y)
        lean, fibre = self.world.weave.directions(at, hits.azimuth, hits.y)
        lit = light_on_threads(self.light, unit_vectors(hits.normal + lean), sight)
        for lamp in self.light.lamps:
            skew = np.einsum("ij,ij->i", fibre, unit_vectors(sight + lamp.towards))
            lit += _FIBRE_GLOSS * lamp.irradiance(hits.normal) * np.clip(1 - skew**2, 0, 1) ** 12
        facing = np.clip(np.einsum("ij,ij->i", hits.normal, sight), 0, 1)
        lit += self.world.muscle.sheen * (1 - facing) ** self.world.muscle.sheen_power
        albedo = np.array(self.world.muscle.albedo)
        return (lit * self.world.weave.reflectance(at))[:, None] * albedo

    def _glossy(self, hits: Hits, sight: Array, albedo: Array, gloss: float, power: float) -> Array:
        """A smooth coloured surface with glare (Blinn and Phong)."""
        diffuse = np.full(hits.y.shape, self.light.ambient)
        glare = np.zeros(hits.y.shape)
        for lamp in self.light.lamps:
            diffuse += lamp.irradiance(hits.normal)
            half = unit_vectors(sight + lamp.towards)
            shine = np.clip(np.einsum("ij,ij->i", hits.normal, half), 0, 1)
            glare += lamp.strength * gloss * shine**power
        return diffuse[:, None] * albedo + glare[:, None]


def light_on_threads(light: Light, normal: Array, sight: Array) -> Array:
    """Light of white threads along the unit vectors to the camera (Oren and Nayar 1994, eq. 30)."""
    total = np.full(normal.shape[0], light.ambient)
    for lamp in light.lamps:
        lit = lamp.irradiance(normal)
        if light.reflectance == "sqrt":
            lit = np.sqrt(lit * lamp.strength)
        elif light.reflectance == "oren-nayar":
            lit = lit * _oren_nayar(normal, lamp.towards, sight)
        total += lit
    return total


def _oren_nayar(normal: Array, lamp: Array, sight: Array) -> Array:
    cos_i = np.clip(normal @ lamp, 0.05, 1)
    cos_r = np.clip(np.einsum("ij,ij->i", normal, sight), 0.05, 1)
    along = np.clip(sight @ lamp - cos_i * cos_r, 0, None)  # sin sin cos(delta phi)
    s2 = _ROUGHNESS**2
    A, B = 1 - 0.5 * s2 / (s2 + 0.33), 0.45 * s2 / (s2 + 0.09)
    return A + B * along / np.maximum(cos_i, cos_r)


def draw(sight: LitWorld | Ruler, scene: Setting) -> Floats:
    """The light on the sensor of something in front of the scene's cloth, behind its lens."""
    background = cloth(scene)
    light = background.copy()
    parts = _draw_once(sight, light)
    _refine(sight, light, parts, background)
    if isinstance(sight, LitWorld) and sight.world.muscle.fray:
        _draw_fibres(sight.world, light)
    light = light * np.array(scene.light.colour, np.float32)
    return through_lens(light, scene.lens)


def _draw_fibres(world: World, light: Floats) -> None:
    """Loose fibres, each an arc that leaves the outline."""
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
        begin = np.stack([side_of[k] for side_of in outline[side]])
        points = begin[:, None] + np.cumsum(step, axis=1)
        cover = np.zeros(light.shape[:2], np.uint8)
        shifted = np.round(points.T * 16).astype(np.int32)
        cv2.polylines(cover, [shifted], False, 255, 1, cv2.LINE_AA, 4)
        part = cover[..., None] / np.float32(255) * np.float32(random.uniform(0.3, 0.9))
        light += part * (colour - light)


def cloth(scene: Setting) -> Floats:
    """The black cloth: gradient, folds and an out-of-focus reflection."""
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


def _draw_once(sight: LitWorld | Ruler, light: Floats) -> NDArray[np.int8]:
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


def _refine(sight: LitWorld | Ruler, light: Floats, parts: NDArray[np.int8], cloth: Floats) -> None:
    """The mean of many rays in every pixel next to an edge."""
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
        light[rows[at], columns[at]] = mean + missed[:, None] * cloth[rows[at], columns[at]]


def render(scene: Scene, seed: int) -> Photo:
    """The photograph of a scene, with the truth beside it; the seed is that of the noise."""
    return expose(render_linear(scene), seed)


def render_linear(scene: Scene) -> LinearPhoto:
    """The light on the sensor; the mean of 55 rays near edges, right to 0.01 px, one elsewhere."""
    if scene.muscle is None:
        return LinearPhoto(scene, through_lens(cloth(scene), scene.lens), None)
    world = World(scene.muscle, scene.camera)
    return LinearPhoto(scene, draw(LitWorld(world, scene.light), scene), true_figures(world))


def render_ruler(scene: RulerScene, seed: int) -> Photo:
    ruler = Ruler(scene)
    return expose(LinearPhoto(scene, draw(ruler, scene), ruler.truth()), seed)
