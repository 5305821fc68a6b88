"""A muscle to be exported, as a table for small targets, and the error of that table."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .. import __version__
from .._arrays import Real, RealArray
from ..boundary.errors import InputError, Own
from ..boundary.files import Origin
from ..cards import MuscleCard, read_card, unidentified
from ..compile_options import quick_jit
from ..continuation import Region, SafeMuscle, slopes
from ..muscle import AbstractMuscle
from ..muscles import bundled_card, bundled_name, bundled_text
from ..plant import Plant
from .plain import TabulatedPull

CLOSE = 5e-8
"""Largest error of the interpolation along either axis, of the largest force in the region."""

_MOST = {"length": 257, "pressure": 65}
_FIRST = {"length": 9, "pressure": 2}
_INSIDE = np.array([0.2, 0.5, 0.8])  # where the error in a cell is looked for
_AT_ONCE = 2048
_STATES = 4000
_LIMIT = 2.0  # highest pressure that the inverse looks at, of the highest of the region
_STEEP = 0.01  # of the mean area: below it a pressure is not determined by the force

Numbers = Float[np.ndarray, "..."]


@dataclasses.dataclass(frozen=True, eq=False)
class Subject:
    """A muscle to be exported.

    Attributes:
        name: of the muscle.
        muscle: what is exported.
        card: that it comes from, or None.
        origin: lines on the file it comes from.
        plant: circuit, friction and loss of the muscle, which is exported with them to C, MuJoCo and an
            FMU; its load is not. None for the static map, and in an FMU for `PneumaticCircuit`.
    """

    name: str
    muscle: SafeMuscle
    card: MuscleCard | None = None
    origin: tuple[str, ...] = ()
    plant: Plant | None = None

    @classmethod
    def of_card(
        cls, card: MuscleCard, *, length: float | None = None, origin: tuple[str, ...] = ()
    ) -> "Subject":
        """The muscle of a card, cut to a rest length [m] if one is given."""
        card = card if length is None else card.cut(length)
        return cls(card.name, card.safe(), card, origin)

    @property
    def identifier(self) -> str:
        """The name as C, MATLAB and files take it: lower case letters, digits, underscores."""
        plain = re.sub(r"[^a-z0-9]+", "_", self.name.lower()).strip("_")
        return plain if plain[:1].isalpha() else f"muscle_{plain}".strip("_")

    @functools.cached_property
    def table(self) -> dict[str, Any]:
        """The muscle as a table, see `tabulated`."""
        return tabulated(self.muscle)

    @functools.cached_property
    def pull(self) -> TabulatedPull:
        """The pull by the table, in plain floats."""
        return TabulatedPull(self.table)

    @functools.cached_property
    def errors(self) -> "TableErrors":
        """Error of the table against the model."""
        return table_errors(self.muscle, self.pull)

    @property
    def about(self) -> list[str]:
        """Head of every file: muscle, origin, region."""
        L, P = (np.asarray(getattr(self.muscle.region, of)) for of in ("length", "pressure"))
        lines = [
            f"{self.name}, exported by famjax {__version__} with jax "
            f"{importlib.metadata.version('jax')}",
            *self.origin,
            f"the model's own from {L[0]:.6g} to {L[1]:.6g} m and {P[0]:.6g} to {P[1]:.6g} Pa, "
            "continued beyond",
        ]
        if self.plant is None and self.muscle.hysteresis is not None:
            lines.append("the static map: the card's hysteresis is left out")
        if self.card is not None:
            made = self.card.provenance
            doubt = unidentified(self.name, made.verdict, made.reasons)
            lines += [] if doubt is None else [f"WARNING: {doubt}"]
            lines += made.notes
        return [*lines, *self.muscle.notes]

    @property
    def about_table(self) -> list[str]:
        """Head of a file with the table, including its error against the model."""
        off = self.errors
        return [
            *self.about,
            f"largest difference from the model at {_STATES} random states, in parts of the "
            f"largest force {off.largest_force:.6g} N:",
            f"  {off.force:.1e} in that region, {off.force_beyond:.1e} up to twice its lengths and "
            "pressures,",
            f"  {off.pressure:.2g} Pa by the inverse; the target's own rounding comes on top",
        ]


def read_subject(
    source: str | Path,
    *,
    length: float | None = None,
    origin: Origin | None = None,
    own: Own = (),
) -> Subject:
    """Read the muscle of a card's file, or a bundled one by name.

    Args:
        source: a file that `famjax card` has written, or the name of a bundled muscle.
        length: rest length [m] to which it is cut; its own unless given.
        origin: of the files that will be written.
        own: modules and classes that are trusted, as for `famjax.cards.read_card`.

    Raises:
        InputError: no such file, no card, or the muscle cannot be cut.
    """
    path = Path(source)
    name = None if path.exists() else bundled_name(str(source))
    if name is not None:
        card = bundled_card(name)
        origins = made_of(f"the bundled card {name}", bundled_text(name), origin)
    else:
        card = read_card(path, own=own)
        origins = made_of(path.name, path.read_bytes(), origin)
    return Subject.of_card(card, length=length, origin=origins)


def made_of(name: str, content: bytes, origin: Origin | None = None) -> tuple[str, ...]:
    """Lines about the file that a muscle comes from and the command that exports it."""
    lines = [f"of {name}, sha256 {hashlib.sha256(content).hexdigest()}"]
    return tuple(lines if origin is None else [*lines, f"by `{origin.command}` on {origin.date}"])


# --- the table


def tabulated(muscle: SafeMuscle) -> dict[str, Any]:
    """The table of a safe muscle's static map, as `TabulatedPull` takes it: plain lists, SI.

    Nodes are put where they are needed: a cell is halved as long as the cubic between its ends is
    off by more than `CLOSE` of the largest force, anywhere along the other axis. A model that is
    affine in the pressure needs two pressures.

    Args:
        muscle: the safe muscle. Its hysteresis is left out.

    Raises:
        InputError: more nodes would be needed than a table may have, the force is not finite
            somewhere, or JAX is in float32.
    """
    check_float64()
    inside = muscle.continued
    nodes, (force, *slopes) = _nodes(inside.muscle, inside.region)
    names = ("stiffness_N_per_m", "area_m2", "mixed_m")
    return {
        "length_m": nodes["length"].tolist(),
        "pressure_Pa": nodes["pressure"].tolist(),
        "force_N": force.tolist(),
        **{name: value.tolist() for name, value in zip(names, slopes, strict=True)},
        "stops_m": np.asarray(inside.stops, float).tolist(),
        "stop_stiffness_N_per_m": float(inside.stop_stiffness),
        "stop_onset_m": float(inside.stop_onset),
        "length_ends_per_m": np.asarray(inside.length_ends, float).tolist(),
        "pressure_ends_per_Pa": np.asarray(inside.pressure_ends, float).tolist(),
        "slack_width_N": float(muscle.slack_width),
        "pressure_limit_Pa": _LIMIT * float(inside.region.pressure[1]),
    }


class _Holding(AbstractMuscle):
    """A muscle whose volume is tabulated as a force is."""

    muscle: AbstractMuscle

    @property
    def rest_length(self) -> RealArray:
        return self.muscle.rest_length

    def force(self, length: Real, pressure: Real) -> RealArray:
        return self.muscle.volume(length, pressure)

    def length_range(self) -> tuple[RealArray, RealArray]:
        return self.muscle.length_range()


def tabulated_volume(muscle: SafeMuscle) -> tuple[dict[str, Numbers], Numbers]:
    """Nodes `length` and `pressure`, and V [m3], dV/dL, dV/dP, d2V/dLdP at them, shape (4, n, m).

    Raises:
        InputError: as `tabulated`, or the muscle is of a model without a geometry.
    """
    return _nodes(_Holding(muscle.continued.muscle), muscle.region)


def _nodes(model: Any, region: Region) -> tuple[dict[str, Numbers], Numbers]:
    """Nodes at which a cubic in each cell is close enough; force and slopes at them."""
    ends = {name: np.asarray(getattr(region, name), float) for name in ("length", "pressure")}
    nodes = {name: np.linspace(low, high, _FIRST[name]) for name, (low, high) in ends.items()}
    scale = float(np.abs(_slopes(model, *np.meshgrid(*nodes.values()))[0]).max())
    while True:
        wide = {name: _cubic_errors(model, nodes, name) > CLOSE * scale for name in nodes}
        if not any(one.any() for one in wide.values()):
            break
        for name, at in nodes.items():
            middles = 0.5 * (at[1:] + at[:-1])[wide[name]]
            nodes[name] = np.sort(np.concatenate([at, middles]))
            if len(nodes[name]) > _MOST[name]:
                raise InputError(
                    f"the model is not smooth enough for a table: more than {_MOST[name]} "
                    f"{name}s would be needed for {CLOSE:g} of the largest force; export the model "
                    "itself, --to jax or --to mjx"
                )
    return nodes, np.stack(_slopes(model, *np.meshgrid(*nodes.values(), indexing="ij")))


def check_float64() -> None:
    """Refuse to export a muscle in float32.

    Raises:
        InputError: JAX is in float32.
    """
    if not jax.config.read("jax_enable_x64"):
        raise InputError(
            "a muscle is exported in float64: call jax.config.update('jax_enable_x64', True) before "
            "anything of JAX"
        )


def _cubic_errors(model: AbstractMuscle, nodes: dict[str, Numbers], name: str) -> Numbers:
    """By how much [N] the cubic in each cell along one axis is off, at most, along the other."""
    along, other = nodes[name], nodes["pressure" if name == "length" else "length"]
    across = np.concatenate([other, 0.5 * (other[1:] + other[:-1])])
    width = np.diff(along)

    def asked(values: Numbers) -> tuple[Numbers, ...]:
        pair = np.meshgrid(values, across, indexing="ij")
        return _slopes(model, *(pair if name == "length" else pair[::-1]))

    between = asked((along[:-1, None] + width[:, None] * _INSIDE).ravel())[0]
    ends = asked(along)
    force, slope = ends[0], ends[1 if name == "length" else 2]
    u, h = _INSIDE[:, None], width[:, None, None]
    rise = (force[1:] - force[:-1])[:, None]
    p, q = h * slope[:-1, None], h * slope[1:, None]
    cubic = force[:-1, None] + u * (p + u * (3 * rise - 2 * p - q + u * (p + q - 2 * rise)))
    off = np.abs(cubic - between.reshape(cubic.shape)).max(axis=(1, 2))
    if not np.isfinite(off).all():
        raise InputError("the model has no finite force somewhere in its region: nothing to export")
    return off


def _slopes(model: AbstractMuscle, length: Numbers, pressure: Numbers) -> tuple[Numbers, ...]:
    """Force, stiffness, area and mixed slope at states of one shape, in chunks of one size."""
    L, P = np.ravel(length), np.ravel(pressure)
    spare = -len(L) % _AT_ONCE
    chunks = (np.pad(one, (0, spare), mode="edge").reshape(-1, _AT_ONCE) for one in (L, P))
    found = [
        np.stack(_slopes_of_chunk(model, jnp.asarray(one), jnp.asarray(at)))
        for one, at in zip(*chunks, strict=True)
    ]
    return tuple(np.concatenate(found, axis=1)[:, : len(L)].reshape(4, *np.shape(length)))


_slopes_of_chunk = quick_jit(slopes)


# --- how near it is


class TableErrors(NamedTuple):
    """Error of a table against its model, at random states.

    Attributes:
        largest_force: in the region [N]; forces are given in parts of it.
        force: largest difference of force in the region [-].
        force_beyond: the same from no length to twice the longest, from no pressure to twice the
            highest [-].
        pressure: largest error of the inverse [Pa] over all of these states between the stops, where
            the muscle pulls with more than the blend into slack and its area F_P is above a
            hundredth of the mean: elsewhere the force hardly tells the pressure.
    """

    largest_force: float
    force: float
    force_beyond: float
    pressure: float


def table_errors(muscle: SafeMuscle, pull: TabulatedPull) -> TableErrors:
    """Measure the error of the table of a safe muscle; see `TableErrors`."""
    rng, half = np.random.default_rng(0), _STATES // 2
    L, P = (
        np.concatenate([rng.uniform(low, high, half), rng.uniform(0, _LIMIT * high, half)])
        for low, high in (map(float, muscle.region.length), map(float, muscle.region.pressure))
    )
    force = np.asarray(_force(muscle, jnp.asarray(L), jnp.asarray(P)))
    states = [*zip(L.tolist(), P.tolist(), strict=True)]
    largest = float(force[:half].max())
    off = np.abs(np.array([pull.force(*state) for state in states]) - force) / largest
    area = np.array([pull.area(*state) for state in states])
    told = (force > pull.slack_width) & (area > _STEEP * area[:half].mean())
    told &= (pull.stops[0] < L) & (pull.stops[1] > L)
    back = [abs(pull.pressure(L[k], force[k]) - P[k]) for k in np.flatnonzero(told)]
    return TableErrors(
        largest, float(off[:half].max()), float(off[half:].max()), max(back, default=math.nan)
    )


@quick_jit
def _force(muscle: SafeMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    return muscle.force(length, pressure)
