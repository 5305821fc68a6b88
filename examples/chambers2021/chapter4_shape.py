"""Chapter 4, photogrammetry: the muscle's shape from printed data and from photographs of the twin."""

import functools
import math
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from beside_print import Chapter, Row, beside, printed
from jaxtyping import Array, Float
from specimen import elliptic_ends, inelastic_braid, profile, transcribed_profile, tube_volume
from twin import Twin

from famjax import units
from famjax.braids import diameter_from_length
from famjax.compile_options import quick_jit
from famjax.measured import Meridian
from famjax.profiles import FourierProfile
from imaging.campaign import POSITION

chapter = Chapter(__name__)


# %% [markdown]
# # Chapter 4: photogrammetry
# One camera, 60 in away, photographs the muscle once per second while the machine strokes it. Bright tapes
# on the fittings mark the ends of the active length, and a ruler provides the scale. In every photograph
# the outline is detected and described by three Fourier terms. The chapter compares the photographed
# lengths with those from the testing machine, and the shape with the cylinder that is usually assumed.
#
# ## Dimensions and set-up


# %%
@chapter.table("section 4: volumes")
def volumes() -> list[Row]:
    of = printed()["specimen"]
    length, rubber = of["active_length_in"], of["bladder_thickness_in"]
    bladder = float(tube_volume(length, of["bladder_outer_diameter_in"], rubber))
    braid = float(tube_volume(length, of["braid_resting_diameter_in"], of["braid_thickness_in"]))
    return [
        beside("4, volumes", "bladder", bladder, "in3", "specimen.bladder_volume_in3"),
        beside("4, volumes", "braid", braid, "in3", "specimen.braid_volume_in3"),
    ]


@chapter.table("section 4: camera")
def camera() -> list[Row]:
    """Derive pixel size, angle of view and depth error from scale and distance."""
    of = printed()["photogrammetry"]
    length, distance = printed()["specimen"]["active_length_in"], of["camera_distance_in"]
    view = math.degrees(2 * math.atan(length / (2 * distance)))
    key = "photogrammetry.{}".format
    return [
        beside("4, camera", "pixel size", 1 / of["scale_px_per_in"], "in",
               key("resolution_in_per_px")),
        beside("4, camera", "angle of view of the active length", view, "deg",
               key("angle_of_view_deg"), view * 0.05 / distance,
               "half a unit in the last digit of the distance, 60.0 in"),
        beside("4, camera", "change in scale per inch of depth", 1 / distance, "1",
               key("scale_change_per_inch_of_depth")),
    ]  # fmt: skip


# %% [markdown]
# ## The braid angle from the slope of blocked force
# Without a camera, the angle is estimated from the slope of blocked force against pressure, which is
# pi R^2 (2 tan^2 theta - 1) for a braid. The diameter may be that of the bladder or that of the braid, so
# there are two estimates.


# %%
def _angle_from_slope(
    pressure: Float[np.ndarray, " n"], force: Float[np.ndarray, " n"], diameter: float
) -> float:
    """Return theta0 [deg] of a braid whose dF/dP is pi D0^2/4 (2 tan(theta0)^2 - 1)."""
    magnification = 4 * np.polyfit(pressure, force, 1)[0] / (math.pi * diameter**2)
    return math.degrees(math.atan(math.sqrt((magnification + 1) / 2)))


@chapter.table("section 4: angle from the slope of blocked force")
def angle_from_slope() -> list[Row]:
    """Return theta0 for which the slope of Gaylord's blocked force equals that of the tested force."""
    tested = printed()["tested"]
    P, F = (np.array(tested[key], float) for key in ("pressure_psi", "blocked_force_lbf"))
    found = []
    for diameter, key in ((0.875, "from_D0_0p875"), (1.025, "from_D0_1p025")):
        angle, *between = (
            _angle_from_slope(P[part], F[part], diameter)
            for part in (slice(None), *(slice(k, k + 2) for k in range(P.size - 1)))
        )
        spread = max(abs(one - angle) for one in between)
        entry = f"initial angle from the slope of blocked force, D0 = {diameter} in"
        why = "the largest change if the slope is taken between two neighbouring pressures"
        found.append(
            beside("4, angle", entry, angle, "deg", f"photogrammetry.estimated_theta0_deg.{key}",
                   spread, why)
        )  # fmt: skip
    return found


# %% [markdown]
# ## Table 4.3: profiles at 100 psi
# The table describes the diameter, D(x) = a0 + sum a_n cos(n w x) + b_n sin(n w x), at five contractions.
# As printed, only the row at 0 % describes a muscle; the other profiles are asymmetric, and some diameters
# are negative. A profile that is symmetric about x = 1/2 requires b_n/a_n = tan(n w/2), which determines w.

