"""Identifications: errors, certificates, an independent optimum, truth found again, intervals.

By public names alone, on any force map.
"""

import dataclasses
import importlib
import math
from typing import Any, TypeAlias

import jax
import numpy as np
from jaxtyping import Float
from row import Case
from scipy import sparse, stats

import famjax
import fitting
from fitting import ForceData, Identification, Parameter, Specimen
from fitting.convex import Status

Vector: TypeAlias = Float[np.ndarray, " n"]
Matrix: TypeAlias = Float[np.ndarray, "m n"]
A1, A2 = "DMSP-20-300", "DMSP-10-250"
CONSTRAINTS = ("none", "positive", "slope", "drucker")

ENDS, BRAID, RIG = (
    {name: Parameter()} for name in ("end_factor", "braid_compliance", "series_compliance")
)
# Lengths are printed in whole millimetres, so the rest length is good to half of one.
ROUNDED = {"rest_length": Parameter(min=295.5, max=296.5, unit="mm")}
# The rubber of A1, identified there as -6.47 +- 0.56: the same make and compound.
SAME_RUBBER = {"ogden_exponent": Parameter(prior=(-6.5, 0.6))}
WIDE = {
    "braid_diameter": (5e-3, 40e-3), "braid_angle": (0.785, 1.396), "deadband_pressure": (0.0, 2e5),
}  # fmt: skip
"""Bounds in which the geometry is a fit parameter only, no muscle that can be built."""
_linear = famjax.materials.PressurePolynomialMaterial
LINEAR = {order: _linear(np.array([1e5, 6e5]), np.ones((2, order))) for order in (3, 4)}
MODELS: dict[str, dict[str, Any]] = {
    "cubic": {},
    "cubic, wide bounds": {"order": 3, "bounds": WIDE},
    "Ogden, ends, rest length to its rounding": {"law": "ogden", "parameters": ENDS | ROUNDED},
    "Ogden, compliant braid, the rubber of the DMSP-20 as a prior": {
        "law": "ogden", "parameters": BRAID | SAME_RUBBER, "noise": 1.0,
    },
    "Mooney-Rivlin, wide bounds": {"law": "mooney-rivlin", "bounds": WIDE},
    "quartic linear in pressure, wide bounds": {"law": LINEAR[4], "bounds": WIDE},
    "cubic linear in pressure, wide bounds": {"law": LINEAR[3], "bounds": WIDE},
}  # fmt: skip
"""Options of `fitting.identify` by the model in words."""


def fit(case: Case, **options: Any) -> Identification:
    """The identification of the case's map, made once for the same options."""
    return case.once(("fit", repr(options)), lambda: fitting.identify(case.map, **options))


def model(case: Case, name: str) -> dict[str, float]:
    """RMSE of a model of `MODELS`, and whether it is one to believe."""
    found = fit(case, **MODELS[name])
    stable = found.certificate.stability_margin >= -1e-9 * float(np.abs(found.coefficients).max())
    return {
        "RMSE [N]": found.errors.rmse,
        "parameters": float(found.n_parameters),
        "converged and Drucker-stable": float(found.converged and stable),
    }


def left_out(case: Case, name: str) -> dict[str, float]:
    """RMSE of a model of `MODELS` on readings that it has not seen."""
    found = fit(case, **MODELS[name])
    return {
        "RMSE, one pressure out [N]": fitting.validate(found, "pressure", starts=12).rmse,
        "RMSE, one interior length out [N]": fitting.validate(
            found, "length", starts=12
        ).interior_rmse,
    }


def certificates(case: Case) -> dict[str, float]:
    """What the default polynomial fit is certified by."""
    found = fit(case)
    certificate, largest = found.certificate, float(np.abs(found.coefficients).max())
    return {
        "KKT residual, relative": certificate.kkt_residual,
        "duality gap, relative": certificate.duality_gap,
        "gradient residual of the geometry": certificate.gradient_residual,
        "stability margin / largest coefficient": certificate.stability_margin / largest,
    }


