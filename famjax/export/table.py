"""Muscles to export, their tables for small targets, and the errors of these tables."""

import dataclasses
import functools
import hashlib
import re
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .. import __version__
from .._arrays import RealArray
from ..boundary.errors import InputError, Own
from ..boundary.files import Origin
from ..cards import MuscleCard, read_card, unidentified
from ..compile_options import quick_jit
from ..continuation import Region, SafeMuscle, Slopes, slopes
from ..muscles import card_file
from ..plant import Plant
from .plain import TabulatedPull

CLOSE = 5e-8
"""Maximum interpolation error along either axis, relative to the largest force in the region."""

_COARSE = 5e-4
"""Error accepted if `CLOSE` cannot be reached, as where a muscle in a compliant rig becomes slack."""
_MOST = {"length": 257, "pressure": 65}
_FIRST = {"length": 9, "pressure": 2}
_INSIDE = np.array([0.2, 0.5, 0.8])  # positions in a cell at which the error is evaluated
_AT_ONCE = 2048
_STATES = 4000
_LIMIT = 2.0  # highest pressure of the inverse, relative to the region's highest

Numbers = Float[np.ndarray, "..."]


class TableErrors(NamedTuple):
    """Errors of a table compared with its model at random states.

    Attributes:
        largest_force: largest force in the region [N], to which the errors are relative.
        force: largest force error in the region [-].
        force_beyond: largest force error for lengths and pressures from 0 to twice their maxima [-].
    """

    largest_force: float
    force: float
    force_beyond: float


