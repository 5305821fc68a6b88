"""Test whether pressure-independent E_n suffice: fit each geometry to muscles with a known truth."""

import dataclasses
from collections.abc import Iterator, Mapping
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from beside_print import printed
from jaxtyping import Array, Bool, Float
from specimen import (
    GEOMETRIES,
    PRESSURES,
    bladder,
    elastic_braid,
    elliptic_ends,
    four_geometries,
    inelastic_braid,
)
from twin import Twin

import famjax
import fitting
from famjax import units
from famjax.app import simulate
from famjax.braids import diameter_from_length
from famjax.compile_options import quick_jit
from famjax.geometries import AbstractGeometry
from famjax.measured import AverageDiameterGeometry
from famjax.surfaces import SampledSurface
from famjax.terms import AbstractForceTerm, BladderWall, PressurisedBraid, VirtualWork
from rig.control import Control
from rig.plan import Isobaric, PlanFile

ORDER = 3
"""Order of the law chosen in the work."""
FORMS = ("constant", "linear", "free")
"""Pressure dependence of the E_n; free: a value at each tested pressure, linear in between."""
WORK = "measured, virtual work"
RUBBER = famjax.materials.MooneyRivlinMaterial(25.0 * units.PSI, 15.0 * units.PSI)
"""A non-polynomial law, as stiff as the latex in chapter 6 at its largest strain."""

Model = tuple[AbstractGeometry, PressurisedBraid | VirtualWork]
"""Geometry, and force term due to the pressure."""


@dataclasses.dataclass(frozen=True)
class Truth:
    """A muscle to fit: name, force map and models, in SI units."""

    name: str
    data: fitting.ForceData
    models: dict[str, Model]


@dataclasses.dataclass(frozen=True)
class Trial:
    """One model of one muscle with one pressure dependence; errors are relative to the largest force.

    Attributes:
        truth, model, deadband, form: description of the fit; the deadband is identified or held at zero.
        rmse: RMSE of the fit; nan if the readings do not determine the law.
        left_out: held-out RMSE over all pressures except the lowest and the highest.
        modulus: smallest modulus along the paths [Pa] for a constant law; stable (Drucker) if >= 0.
    """

    truth: str
    model: str
    deadband: bool
    form: str
    rmse: float
    left_out: float
    modulus: float


def truths(twin: Twin) -> Iterator[Truth]:
    """Yield the twin as measured, three more complex muscles on the simulated rig, and the work's muscle.

    The complex muscles have the work's braid, with elastic threads. Their models use the true shape, as
    photographs would show it; the cylinders use the printed braid.
    """
    yield Truth("twin", twin.data, models(twin.geometries()))
    printed_shapes: dict[str, AbstractGeometry] = dict(
        zip(GEOMETRIES, four_geometries(units.INCH, units.PSI), strict=True)
    )
    cubic = famjax.PolynomialMaterial(jnp.array(twin.muscle.coefficients))
    for name, shapes, law, pull, friction in (
        ("elastic braid", printed_shapes, cubic, PressurisedBraid(0.0), 0.01),
        ("elastic braid, deadband, friction, other rubber", printed_shapes, RUBBER,
         PressurisedBraid(8e3), 0.03),
        ("the same with elliptic ends and virtual work", with_ends(), RUBBER,
         VirtualWork(8e3, at_thread_length=True), 0.03),
    ):  # fmt: skip
        muscle = famjax.Muscle(shapes["measured"], BladderWall(law) + pull)
        folder = twin.folder / "richer" / name.replace(", ", "-").replace(" ", "-")
        yield Truth(name, simulated(muscle, friction, folder), models(shapes))
    yield Truth("the work's own muscle, as printed", ends_of_isobars(), models(printed_shapes))


def models(shapes: Mapping[str, AbstractGeometry]) -> dict[str, Model]:
    """Return the four geometries with Gaylord's force, and the measured one with virtual work."""
    found: dict[str, Model] = {name: (one, PressurisedBraid(0.0)) for name, one in shapes.items()}
    return {**found, WORK: (shapes["measured"], VirtualWork(0.0))}