# %%
SHAPE_X = np.linspace(0, 1, 301)
"""Positions x at which the profiles in table 4.3 are plotted."""

_X = np.linspace(0, 1, 401)


def printed_diameter(
    row: dict, x: Float[np.ndarray, " n"], *, corrected: bool
) -> Float[np.ndarray, " n"]:
    """Return the diameter [in] at x for a row in table 4.3, even if it is negative as printed."""
    w = row["w_corrected" if corrected else "w_as_printed"]
    b = [row["b"][0] if corrected else row.get("b1_as_printed", row["b"][0]), *row["b"][1:]]
    angle = np.arange(1, len(b) + 1) * w * np.asarray(x)[:, None]
    return row["a"][0] + np.cos(angle) @ row["a"][1:] + np.sin(angle) @ b


@quick_jit
def _shapes() -> tuple[dict[str, Float[Array, "profiles ..."]], ...]:
    rows, rest = printed()["profile_100psi"], printed()["specimen"]["active_length_in"]
    lengths = jnp.array([rest * (1 - row["contraction"]) for row in rows])

    def measures(even: FourierProfile, length: Float[Array, ""]) -> dict[str, Float[Array, "..."]]:
        meridian = Meridian.of(even.diameter, length)
        return {
            "w": even.w,
            "mean D": meridian.mean_diameter,
            "arc": meridian.arc_length,
            "volume": meridian.volume,
            "D": even.diameter(SHAPE_X, length),
        }

    def of(profiles: list[FourierProfile]) -> dict[str, Float[Array, "profiles ..."]]:
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *profiles)
        return eqx.filter_vmap(measures)(stacked, lengths)

    return (
        of([profile(row) for row in rows]),
        of([transcribed_profile(row).symmetrised() for row in rows]),
    )


@functools.cache
def shapes() -> dict[str, dict[str, Float[np.ndarray, "profiles ..."]]]:
    """Return w, mean D, arc length and volume in inches, and D at `SHAPE_X`, for table 4.3."""
    used, transcribed = jax.tree.map(np.asarray, _shapes())
    return {"used": used, "transcribed w": transcribed}


