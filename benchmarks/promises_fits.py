"""Promises of the identification: errors, certificates, truth recovered, intervals that cover.

Every function takes any force map, through public names alone.
"""

import dataclasses
import importlib
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import goals
import numpy as np
from jaxtyping import Float
from promise import Case, Cost, Direction, Promise
from scipy import sparse, stats

import famjax
import fitting
from fitting import ForceData, Identification, Parameter, Specimen

clarabel: Any = importlib.import_module("clarabel")  # its compiled module names no types

A1, A2 = "DMSP-20-300", "DMSP-10-250"
LOADED = "loaded readings, F > 0"
CONSTRAINTS = ("none", "positive", "slope", "drucker")
_STATIONS = 4000
_REPLICATES, _NOISE = 200, 2.0  # N


def fit(case: Case, **options: Any) -> Identification:
    """The identification of the case's map, made once for the same options."""
    return case.once(("fit", repr(options)), lambda: fitting.identify(case.map, **options))


def rmse(**options: Any) -> Callable[[Case], float]:
    """RMSE [N] over the loaded readings."""
    return lambda case: fit(case, **options).errors.rmse


def left_out(groups: str, options: dict[str, Any]) -> Callable[[Case], float]:
    """RMSE [N] on each pressure while it was left out, or on each interior length."""

    def measure(case: Case) -> float:
        result = fit(case, **options)
        found = case.once(
            (groups, repr(options)), lambda: fitting.validate(result, groups, starts=12)
        )
        return found.rmse if groups == "pressure" else found.interior_rmse

    return measure


def certificate(name: str, **options: Any) -> Callable[[Case], float]:
    """A member of the certificate; the margin in parts of the largest coefficient."""

    def measure(case: Case) -> float:
        result = fit(case, **options)
        value = getattr(result.certificate, name)
        return (
            value / float(np.abs(result.coefficients).max()) if name.endswith("margin") else value
        )

    return measure


def from_independent_optimum(case: Case) -> float:
    """Largest relative difference of an objective from Clarabel's, over orders and constraints.

    Of orders up to 4 those that the map determines: others are refused.
    """
    data, off = case.map, []
    strained = np.unique(data.lengths.level[data.strained]).size
    for order in range(1, min(strained, 4) + 1):
        for constraint in CONSTRAINTS:
            result = fit(case, order=order, constraint=constraint)
            ours = 0.5 * float(np.sum(result.residuals**2))
            off.append(abs(ours / _clarabel(result, order, constraint) - 1))
    return max(off)


def _clarabel(result: Identification, order: int, constraint: str) -> float:
    """Clarabel's objective at the geometry of a result, constraint on its own grid of the path."""
    geometry, deadband = result.muscle.geometry, result.muscle.deadband_pressure
    data, at = result.data, result.data.loaded
    length, pressure, shortest = data.length[at], data.pressure[at], float(data.length.min())

    def force(E: Float[np.ndarray, " n"]) -> Float[np.ndarray, " k"]:
        muscle = famjax.Muscle(geometry, famjax.PolynomialMaterial(E), deadband)
        return np.asarray(muscle.force(length, pressure))

    rest = force(np.zeros(order))
    A = np.stack([force(1e6 * one) - rest for one in np.eye(order)], axis=1)
    path = np.linspace(float(geometry.rest_length), shortest, _STATIONS)
    if constraint == "none":
        G = np.zeros((0, order))
    elif constraint == "positive":
        G = np.eye(order)
    elif constraint == "slope":
        ends = geometry.dimensions(np.array([path[0], shortest]), float(pressure.max()))
        largest = max(float(np.abs(ends.hoop_strain).max()), float(np.abs(ends.axial_strain).max()))
        powers = np.arange(1, order + 1)
        G = powers * np.linspace(0, largest, _STATIONS)[:, None] ** (powers - 1)
    else:
        laws = [famjax.PolynomialMaterial(one) for one in np.eye(order)]
        columns = [famjax.path_modulus(law, geometry, path, float(pressure.max())) for law in laws]
        G = np.stack([np.asarray(column) for column in columns], axis=1)
    return _least_squares(A, data.force[at] - rest, G)


