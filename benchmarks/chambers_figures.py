"""The figures of the reference work, redrawn from the computed terms; no pyplot."""

from collections.abc import Callable
from typing import Any

import chapter2_design
import chapter5_braid
import chapter6_virtual_work
import matplotlib as mpl
import numpy as np
from beside_print import printed
from chapter4_shape import SHAPE_X, printed_diameter, shapes, synthetic_profiles
from force_balance import OWN, PRINTED_FREE, terms
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from specimen import PRESSURES

from famjax import units
from famjax.braids import BraidState
from famjax.design import Feasibility, feasibility, load_catalogue

COMBINED_PSI = 100.0
"""Gauge pressure at which braids on bladders are compared."""

_STYLES: dict[str, dict[str, Any]] = {
    "estimated inelastic": {"color": "C0", "ls": "--"},
    "estimated elastic": {"color": "C0", "ls": "-"},
    "measured average diameter": {"color": "C3", "ls": "--"},
    "measured": {"color": "C3", "ls": "-"},
}
_SHADES = mpl.colormaps["viridis"](np.linspace(0, 0.9, 5))


def _axes(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, np.ndarray]:
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    for one in axes.flat:
        one.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _legend(figure: Figure, axes: Axes, columns: int = 4) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False)


def combinations() -> Figure:
    """Force and outer diameter over contraction of every braid on every bladder that it fits."""
    figure, (axes,) = _axes(1, 2, (11, 4.4))
    offered = {round(one.nominal_diameter / units.INCH, 6): one for one in load_catalogue().braids}
    table = printed()["braid_angle_table"]
    for (nominal, braid), line in zip(offered.items(), ("-", "--", ":"), strict=True):
        for D, shade in zip(table["fam_diameter_in"], _SHADES, strict=False):
            if feasibility(D * units.INCH, braid) is Feasibility.INFEASIBLE:
                continue
            pair = chapter2_design.combination(D, braid)
            at = np.linspace(0, float(pair.usable_contraction(COMBINED_PSI)), 61)
            style = {"color": shade, "ls": line, "label": f"{D} in, {nominal} in braid"}
            axes[0].plot(at, pair.force(at, COMBINED_PSI), **style)
            axes[1].plot(at, pair.outer_diameter(at), **style)
    axes[0].set(xlabel="contraction", ylabel="force of the braid, lbf", ylim=(0, None))
    axes[1].set(xlabel="contraction", ylabel="outer diameter, in")
    _legend(figure, axes[0], 4)
    return figure


def profiles() -> Figure:
    """Diameter over position at the five contractions."""
    figure, ((axes,),) = _axes(1, 1, (7.5, 3.8))
    rows, used = printed()["profile_100psi"], shapes()["used"]["D"]
    for row, D, shade in zip(rows, used, _SHADES, strict=True):
        label = f"{100 * row['contraction']:.4g} %"
        axes.plot(SHAPE_X, printed_diameter(row, SHAPE_X, corrected=True), color=shade, lw=0.6)
        axes.plot(SHAPE_X, D, color=shade, label=label)
    axes.set(xlabel="position x along the active length", ylabel="diameter, in", ylim=(0, None))
    axes.legend(title="contraction", frameon=False, loc="lower center", ncols=5)
    return figure


def synthetic() -> Figure:
    """The synthetic diameters of table 4.2."""
    figure, ((axes,),) = _axes(1, 1, (7.5, 3.0))
    for (contraction, D), shade in zip(synthetic_profiles().items(), _SHADES, strict=True):
        axes.plot(np.linspace(0, 1, D.size), D, color=shade, label=f"{100 * contraction:.4g} %")
    axes.set(xlabel="position x along the active length", ylabel="diameter, in", ylim=(0, None))
    axes.set_title("SYNTHETIC", fontsize=9, color="C3")
    axes.legend(title="contraction", frameon=False, loc="lower center", ncols=5)
    return figure


def stretch() -> Figure:
    """B, D, theta and Gaylord's force over pressure."""
    figure, axes = _axes(1, 4, (12, 3.4))
    P = chapter5_braid.SWEPT
    soft = chapter5_braid.stretch(chapter5_braid.SOFT).elastic
    kevlar = chapter5_braid.stretch()
    lines: tuple[tuple[str, BraidState, dict[str, Any]], ...] = (
        ("inelastic", kevlar.inelastic, {"color": "0.5", "ls": ":"}),
        ("Kevlar", kevlar.elastic, {"color": "C0"}),
        ("one tenth of its stiffness", soft, {"color": "C1"}),
    )
    for label, state, style in lines:
        columns = (
            state.thread_length,
            state.diameter,
            np.rad2deg(state.braid_angle),
            state.gaylord_force,
        )
        for one, column in zip(axes.flat, columns, strict=True):
            one.plot(P, column, label=label, **style)
    table = printed()["elastic_braid"]
    for one, key in zip(axes.flat, ("B_in", "D_in", "theta_deg"), strict=False):
        one.plot(
            table["pressure_psi"], table[key], "o", mfc="none", mec="black", ms=5, label="printed"
        )
    for one, label in zip(
        axes.flat,
        ("thread length B, in", "diameter D, in", "braid angle, deg", "Gaylord's force, lbf"),
        strict=True,
    ):
        one.set(xlabel="pressure, psi", ylabel=label)
    _legend(figure, axes[0, 0])
    return figure