@dataclasses.dataclass(frozen=True, eq=False)
class Subject:
    """A muscle to export.

    Attributes:
        name: name of the muscle.
        muscle: muscle to export.
        card: card of the muscle, or None.
        origin: lines that describe the source file.
        plant: circuit, friction and viscous loss to export to C, MuJoCo and an FMU, without the load.
            None exports the static map; an FMU then uses a `PneumaticCircuit`.
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
        """Create the subject from a card, cut to a rest length [m] if one is given."""
        card = card if length is None else card.cut(length)
        return cls(card.name, card.safe(), card, origin)

    @property
    def identifier(self) -> str:
        """Name used in C, MATLAB and file names: lower-case letters, digits and underscores."""
        plain = re.sub(r"[^a-z0-9]+", "_", self.name.lower()).strip("_")
        return plain if plain[:1].isalpha() else f"muscle_{plain}".strip("_")

    @functools.cached_property
    def table(self) -> dict[str, Any]:
        """Table for the muscle, see `tabulated`."""
        return tabulated(self.muscle)

    @functools.cached_property
    def pull(self) -> TabulatedPull:
        """Muscle whose force is computed from the table, in plain floats."""
        return TabulatedPull(self.table)

    @functools.cached_property
    def errors(self) -> TableErrors:
        """Errors of the table compared with the model at random states."""
        rng, half, region = np.random.default_rng(0), _STATES // 2, self.muscle.region
        L, P = (
            np.concatenate([rng.uniform(low, high, half), rng.uniform(0, _LIMIT * high, half)])
            for low, high in (map(float, region.length), map(float, region.pressure))
        )
        force = np.asarray(self.muscle.force(L, P))
        off = np.abs([*map(self.pull.force, L.tolist(), P.tolist())] - force)
        scale = float(force[:half].max())
        return TableErrors(scale, float(off[:half].max()) / scale, float(off[half:].max()) / scale)

    @property
    def about(self) -> list[str]:
        """Header lines for every file: muscle, origin and region."""
        L, P = self.muscle.region.length, self.muscle.region.pressure
        lines = [
            f"{self.name}, exported by famjax {__version__} with jax {jax.__version__}",
            *self.origin,
            f"same as the model from {L[0]:.6g} to {L[1]:.6g} m and {P[0]:.6g} to {P[1]:.6g} Pa, "
            "continued beyond this region",
        ]
        if self.plant is None and self.muscle.hysteresis is not None:
            lines.append("static map: the card's hysteresis is omitted")
        if self.card is not None:
            made = self.card.provenance
            doubt = unidentified(self.name, made.verdict, made.reasons)
            lines += [] if doubt is None else [f"WARNING: {doubt}"]
            if made.rmse_N is not None and made.max_force_N is not None:
                lines.append(
                    f"fit: {made.verdict or 'not judged'}; RMSE {made.rmse_N:.3g} N, largest reading "
                    f"{made.max_force_N:.5g} N; for the 95 % band, use famjax predict with the fit.json"
                )
            lines += made.notes
        return [*lines, *self.muscle.notes]

    @property
    def about_table(self) -> list[str]:
        """Header lines for a file with the table, including the errors of the table."""
        off = self.errors
        return [
            *self.about,
            f"largest difference from `famjax.SafeMuscle` at {_STATES} random states, relative to the "
            f"largest force at these states, {off.largest_force:.6g} N:",
            f"  {off.force:.1e} in that region, {off.force_beyond:.1e} up to twice its lengths and "
            "pressures; rounding in the target program is not included",
        ]


def read_subject(
    source: str | Path, *, length: float | None = None, origin: Origin | None = None, own: Own = ()
) -> Subject:
    """Read a muscle to export from a card file, or a bundled muscle by name.

    Args:
        source: file written by `famjax card`, or the name of a bundled muscle.
        length: rest length [m] to which the muscle is cut; unchanged by default.
        origin: date and command to record in the files.
        own: trusted modules and classes, as in `famjax.cards.read_card`.

    Raises:
        InputError: the file is missing or not a card, or the muscle cannot be cut.
    """
    file = card_file(source)
    card, origins = read_card(file, own=own), made_of(file.name, file.read_bytes(), origin)
    return Subject.of_card(card, length=length, origin=origins)


def made_of(name: str, content: bytes, origin: Origin | None = None) -> tuple[str, ...]:
    """Describe the source file of a muscle and the command that exports it."""
    lines = [f"from {name}, sha256 {hashlib.sha256(content).hexdigest()}"]
    return tuple(lines if origin is None else [*lines, f"by `{origin.command}` on {origin.date}"])


# --- the table


def tabulated(muscle: SafeMuscle) -> dict[str, Any]:
    """Tabulate the static map of a safe muscle for `TabulatedPull`, as plain lists in SI.

    Each cell is halved until the cubic between its ends is accurate to `CLOSE` times the largest force,
    everywhere along the other axis. A model that is affine in the pressure needs only two pressures.

    Args:
        muscle: safe muscle; its hysteresis is omitted.

    Raises:
        InputError: the table would need too many nodes, the force is not finite everywhere, or JAX uses
            float32.
    """
    check_float64()
    inside = muscle.continued
    nodes, values = _nodes(inside.muscle, "force", inside.region)
    names = ("force_N", "stiffness_N_per_m", "area_m2", "mixed_m")
    numbers: dict[str, Any] = {
        "length_m": nodes["length"], "pressure_Pa": nodes["pressure"],
        **dict(zip(names, values, strict=True)), "stops_m": inside.stops,
        "stop_stiffness_N_per_m": inside.stop_stiffness, "stop_onset_m": inside.stop_onset,
        "length_ends_per_m": inside.length_ends, "pressure_ends_per_Pa": inside.pressure_ends,
        "slack_width_N": muscle.slack_width, "pressure_limit_Pa": _LIMIT * inside.region.pressure[1],
    }  # fmt: skip
    return {name: np.asarray(one, float).tolist() for name, one in numbers.items()}


def tabulated_volume(muscle: SafeMuscle) -> tuple[dict[str, Numbers], Numbers]:
    """Return the nodes `length` and `pressure`, and V [m3], dV/dL, dV/dP, d2V/dLdP there, shape (4, n, m).

    Raises:
        InputError: see `tabulated`, or the model has no geometry.
    """
    return _nodes(muscle.continued.muscle, "volume", muscle.region)


def _nodes(muscle: Any, of: str, region: Region) -> tuple[dict[str, Numbers], Numbers]:
    """Refine the nodes until the cubic in each cell is accurate; return nodes, values and slopes."""
    ends = {name: np.asarray(getattr(region, name), float) for name in ("length", "pressure")}
    first = {name: np.linspace(low, high, _FIRST[name]) for name, (low, high) in ends.items()}
    nodes = dict(first)
    scale = float(np.abs(_slopes(muscle, of, *np.meshgrid(*nodes.values()))[0]).max())
    close = CLOSE
    while True:
        wide = {name: _cubic_errors(muscle, of, nodes, name) > close * scale for name in nodes}
        if not any(one.any() for one in wide.values()):
            return nodes, _slopes(muscle, of, *np.meshgrid(*nodes.values(), indexing="ij"))
        for name, at in nodes.items():
            middles = 0.5 * (at[1:] + at[:-1])[wide[name]]
            nodes[name] = np.sort(np.concatenate([at, middles]))
        if any(len(at) > _MOST[name] for name, at in nodes.items()):
            if close == _COARSE:
                raise InputError(
                    "the model is not smooth enough for a table: to be accurate to within "
                    f"{_COARSE:g} of the largest force, the table would need more than "
                    f"{_MOST['length']} lengths or {_MOST['pressure']} pressures; export the model itself "
                    "with --to mjx"
                )
            close, nodes = _COARSE, first


def check_float64() -> None:
    """Check that JAX uses float64, which export requires.

    Raises:
        InputError: JAX uses float32.
    """
    if not jax.config.read("jax_enable_x64"):
        raise InputError(
            "export requires float64: call jax.config.update('jax_enable_x64', True) first"
        )


def _cubic_errors(muscle: Any, of: str, nodes: dict[str, Numbers], name: str) -> Numbers:
    """Return the largest error of the cubic in each cell along one axis, over the other axis."""
    along, other = nodes[name], nodes["pressure" if name == "length" else "length"]
    across = np.concatenate([other, 0.5 * (other[1:] + other[:-1])])
    width = np.diff(along)

    def asked(values: Numbers) -> Numbers:
        pair = np.meshgrid(values, across, indexing="ij")
        return _slopes(muscle, of, *(pair if name == "length" else pair[::-1]))

    between = asked((along[:-1, None] + width[:, None] * _INSIDE).ravel())[0]
    ends = asked(along)
    force, slope = ends[0], ends[1 if name == "length" else 2]
    u, h = _INSIDE[:, None], width[:, None, None]
    rise = (force[1:] - force[:-1])[:, None]
    p, q = h * slope[:-1, None], h * slope[1:, None]
    cubic = force[:-1, None] + u * (p + u * (3 * rise - 2 * p - q + u * (p + q - 2 * rise)))
    off = np.abs(cubic - between.reshape(cubic.shape)).max(axis=(1, 2))
    if not np.isfinite(off).all():
        raise InputError(
            "the force must be finite in the whole region: this muscle cannot be exported"
        )
    return off


def _slopes(muscle: Any, of: str, length: Numbers, pressure: Numbers) -> Numbers:
    """Return the value of a method, both slopes and the mixed slope at each state, shape (4, ...).

    The states are evaluated in chunks of equal size, so only one program is compiled.
    """
    L, P = np.ravel(length), np.ravel(pressure)
    spare = -len(L) % _AT_ONCE
    chunks = (np.pad(one, (0, spare), mode="edge").reshape(-1, _AT_ONCE) for one in (L, P))
    found = [np.stack(_slopes_of_chunk(muscle, of, *chunk)) for chunk in zip(*chunks, strict=True)]
    return np.concatenate(found, axis=1)[:, : len(L)].reshape(4, *np.shape(length))


@quick_jit
def _slopes_of_chunk(
    muscle: Any, of: str, length: RealArray | Numbers, pressure: RealArray | Numbers
) -> Slopes:
    return slopes(getattr(muscle, of), jnp.asarray(length), jnp.asarray(pressure))
