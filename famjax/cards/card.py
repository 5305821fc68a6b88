"""The muscle card: one file with everything that a simulator, a controller or a colleague needs.

`muscle_card.schema.json` in this folder contains the output of `schema()`, for use in other languages.
"""

import dataclasses
import functools
import html
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import equinox as eqx
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct

import famjax

from .._arrays import Real, RealArray, as_real, in_trace
from ..boundary.errors import InputError, Own
from ..boundary.files import as_svg, write_all
from ..continuation import Region, SafeMuscle, continued_volume
from ..muscle import (
    AbstractMuscle,
    MeanMuscle,
    MountedMuscle,
    Muscle,
    cut_to_length,
    flatten,
    number_names,
)
from ..slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements
from .parts import muscle_as_dict, muscle_from_dict

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

SCHEMA = "famjax-card/1"
_TABLE = 33, 5  # lengths and pressures in the table of volumes

Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]


# --- the file


class _Entry(Struct, forbid_unknown_fields=True):
    """A JSON object with exactly these entries."""


class Member(_Entry, omit_defaults=True):
    """One model of the muscle, with its weight in the force and its mounting."""

    muscle: Annotated[
        dict[str, Any], Meta(description="geometry and force terms, with units in the keys")
    ]
    series_compliance_m_per_N: float
    weight: float
    series_exponent: Annotated[
        float | None,
        Meta(description="n in the series deflection compliance 100 N (F/100 N)^n; 1 if omitted"),
    ] = None


class Ranges(_Entry):
    """A range of lengths and a range of gauge pressures, each from low to high."""

    length_m: Pair
    pressure_Pa: Pair

    @classmethod
    def of(cls, region: Region) -> "Ranges":
        """Convert a region to plain numbers."""
        return cls(*(np.asarray(one, float).tolist() for one in (region.length, region.pressure)))


class Volume(_Entry):
    """Fluid volume on a grid of lengths and pressures, one row per length."""

    length_m: list[float]
    pressure_Pa: list[float]
    volume_m3: list[list[float]]


class Covariance(_Entry):
    """Covariance of the identified parameters, relative to their scales."""

    parameters: list[str]
    units: list[str]
    values: list[float]
    scales: list[float]
    matrix: list[list[float]]


class Sample(_Entry):
    """Parameters of the first member for muscles sampled from the covariance, one row per muscle."""

    seed: int
    numbers: list[str]
    rows: list[list[float]]


class Elements(_Entry):
    """Maxwell-slip elements on one coordinate."""

    thresholds: list[float]
    strengths_N: list[float]


class Ramp(_Entry, tag="ramp", tag_field="kind"):
    """A pressure cycle at constant length."""

    cycled: bool
    start_Pa: float
    turn_Pa: float


class Stroke(_Entry, tag="stroke", tag_field="kind"):
    """A length cycle at constant pressure."""

    cycled: bool
    start_m: float
    turn_m: float


class Hysteresis(_Entry):
    """Slip elements about the static map, which is the mean over `cycle`; see `famjax.slip.CentredSlip`."""

    rest_length_m: float
    modulus_Pa: float
    wall: Elements
    braid: Elements
    cycle: Ramp | Stroke

    @classmethod
    def of(cls, centred: CentredSlip) -> "Hysteresis":
        """Convert the elements and the cycle to plain numbers."""
        slip, cycle = centred.slip, centred.cycle
        wall, braid = (
            Elements(*(np.asarray(x).tolist() for x in (of.threshold, of.strength)))
            for of in (slip.wall, slip.braid)
        )
        kind = Ramp if cycle.kind == "ramp" else Stroke
        ends = kind(cycle.cycled, cycle.start, cycle.turn)
        return cls(float(slip.rest_length), float(slip.modulus), wall, braid, ends)

    def centred(self) -> CentredSlip:
        """Rebuild the elements and their cycle."""
        wall, braid = (
            SlipElements(np.array(one.thresholds, float), np.array(one.strengths_N, float))
            for one in (self.wall, self.braid)
        )
        cycled, start, turn = msgspec.structs.astuple(self.cycle)
        kind = "ramp" if isinstance(self.cycle, Ramp) else "stroke"
        slip = MaxwellSlip(wall, braid, self.rest_length_m, self.modulus_Pa)
        return CentredSlip(slip, ReferenceCycle(kind, start, turn, cycled))


