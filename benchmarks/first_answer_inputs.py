"""What the rows of `first_answer.py` work on: maps derived from one map, and photographs.

    python benchmarks/first_answer_inputs.py FOLDER MAP maps|photos

MAP is a CSV file or the name of a bundled map. Everything is seeded.
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np

import fitting

OTHERS = ("DMSP-10-250", "DMSP-20-300")
"""Bundled maps, of which the first that is not the given one is the other specimen."""


def load(name: str) -> fitting.ForceData:
    """The bundled map of that name, or else the file."""
    if name in fitting.bundled_names():
        return fitting.load_bundled(name)
    return fitting.read_csv(name)


def part(data: fitting.ForceData, keep: np.ndarray) -> fitting.ForceData:
    """Some readings of a map.

    Args:
        data: the map.
        keep: which, boolean, shape (n,).
    """
    columns = {
        name: values[keep]
        for name in ("force", "pressure", "length", "force_std", "pressure_std", "length_std")
        for values in [getattr(data, name)]
        if values is not None
    }
    return dataclasses.replace(data, **columns)


def without_a_pressure(data: fitting.ForceData) -> fitting.ForceData:
    """A map of another size: the middle pressure is left out."""
    levels = np.unique(data.pressure[data.loaded])
    return part(data, data.pressure != levels[len(levels) // 2])


def repeated(data: fitting.ForceData, seed: int = 0, left_out: int = 2) -> fitting.ForceData:
    """Another map in the same bucket: forces by 0.2 % elsewhere, two loaded readings less.

    Args:
        data: the map.
        seed: of the noise.
        left_out: number of loaded readings left out.
    """
    rng = np.random.default_rng(seed)
    keep = np.ones(data.force.size, bool)
    keep[rng.choice(np.flatnonzero(data.loaded), left_out, replace=False)] = False
    moved = data.force * (1 + 2e-3 * rng.normal(size=data.force.size))
    return part(dataclasses.replace(data, force=moved), keep)


def renamed(data: fitting.ForceData, name: str = "renamed") -> fitting.ForceData:
    """The same readings of a specimen with another name."""
    return dataclasses.replace(data, specimen=dataclasses.replace(data.specimen, name=name))


def as_csv(data: fitting.ForceData) -> str:
    """The map as the documented file, SI, so that it reads back to the same bits."""
    lines = []
    for field in dataclasses.fields(data.specimen):
        value = getattr(data.specimen, field.name)
        if isinstance(value, str):
            lines.append(f"# specimen: {field.name} = {value}")
        elif isinstance(value, bool):
            lines.append(f"# specimen: {field.name} = {str(value).lower()}")
        elif value is not None:
            lines.append(f"# specimen: {field.name}_m = {float(value)!r}")
    lines.append("pressure_Pa,length_m,force_N")
    rows = np.stack([data.pressure, data.length, data.force], axis=1).tolist()
    return "\n".join(lines + [",".join(map(repr, row)) for row in rows]) + "\n"


def write_maps(folder: Path, name: str) -> None:
    """`smaller.csv`, `repeated.csv`, `renamed.csv` and `specimen.csv`."""
    data = load(name)
    other = next(one for one in map(load, OTHERS) if one.sha256 != data.sha256)
    maps = {
        "smaller": without_a_pressure(data),
        "repeated": repeated(data),
        "renamed": renamed(data),
        "specimen": other,
    }
    for stem, one in maps.items():
        (folder / f"{stem}.csv").write_text(as_csv(one), encoding="utf-8")


def write_photos(folder: Path) -> None:
    """`photo.jpg` and `photo2.jpg` of a muscle, and `ruler.jpg`, at the reference work's size."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from rendering import published_ruler, published_scene, render, render_ruler  # noqa: PLC0415

    render(published_scene(0.175), 7).save(folder / "photo.jpg")
    render(published_scene(0.1), 11).save(folder / "photo2.jpg")
    render_ruler(published_ruler(), 1).save(folder / "ruler.jpg")


if __name__ == "__main__":
    _, where, which, kind = sys.argv
    if kind == "maps":
        write_maps(Path(where), which)
    else:
        write_photos(Path(where))