def with_ends() -> dict[str, AbstractGeometry]:
    """Return the geometries of a muscle with elliptic ends, whose middle follows the elastic braid."""
    of, tube = printed()["specimen"], bladder(units.INCH)
    rigid = inelastic_braid(units.INCH)
    braid = elastic_braid(inch=units.INCH, psi=units.PSI)
    end = of["braid_resting_diameter_in"] * units.INCH
    lengths = tube.rest_length * (1 - np.linspace(0, 0.35, 29))
    pressures, x = np.array([0.0, 100 * units.PSI]), np.linspace(0, 1, 201)
    at = lengths[:, None], pressures[:, None, None]
    middle = diameter_from_length(at[0], braid.thread_length(*at), braid.turns)
    surface = SampledSurface(
        lengths=lengths,
        pressures=pressures,
        diameters=elliptic_ends(x, at[0], middle, end, 1.1 * units.INCH, 1.0),
        braid=braid,
    )
    shapes = (
        famjax.EstimatedGeometry(rigid, tube),
        famjax.EstimatedGeometry(braid, tube),
        AverageDiameterGeometry(surface, tube),
        famjax.MeasuredGeometry(surface, tube),
    )
    return dict(zip(GEOMETRIES, shapes, strict=True))


def simulated(muscle: famjax.Muscle, friction: float, folder: Path) -> fitting.ForceData:
    """Measure the force map of a muscle on the simulated rig, and keep the result in a folder."""
    path = folder / "dataset.csv"
    if not path.exists():
        rest = float(muscle.geometry.rest_length)
        plan = Isobaric(
            tuple(P * units.PSI for P in PRESSURES), 1, 0.345 * rest, 0.1 * units.INCH, settle=6.0
        )
        test = PlanFile(plan, "air", 115 * units.PSI, Control.per_psi(4, 2))
        wall = {
            "name": folder.name,
            "wall_thickness_in": printed()["specimen"]["bladder_thickness_in"],
        }
        simulate(test, folder, muscle=muscle, friction=friction, specimen=wall)
    return fitting.read_csv(path)


def ends_of_isobars() -> fitting.ForceData:
    """Return the work's blocked forces and free contractions, the only printed values of its isobars.

    A reading of zero force counts as slack, so free contraction has a force of 0.01 lbf.
    """
    tested, tube = printed()["tested"], bladder(units.INCH)
    free = float(tube.rest_length) * (1 - np.array(tested["free_contraction"]))
    P = np.array(tested["pressure_psi"], float) * units.PSI
    return fitting.ForceData(
        force=np.array([*tested["blocked_force_lbf"], *[0.01] * P.size]) * units.LBF,
        pressure=np.concatenate([P, P]),
        length=np.concatenate([np.full(P.size, float(tube.rest_length)), free]),
        specimen=fitting.Specimen(
            "the work's", float(tube.rest_length), float(tube.rest_thickness)
        ),
        source="tables 6.11 and 6.12",
    )


def trials(truth: Truth) -> Iterator[Trial]:
    """Fit every model of a muscle in every form, with the deadband held at zero and identified."""
    for name, model in truth.models.items():
        system = System.of(truth.data, model)
        for deadband in (False, True):
            for form in FORMS:
                rmse, left_out, law = system.judged(form, deadband=deadband)
                modulus = np.nan if form != "constant" else least_modulus(truth.data, model, law)
                yield Trial(truth.name, name, deadband, form, rmse, left_out, modulus)


_SIZE = np.array([1e6] * ORDER + [1e4])  # Pa, scales of the E_n and the deadband
_PADDED = 512


