"""The sweep against Clarabel on a fine grid, its file, and its derivatives in the forces."""

import dataclasses
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.boundary.tasks import Store
from fitting import ForceData, InputError, Specimen
from fitting.convex import Status
from fitting.sweeps import Sweep, SweepRow, sweep
from fitting.sweeps.all_forms import FEASIBLE
from fitting.sweeps.design import Design
from fitting.sweeps.fits import solve
from fitting.sweeps.forms import Forms
from fitting.sweeps.linear_model import LinearModel
from fitting.sweeps.readings import arrange
from fitting.sweeps.sweep_files import table_row

OBJECTIVE = 1e-6  # relative; Clarabel's accuracy, and 4000 stations in place of the path
DIFFERENCE = 1e-5  # central differences with a step of 1e-4 N
EXACT = 1e-9  # noise-free data, condition numbers up to 1e4
SPREAD = 0.25  # of a standard deviation from 250 replicates, and of a first-order covariance
REST, PRESSURES, STATIONS = 0.2, np.array([1e5, 2e5, 3e5]), 4000
SOFTENING = np.array([2.5e6, -4.5e6, 2.4e6])  # its tangent falls below zero and rises again


def geometry(diameter: float = 0.022) -> famjax.EstimatedGeometry:
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=1.2, length=REST, thickness=2e-4)
    return famjax.EstimatedGeometry(braid, famjax.Bladder(REST, 0.02, 1.5e-3))


def measured(noise: float, seed: int = 0) -> ForceData:
    """Readings of a muscle whose bladder softens more than is stable."""
    length, pressure = (
        grid.ravel() for grid in np.meshgrid(REST * np.linspace(1, 0.8, 21), PRESSURES)
    )
    muscle = famjax.Muscle(geometry(), famjax.PolynomialMaterial(SOFTENING), 1e4)
    force = np.asarray(muscle.force(length, pressure))
    force = force + noise * np.random.default_rng(seed).normal(size=force.size)
    return ForceData(force, pressure, length, Specimen("softening", REST, 1.5e-3))