def columns(
    geometry: Any, deadband: Any, length: Vector, pressure: Vector, order: int
) -> tuple[Matrix, Vector]:
    """Force of each unit coefficient [N/Pa], and that of the braid alone [N], at readings."""

    def force(E: Any) -> Any:
        muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(E), deadband)
        return muscle.force(length, pressure)

    none = np.zeros(order)
    return np.asarray(jax.jacfwd(force)(none)), np.asarray(force(none))


def constraint_rows(
    geometry: Any, constraint: str, shortest: float, pressure: float, order: int, stations: int
) -> Matrix:
    """Rows G of a constraint G E >= 0 at stations of the path to the shortest length."""
    path = np.linspace(float(geometry.rest_length), shortest, stations)
    if constraint == "none":
        return np.zeros((0, order))
    if constraint == "positive":
        return np.eye(order)
    if constraint == "drucker":
        laws = [famjax.PolynomialMaterial(one) for one in np.eye(order)]
        moduli = [famjax.path_modulus(law, geometry, path, pressure) for law in laws]
        return np.stack([np.asarray(column) for column in moduli], axis=1)
    ends = geometry.dimensions(np.array([path[0], shortest]), pressure)
    largest = max(float(np.abs(ends.hoop_strain).max()), float(np.abs(ends.axial_strain).max()))
    powers = np.arange(1, order + 1)
    return powers * np.linspace(0, largest, stations)[:, None] ** (powers - 1)


def clarabel(A: Matrix, b: Vector, G: Matrix) -> Any:
    """Minimum of 1/2 |A x - b|^2 under G x >= 0 by Clarabel called directly: a function to time."""
    solver: Any = importlib.import_module("clarabel")  # its compiled module names no types
    settings = solver.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    cones = [solver.NonnegativeConeT(len(G))] if len(G) else []
    P, q, rows = sparse.csc_matrix(np.triu(A.T @ A)), -A.T @ b, sparse.csc_matrix(-G)

    def solve() -> Vector:
        return np.array(
            solver.DefaultSolver(P, q, rows, np.zeros(len(G)), cones, settings).solve().x
        )

    return solve


def sweep(case: Case) -> dict[str, float]:
    """The 48 fits at the geometry that the standard fit finds."""
    result, data = fit(case), case.map
    geometry, deadband = (getattr(result.muscle, of) for of in ("geometry", "deadband_pressure"))
    found = fitting.sweep(data, geometry, deadband=float(deadband))
    at = data.loaded
    pressure = data.pressures.level[at]
    A, _ = columns(geometry, deadband, data.length[at], pressure, 4)
    determined = [_determined(A[:, : row.order], pressure, row.dependence) for row in found.rows]
    drucker = [row for row in found.rows if row.constraint == "drucker"]
    pairs = list(zip(found.rows, determined, strict=True))
    return {
        "determined fits not certified": sum(
            row.status is not Status.OPTIMAL for row, known in pairs if known
        ),
        "undetermined fits not refused": sum(
            row.status is not Status.RANK_DEFICIENT for row, known in pairs if not known
        ),
        "largest relative duality gap": max(row.duality_gap for row in found.rows),
        "largest violation between stations / largest coefficient": max(
            -row.margin / float(np.abs(row.coefficients).max()) for row in drucker
        ),
    }


def _determined(A: Matrix, pressure: Vector, dependence: str) -> bool:
    """Whether the columns of a law are independent at the readings, by their singular values."""
    levels = np.unique(pressure)
    share = ((pressure - levels[0]) / (levels[-1] - levels[0]))[:, None]
    linear = np.hstack([(1 - share) * A, share * A])
    parts = {"fixed": [A], "linear": [linear], "free": [A[pressure == level] for level in levels]}
    sizes = [(part, np.linalg.norm(part, axis=0)) for part in parts[dependence]]
    return all(
        size.all() and np.linalg.matrix_rank(part / size) == part.shape[1] for part, size in sizes
    )