def _over_contraction(axes: Axes, quantity: str, label: str) -> None:
    for name, of in terms().items():
        axes.plot(
            of.contraction[-1, OWN], of.at_100_psi(quantity)[OWN], label=name, **_STYLES[name]
        )
    axes.set(xlabel="contraction", ylabel=label)


def strains() -> Figure:
    """Moments of the two strains; points: tables 6.1 and 6.2."""
    figure, axes = _axes(2, 4, (12, 5.6))
    tables = (("axial", "longitudinal_strain"), ("hoop", "circumferential_strain"))
    for row, (strain, key) in zip(axes, tables, strict=True):
        for n, one in enumerate(row, 1):
            _over_contraction(one, f"{strain} strain {n}", f"mean of |{strain} strain|$^{n}$")
            for kind, values in printed()[key].items():
                name = "estimated inelastic" if kind == "cylindrical" else kind.replace("_", " ")
                colour = _STYLES[name]["color"]
                one.plot(PRINTED_FREE, values[n - 1], "o", mfc="none", mec=colour, ms=5)
    _legend(figure, axes[0, 0])
    return figure


def stresses() -> Figure:
    """Thickness and the two stresses."""
    figure, axes = _axes(1, 3, (12, 3.8))
    _over_contraction(axes[0, 0], "bladder thickness", "bladder thickness, in")
    _over_contraction(axes[0, 1], "longitudinal stress", "longitudinal stress, psi")
    _over_contraction(axes[0, 2], "circumferential stress", "circumferential stress, psi")
    _legend(figure, axes[0, 0])
    return figure


def force_terms() -> Figure:
    """Gaylord's force and the two of the bladder."""
    figure, axes = _axes(1, 4, (12, 3.6))
    for one, quantity in zip(
        axes.flat,
        (
            "Gaylord force",
            "longitudinal bladder force",
            "circumferential bladder force",
            "bladder force",
        ),
        strict=True,
    ):
        _over_contraction(one, quantity, f"{quantity}, lbf")
    _legend(figure, axes[0, 0])
    return figure


def forces() -> Figure:
    """Isobars of the four geometries and the tested points."""
    figure, axes = _axes(1, 4, (12, 4.0))
    tested = printed()["tested"]
    for one, (name, of) in zip(axes.flat, terms().items(), strict=True):
        for row, (P, shade) in enumerate(zip(PRESSURES, _SHADES, strict=True)):
            force = of.values["total force"][row, OWN]
            one.plot(of.contraction[row, OWN], force, color=shade, label=f"{P:g} psi")
            blocked, free = tested["blocked_force_lbf"][row], tested["free_contraction"][row]
            points = {"color": shade, "mec": "black", "ms": 5, "clip_on": False, "zorder": 3}
            one.plot([0, free], [blocked, 0], "o", **points)
        one.set(xlabel="contraction", xlim=(0, 0.4), ylim=(0, 1150))
        one.set_title(name, fontsize=10)
    axes[0, 0].set(ylabel="force, lbf")
    axes[0, 0].plot([], [], "o", color="white", mec="black", ms=5, label="tested")
    _legend(figure, axes[0, 0], 6)
    return figure


def work() -> Figure:
    """Gaylord's force against virtual work."""
    figure, ((left, right),) = _axes(1, 2, (10, 4.0))
    at = chapter6_virtual_work.CONTRACTIONS
    for name, of in chapter6_virtual_work.over_contraction().items():
        force, gaylord = (
            of[key]
            for key in (chapter6_virtual_work.AT_THREAD_LENGTH, chapter6_virtual_work.GAYLORD)
        )
        left.plot(at, force, label=f"{name}, -P dV/dL", **_STYLES[name])
        right.plot(at, force - gaylord, **_STYLES[name])
        if name == "measured":
            left.plot(at, gaylord, color="black", lw=1, label="measured, Gaylord")
    for row in printed()["profile_100psi"]:
        right.axvline(row["contraction"], color="0.8", lw=0.8, zorder=0)
    left.set(xlabel="contraction", ylabel="pressure term, lbf")
    right.set(xlabel="contraction", ylabel="-P dV/dL minus Gaylord's force, lbf")
    right.set_title("grey: measured profiles, between them a spline", fontsize=9)
    _legend(figure, left, 3)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    "Figures 2.4 and 2.5, by subject, as their curves were not given to us: force at 100 psi and "
    "outer diameter over contraction of the braids of table 2.2 on the bladders of table 2.3, "
    "to the neutral angle or to jamming; bladders neglected.": combinations,
    "Profiles at 100 psi, table 4.3 corrected and made symmetric; thin: corrected only.": profiles,
    "SYNTHETIC profiles behind our table 4.2: elliptic ends, a cylinder.": synthetic,
    "Braid at the resting length over pressure: Kevlar, and a braid of one tenth its "
    "stiffness; circles: table 5.1.": stretch,
    "Strains at 100 psi, axial means of the powers 1 to 4 (axial: magnitudes).": strains,
    "Bladder thickness and true stresses at 100 psi.": stresses,
    "Terms of the force balance at 100 psi.": force_terms,
    "Total force at 20 to 100 psi and the tested blocked forces and free contractions.": forces,
    "Pressure term at 100 psi: Gaylord's force, and -P dV/dL at constant thread length.": work,
}
"""What draws each figure of the page, by its caption."""
