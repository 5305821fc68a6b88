"""Figures of the concept pages, computed by the packages.

python docs/figures.py              # all of them, into docs/figures, the same bytes every time
python docs/figures.py FOLDER       # or elsewhere

What a figure shows is also in `curves.json` beside them: the tests compute it anew and compare.
"""

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import famjax
import fitting
from famjax.boundary.files import as_svg
from famjax.braids import NEUTRAL_ANGLE, force_magnification

FOLDER = Path(__file__).parent / "figures"

Curves = dict[str, np.ndarray]
PRESSURE = 5e5  # Pa, of the figures at one pressure
NOISE, SEED = 80.0, 0  # N; readings whose best law of order 4 is not stable


def muscle_of_readme() -> famjax.Muscle:
    """The DMSP-20-300 with the cubic law, as the README has it."""
    braid = famjax.Braid.from_rest(diameter=0.0236, braid_angle=jnp.deg2rad(61.7), length=0.296)
    bladder = famjax.Bladder(0.296, 0.0236, rest_thickness=0.0018, embedded=True)
    law = famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6])
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, deadband_pressure=40e3)


def noisy_map() -> fitting.ForceData:
    """The bundled map with noise on the readings that pull."""
    data = fitting.load_bundled("DMSP-20-300")
    noise = NOISE * np.random.default_rng(SEED).standard_normal(data.force.size)
    force = np.maximum(data.force + np.where(data.force > 0, noise, 0), 0)
    return dataclasses.replace(data, force=force)


def braid() -> tuple[Figure, Curves]:
    """The unrolled thread at rest and contracted, and the force magnification."""
    one = muscle_of_readme().geometry.braid
    lengths = jnp.array([0.296, 0.237])
    around = jnp.pi * one.turns * one.diameter(lengths)
    angle = jnp.linspace(jnp.deg2rad(25.0), jnp.deg2rad(75.0), 101)
    lift = force_magnification(angle)
    figure, (left, right) = _axes(2)
    for L, W, colour in zip(lengths, around, ("C0", "C1"), strict=True):
        left.plot([0, W, W, 0], [0, 0, L, 0], color=colour, label=f"L = {1e3 * L:.0f} mm")
    left.set(xlabel="pi N D, m", ylabel="L, m", aspect="equal", title="one thread, unrolled")
    left.set_xlim(-0.02, 0.45)
    left.legend(frameon=False, loc="upper right")
    right.plot(jnp.rad2deg(angle), lift, color="C0")
    right.axvline(np.rad2deg(NEUTRAL_ANGLE), color="0.5", lw=0.8, ls="--")
    right.axhline(0, color="0.5", lw=0.8)
    right.set(xlabel="braid angle, deg", ylabel="2 tan²θ - 1", title="force magnification")
    return figure, {"around": around, "magnification": lift}


def bladder() -> tuple[Figure, Curves]:
    """The parts of the force over contraction at one pressure."""
    muscle = muscle_of_readme()
    contraction = jnp.linspace(0.0, 0.25, 51)
    length = 0.296 * (1 - contraction)
    parts = {
        "pressurised braid": muscle.braid_force(length, PRESSURE),
        "bladder": muscle.bladder_force(length, PRESSURE),
        "muscle": muscle.force(length, PRESSURE),
    }
    figure, (axes,) = _axes(1)
    for (name, force), colour in zip(parts.items(), ("C0", "C1", "k"), strict=True):
        axes.plot(100 * contraction, force, color=colour, label=name)
    axes.axhline(0, color="0.5", lw=0.8)
    axes.set(xlabel="contraction, %", ylabel="force, N", title="DMSP-20-300 at 5 bar")
    axes.legend(frameon=False)
    return figure, {name.replace(" ", "_"): force for name, force in parts.items()}


def stability() -> tuple[Figure, Curves]:
    """Laws of order 4 with and without the constraint, fitted to noisy readings."""
    data = noisy_map()
    figure, (left, right) = _axes(2)
    curves: Curves = {}
    for constraint, colour in (("none", "C3"), ("drucker", "C0")):
        found = fitting.identify(data, order=4, constraint=constraint)
        strain = jnp.linspace(0, found.strain_range, 81)
        law, geometry = found.muscle.material, found.muscle.geometry
        contraction = jnp.linspace(0.0, 0.25, 81)
        modulus = famjax.path_modulus(law, geometry, 0.296 * (1 - contraction), PRESSURE)
        stress = law.stress(strain)
        left.plot(strain, stress / 1e6, color=colour, label=f"constraint: {constraint}")
        right.plot(100 * contraction, modulus / 1e6, color=colour)
        curves |= {f"{constraint}_stress": stress, f"{constraint}_modulus": modulus}
    left.set(xlabel="strain", ylabel="stress, MPa", title="the law")
    left.legend(frameon=False)
    right.axhline(0, color="0.5", lw=0.8)
    right.set(xlabel="contraction, %", ylabel="modulus along the path, MPa", title="its stability")
    return figure, curves


