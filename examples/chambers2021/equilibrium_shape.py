"""Beyond the work: the equilibrium shape computed from the printed specimen, compared with measurements.

The work calls for a braid term that uses the real geometry. Here the profile is the one that minimises the
energy. Force, diameter and free contraction are computed from the profile; nothing is fitted to the muscle.
The latex is the one in the work's tensile test. It is described by two separate uniaxial laws, as in the
work, or by one isotropic incompressible law fitted to the same curve.

    python examples/chambers2021/equilibrium_shape.py [--json] [--fit]
"""

# %%
import functools
import json
import sys
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from beside_print import printed
from jaxtyping import Array, Float
from scipy.optimize import brentq, least_squares
from specimen import PRESSURES, bladder, profile

from famjax import Braid, EquilibriumMuscle, PolynomialMaterial, Real, parameter
from famjax.materials import AbstractHyperelastic, AbstractMaterial

STATIONS = np.linspace(0, 1, 201)
TOLERANCES = np.array([1 / 32, 0.005, 0.04])
"""Tolerances on the printed values used in the fit: thread length [in], turns and end diameter [in]."""


class Latex(AbstractHyperelastic):
    """W = C10 (I1 - 3) + C01 (I2 - 3) + C20 (I1 - 3)^2.

    Attributes:
        coefficients: C10, C01 and C20 [psi].
    """

    coefficients: Float[Array, " terms"] = parameter("Pa", kind="stress", name="C_{}")

    def energy(self, axial_stretch: Real, hoop_stretch: Real) -> Float[Array, "..."]:
        """Return the energy W per volume, broadcast shape."""
        a, b = jnp.square(axial_stretch), jnp.square(hoop_stretch)
        first, second = a + b + 1 / (a * b) - 3, 1 / a + 1 / b + a * b - 3
        C = self.coefficients
        return C[0] * first + C[1] * second + C[2] * first**2

    @property
    def initial_shear_modulus(self) -> Float[Array, ""]:
        """Shear modulus at zero strain, 2 (C10 + C01)."""
        return 2 * (self.coefficients[0] + self.coefficients[1])


def isotropic() -> Latex:
    """Fit the isotropic law to the printed tensile curve, in nominal stress, up to a strain of 2.1."""
    strain = np.linspace(0.01, 2.1, 210)
    true = sum(E * strain ** (n + 1) for n, E in enumerate(printed()["latex"]["E_psi"]))
    stretch = 1 + strain
    first = stretch**2 + 2 / stretch - 3
    unit = 2 * (stretch - stretch**-2)
    columns = np.stack([unit, unit / stretch, 2 * unit * first], axis=1)
    coefficients: Any = np.linalg.lstsq(columns, true / stretch, rcond=None)[0]
    return Latex(coefficients)


LAWS = {"uniaxial": lambda: PolynomialMaterial(printed()["latex"]["E_psi"]), "isotropic": isotropic}


@functools.cache
def muscle(law: str) -> EquilibriumMuscle:
    """Return a model of the specimen with the printed dimensions, in inches and psi."""
    return made(*nominal(), LAWS[law]())


def nominal() -> tuple[float, float, float]:
    """Return thread length [in], turns and end diameter [in] as measured."""
    of = printed()["specimen"]
    return of["thread_length_B_in"], of["turns_N"], of["braid_resting_diameter_in"]


def made(B: Real, N: Real, end: Real, law: AbstractMaterial) -> EquilibriumMuscle:
    """Build the muscle from thread length B, turns N, end diameter and law."""
    braid = Braid(B, N, printed()["specimen"]["braid_thickness_in"])
    return EquilibriumMuscle(braid, bladder(), law, end_diameter=end, modes=26)


def rows() -> list[dict[str, Any]]:
    """Return measured and computed values: profiles at 100 psi, and both ends of the stroke."""
    found = []
    table = printed()["profile_100psi"]
    contractions = np.array([row["contraction"] for row in table])
    tested = printed()["tested"]
    for law in LAWS:
        one = muscle(law)
        length = float(one.rest_length) * (1 - contractions)
        force, shape = np.asarray(one.force(length, 100.0)), one.profile(length, 100.0)
        for i, row in enumerate(table):
            measured = np.asarray(profile(row).diameter(STATIONS, 1.0))
            D = 2 * np.interp(STATIONS * length[i], shape.position[i], shape.radius[i])
            found.append({
                "law": law, "pressure_psi": 100.0, "contraction": contractions[i],
                "force_lbf": force[i], "mid_diameter_in": D[100],
                "published_mid_diameter_in": measured[100],
                "profile_rmse_in": float(np.sqrt(np.mean((D - measured) ** 2))),
            })  # fmt: skip
        P = np.array(PRESSURES)
        free, blocked = one.free_contraction(P), one.blocked_force(P)
        for i in range(P.size):
            found.append({
                "law": law, "pressure_psi": P[i], "free_contraction": free[i],
                "published_free_contraction": tested["free_contraction"][i],
                "blocked_force_lbf": blocked[i],
                "published_blocked_force_lbf": tested["blocked_force_lbf"][i],
            })  # fmt: skip
    return [{k: v if isinstance(v, str) else float(v) for k, v in row.items()} for row in found]