class Provenance(_Entry):
    """Origin of the card."""

    verdict: str | None = None
    reasons: list[str] = []
    rmse_N: float | None = None
    max_error_N: float | None = None
    max_force_N: float | None = None
    model_error: dict[str, Any] | None = None
    source: str | None = None
    data_sha256: str | None = None
    specimen: dict[str, Any] = {}
    date: str | None = None
    command: str | None = None
    versions: dict[str, str] = {}
    notes: list[str] = []


class CardDocument(_Entry):
    """A muscle card as a document, with numbers in SI and units in the keys."""

    schema: Literal["famjax-card/1"]
    name: str
    members: Annotated[list[Member], Meta(min_length=1)]
    rest_length_m: float
    data: Ranges
    monotone: Annotated[Ranges, Meta(description="region in which the model is used unchanged")]
    stops_m: Annotated[
        Pair,
        Meta(
            description="length at which the braid locks, and length at which the threads are straight"
        ),
    ]
    volume: Volume | None
    covariance: Covariance | None
    sample: Sample | None
    hysteresis: Hysteresis | None
    provenance: Provenance


def schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) for a card."""
    found = msgspec.json.schema(CardDocument)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": SCHEMA, **found}


def slip_as_dict(centred: CentredSlip) -> dict[str, Any]:
    """Return slip elements and their reference cycle as JSON-ready data in SI, without rounding."""
    return msgspec.to_builtins(Hysteresis.of(centred))


def slip_from_dict(document: dict[str, Any]) -> CentredSlip:
    """Rebuild the slip elements and cycle from the output of `slip_as_dict`; other entries are ignored.

    Raises:
        InputError: an entry is missing or is not a number.
    """
    known = {key: document[key] for key in Hysteresis.__struct_fields__ if key in document}
    try:
        return msgspec.convert(known, Hysteresis).centred()
    except msgspec.ValidationError as error:
        raise InputError(
            f"the hysteresis cannot be read ({error}): create it with famjax assess --hysteresis"
        ) from None


def unidentified(name: str, verdict: str | None, reasons: Sequence[str] | None) -> str | None:
    """Return a warning if a fit did not identify the muscle, otherwise None.

    Args:
        name: name of the file or the muscle.
        verdict: verdict of the fit.
        reasons: reasons for the verdict, the most serious first.
    """
    if verdict != "not identified":
        return None
    return f"{name} contains no identified muscle: {(reasons or ['see its report'])[0]}"


# --- the muscle


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MuscleCard:
    """A muscle with its data range, errors, hysteresis and provenance.

    Attributes:
        name: name of the muscle.
        members: models of the muscle in the test rig; the force is the weighted sum of their forces.
        weights: weights of the members, which sum to 1, shape (members,).
        data: range of lengths and pressures covered by the readings.
        covariance: covariance of the identified parameters relative to their scales, or None.
        draws: sample of muscles from `draw`, or None.
        hysteresis: hysteresis added to the static force, or None if it was not identified.
        provenance: origin of the data.
    """

    name: str
    members: tuple[MountedMuscle, ...]
    weights: Float[np.ndarray, " members"]
    data: Region
    covariance: Covariance | None = None
    draws: Sample | None = None
    hysteresis: CentredSlip | None = None
    provenance: Provenance = dataclasses.field(default_factory=Provenance)

    def __repr__(self) -> str:
        L, P = 1e3 * np.asarray(self.data.length), 1e-3 * np.asarray(self.data.pressure)
        return f"MuscleCard({self.name}: {L[0]:.4g} to {L[1]:.4g} mm, {P[0]:.4g} to {P[1]:.4g} kPa)"

    def _repr_html_(self) -> str:
        from matplotlib.figure import Figure  # noqa: PLC0415 -- 0.3 s, only for notebooks

        (short, long), (low, high) = self.data.length, self.data.pressure
        L = np.linspace(float(short), float(long), 80)
        P = np.linspace(float(low), float(high), 6)[1:]
        figure = Figure(figsize=(6, 3.5), layout="constrained")
        axes = figure.subplots()
        labels = [f"{1e-3 * level:.3g} kPa" for level in P]
        axes.plot(1e3 * L, self.safe().force(L[:, None], P), label=labels)
        axes.set(xlabel="active length, mm", ylabel="force, N")
        axes.legend()
        said = [
            self,
            self.provenance.verdict or "no verdict",
            *(one.muscle for one in self.members),
        ]
        text = html.escape("\n".join(map(str, said)))
        return f"<pre>{text}</pre>{as_svg(figure)}"

    @functools.cached_property
    def muscle(self) -> AbstractMuscle:
        """The identified model, including the compliance of the test rig. In simulators, use `safe()`."""
        return combined(self.members, self.weights)

    @functools.cached_property
    def _safe(self) -> SafeMuscle:
        if in_trace():
            raise InputError(
                "call card.safe() outside jit, grad and vmap, and use the muscle that it returns inside"
            )
        data = (np.asarray(one) for one in (self.data.length, self.data.pressure))
        return SafeMuscle.of(self.muscle, *data, hysteresis=self.hysteresis)

    def safe(self) -> SafeMuscle:
        """Return a `famjax.SafeMuscle` for simulators, valid in any state and including hysteresis."""
        return self._safe

    @property
    def region(self) -> Region:
        """Part of the data range in which the model is monotone and is used unchanged."""
        return self._safe.region

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3]; arguments broadcast; see `famjax.continuation.continued_volume`.

        Raises:
            InputError: the model has no geometry.
        """
        return continued_volume(self.muscle, self.region, length, pressure)

    @property
    def sample(self) -> AbstractMuscle | None:
        """Muscles sampled from the fit's uncertainty, stacked along a leading axis; None if not available.

        Evaluate the muscles with `equinox.filter_vmap`. Their spread does not include the model error; see
        `provenance.model_error`.
        """
        if self.draws is None:
            return None
        rows = as_real(np.array(self.draws.rows))
        vary = functools.partial(combined, self.members, self.weights)
        return eqx.filter_vmap(vary, out_axes=eqx.if_array(0))(rows)

    def cut(self, rest_length: float) -> "MuscleCard":
        """Return the card for this muscle cut to a different rest length; see `famjax.cut_to_length`.

        The data range covers the same contractions and pressures. Errors, sample and hysteresis are
        omitted, because one specimen does not show how specimens differ.

        Raises:
            InputError: the muscle cannot be cut to this length.
        """
        fault = f"{self.name} cannot be cut to {rest_length:.4g} m"
        if not 0 < rest_length < np.inf:
            raise InputError(f"{fault}: the rest length must be > 0")
        try:
            members = tuple(
                one.with_muscle(cut_to_length(one.muscle, rest_length)) for one in self.members
            )
        except (eqx.EquinoxRuntimeError, ValueError) as error:
            why = (
                error
                if isinstance(error, ValueError)
                else "the muscle would be shorter than its rounded ends"
            )
            raise InputError(f"{fault}: {why}") from None
        wide = _diameter_at_rest(members[0].muscle)
        if rest_length < wide:
            raise InputError(
                f"{fault}: the rest length must exceed the braid diameter, {wide:.4g} m"
            )
        old = float(self.muscle.rest_length)
        lost = "" if self.hysteresis is None else ", without hysteresis"
        notes = [*self.provenance.notes, f"cut from {old:.6g} to {rest_length:.6g} m{lost}"]
        data = Region(rest_length / old * self.data.length, self.data.pressure)
        provenance = msgspec.structs.replace(self.provenance, notes=notes)
        return MuscleCard(self.name, members, self.weights, data, provenance=provenance)


