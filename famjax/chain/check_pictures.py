"""The pictures of a campaign for a check by eye."""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from famjax.boundary.units import factor, unit_system
from imaging import Recipe, Table, draw_overlay, measure, readable_part
from imaging.arrays import Image

from .contact_sheet import Tile, contact_sheet
from .table_plot import plot_table

_QUALITY = 95  # of the overlays' JPEG files


def write_check_pictures(
    table: Table, recipe: Recipe, folder: Path, number: int = 12, system: str = "us"
) -> list[Path]:
    """Write `profiles.png`, `contact_sheet.png` and some `overlays/`.

    Args:
        table: of the campaign.
        recipe: by which it was measured.
        folder: made if need be.
        number: of pictures on the sheet and of overlays: some of those that failed, the others
            evenly over the contraction. They are measured once more.
        system: units of the plots.

    Returns:
        What was written, the folder of overlays as one.
    """
    overlays = folder / "overlays"
    overlays.mkdir(parents=True, exist_ok=True)
    tiles = []
    for k in choose(table, number):
        path = Path(table.path[k])
        seen = readable_part(path)
        if table.ok[k] and seen is not None:
            trace = measure(seen, recipe).trace
            _save(overlays / f"{k + 1:06d}_{path.stem}.jpg", draw_overlay(seen, trace))
            seen = draw_overlay(seen, trace, thickness=_thick(seen))
        tiles.append(Tile(seen, path.name, _text(table, int(k), system), ok=bool(table.ok[k])))
    plot = io.BytesIO()
    plot_table(table, system, recipe.limits).savefig(plot, format="png", dpi=130)
    profiles = folder / "profiles.png"
    profiles.write_bytes(plot.getvalue())
    sheet = [_save(folder / "contact_sheet.png", contact_sheet(tiles))] if tiles else []
    return [*sheet, profiles, overlays]


def choose(table: Table, number: int) -> NDArray[np.intp]:
    """The pictures to inspect: up to a third of them failed ones, the others spread over the stroke."""
    failed = np.flatnonzero(~table.ok)
    good = np.flatnonzero(table.ok)
    n_failed = min(len(failed), max(number // 3, number - len(good)))
    ordered = good[np.argsort(table["contraction"][good])] if len(good) else good
    chosen = [_evenly(failed, n_failed), _evenly(ordered, number - n_failed)]
    return np.sort(np.concatenate(chosen))


def _evenly(which: NDArray[np.intp], number: int) -> NDArray[np.intp]:
    if not len(which) or number < 1:
        return which[:0]
    at = np.linspace(0, len(which) - 1, min(number, len(which)))
    return which[np.round(at).astype(int)]


def _thick(image: Image) -> int:
    """Lines that can still be seen when the picture has been made small."""
    return max(1, round(max(image.shape) / 500))


def _text(table: Table, k: int, system: str) -> str:
    if not table.ok[k]:
        return table.error[k]
    unit = unit_system(system)["length"]
    length = table["length"][k] / factor(unit, "length")
    return f"L {length:.4f} {unit}, contraction {table['contraction'][k]:.4f}"


def _save(path: Path, image: Image) -> Path:
    from PIL import Image as Pictures  # noqa: PLC0415 -- loaded when pictures are

    Pictures.fromarray(image).save(path, quality=_QUALITY)
    return path