def ridges() -> tuple[Figure, Curves]:
    """The least RMSE at every braid diameter and angle: deadband and E_n are fitted at each."""
    data = fitting.load_bundled("DMSP-20-300")
    F, L, P = (jnp.asarray(c[data.loaded]) for c in (data.force, data.length, data.pressure))

    def least(diameter: jax.Array, angle: jax.Array) -> jax.Array:
        threads = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle, length=0.296)
        tube = famjax.Bladder(0.296, diameter, 0.0018, embedded=True)
        shape = famjax.EstimatedGeometry(threads, tube)

        def force(x: jax.Array) -> jax.Array:  # affine: deadband [kPa] and E_n [MPa]
            law = famjax.PolynomialMaterial(1e6 * x[1:])
            return famjax.Muscle(shape, law, 1e3 * x[0]).force(L, P)

        columns, rest = jax.jacfwd(force)(jnp.zeros(4)), force(jnp.zeros(4))
        found = jnp.linalg.lstsq(columns, F - rest)[0]
        return jnp.sqrt(jnp.mean((rest + columns @ found - F) ** 2))

    diameters, angles = jnp.linspace(0.020, 0.0236, 121), jnp.deg2rad(jnp.linspace(60.5, 65.5, 161))
    rows = jax.jit(jax.vmap(jax.vmap(least, (None, 0)), (0, None)))
    rmse = rows(diameters, angles)
    figure, (axes,) = _axes(1)
    levels = [8, 10, 14, 20, 30]
    drawn = axes.contour(1e3 * diameters, jnp.rad2deg(angles), rmse.T, levels, cmap="viridis")
    axes.clabel(drawn, fmt="%g N", fontsize=8)
    axes.set(
        xlabel="braid diameter, mm", ylabel="braid angle, deg",
        title="least RMSE, deadband and E_n fitted at each point",
    )  # fmt: skip
    return figure, {"rmse": rmse[::20, ::32]}


def bands() -> tuple[Figure, Curves]:
    """Predictions with their 95 % bands, within and beyond the lengths of the map."""
    data = fitting.load_bundled("DMSP-20-300")
    fit = fitting.choose(data).chosen
    level = data.pressure[np.abs(data.pressure - PRESSURE).argmin()]
    lengths = np.linspace(0.205, 0.303, 99)
    rows = fitting.predict(fit, lengths, np.array([level]))
    low, middle, high = (
        np.array([row[key] for row in rows], float) for key in ("low_95_N", "force_N", "high_95_N")
    )
    figure, (left, right) = _axes(2)
    left.fill_between(1e3 * lengths, low, high, color="C0", alpha=0.25, lw=0, label="95 %")
    left.plot(1e3 * lengths, middle, color="C0", label="prediction")
    seen = data.loaded & (data.pressure == level)
    left.plot(1e3 * data.length[seen], data.force[seen], "k.", label="readings")
    half = fitting.prediction.model_forces(fit, lengths, np.full(lengths.size, level)).half
    right.plot(1e3 * lengths, half, color="C0")
    for axes in (left, right):
        axes.set(xlabel="length, mm")
        for edge in (data.length.min(), data.length.max()):
            axes.axvline(1e3 * edge, color="0.5", lw=0.8, ls="--")
    left.set(ylabel="force, N", title=f"DMSP-20-300 at {level / 1e5:g} bar")
    left.legend(frameon=False)
    right.set(ylabel="half width of the band, N", ylim=(0, None), title="its band")
    return figure, {"low": low[::7], "force": middle[::7], "high": high[::7]}


FIGURES: dict[str, Callable[[], tuple[Figure, Curves]]] = {
    one.__name__: one for one in (braid, bladder, stability, ridges, bands)
}


def make(folder: Path) -> dict[str, dict[str, list]]:
    """Every figure as SVG, and `curves.json`, into a folder; the curves."""
    folder.mkdir(parents=True, exist_ok=True)
    curves = {}
    for name, draw in FIGURES.items():
        figure, shown = draw()
        with mpl.rc_context({"svg.fonttype": "none"}):
            (folder / f"{name}.svg").write_text(as_svg(figure), encoding="utf-8")
        curves[name] = {key: _rounded(value) for key, value in shown.items()}
    (folder / "curves.json").write_text(json.dumps(curves, indent=0) + "\n", encoding="utf-8")
    return curves


def _rounded(values: np.ndarray) -> list:
    """Six digits, and no nan."""
    return [
        _rounded(one) if np.ndim(one) else None if np.isnan(one) else float(f"{float(one):.6g}")
        for one in np.asarray(values)
    ]


def _axes(count: int) -> tuple[Figure, list]:
    figure = Figure(figsize=(4.6 * count + 0.6, 3.6), layout="constrained")
    return figure, list(np.ravel(figure.subplots(1, count)))


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    place = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    make(place)
    print(*(f"{name}.svg" for name in FIGURES))
