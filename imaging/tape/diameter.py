"""The tapes' diameter in the picture against the one that a caliper gives."""

import numpy as np

from ..arrays import Image
from ..camera.pinhole import Camera, turned
from ..camera.silhouette import Silhouette
from ..errors import ScaleContradiction
from ..outline.both_sides import find_outline
from ..recipe import Recipe
from ..segment.segmentation import Segmentation, TapeBand

_GUARD = 5  # px at a tape's ends that are left out
_FEWEST_ROWS = 12


def check_tape_diameter(
    rgb: Image, coarse: Segmentation, body: Silhouette, camera: Camera, recipe: Recipe, known: float
) -> None:
    """Refuse a scale that contradicts the tapes' known diameter.

    Raises:
        ScaleContradiction: the tapes' mean diameter differs from the known one by more than
            `QualityLimits.scale_contradiction`, or a tape shows too few rows for that.
    """
    seen = [
        tape_diameter(rgb, coarse, tape, body, camera, recipe)
        for tape in (coarse.upper, coarse.lower)
    ]
    mean = float(np.mean(seen))
    if abs(mean / known - 1) > recipe.limits.scale_contradiction:
        raise ScaleContradiction(
            "the tapes' diameter in the picture must be the known one; their ratio is "
            f"{mean / known:.4f}: was the ruler in the plane of the muscle's axis, and is the "
            "distance right?",
            diameter=mean,
            known_diameter=known,
            px_per_m=camera.px_per_m,
            limit=recipe.limits.scale_contradiction,
        )


def tape_diameter(
    rgb: Image,
    coarse: Segmentation,
    tape: TapeBand,
    body: Silhouette,
    camera: Camera,
    recipe: Recipe,
) -> float:
    """Diameter [m] of a tape, a cylinder about the muscle's axis, by the limb model.

    R = rho sin(beta) with the half angle beta between its two tangent planes.

    Raises:
        ScaleContradiction: it shows too few rows.
    """
    inner = tape.inner_limbs
    if tape is coarse.upper:
        first, last = tape.top, min(inner)
    else:
        first, last = max(inner), tape.bottom
    rows = np.arange(int(first) + _GUARD, int(last) - _GUARD)
    if rows.size < _FEWEST_ROWS:
        raise ScaleContradiction(
            f"a tape must show {_FEWEST_ROWS} rows to check the scale by its diameter: use a wider "
            "tape, or leave the tape's diameter out",
            rows=rows.size,
        )
    y = (rows - camera.centre[1]) / camera.px_per_m
    X, Y = turned(np.full(rows.size, body.x0), y, body.roll)
    middle = camera.pixels(X, Y, camera.distance)[0]
    half = (tape.right - tape.left) / 2
    # Luma hardly sees blue: the colour in which the tape is brightest does.
    colour = int(np.argmax(coarse.tape))
    dark, bright = np.interp(
        [coarse.cloth[colour], coarse.tape[colour]], np.arange(256), recipe.tone_curve.table
    )
    outline = find_outline(
        rgb[..., colour],
        ((recipe.tone_curve.table - dark) / (bright - dark)).astype(np.float32),
        rows,
        middle - half,
        middle + half,
        resolution=2.0 * rows.size,
    )
    sides = [
        turned(*camera.rays(side.column, rows), -body.roll)[0]
        for side in (outline.left, outline.right)
    ]
    beta = float(np.median(np.arctan(sides[1]) - np.arctan(sides[0]))) / 2
    return 2 * float(np.hypot(body.x0, camera.distance)) * np.sin(beta)