def _diameter_at_rest(mounted: AbstractMuscle) -> float:
    """Return the braid diameter [m] at rest without pressure, or the diameter at the end-fittings."""
    if isinstance(mounted, Muscle):
        return 2 * float(mounted.geometry.dimensions(mounted.rest_length, 0.0).radius)
    assert isinstance(mounted, famjax.EquilibriumMuscle)
    return float(mounted.end_diameter)


def combined(
    members: Sequence[MountedMuscle], weights: Any, numbers: Any = None, *, rigid: bool = False
) -> AbstractMuscle:
    """Combine all members into one muscle. Compliant mountings are included unless `rigid` is True.

    If `numbers` replaces the parameters of the first member, the forces of the other members shift by
    the same amount. The force then has the spread of the first member, whatever its weight.
    """
    loose = [not rigid and bool(np.any(np.asarray(one.compliance))) for one in members]
    own = [one if kept else one.muscle for one, kept in zip(members, loose, strict=True)]
    if numbers is not None:
        first = flatten(members[0])[1](numbers)
        own = [first if loose[0] else first.muscle, *(own if len(own) > 1 else [])]
        weights = jnp.concatenate([jnp.ones(1), jnp.asarray(weights).at[0].add(-1.0)])
    return own[0] if len(own) == 1 else MeanMuscle(own, jnp.asarray(weights))


# --- conversion