def _least_squares(
    A: Float[np.ndarray, "k n"], b: Float[np.ndarray, " k"], G: Float[np.ndarray, "m n"]
) -> float:
    """Minimum of 1/2 |A x - b|^2 under G x >= 0 by Clarabel, all of order one inside."""
    columns, size = np.linalg.norm(A, axis=0), float(np.linalg.norm(b))
    A, b, G = A / columns, b / size, G / columns
    rows = np.linalg.norm(G, axis=1)
    G = G[rows > 0] / rows[rows > 0, None]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    cones = [clarabel.NonnegativeConeT(len(G))] if len(G) else []
    found = clarabel.DefaultSolver(
        sparse.csc_matrix(np.triu(A.T @ A)), -A.T @ b, sparse.csc_matrix(-G), np.zeros(len(G)),
        cones, settings,
    ).solve()  # fmt: skip
    return 0.5 * float(np.sum((A @ np.array(found.x) - b) ** 2)) * size**2


def units_of_the_file(case: Case) -> float:
    """Largest relative difference of an estimate between a file in psi, in, lbf and kPa, mm, N."""
    units = {"psi,in,lbf": (6894.757293168361, 0.0254, 4.4482216152605), "kPa,mm,N": (1e3, 1e-3, 1)}
    data, found = case.map, []
    with tempfile.TemporaryDirectory() as folder:
        for names, sizes in units.items():
            P, L, F = names.split(",")
            columns = (data.pressure, data.length, data.force)
            rows = np.stack([one / size for one, size in zip(columns, sizes, strict=True)], axis=1)
            path = Path(folder) / f"{P}.csv"
            lines = [f"pressure_{P},length_{L},force_{F}"]
            lines += [",".join(map(repr, row)) for row in rows.tolist()]
            path.write_text("\n".join([*_specimen(data.specimen), *lines]) + "\n")
            found.append(fitting.identify(fitting.read_csv(path)))
    values = [np.array([e.value for e in one.estimates]) for one in found]
    return float(np.abs(values[0] / values[1] - 1).max())


def _specimen(of: Specimen) -> list[str]:
    lines = [f"# specimen: name = {of.name}", f"# specimen: embedded = {str(of.embedded).lower()}"]
    sizes = ("rest_length", "wall_thickness", "nominal_diameter", "bladder_diameter",
             "braid_thickness")  # fmt: skip
    known = {name: getattr(of, name) for name in sizes}
    return lines + [f"# specimen: {k}_m = {v!r}" for k, v in known.items() if v is not None]


def swept(case: Case) -> fitting.sweeps.Sweep:
    """The 48 fits at the geometry that the standard fit finds."""
    result = fit(case)
    deadband = float(result.muscle.deadband_pressure)
    return case.once(
        "sweep", lambda: fitting.sweep(case.map, result.muscle.geometry, deadband=deadband)
    )


def unsolved(case: Case) -> float:
    """Of the fits that the readings determine, how many are not certified optimal."""
    found = swept(case)
    return sum(
        row.status is not fitting.convex.Status.OPTIMAL
        for row in found.rows
        if _determined(found, row)
    )


def refused(case: Case) -> float:
    """Of the fits that the readings do not determine, how many are fitted all the same."""
    found = swept(case)
    deficient = fitting.convex.Status.RANK_DEFICIENT
    return sum(row.status is not deficient for row in found.rows if not _determined(found, row))


def _determined(found: fitting.sweeps.Sweep, row: fitting.sweeps.SweepRow) -> bool:
    """Whether the columns of a law are independent at the readings, by their singular values."""
    (data,), (levels,), (model,) = found.data, found.pressures, found.models
    at = data.loaded
    pressure = data.pressures.level[at]
    columns = model.columns(data.length[at], pressure)[1][:, : row.order]
    if row.dependence == "free":
        parts = [columns[pressure == level] for level in levels]
    else:
        share = (pressure - levels[0]) / (levels[-1] - levels[0])
        linear = np.hstack([(1 - share)[:, None] * columns, share[:, None] * columns])
        parts = [columns if row.dependence == "fixed" else linear]
    size = [np.linalg.norm(part, axis=0) for part in parts]
    return all(
        one.all() and np.linalg.matrix_rank(part / one) == part.shape[1]
        for part, one in zip(parts, size, strict=True)
    )