@chapter.table("table 4.3: profiles")
def profiles() -> list[Row]:
    """Return table 4.3 as printed, as corrected, and as used (corrected and made symmetric)."""
    rest = printed()["specimen"]["active_length_in"]
    found = []
    for k, row in enumerate(printed()["profile_100psi"]):
        at = f"{100 * row['contraction']:.4g} %"
        for label, corrected in (("as printed", False), ("corrected", True)):
            D = printed_diameter(row, _X, corrected=corrected)
            values = (
                ("D at x = 0", D[0]),
                ("D at x = 1/2", D[_X.size // 2]),
                ("D at x = 1", D[-1]),
                ("largest |D(x) - D(1 - x)|", np.abs(D - D[::-1]).max()),
            )
            found += [Row("4.3", f"{label}, {at}, {name}", float(v), "in") for name, v in values]
        symmetric = float(shapes()["used"]["w"][k])
        entry = f"w that makes the printed profile symmetric, {at}"
        key = f"profile_100psi.{k}.w_as_printed"
        # The sign of w follows from the b_n, and the print is consistent with it.
        signed = math.copysign(symmetric, row["w_as_printed"])
        found.append(beside("4.3", entry, signed, "1", key, misprint=True))
        if "b1_as_printed" in row:
            b1 = row["a"][1] * math.tan(symmetric / 2)
            entry, key = (
                f"b_1 that makes the first term symmetric, {at}",
                f"profile_100psi.{k}.b1_as_printed",
            )
            found.append(beside("4.3", entry, b1, "1", key, misprint=True))
        for label, of in shapes().items():
            found += [
                Row("4.3", f"{label}, {at}, w", float(of["w"][k]), "1"),
                Row("4.3", f"{label}, {at}, mean D", float(of["mean D"][k]), "in"),
                Row("4.3", f"{label}, {at}, outline volume", float(of["volume"][k]), "in3"),
                Row("4.3", f"{label}, {at}, axial strain", float(of["arc"][k]) / rest - 1, "1"),
            ]
    return found


# %% [markdown]
# ## Table 4.2: how many Fourier terms a profile needs
# The photographs are not published, so synthetic profiles are used: a cylinder with elliptic ends.

# %%
END_LENGTH, END_ANGLE = 1.1, 1.0
"""Length [in] of each rounded end of the synthetic profiles, and the parameter angle [rad] of its
ellipse at the fitting, chosen so that the slope there is finite."""

_WAVE_NUMBERS = np.linspace(1.0, 7.0, 241)

CONTRACTIONS = (0.0, 0.0875, 0.175, 0.2625, 0.35)
"""Contractions of the synthetic profiles."""


def _series(w: float, x: Float[np.ndarray, " n"], terms: int) -> Float[np.ndarray, "n p"]:
    angle = np.arange(1, terms + 1) * w * x[:, None]
    return np.hstack([np.ones((x.size, 1)), np.cos(angle), np.sin(angle)])


def fit_terms(
    x: Float[np.ndarray, " n"], diameters: Float[np.ndarray, "profiles n"], terms: int
) -> Float[np.ndarray, "profiles n"]:
    """Fit a Fourier series with this number of terms and free w to each profile by least squares.

    For each w on a grid, the coefficients are found by linear least squares; the best w is kept.
    """
    columns = [_series(w, x, terms) for w in _WAVE_NUMBERS]
    planes = [np.linalg.qr(column)[0] for column in columns]
    caught = np.array([np.sum((diameters @ plane) ** 2, axis=1) for plane in planes])
    best = [planes[k] for k in caught.argmax(axis=0)]
    return np.array([plane @ (plane.T @ D) for plane, D in zip(best, diameters, strict=True)])


@quick_jit
def _synthetic_diameters() -> Float[Array, "profiles n"]:
    of, braid = printed()["specimen"], inelastic_braid()
    length = of["active_length_in"] * (1 - jnp.array(CONTRACTIONS)[:, None])
    middle = diameter_from_length(length, braid.rest_thread_length, braid.turns)
    end = of["braid_resting_diameter_in"]
    return elliptic_ends(_X[::2], length, middle, end, END_LENGTH, END_ANGLE)


@functools.cache
def synthetic_profiles() -> dict[float, Float[np.ndarray, " n"]]:
    """Return SYNTHETIC diameters [in] at 201 positions, by contraction, of a cylinder with elliptic ends.

    The diameter of the cylinder follows from the triangle relation of the braid. At the fittings, the
    diameter is that of the braid at rest.
    """
    return dict(zip(CONTRACTIONS, np.asarray(_synthetic_diameters()), strict=True))


@chapter.table("table 4.2: Fourier terms of a profile")
def fourier_terms() -> list[Row]:
    """Return the errors in table 4.2 for synthetic profiles, because the photographs are not published."""
    profiles = np.stack(list(synthetic_profiles().values()))
    found = []
    for terms in printed()["fourier_terms"]["terms"]:
        errors = fit_terms(_X[::2], profiles, terms) - profiles
        for name, value in (
            ("largest error, mean of the profiles", np.abs(errors).max(axis=1).mean()),
            ("RMSE, mean of the profiles", np.sqrt((errors**2).mean(axis=1)).mean()),
        ):
            found.append(
                Row("4.2", f"SYNTHETIC profiles, {terms} terms, {name}", float(value), "in")
            )
    return found


# %% [markdown]
# ## Photographs of the twin
# The reference work used photographs to check the lengths from the testing machine, and to choose the
# number of Fourier terms. The twin's photographs are rendered, and its true lengths are known.


# %%
def photographed_lengths(twin: Twin) -> list[Row]:
    """Return the largest errors in length, relative to the machine (as in the work) and to the truth."""
    table, rest = twin.pictures, twin.sheet.specimen.rest_length
    errors = {"the machine": table["length"] - (rest + table["displacement"])}
    true = np.array([twin.lengths[Path(path).name] for path in table.path])
    errors["the truth"] = table["length"] - true
    published = {"the machine": printed()["photogrammetry"]["max_length_error_in"]}
    return [
        Row("4.1", f"TWIN, {table.ok.sum()} of {len(table)} pictures, largest error in length "
            f"relative to {what}", float(np.nanmax(np.abs(error))) / units.INCH, "in", published.get(what))
        for what, error in errors.items()
    ]  # fmt: skip


def photographed_terms(twin: Twin) -> list[Row]:
    """Return table 4.2 for the twin's photographs."""
    table, of = twin.pictures, printed()["fourier_terms"]
    diameters = table.diameter[table.ok] / units.INCH
    found = []
    for terms, largest, rmse in zip(of["terms"], of["max_error_in"], of["rmse_in"], strict=True):
        errors = fit_terms(POSITION, diameters, terms) - diameters
        for name, value, theirs in (
            ("largest error", np.abs(errors).max(axis=1).mean(), largest),
            ("RMSE", np.sqrt((errors**2).mean(axis=1)).mean(), rmse),
        ):
            entry = f"TWIN, {terms} terms, {name}, mean of the pictures"
            found.append(Row("4.2", entry, float(value), "in", theirs))
    return found


# %%
if chapter.shown:
    twin = Twin.of_command_line()
    chapter.show("table 4.1: lengths of the twin", photographed_lengths(twin))
    chapter.show("table 4.2: Fourier terms of the twin", photographed_terms(twin))