_CUBIC = (4e6, -6e6, 6e6)
TRUTH = {"braid_diameter": 0.022, "braid_angle": math.radians(65), "deadband_pressure": 30e3,
         "E_1": 4e6, "E_2": -6e6, "E_3": 6e6}  # fmt: skip
NOISE, REPLICATES = 2.0, 200  # N


def muscle_map(diameter: float = 0.022, angle_deg: float = 65, material: Any = None,
               deadband: float = 30e3, compliance: float = 0.0) -> ForceData:  # fmt: skip
    """Noise-free readings of a known muscle at 8 lengths and 5 pressures."""
    braid = famjax.Braid.from_rest(
        diameter=diameter, braid_angle=math.radians(angle_deg), length=0.3
    )
    bladder = famjax.Bladder(0.3, diameter, 0.002, embedded=True)
    law = famjax.PolynomialMaterial(_CUBIC) if material is None else material
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, deadband)
    mounted = famjax.MountedMuscle(muscle, compliance) if compliance else muscle
    L, P = (g.ravel() for g in np.meshgrid(np.linspace(0.3, 0.25, 8), np.linspace(3e5, 7e5, 5)))
    specimen = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
    return ForceData(np.asarray(mounted.force(L, P)), P, L, specimen)


def recovery(_: Case, law: str) -> dict[str, float]:
    """Parameters of three random muscles from noise-free readings."""
    random, worst = np.random.default_rng(0 if law == "polynomial" else 1), 0.0
    for _k in range(3):
        diameter, angle = random.uniform(20.5e-3, 23e-3), random.uniform(62, 68)
        deadband, scale = random.uniform(10e3, 60e3), random.uniform(0.8, 1.2)
        truth = {"braid_diameter": diameter, "braid_angle": math.radians(angle),
                 "deadband_pressure": deadband}  # fmt: skip
        if law == "polynomial":
            E, options, compliance = scale * np.array(_CUBIC), {}, 0.0
            material = famjax.PolynomialMaterial(E)
            truth |= {f"E_{n}": value for n, value in enumerate(E, 1)}
        else:
            shear, exponent, compliance = 1.2e6 * scale, -6.0, 2e-6
            material = famjax.materials.OgdenMaterial([2 * shear / exponent], [exponent])
            truth |= {"shear_modulus": shear, "ogden_exponent": exponent,
                      "series_compliance": compliance}  # fmt: skip
            options = {"law": "ogden", "parameters": RIG}
        data = muscle_map(diameter, angle, material, deadband, compliance)
        result = fitting.identify(data, **options)
        worst = max(worst, *(abs(result.estimate(k).value / v - 1) for k, v in truth.items()))
    return {"largest relative error of a parameter": worst}


def _pulls(data: ForceData, noise: Vector, starts: int) -> list[float]:
    """Errors of the estimates of a noisy map in their standard errors."""
    result = fitting.identify(dataclasses.replace(data, force=data.force + noise), starts=starts)
    return [(result.estimate(k).value - v) / result.estimate(k).stderr for k, v in TRUTH.items()]


def coverage(_: Case) -> dict[str, float]:
    """Two-sided probability, over parameters the least, of so many hits of 200 intervals."""
    data, found = muscle_map(), {}
    noise = np.random.default_rng(11).normal(0, NOISE, (REPLICATES, data.force.size))
    pulls = np.abs([_pulls(data, one, 4) for one in noise])
    for level in (0.68, 0.95):
        reach = stats.t.ppf((1 + level) / 2, data.force.size - len(TRUTH))
        inside = (pulls < reach).sum(axis=0)
        below = stats.binom.cdf(inside, REPLICATES, level)
        above = stats.binom.sf(inside - 1, REPLICATES, level)
        found[f"least probability of the hits of {level:.0%} intervals"] = float(
            np.minimum(1, 2 * np.minimum(below, above)).min()
        )
    return found