def sweep_gap(case: Case) -> float:
    """Largest duality gap of the 48, relative to the objective: a bound of the distance from it."""
    return max(row.duality_gap for row in swept(case).rows)


def sweep_violation(case: Case) -> float:
    """Largest violation of Drucker's constraint anywhere on a path, per largest coefficient."""
    rows = [row for row in swept(case).rows if row.constraint == "drucker"]
    return max(-row.margin / float(np.abs(row.coefficients).max()) for row in rows)


_KNOWN = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)


def muscle_map(diameter: float, angle_deg: float, material: Any, deadband: float = 30e3,
               compliance: float = 0.0) -> ForceData:  # fmt: skip
    """Noise-free readings of a known muscle at 8 lengths and 5 pressures."""
    braid = famjax.Braid.from_rest(
        diameter=diameter, braid_angle=math.radians(angle_deg), length=0.3
    )
    bladder = famjax.Bladder(0.3, diameter, 0.002, embedded=True)
    muscle = famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), material, deadband)
    model = famjax.MountedMuscle(muscle, compliance) if compliance else muscle
    L, P = (g.ravel() for g in np.meshgrid(np.linspace(0.3, 0.25, 8), np.linspace(3e5, 7e5, 5)))
    return ForceData(np.asarray(model.force(L, P)), P, L, _KNOWN)


def recovered(seed: int, law: str) -> Callable[[Case], float]:
    """Largest relative error of a parameter of random muscles from noise-free readings."""

    def measure(case: Case) -> float:
        del case
        random, worst = np.random.default_rng(seed), 0.0
        for _ in range(3):
            diameter, angle = random.uniform(20.5e-3, 23e-3), random.uniform(62, 68)
            deadband = random.uniform(10e3, 60e3)
            scale = random.uniform(0.8, 1.2)
            truth = {"braid_diameter": diameter, "braid_angle": math.radians(angle),
                     "deadband_pressure": deadband}  # fmt: skip
            options: dict[str, Any] = {}
            compliance = 0.0
            if law == "polynomial":
                E = scale * np.array([4e6, -6e6, 6e6])
                material = famjax.PolynomialMaterial(E)
                truth |= {f"E_{n}": value for n, value in enumerate(E, 1)}
            else:
                shear, exponent, compliance = 1.2e6 * scale, -6.0, 2e-6
                material = famjax.materials.OgdenMaterial([2 * shear / exponent], [exponent])
                truth |= {"shear_modulus": shear, "ogden_exponent": exponent,
                          "series_compliance": compliance}  # fmt: skip
                options = {"law": "ogden", "parameters": {"series_compliance": Parameter()}}
            data = muscle_map(diameter, angle, material, deadband, compliance)
            result = fitting.identify(data, **options)
            worst = max(worst, *(abs(result.estimate(k).value / v - 1) for k, v in truth.items()))
        return worst

    return measure


def _replicates(case: Case) -> tuple[Float[np.ndarray, "r k"], Float[np.ndarray, " k"], int]:
    """Pulls of the estimates of noisy replicates, values of the truth, degrees of freedom."""

    def compute() -> tuple[np.ndarray, np.ndarray, int]:
        clean = muscle_map(0.022, 65, famjax.PolynomialMaterial([4e6, -6e6, 6e6]))
        truth = np.array([0.022, math.radians(65), 30e3, 4e6, -6e6, 6e6])
        names = ("braid_diameter", "braid_angle", "deadband_pressure", "E_1", "E_2", "E_3")
        noise = np.random.default_rng(11).normal(0, _NOISE, (_REPLICATES, clean.force.size))
        pulls = []
        for one in noise:
            result = fitting.identify(dataclasses.replace(clean, force=clean.force + one), starts=4)
            found = [result.estimate(name) for name in names]
            pulls.append([(e.value - t) / e.stderr for e, t in zip(found, truth, strict=True)])
        return np.array(pulls), truth, clean.force.size - truth.size

    return case.once("replicates", compute)


