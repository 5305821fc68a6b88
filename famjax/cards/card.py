"""The muscle card: all that a simulator, a controller or a colleague needs of a muscle, in one file."""

import dataclasses
import functools
import json
from pathlib import Path
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jax.core import Tracer
from jaxtyping import Float
from msgspec import UNSET

from .._arrays import Real, RealArray, as_real
from ..boundary.errors import InputError
from ..boundary.files import write_all
from ..continuation import Region, SafeMuscle, continued_volume
from ..muscle import AbstractMuscle, MountedMuscle, Muscle, cut_to_length, number_names
from ..slip import CentredSlip
from .document import (
    SCHEMA,
    CardDocument,
    Covariance,
    Hysteresis,
    Member,
    Provenance,
    Ranges,
    Sample,
    Volume,
    as_text,
    checked,
)
from .draws import Draws, giving_way, joined, varied
from .muscle_card import muscle_as_dict, muscle_from_dict
from .slip_card import slip_as_dict, slip_from_dict

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

_TABLE = 33, 5  # lengths and pressures of the table of volumes


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class MuscleCard:
    """A muscle with the region it was identified in, its errors, its history and its origin.

    Attributes:
        name: of the muscle.
        members: models of it in the rig of the fit; the pull is their weighted sum.
        weights: theirs, of sum 1, shape (members,).
        data: lengths and pressures of the readings.
        covariance: of the identified parameters in parts of their scales, or None.
        draws: numbers of the sample of muscles, or None.
        hysteresis: about the muscle's force, or None where it was not identified.
        provenance: where all of it comes from.
    """

    name: str
    members: tuple[MountedMuscle, ...]
    weights: Float[np.ndarray, " members"]
    data: Region
    covariance: Covariance | None = None
    draws: Draws | None = None
    hysteresis: CentredSlip | None = None
    provenance: Provenance = dataclasses.field(default_factory=Provenance)

    def __repr__(self) -> str:
        L, P = 1e3 * np.asarray(self.data.length), 1e-3 * np.asarray(self.data.pressure)
        return f"MuscleCard({self.name}: {L[0]:.4g} to {L[1]:.4g} mm, {P[0]:.4g} to {P[1]:.4g} kPa)"

    @functools.cached_property
    def muscle(self) -> AbstractMuscle:
        """The model as it was identified: what the rig of the fit measures. Not for a simulator."""
        return joined(self.members, as_real(self.weights), mounted=giving_way(self.members))

    @functools.cached_property
    def _safe(self) -> SafeMuscle:
        if isinstance(jnp.zeros(()), Tracer):
            raise InputError(
                "a card's region is found with numbers, not while JAX traces: make the muscle before "
                "jit, grad or vmap, muscle = card.safe(), and use it within"
            )
        data = (np.asarray(one) for one in (self.data.length, self.data.pressure))
        return SafeMuscle.of(self.muscle, *data, hysteresis=self.hysteresis)

    def safe(self) -> SafeMuscle:
        """The muscle that may be taken anywhere, with its hysteresis: see `famjax.SafeMuscle`."""
        return self._safe

    @property
    def region(self) -> Region:
        """The part of the data's region in which the model is monotone, and taken as it is."""
        return self._safe.region

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, `famjax.continuation.continued_volume`, broadcast shape.

        Raises:
            InputError: the muscle is of a model without a geometry.
        """
        return continued_volume(self.muscle, self.region, length, pressure)

    @property
    def sample(self) -> AbstractMuscle | None:
        """Muscles drawn from the fit's errors, each array with a leading axis; None without errors.

        Ask them under `equinox.filter_vmap`. They do not spread by the model's own error, which
        `provenance.model_error` tells.
        """
        if self.draws is None:
            return None
        members, weights = self.members, as_real(self.weights)
        mounted = giving_way(members)
        return eqx.filter_vmap(
            lambda row: varied(members, weights, row, mounted=mounted),
            out_axes=eqx.if_array(0),
        )(as_real(self.draws.rows))

    def safe_sample(self) -> SafeMuscle | None:
        """The sample as safe muscles, each array with a leading axis; None without errors.

        Each is continued from where it rises within the card's region.
        """
        muscles = self.sample
        if muscles is None or self.draws is None:
            return None
        region = [np.asarray(one) for one in (self.region.length, self.region.pressure)]
        each = [
            SafeMuscle.of(
                jax.tree.map(lambda leaf, k=k: leaf[k], muscles),
                *region,
                hysteresis=self.hysteresis,
            )
            for k in range(len(self.draws.rows))
        ]
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)

    def cut(self, rest_length: float) -> "MuscleCard":
        """The card of another muscle of the series: `famjax.cut_to_length`, the same contractions.

        Its region is that of the same contractions and pressures. Errors and sample are left out:
        one specimen does not tell how specimens differ.

        Raises:
            InputError: the muscle cannot be cut to that length.
        """
        old = float(self.muscle.rest_length)
        if not (np.isfinite(rest_length) and rest_length > 0):
            raise InputError(f"the rest length must be > 0, got {rest_length} m")
        try:
            members = tuple(
                one.with_muscle(cut_to_length(one.muscle, rest_length)) for one in self.members
            )
        except ValueError as error:
            raise InputError(f"{self.name} cannot be cut to {rest_length:.4g} m: {error}") from None
        except eqx.EquinoxRuntimeError:
            raise InputError(
                f"{self.name} cannot be cut to {rest_length:.4g} m: that is shorter than its rounded "
                "ends. Give a longer rest length"
            ) from None
        ratio = rest_length / old
        hysteresis = self.hysteresis
        if hysteresis is not None:
            cycle, slip = hysteresis.cycle, hysteresis.slip
            if cycle.kind == "stroke":
                ends = {"start": ratio * cycle.start, "turn": ratio * cycle.turn}
                cycle = dataclasses.replace(cycle, **ends)
            slip = dataclasses.replace(slip, rest_length=as_real(rest_length))
            hysteresis = CentredSlip(slip, cycle)
        notes = [*self.provenance.notes, f"cut from {old:.6g} to {rest_length:.6g} m"]
        return dataclasses.replace(
            self,
            members=members,
            data=Region(ratio * self.data.length, self.data.pressure),
            covariance=None,
            draws=None,
            hysteresis=hysteresis,
            provenance=msgspec.structs.replace(self.provenance, notes=notes),
        )


def card_as_document(card: MuscleCard) -> CardDocument:
    """What stands in the card's file.

    Raises:
        InputError: a part of the muscle has no card format, or the model rises nowhere.
    """
    safe, members = card.safe(), []
    for one, weight in zip(card.members, np.asarray(card.weights, float), strict=True):
        if not isinstance(one.muscle, Muscle):
            raise InputError(
                f"a muscle card holds a famjax.Muscle, got a {type(one.muscle).__name__}, which has no "
                "card format"
            )
        of = muscle_as_dict(one.muscle)
        exponent = UNSET if one.exponent is None else float(one.exponent)
        members.append(Member(of, float(one.compliance), float(weight), exponent))
    loops = card.hysteresis
    return CardDocument(
        schema=SCHEMA,
        name=card.name,
        members=members,
        rest_length_m=float(safe.rest_length),
        data=_ranges(card.data),
        monotone=_ranges(safe.region),
        stops_m=np.asarray(safe.continued.stops, float).tolist(),
        volume=_volume(card),
        covariance=card.covariance,
        sample=None
        if card.draws is None
        else Sample(card.draws.seed, list(card.draws.names), card.draws.rows.tolist()),
        hysteresis=None if loops is None else msgspec.convert(slip_as_dict(loops), Hysteresis),
        provenance=card.provenance,
    )


def card_from_document(document: CardDocument) -> MuscleCard:
    """The card of a file's content.

    Raises:
        InputError: a muscle in it is none, or the sample is of other numbers.
    """
    members = tuple(
        MountedMuscle(
            muscle_from_dict(one.muscle),
            one.series_compliance_m_per_N,
            None if one.series_exponent is UNSET else one.series_exponent,
        )
        for one in document.members
    )
    sample, loops = document.sample, document.hysteresis
    if sample is not None and tuple(sample.numbers) != number_names(members[0]):
        raise InputError(
            "the muscle card is damaged: the sample's numbers must be those of the first member, "
            f"{', '.join(number_names(members[0]))}; got {', '.join(sample.numbers)}"
        )
    return MuscleCard(
        name=document.name,
        members=members,
        weights=np.array([one.weight for one in document.members]),
        data=Region(document.data.length_m, document.data.pressure_Pa),
        covariance=document.covariance,
        draws=None
        if sample is None
        else Draws(sample.seed, tuple(sample.numbers), np.array(sample.rows)),
        hysteresis=None if loops is None else slip_from_dict(msgspec.to_builtins(loops)),
        provenance=document.provenance,
    )


def read_card(path: "str | Path | Traversable") -> MuscleCard:
    """The muscle card in a file, of this version of its schema or an earlier one.

    Args:
        path: a file that `write_card` or `famjax card` has written; also one in a package.

    Returns:
        The card. Enable float64 in JAX first, or the muscle's numbers are rounded to float32.

    Raises:
        InputError: no such file, no muscle card, or a damaged one.
    """
    file = Path(path) if isinstance(path, str) else path
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path} is not a JSON file: {error}") from None
    try:
        return card_from_document(checked(document))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def write_card(card: MuscleCard, path: str | Path) -> Path:
    """Write a card's file, whole or not at all; its folder is made if need be.

    Raises:
        InputError: what cannot be written, and why.
    """
    path = Path(path)
    content = as_text(card_as_document(card)).encode()
    return write_all(path.parent, {path.name: content})[0]


def _ranges(region: Region) -> Ranges:
    return Ranges(
        np.asarray(region.length, float).tolist(), np.asarray(region.pressure, float).tolist()
    )


def _volume(card: MuscleCard) -> Volume | None:
    """A table over the region for readers that have no geometry; None for a model without one."""
    L, P = (
        np.linspace(float(ends[0]), float(ends[1]), count)
        for ends, count in zip((card.region.length, card.region.pressure), _TABLE, strict=True)
    )
    try:
        table = card.volume(L[:, None], P)
    except InputError:
        return None
    return Volume(L.tolist(), P.tolist(), np.asarray(table, float).tolist())