@dataclasses.dataclass(frozen=True)
class System:
    """The force of a model at the readings, F = force + columns (E_1, E_2, E_3, P_d).

    The force is linear in the E_n and, for both pressure terms, also in the deadband. A fit is therefore
    a linear least-squares problem, and leaving out a pressure adds little work. `fitting.identify`
    returns the same result with a certificate, and can also enforce stability and identify the geometry.
    """

    data: fitting.ForceData
    force: Float[np.ndarray, " n"]
    columns: Float[np.ndarray, "n unknowns"]

    @classmethod
    def of(cls, data: fitting.ForceData, model: Model) -> "System":
        """Evaluate the model at the readings whose lengths the geometry covers."""
        low, high = (float(end) for end in model[0].length_range())
        data = data.part(data.loaded & (data.length >= low) & (data.length <= high))
        force, columns = _linear(*model, *_padded(data.length, data.pressure))
        count = data.force.size
        return cls(data, np.asarray(force)[:count], np.asarray(columns).T[:count])

    def judged(
        self, form: str, *, deadband: bool
    ) -> tuple[float, float, Float[np.ndarray, " unknowns"]]:
        """Return in-sample and held-out RMSE relative to the largest force, and the unknowns [Pa]."""
        level = self.data.pressures.level
        levels, whole = np.unique(level), np.ones(level.size, bool)
        unknowns = self._fit(form, levels, whole, deadband=deadband)
        error = self._at(form, levels, unknowns) - self.data.force
        left = [np.zeros(0)]
        for P in levels[1:-1]:
            others = levels[levels != P]
            without = self._fit(form, others, level != P, deadband=deadband)
            left.append((self._at(form, others, without) - self.data.force)[level == P])
        sizes = (
            np.sqrt(np.mean(e**2)) / self.data.max_force for e in (error, np.concatenate(left))
        )
        rmse, left_out = (float(size) for size in sizes)
        return rmse, left_out, unknowns

    def _matrix(
        self, form: str, levels: Float[np.ndarray, " p"]
    ) -> Float[np.ndarray, "n unknowns"]:
        """Return the columns for the E_n at the pressure nodes of the form, and for the deadband."""
        P = self.data.pressure
        nodes = {"constant": levels[:1], "linear": levels[[0, -1]], "free": levels}[form]
        if nodes.size == 1:
            share = np.ones((P.size, 1))
        elif nodes.size == 2:
            share = (P - nodes[0]) / (nodes[1] - nodes[0])
            share = np.stack([1 - share, share], axis=1)
        else:
            share = np.stack([np.interp(P, nodes, one) for one in np.eye(nodes.size)], axis=1)
        law = self.columns[:, None, :ORDER] * share[:, :, None]
        return np.hstack([law.reshape(P.size, -1), self.columns[:, ORDER:]])

    def _fit(
        self,
        form: str,
        levels: Float[np.ndarray, " p"],
        rows: Bool[np.ndarray, " n"],
        *,
        deadband: bool,
    ) -> Float[np.ndarray, " unknowns"]:
        """Solve for the unknowns [Pa] with a nonnegative deadband; nan if not determined."""
        A, target = self._matrix(form, levels)[rows], (self.data.force - self.force)[rows]
        count = A.shape[1] if deadband else A.shape[1] - 1
        size = np.linalg.norm(A[:, :count], axis=0)
        found, _, rank, _ = np.linalg.lstsq(A[:, :count] / size, target)
        if rank < count:
            return np.full(A.shape[1], np.nan)
        found = np.append(found / size, [0.0] * (A.shape[1] - count))
        if found[-1] < 0:
            return self._fit(form, levels, rows, deadband=False)
        return found

    def _at(
        self, form: str, levels: Float[np.ndarray, " p"], unknowns: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, " n"]:
        return self.force + self._matrix(form, levels) @ unknowns


@quick_jit
def _linear(
    geometry: AbstractGeometry,
    pull: AbstractForceTerm,
    length: Float[Array | np.ndarray, " n"],
    pressure: Float[Array | np.ndarray, " n"],
) -> tuple[Float[Array, " n"], Float[Array, "unknowns n"]]:
    """Return the force [N] without law and deadband, and its derivatives [N/Pa] in the unknowns."""

    def force(unknowns: Float[Array, " unknowns"]) -> Float[Array, " n"]:
        law = famjax.PolynomialMaterial(unknowns[:ORDER])
        braid = pull.with_parameters({"deadband_pressure": unknowns[ORDER]})
        return famjax.Muscle(geometry, BladderWall(law) + braid).force(length, pressure)

    first = force(jnp.zeros(_SIZE.size))
    return first, (jax.vmap(force)(jnp.diag(_SIZE)) - first) / _SIZE[:, None]


def least_modulus(
    data: fitting.ForceData, model: Model, unknowns: Float[np.ndarray, " unknowns"]
) -> float:
    """Return the smallest modulus [Pa] of a constant law along the paths at all tested pressures."""
    level, geometry = data.pressures.level, model[0]
    low = float(geometry.length_range()[0])
    lengths, pressures = [], []
    for P in np.unique(level):
        shortest = max(low, data.length[data.loaded & (level == P)].min())
        lengths.append(np.linspace(float(geometry.rest_length), shortest, 50))
        pressures.append(np.full(50, P))
    at = _padded(np.concatenate(lengths), np.concatenate(pressures))
    return float(np.min(_moduli(jnp.asarray(unknowns[:ORDER]), geometry, *at)))


@quick_jit
def _moduli(
    E: Float[Array, " order"],
    geometry: AbstractGeometry,
    length: Float[Array | np.ndarray, " n"],
    pressure: Float[Array | np.ndarray, " n"],
) -> Float[Array, " n"]:
    return famjax.path_modulus(famjax.PolynomialMaterial(E), geometry, length, pressure)


def _padded(*columns: Float[np.ndarray, " n"]) -> list[Float[np.ndarray, " padded"]]:
    """Repeat the last state to a fixed size, so one program serves every muscle."""
    count = -(-columns[0].size // _PADDED) * _PADDED
    return [np.pad(one, (0, count - one.size), mode="edge") for one in columns]