def coverage(level: float) -> Callable[[Case], float]:
    """The least two-sided probability, over parameters, of so many intervals hit as were."""

    def measure(case: Case) -> float:
        pulls, _, freedom = _replicates(case)
        inside = (np.abs(pulls) < stats.t.ppf((1 + level) / 2, freedom)).sum(axis=0)
        tails = np.minimum(
            stats.binom.cdf(inside, _REPLICATES, level),
            stats.binom.sf(inside - 1, _REPLICATES, level),
        )
        return float(np.minimum(1, 2 * tails).min())

    return measure


def noisy_pull(case: Case) -> float:
    """Largest error of a parameter in standard errors, one noisy map."""
    law = famjax.PolynomialMaterial([4e6, -6e6, 6e6])
    data = muscle_map(0.022, 65, law)
    noise = np.random.default_rng(5).normal(0, _NOISE, data.force.size)
    result = case.once(
        "noisy",
        lambda: fitting.identify(dataclasses.replace(data, force=data.force + noise)),
    )
    truth = {"braid_diameter": 0.022, "braid_angle": math.radians(65), "deadband_pressure": 30e3,
             "E_1": 4e6, "E_2": -6e6, "E_3": 6e6}  # fmt: skip
    found = {name: result.estimate(name) for name in truth}
    return max(abs(found[k].value - v) / found[k].stderr for k, v in truth.items())


def ridge_named(case: Case) -> float:
    """1 where two lengths alone leave rest length and end factor open, and the report says so."""
    del case
    law = famjax.PolynomialMaterial([4e6, -6e6, 6e6])
    data = muscle_map(0.022, 65, law)
    two = np.isin(data.length, np.unique(data.length)[-2:])
    part = dataclasses.replace(
        data, force=data.force[two], pressure=data.pressure[two], length=data.length[two]
    )
    table = {"rest_length": Parameter(min=297.0, max=303.0, unit="mm"), "end_factor": Parameter()}
    warned = " ".join(fitting.identify(part, order=1, parameters=table, starts=4).warnings)
    return float("Ridge" in warned or "cannot be told apart" in warned)


def _of(issue: int, name: str, measure: Callable[[Case], float], command: str, data: str,
        statistic: str, limit: float, **more: Any) -> Promise:  # fmt: skip
    return Promise(issue, name, measure, command, data, LOADED, statistic, limit, seed=0, **more)


def _physical_and_open() -> list[Promise]:
    found = []
    for data, physical, open_box in ((A1, 7.6, 4.6), (A2, 1.9, 1.8)):
        name, command = "RMSE, order 3, Drucker", "fitting.identify(data)"
        own: dict[str, Any] = {"of_its_data": True, "figure": True, "cost": "quick"}
        found += [
            _of(2, f"{name}, physical box", rmse(), command, data, "RMSE [N]", physical, **own),
            _of(2, f"{name}, open box", rmse(box="open"), 'fitting.identify(data, box="open")',
                data, "RMSE [N]", open_box, **own),
        ]  # fmt: skip
    return found


def _certificates() -> list[Promise]:
    found = []
    for data in (A1, A2):
        for name, statistic, limit in (
            ("kkt_residual", "KKT residual, relative", 1e-9),
            ("duality_gap", "duality gap, relative", 1e-9),
            ("gradient_residual", "gradient residual of the geometry", 1e-6),
        ):
            found.append(_of(2, f"certificate, {name}", certificate(name),
                             "fitting.identify(data)", data, statistic, limit, cost="quick"))  # fmt: skip
        found.append(_of(2, "certificate, stability_margin", certificate("stability_margin"),
                         "fitting.identify(data)", data, "margin / largest coefficient", -1e-9,
                         direction="at least", cost="quick"))  # fmt: skip
    return found