def one_law_fit() -> dict[str, Any]:
    """Fit one pressure-independent law to ten figures, with B, N and end diameter within tolerance.

    The figures are the blocked forces at five pressures, and zero force at the free contractions.
    """
    tested, P = printed()["tested"], np.tile(PRESSURES, 2)
    L0 = printed()["specimen"]["active_length_in"]
    length = L0 * (1 - np.array([*[0.0] * 5, *tested["free_contraction"]]))
    target = np.array([*tested["blocked_force_lbf"], *[0.0] * 5])
    start = np.array([*nominal(), *printed()["latex"]["E_psi"]])

    def off(numbers: Float[Array, "6"]) -> Float[Array, "10"]:
        B, N, end, *E = numbers
        return made(B, N, end, PolynomialMaterial(jnp.stack(E))).force(length, P) - target

    slopes = jax.jit(jax.jacfwd(lambda x: (off(x),) * 2, has_aux=True))
    known: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if x.tobytes() not in known:
            slope, value = slopes(x)
            known[x.tobytes()] = np.asarray(slope), np.asarray(value)
        return known[x.tobytes()]

    # A state without a shape counts as a large error.
    wide = np.array([*TOLERANCES, 1000.0, 1000.0, 1000.0])
    residual: Any = lambda x: np.nan_to_num(at(x)[1], nan=1e3)  # noqa: E731
    slope: Any = lambda x: at(x)[0]  # noqa: E731
    fit = least_squares(
        residual, start, jac=slope,
        bounds=(start - wide, start + wide), x_scale=np.array([0.01, 0.002, 0.01, 30.0, 30.0, 30.0]),
    )  # fmt: skip
    return {
        "thread_length_in": fit.x[0], "turns": fit.x[1], "end_diameter_in": fit.x[2],
        "E_psi": fit.x[3:].tolist(), "rmse_lbf": float(np.sqrt(np.mean(fit.fun**2))),
        "errors_lbf": fit.fun.tolist(),
    }  # fmt: skip


def thread_lengths() -> list[dict[str, Any]]:
    """Return the length of one thread along each measured profile, for comparison with 9.89 in.

    A thread pinned at its crossings winds evenly along its own length, so with the meridian s

        int ds / sqrt(B^2 - (2 pi N r)^2) = 1.

    A thread free to slide is a geodesic, r sin(angle to the meridian) = c, with
    int c ds / (r sqrt(r^2 - c^2)) = 2 pi N. The thread length "lost to curvature" in the work is computed
    for a cylinder with the mean diameter, and is an artefact of the cylinder.
    """
    nodes, weights = np.polynomial.legendre.leggauss(400)
    x, w = (nodes + 1) / 2, weights / 2
    turns, rest = nominal()[1], printed()["specimen"]["active_length_in"]
    found = []
    for row in printed()["profile_100psi"]:
        length, outline = rest * (1 - row["contraction"]), profile(row)
        r = np.asarray(outline.diameter(x, length)) / 2
        slope = np.gradient(np.asarray(outline.diameter(STATIONS, length)) / 2, STATIONS * length)
        ds = w * length * np.hypot(1, np.interp(x, STATIONS, slope))
        around = 2 * np.pi * turns * r

        def uneven(B: float, around: np.ndarray = around, ds: np.ndarray = ds) -> float:
            return float(np.sum(ds / np.sqrt(B**2 - around**2))) - 1

        def unwound(c: float, r: np.ndarray = r, ds: np.ndarray = ds) -> float:
            return float(np.sum(c * ds / (r * np.sqrt(r**2 - c**2)))) - 2 * np.pi * turns

        most = 0.999 * float(r.min())
        bound: Any = brentq(unwound, 0, most) if unwound(most) > 0 else np.nan
        c = float(bound)
        found.append({
            "contraction": row["contraction"],
            "pinned_thread_in": brentq(uneven, 1.0001 * float(around.max()), 20.0),
            "geodesic_thread_in": float(np.sum(ds * r / np.sqrt(r**2 - c**2))),
        })  # fmt: skip
    return found


def _without_nan(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Replace missing values with null for JSON."""
    return [{k: None if v != v else v for k, v in row.items()} for row in found]  # noqa: PLR0124


def main(arguments: list[str]) -> None:
    """Print the tables, or their rows as one JSON list."""
    jax.config.update("jax_enable_x64", True)
    found = rows() + thread_lengths()
    if "--fit" in arguments:
        found.append(one_law_fit())
    if "--json" in arguments:
        print(json.dumps(_without_nan(found)))
        return
    print("law        psi  contraction    F [lbf]   mid D [in], measured   RMSE of D(x) [in]")
    for row in found:
        if "mid_diameter_in" in row:
            print(
                f"{row['law']:9} {row['pressure_psi']:4.0f} {row['contraction']:12.4f} "
                f"{row['force_lbf']:10.1f} {row['mid_diameter_in']:8.3f} "
                f"{row['published_mid_diameter_in']:10.3f} {row['profile_rmse_in']:12.3f}"
            )
    print("law        psi   free contraction, measured   blocked force [lbf], measured")
    for row in found:
        if "free_contraction" in row:
            print(
                f"{row['law']:9} {row['pressure_psi']:4.0f} {row['free_contraction']:12.4f} "
                f"{row['published_free_contraction']:10.3f} {row['blocked_force_lbf']:14.1f} "
                f"{row['published_blocked_force_lbf']:10.0f}"
            )
    print("contraction   thread length on the measured profile [in]: pinned, geodesic")
    for row in thread_lengths():
        print(
            f"{row['contraction']:11.4f} {row['pinned_thread_in']:37.3f} {row['geodesic_thread_in']:9.3f}"
        )
    if "--fit" in arguments:
        print(f"one law for all pressures: RMSE {found[-1]['rmse_lbf']:.1f} lbf")


if __name__ == "__main__":
    main(sys.argv[1:])
