"""A fit with the shape that photographs show: `famjax fit MAP.csv --shape measurements.nc`."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import fitting
from fitting.evidence import Move, drawn_moves, moves_of
from fitting.families import Parameter

if TYPE_CHECKING:
    from fitting.shapes import ShapeSurface

TURNS = "turns"


def with_shape(
    data: fitting.ForceData, pictures: Path, options: Mapping[str, Any]
) -> tuple[fitting.ForceData, dict[str, Any], "ShapeSurface"]:
    """The map with notes on the shape, the options of a fit with that geometry, and the shape.

    The turns of the threads are identified unless they are named: the force tells them, and the
    diameters alone do not.

    Raises:
        InputError: the pictures give no surface, or the map leaves its lengths.
    """
    surface = fitting.shape_surface(pictures)
    geometry = surface.geometry(data.specimen)
    low, high = (float(one) for one in geometry.length_range())
    outside = (data.length < low) | (data.length > high)
    if outside.any():
        raise fitting.InputError(
            f"{int(outside.sum())} readings of {data.source} lie outside the lengths of the pictures, "
            f"{low * 1e3:.4g} to {high * 1e3:.4g} mm: photograph the whole stroke, or leave them out"
        )
    named = {*options["bounds"], *options["parameters"]}
    least, most = surface.threads.turns_range()
    free = {} if TURNS in named else {TURNS: Parameter(min=least, max=most)}
    noted = dataclasses.replace(data, notes=(*data.notes, *surface.summary()))
    fitted = {**options, "geometry": geometry, "parameters": {**options["parameters"], **free}}
    return noted, fitted, surface


def shared_moves(
    data: fitting.ForceData,
    errors: fitting.data.SharedErrors,
    surface: "ShapeSurface | None",
) -> dict[str, list[Move]]:
    """What errors that all readings share move: those that are stated, and that of a measured shape.

    Args:
        data: the map.
        errors: that are stated.
        surface: the measured shape, or None.
    """
    if surface is None:
        return moves_of(data, errors)
    draws = drawn_moves(lambda draw: surface.geometry(data.specimen, draw=draw))
    return {**moves_of(data, errors, surface.geometry), "shape": draws}