DATA = measured(noise=2.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("sweep") / "parts.jsonl"


@pytest.fixture(scope="module")
def swept(folder: Path) -> Sweep:
    return sweep(DATA, geometry(), deadband=1e4, orders=(2, 3), bootstrap=250, resume=folder)


def row(of: Sweep, dependence: str, order: int, constraint: str) -> SweepRow:
    key = (dependence, order, constraint)
    (found,) = (r for r in of.rows if (r.dependence, r.order, r.constraint) == key)
    return found


def unit_forces(length: np.ndarray, pressure: np.ndarray, order: int) -> np.ndarray:
    columns = [
        famjax.Muscle(geometry(), famjax.PolynomialMaterial(E)).bladder_force(length, pressure)
        for E in np.eye(order)
    ]
    return np.stack([np.asarray(column) for column in columns], axis=-1)


def constraint_rows(constraint: str, order: int, pressure: float, end: float) -> np.ndarray:
    """Rows on E_n at one pressure, on a grid that has nothing to do with the sweep's."""
    s = np.linspace(0, 1, STATIONS)
    length = REST + s * (end - REST)
    if constraint == "none":
        return np.zeros((1, order))
    if constraint == "positive":
        return np.eye(order)
    if constraint == "slope":
        at = geometry().dimensions(np.array([REST, end]), pressure)
        largest = max(np.abs(at.hoop_strain).max(), np.abs(at.axial_strain).max())
        return np.arange(1, order + 1) * (s * largest)[:, None] ** np.arange(order)
    columns = [
        famjax.path_modulus(famjax.PolynomialMaterial(E), geometry(), length, pressure)
        for E in np.eye(order)
    ]
    return np.stack([np.asarray(column) for column in columns], axis=-1)


def path_end(pressure: float) -> float:
    at = DATA.pressure == pressure
    shortest = DATA.length[at & DATA.loaded].min()
    slack = DATA.length[at & ~DATA.loaded & (DATA.length < shortest)]
    return float(slack.max(initial=-np.inf)) if slack.size else float(shortest)


@pytest.mark.parametrize("constraint", ["none", "positive", "slope", "drucker"])
@pytest.mark.parametrize("dependence", ["fixed", "linear", "free"])
def test_fits_agree_with_clarabel(
    swept: Sweep, dependence: str, constraint: str, clarabel_objective: Callable[..., float]
) -> None:
    loaded = DATA.loaded
    length, pressure = DATA.length[loaded], DATA.pressure[loaded]
    braid = famjax.Muscle(geometry(), famjax.PolynomialMaterial([0.0]), 1e4)
    target = DATA.force[loaded] - np.asarray(braid.braid_force(length, pressure))
    share = (PRESSURES - PRESSURES[0]) / (PRESSURES[-1] - PRESSURES[0])
    bases = {
        "fixed": np.ones((3, 1)),
        "linear": np.stack([1 - share, share], axis=1),
        "free": np.eye(3),
    }
    basis = bases[dependence]
    for order in (2, 3):
        columns = unit_forces(length, pressure, order)
        of = np.searchsorted(PRESSURES, pressure)
        A = (basis[of][:, :, None] * columns[:, None, :]).reshape(length.size, -1)
        rows = [
            (basis[p][None, :, None] * G[:, None, :]).reshape(len(G), -1)
            for p, P in enumerate(PRESSURES)
            for G in [constraint_rows(constraint, order, P, path_end(P))]
        ]
        G = np.concatenate(rows)
        best = clarabel_objective(A, target, G, np.zeros(len(G)))
        found = row(swept, dependence, order, constraint)
        assert found.status is Status.OPTIMAL
        assert found.objective == pytest.approx(best, rel=OBJECTIVE)
        assert found.kkt_residual < 1e-10
        assert found.duality_gap < 1e-8


def test_nothing_is_violated_between_the_stations(swept: Sweep) -> None:
    stable = [r for r in swept.rows if r.constraint == "drucker"]
    assert all(r.margin > -FEASIBLE * np.abs(r.coefficients).max() for r in stable)
    assert {r.verdict for r in stable} == {"stable"}
    assert row(swept, "fixed", 3, "none").verdict == "not stable"
    assert sum(abs(r.margin) < FEASIBLE * np.abs(r.coefficients).max() for r in stable) >= 2
    for r in swept.rows:
        if r.constraint == "slope":
            for E, P in zip(r.coefficients, PRESSURES, strict=True):
                G = constraint_rows("slope", r.order, float(P), path_end(float(P)))
                assert (G @ E).min() > -FEASIBLE * np.abs(E).max()


def test_scores(swept: Sweep) -> None:
    """Written out for one fit, and the relations between fits."""
    found = row(swept, "linear", 3, "none")
    forces = []
    for E, P in zip(found.coefficients, PRESSURES, strict=True):
        muscle = famjax.Muscle(geometry(), famjax.PolynomialMaterial(E), 1e4)
        at = DATA.loaded & (DATA.pressure == P)
        forces.append(np.asarray(muscle.force(DATA.length[at], P)) - DATA.force[at])
        free, F = float(muscle.free_contraction(P)), DATA.force[at]
        contraction = 1 - DATA.length[at] / REST
        near = F / F.max() <= 0.1
        near = near if near.sum() > 2 else contraction > 0.185
        measured_free = np.polyfit(F[near], contraction[near], 1)[1]
        error = found.free_contraction_error_by_pressure[len(forces) - 1]
        assert error == pytest.approx(free - measured_free, abs=1e-4)  # 129 lengths, linear
    residual = np.concatenate(forces)
    np.testing.assert_allclose(found.rmse_by_pressure, [np.sqrt(np.mean(r**2)) for r in forces])
    assert found.pooled_rmse == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert found.mae == pytest.approx(np.mean([np.abs(r).mean() for r in forces]))
    n, k = residual.size, 7
    deviance = n * np.log(np.mean(residual**2))
    assert found.aicc == pytest.approx(deviance + 2 * k + 2 * k * (k + 1) / (n - k - 1))
    assert found.bic == pytest.approx(deviance + k * np.log(n))
    at_rest = (DATA.length == REST) & DATA.loaded
    blocked = [r[DATA.length[DATA.loaded & (DATA.pressure == P)] == REST][0] for r, P in
               zip(forces, PRESSURES, strict=True)]  # fmt: skip
    assert at_rest.sum() == 3
    np.testing.assert_allclose(found.blocked_error_by_pressure, blocked)
    for r in swept.rows:
        looser = row(swept, r.dependence, r.order, "none")
        assert r.objective >= looser.objective * (1 - 1e-12)
        assert np.isnan(r.cross_validated_rmse) == (r.dependence == "free")
        if r.dependence == "fixed":
            assert r.cross_validated_rmse > r.pooled_rmse


def test_free_contraction_errors_are_averaged_where_there_are_any() -> None:
    """At the lowest pressure the two shortest readings are alike: no line leads to zero force."""
    keep = (DATA.pressure > 1e5) | (DATA.length > 0.91 * REST)
    columns = {name: getattr(DATA, name)[keep] for name in ("force", "pressure", "length")}
    flat = (columns["pressure"] == 1e5) & (columns["length"] < 0.935 * REST)
    columns["force"][flat] = columns["force"][flat].mean()
    data = ForceData(**columns, specimen=DATA.specimen)
    (found,) = sweep(
        data, geometry(), deadband=1e4, orders=(2,), dependences=("fixed",), constraints=("none",)
    ).rows
    errors = found.free_contraction_error_by_pressure
    np.testing.assert_array_equal(np.isnan(errors), [True, False, False])
    assert found.free_contraction_error == pytest.approx(np.abs(errors[1:]).mean(), rel=1e-14)
    assert table_row(found, "us")["n_free_contractions"] == 2


def test_a_sweep_is_printed_as_a_line(swept: Sweep) -> None:
    assert (
        repr(swept)
        == "Sweep(24 fits of softening, 24 of them solved, sum_of_squares, 250 replicates)"
    )


def test_replicates_scatter_as_the_covariance_says(swept: Sweep) -> None:
    found = row(swept, "fixed", 2, "none")
    loaded = DATA.loaded
    A = unit_forces(DATA.length[loaded], DATA.pressure[loaded], 2)
    expected = found.pooled_rmse * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    np.testing.assert_allclose(found.coefficients_std[0], expected, rtol=2 * SPREAD)
    held = row(swept, "fixed", 3, "positive")
    at_zero = held.coefficients[0] < 1e-6 * held.coefficients.max()
    assert at_zero.any()
    assert (held.coefficients_std[0][at_zero] < 1e-6 * held.coefficients.max()).all()


def test_a_stopped_sweep_goes_on_to_the_same_bytes(
    swept: Sweep, folder: Path, tmp_path: Path
) -> None:
    whole = folder.read_bytes()
    assert len(whole.splitlines()) == 3
    cut = tmp_path / "cut.jsonl"
    cut.write_bytes(whole[:-2000])
    options = {"deadband": 1e4, "orders": (2, 3), "bootstrap": 250}
    parts: list[tuple[int, int]] = []
    with pytest.warns(UserWarning, match=r"line 3 of .* is damaged; its part is done again"):
        again = sweep(
            DATA, geometry(), **options, resume=cut, progress=lambda *done: parts.append(done)
        )
    assert cut.read_bytes() == whole
    assert parts == [(1, 2), (2, 2)]
    assert [r.objective for r in again.rows] == [r.objective for r in swept.rows]
    json.dumps([r.as_dict() for r in swept.rows])
    with pytest.raises(InputError, match=r"a sweep of other data .*settings.geometry was"):
        sweep(DATA, geometry(0.0221), **options, resume=cut)
    cut.write_text("{]\n")
    with pytest.raises(InputError, match=r"cut.jsonl is damaged"):
        sweep(DATA, geometry(), **options, resume=cut)


@pytest.mark.slow
@pytest.mark.timeout(200)
def test_every_executor_finds_the_same_bits() -> None:
    options = {"deadband": 1e4, "orders": (2, 3), "bootstrap": 250}
    maps = [DATA, dataclasses.replace(DATA, force=1.01 * DATA.force)]
    here = sweep(maps, geometry(), **options)
    assert np.isfinite(here.rows[0].coefficients_std).all()
    with ThreadPoolExecutor(2) as threads:
        for executor in (threads, 2):
            found = sweep(maps, geometry(), **options, executor=executor)
            for one, other in zip(found.rows, here.rows, strict=True):
                assert json.dumps(one.as_dict()) == json.dumps(other.as_dict())


@pytest.mark.slow
def test_derivatives_in_the_forces(swept: Sweep) -> None:
    """Of coefficients held by the Drucker constraint between stations."""
    readings = arrange(DATA, REST, 3)
    model = LinearModel(geometry(), 1e4, 3, readings.pressure, readings.path_end)
    of = jax.tree.map(jnp.asarray, Design.of(model, readings))
    forms = Forms((3,), ("free",), ("drucker",))
    direction = 10 * jnp.asarray(np.random.default_rng(0).normal(size=readings.force.shape))

    def coefficients(step: jax.Array) -> jax.Array:
        moved = dataclasses.replace(of, target=of.target + step * direction)
        found, _ = solve(moved, forms, "sum_of_squares")
        return jnp.append(found.coefficients[0, 0, 0, 2], found.active[0, 0, 0])

    both = jax.jit(lambda step: jax.jvp(coefficients, (step,), (jnp.ones_like(step),)))
    value, slope = both(jnp.array(0.0))
    assert int(value[-1]) > 0
    np.testing.assert_allclose(
        value[:-1], row(swept, "free", 3, "drucker").coefficients[2], rtol=EXACT
    )
    central = (both(jnp.array(1e-5))[0] - both(jnp.array(-1e-5))[0]) / 2e-5
    size = float(jnp.max(jnp.abs(central)))
    np.testing.assert_allclose(slope[:-1], central[:-1], atol=DIFFERENCE * size, rtol=0)


def test_another_map_of_the_same_shape_is_not_compiled_again(
    swept: Sweep, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("compiled again")

    monkeypatch.setattr("fitting.sweeps.linear_model.assembled", never)
    monkeypatch.setattr("fitting.sweeps.replicates.replicated", never)
    other = dataclasses.replace(DATA, force=1.01 * DATA.force)
    found = sweep(other, geometry(), deadband=2e4, orders=(2, 3), bootstrap=250)
    assert len(found.rows) == len(swept.rows)
    assert not np.array_equal(found.rows[0].coefficients, swept.rows[0].coefficients)


def test_bad_options_are_refused() -> None:
    with pytest.raises(InputError, match="orders must be a whole number 1 to 4"):
        sweep(DATA, geometry(), orders=(5,))
    with pytest.raises(InputError, match="constraints: known are"):
        sweep(DATA, geometry(), constraints=("convex",))
    with pytest.raises(InputError, match="objective: known are"):
        sweep(DATA, geometry(), objective="rmse")
    with pytest.raises(InputError, match="replicates need the objective"):
        sweep(DATA, geometry(), objective="huber", bootstrap=5)
    with pytest.raises(InputError, match="one geometry for all"):
        sweep(DATA, [geometry(), geometry()])
    longer = dataclasses.replace(DATA, length=DATA.length + 0.1)
    with pytest.raises(InputError, match="no reading is shorter than the rest length"):
        sweep(longer, geometry())


def test_pictures_and_table(swept: Sweep) -> None:
    from fitting.sweeps.sweep_files import table_row
    from fitting.sweeps.sweep_plot import plot_curves, plot_errors

    errors = plot_errors(swept)
    assert len(errors.axes) == 4
    assert all(len(axes.lines) == 3 * 4 for axes in errors.axes)  # forms, constraints
    for axes in errors.axes:
        assert axes.get_ylim()[1] > max(np.nanmax(line.get_ydata()) for line in axes.lines)
    curves = plot_curves(swept, list(swept.rows[:2]), "us")
    assert len(curves.axes) == 2
    lines, readings = curves.axes[0].collections
    levels = swept.pressures[0].size
    assert len(lines.get_paths()) == levels
    assert len(readings.get_offsets()) == DATA.loaded.sum()
    assert len(curves.axes[0].get_legend().get_texts()) == min(levels, 8)
    line = table_row(swept.rows[-1], "us")
    assert line["left_out_rmse_lbf"] is None
    assert line["rmse_lbf"] == pytest.approx(swept.rows[-1].rmse / 4.4482216152605)


def test_the_command_writes_files_and_goes_on(
    monkeypatch: pytest.MonkeyPatch, swept: Sweep, tmp_path: Path
) -> None:
    from fitting.sweeps import sweep_files

    calls = []

    def recorded(*given: object, **options: object) -> Sweep:
        calls.append((given, options))
        return swept

    monkeypatch.setattr(sweep_files, "sweep", recorded)
    document, paths = sweep_files.sweep_command(
        [DATA], geometry(), deadband=1e4, output=tmp_path / "new"
    )
    assert [path.name for path in paths] == ["sweep.json", "errors-1.png", "curves-1.png"]
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert len(document["rows"]) == len(swept.rows)
    (given, options), *_ = calls
    assert options["resume"] is None  # the fits alone take less time than what keeps them
    rows = json.loads(paths[0].read_text())["rows"]
    assert rows[0]["coefficients"] == swept.rows[0].coefficients.tolist()
    assert rows[-1]["cross_validated_rmse"] is None
    sweep_files.sweep_command([DATA], geometry(), bootstrap=3, output=tmp_path / "new")
    assert calls[1][1]["resume"] == tmp_path / "new" / "replicates.jsonl"
    assert options["deadband"] == 1e4
    assert given[0] == [DATA]


def test_only_what_was_chosen_is_computed(swept: Sweep, tmp_path: Path) -> None:
    chosen = {"orders": (3,), "dependences": ("free", "fixed"), "constraints": ("drucker",)}
    some = tmp_path / "some.jsonl"
    found = sweep(DATA, geometry(), deadband=1e4, **chosen, resume=some)
    assert [(r.dependence, r.order, r.constraint) for r in found.rows] == [
        ("fixed", 3, "drucker"), ("free", 3, "drucker"),
    ]  # fmt: skip
    for r in found.rows:
        whole = row(swept, r.dependence, r.order, r.constraint).as_dict() | {
            "coefficients_std": r.coefficients_std.tolist()
        }
        assert json.dumps(r.as_dict()) == json.dumps(whole)
    settings = json.loads(some.read_text().partition("\n")[0])["settings"]
    (part,) = Store(some, "sweep", settings, 1)
    assert part["fits.objective"].shape == (2, 1, 1)
    with pytest.raises(InputError, match="other settings"):
        sweep(DATA, geometry(), deadband=1e4, **(chosen | {"constraints": ("slope",)}), resume=some)
