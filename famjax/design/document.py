"""What `famjax design` computes, as one document of rows, and its picture."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from .. import units
from ..boundary.files import as_png
from ..boundary.units import unit_system
from ..materials.polynomial import PolynomialMaterial
from .catalogue import Catalogue
from .catalogue_file import load_catalogue
from .catalogue_search import DesignCandidate, Requirement, search
from .combination import Feasibility, bladder_material, feasibility
from .design_rows import (
    braid_angle_rows,
    candidate_rows,
    end_fitting_rows,
    geometry_rows,
    performance_rows,
    safety_factor_rows,
    tube_buckling_rows,
)
from .end_fitting import size_end_fittings
from .safety import safety_factors
from .swage_tube import TubeOptions, assumption_notes, tube_strengths

LATEX = np.array([257.8, -57.9, 32.7]) * units.PSI
"""E_n [Pa] of the reference work's latex (Chambers 2021, chapter 6): the bladder of the design."""

_POINTS = 41  # on each curve over contraction


def design_document(
    requirement: Requirement,
    catalogues: Iterable[Path],
    *,
    bundled: bool,
    rest_length: float,
    system: str,
    tube: TubeOptions | None = None,
) -> dict[str, Any]:
    """Everything about the combinations of a catalogue that a designer asks for.

    Args:
        requirement: in SI.
        catalogues: files of the user.
        bundled: whether the bundled catalogue is taken too.
        rest_length: active length L0 [m] for thread length and turns.
        system: "si", "metric" or "us".
        tube: what is known of the swage tubes beyond the catalogue.

    Returns:
        Rows by subject, JSON-ready: braid angles, geometry, candidates, performance, end-fittings,
        buckling of the tubes, safety factors; and `notes`, sentences on what was assumed.
    """
    catalogue = load_catalogue(list(catalogues), bundled=bundled)
    latex = PolynomialMaterial(LATEX)
    candidates = search(catalogue, requirement, material=latex)
    strengths = tube_strengths(catalogue, tube)
    factors = safety_factors(catalogue, requirement, candidates)
    return {
        "braid_angles": braid_angle_rows(catalogue, system=system),
        "geometry": geometry_rows(catalogue, rest_length, system=system),
        "candidates": candidate_rows(candidates, system=system),
        "performance": _performance(candidates, requirement.pressure, system),
        "end_fittings": _end_fittings(catalogue, system),
        "tube_buckling": tube_buckling_rows(strengths, system=system),
        "safety_factors": safety_factor_rows(factors, system=system),
        "notes": assumption_notes(strengths),
    }


def _performance(
    candidates: Iterable[DesignCandidate], pressure: float, system: str
) -> list[dict[str, Any]]:
    """Force and diameter over contraction, to zero force or to jamming, of every pair that fits."""
    latex = PolynomialMaterial(LATEX)
    rows = []
    for candidate in candidates:
        if candidate.usable_contraction > 0:
            at = np.linspace(0.0, candidate.usable_contraction, _POINTS).tolist()
            bladder, braid = candidate.bladder, candidate.braid
            pair = {"bladder": bladder.name, "braid": braid.name}
            rows += [
                pair | row
                for row in performance_rows(
                    bladder,
                    braid,
                    pressure,
                    at,
                    system=system,
                    material=bladder_material(bladder, latex),
                )
            ]
    return rows


def _end_fittings(catalogue: Catalogue, system: str) -> list[dict[str, Any]]:
    """The end-fittings of every pair of braid and bladder diameter that fit."""
    rows = []
    if not catalogue.tubes:
        return rows
    for braid in catalogue.braids:
        for diameter in sorted({b.diameter for b in catalogue.bladders}):
            if feasibility(diameter, braid) is not Feasibility.INFEASIBLE:
                rows += end_fitting_rows(
                    size_end_fittings(catalogue, braid, diameter), system=system
                )
    return rows


def design_picture(document: dict[str, Any], system: str) -> bytes:
    """Force and outer diameter against contraction of every combination, as PNG."""
    from matplotlib import colormaps  # noqa: PLC0415
    from matplotlib.figure import Figure  # noqa: PLC0415 -- slow to load

    figure = Figure(figsize=(11, 5.5), layout="constrained")
    axes = figure.subplots(1, 2)
    force, length = unit_system(system)["force"], unit_system(system)["length"]
    pairs = dict.fromkeys((row["bladder"], row["braid"]) for row in document["performance"])
    braids = list(dict.fromkeys(braid for _, braid in pairs))
    bladders = list(dict.fromkeys(bladder for bladder, _ in pairs))
    colours = colormaps["tab20"]
    for bladder, braid in pairs:
        rows = [
            r for r in document["performance"] if (r["bladder"], r["braid"]) == (bladder, braid)
        ]
        style = {
            "color": colours(bladders.index(bladder) % 20),
            "ls": ("-", "--", ":", "-.")[braids.index(braid) % 4],
            "label": f"{bladder} in {braid}",
        }
        contraction = [row["contraction"] for row in rows]
        for axis, key in zip(axes, (f"force_{force}", f"outer_diameter_{length}"), strict=True):
            axis.plot(contraction, [np.nan if r[key] is None else r[key] for r in rows], **style)
    axes[0].set(xlabel="contraction", ylabel=f"force, {force}", ylim=(0, None))
    axes[1].set(xlabel="contraction", ylabel=f"outer diameter, {length}")
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7
    )
    return as_png(figure)