def _goal(place: int, kinds: tuple[str, ...]) -> list[Promise]:
    """The limits of one of `goals.GOALS`."""
    goal = goals.GOALS[place]
    call = f"python benchmarks/goals.py: {goal.what}"
    found = []
    for kind in kinds:
        limit, cost = getattr(goal, kind), "quick" if kind == "rmse" else "minutes"
        measures = {
            "rmse": rmse(**goal.options),
            "lopo": left_out("pressure", goal.options),
            "lolo_interior": left_out("length", goal.options),
        }
        words = {"rmse": "RMSE [N]", "lopo": "RMSE [N], one pressure out",
                 "lolo_interior": "RMSE [N], one interior length out"}  # fmt: skip
        found.append(_of(4, f"{kind}, {goal.what}", measures[kind], call, goals.MUSCLES[goal.data],
                         words[kind], limit, of_its_data=True, figure=True, cost=cost))  # fmt: skip
    return found


def _ramps() -> list[Promise]:
    """Limits on maps that are no part of the repository: `--data 'bpa10 10cm=MAP.csv'`."""

    def plain(options: dict[str, Any]) -> Callable[[Case], float]:
        def measure(case: Case) -> float:
            data = dataclasses.replace(case.map, force_std=None)
            return case.once(
                ("plain", repr(options)), lambda: fitting.identify(data, **options)
            ).errors.rmse

        return measure

    return [
        _of(4, f"rmse, {goal.what}", plain(goal.options), "python benchmarks/goals.py --ramps",
            goal.data, "RMSE [N], each reading counted the same", goal.rmse, of_its_data=True,
            figure=True)
        for goal in goals.RAMPS[:2]
    ]  # fmt: skip


def _synthetic() -> list[Promise]:
    cases: list[tuple[int, str, Callable[[Case], float], str, float, Direction, int, Cost]] = [
        (4, "noise-free recovery, polynomial", recovered(0, "polynomial"),
         "largest relative error of a parameter, 3 random muscles", 1e-6, "at most", 0, "quick"),
        (4, "noise-free recovery, Ogden on a compliant rig", recovered(1, "ogden"),
         "largest relative error of a parameter, 3 random muscles", 1e-6, "at most", 1, "minutes"),
        (4, "noisy recovery", noisy_pull, "largest error in standard errors", 3, "at most", 5,
         "quick"),
        (4, "coverage, 68 %", coverage(0.68), "least binomial probability of 200 replicates", 1e-3,
         "at least", 11, "long"),
        (4, "coverage, 95 %", coverage(0.95), "least binomial probability of 200 replicates", 1e-3,
         "at least", 11, "long"),
        (4, "a ridge is named", ridge_named, "1 where it is", 1, "at least", 0, "quick"),
    ]  # fmt: skip
    return [
        Promise(issue, name, measure, "fitting.identify(data)", "synthetic muscles", "all readings",
                statistic, limit, direction, seed, cost)
        for issue, name, measure, statistic, limit, direction, seed, cost in cases
    ]  # fmt: skip


FITS: tuple[Promise, ...] = (
    *_physical_and_open(),
    *_certificates(),
    *(
        _of(2, "optimum of an independent solver", from_independent_optimum,
            "fitting.identify(data, order=, constraint=) and Clarabel at its geometry", data,
            "relative difference of the objective, orders that are determined x 4 constraints", 1e-6)
        for data in (A1, A2)
    ),
    _of(2, "units of the file", units_of_the_file, "fitting.identify(fitting.read_csv(file))", A1,
        "relative difference of an estimate, us and metric file", 1e-6),
    *_goal(0, ("rmse", "lopo", "lolo_interior")),
    *_goal(2, ("rmse", "lopo", "lolo_interior")),
    *(promise for place in (5, 6, 7, 8) for promise in _goal(place, ("rmse",))),
    *_ramps(),
    *(
        _of(4, name, measure, "fitting.sweep(data, geometry)", data, statistic, limit)
        for data in (A1, A2)
        for name, measure, statistic, limit in (
            ("48 fits, none unsolved that is determined", unsolved, "fits not certified", 0.0),
            ("48 fits, none made up", refused, "fits of columns that are not independent", 0.0),
            ("48 fits, distance from the optimum", sweep_gap, "largest relative duality gap", 1e-9),
            ("48 fits, feasible between stations", sweep_violation,
             "largest violation / largest coefficient", 1e-9),
        )
    ),
    *_synthetic(),
)  # fmt: skip
"""Issues 2 and 4."""