def card_as_document(card: MuscleCard) -> CardDocument:
    """Return the content of the file for a card.

    Raises:
        InputError: a part of the muscle cannot be stored in a card, or the model is not monotone anywhere.
    """
    safe, members = card.safe(), []
    for one, weight in zip(card.members, np.asarray(card.weights, float), strict=True):
        # `famjax.EquilibriumMuscle` is slow to load, so it is asked for last.
        if not (isinstance(one.muscle, Muscle) or isinstance(one.muscle, famjax.EquilibriumMuscle)):  # noqa: SIM101
            raise InputError(f"a {type(one.muscle).__name__} cannot be stored in a card")
        exponent = None if one.exponent is None else float(one.exponent)
        members.append(
            Member(muscle_as_dict(one.muscle), float(one.compliance), float(weight), exponent)
        )
    loops = card.hysteresis
    return CardDocument(
        schema=SCHEMA, name=card.name, members=members, rest_length_m=float(safe.rest_length),
        data=Ranges.of(card.data), monotone=Ranges.of(safe.region),
        stops_m=np.asarray(safe.continued.stops, float).tolist(), volume=_volume(card),
        covariance=card.covariance, sample=card.draws,
        hysteresis=None if loops is None else Hysteresis.of(loops), provenance=card.provenance,
    )  # fmt: skip


def _volume(card: MuscleCard) -> Volume | None:
    """Tabulate the volume for programs that cannot evaluate the geometry; None if the model has none."""
    ranges = Ranges.of(card.region)
    (short, long), (low, high) = ranges.length_m, ranges.pressure_Pa
    L, P = np.linspace(short, long, _TABLE[0]), np.linspace(low, high, _TABLE[1])
    try:
        table = card.volume(L[:, None], P)
    except InputError:
        return None
    return Volume(L.tolist(), P.tolist(), np.asarray(table, float).tolist())


def card_from_document(document: CardDocument, *, own: Own = ()) -> MuscleCard:
    """Build a card from the content of a file; for `own`, see `read_card`.

    Raises:
        InputError: a muscle is invalid, or the sample has different parameters.
    """
    members = []
    for one in document.members:
        muscle = muscle_from_dict(one.muscle, own=own)
        members.append(MountedMuscle(muscle, one.series_compliance_m_per_N, one.series_exponent))
    names, loops, sample = number_names(members[0]), document.hysteresis, document.sample
    if sample is not None and (
        tuple(sample.numbers) != names or any(len(row) != len(names) for row in sample.rows)
    ):
        raise InputError(
            "the muscle card is damaged: the sample must have the parameters of the first member, "
            f"{', '.join(names)}; got {', '.join(sample.numbers)}"
        )
    return MuscleCard(
        document.name, tuple(members), np.array([one.weight for one in document.members]),
        Region(document.data.length_m, document.data.pressure_Pa), document.covariance,
        sample, None if loops is None else loops.centred(), document.provenance,
    )  # fmt: skip


def read_card(path: "str | Path | Traversable", *, own: Own = ()) -> MuscleCard:
    """Read a muscle card from a file.

    Args:
        path: file written by `write_card` or `famjax card`; may be a package resource.
        own: trusted modules and classes, such as `("my_rubber",)` or `(Gent,)`. A card with a class from
            any other module is rejected, because importing that module would run its code.

    Returns:
        The card. Enable float64 in JAX first; otherwise the numbers in the muscle are rounded to float32.

    Raises:
        InputError: the file is missing, damaged or not a muscle card, or contains an untrusted class.
    """
    file = Path(path) if isinstance(path, str) else path
    try:
        document = msgspec.json.decode(file.read_bytes(), type=CardDocument)
        return card_from_document(document, own=own)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except msgspec.DecodeError as error:
        raise InputError(
            f"{path} is not a muscle card of schema {SCHEMA}, or is damaged: {error}; create a card with "
            "famjax card"
        ) from None
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_card(card: MuscleCard, path: str | Path) -> Path:
    """Write a card to a file, completely or not at all; the folder is created if missing.

    Raises:
        InputError: the card or the file cannot be written.
    """
    path = Path(path)
    return write_all(path.parent, {path.name: as_text(card_as_document(card)).encode()})[0]


def as_text(document: CardDocument) -> str:
    """Return the content of the file, indented, with each row of numbers on one line."""
    text = json.dumps(msgspec.to_builtins(document), indent=1, allow_nan=False)
    # JSON strings contain no line breaks, so only lists are joined.
    return re.sub(
        r"\[\n([^\[\]{}]*)\n *\]",
        lambda found: "[" + ", ".join(x.strip(" ,") for x in found[1].split("\n")) + "]",
        text,
    ) + "\n"  # fmt: skip
