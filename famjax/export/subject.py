"""What is exported: a muscle by its name, with what a file of it says of its making."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..boundary.errors import InputError
from ..boundary.origin import Origin
from ..cards import MuscleCard, read_card, unidentified
from ..continuation import SafeMuscle
from ..muscles import bundled_card, bundled_name, bundled_text
from .plain import TabulatedPull
from .tabulate import TableErrors, table_errors, tabulated


@dataclasses.dataclass(frozen=True, eq=False)
class Subject:
    """A muscle to be exported.

    Attributes:
        name: of the muscle.
        muscle: what is exported.
        card: that it comes from, or None.
        origin: lines on the file it comes from.
        tendon_offset: length [m] of the muscle where the joints of a simulator's `fixed` tendon are at
            0; None for a `spatial` tendon, whose length is the muscle's.
    """

    name: str
    muscle: SafeMuscle
    card: MuscleCard | None = None
    origin: tuple[str, ...] = ()
    tendon_offset: float | None = None

    def __post_init__(self) -> None:
        offset = self.tendon_offset
        if offset is not None and not (math.isfinite(offset) and offset > 0):
            raise InputError(
                f"the offset of a tendon must be > 0, the muscle's length [m] at joint 0, got {offset}"
            )

    @classmethod
    def of_card(
        cls, card: MuscleCard, *, length: float | None = None, origin: tuple[str, ...] = ()
    ) -> "Subject":
        """The muscle of a card, cut to a rest length [m] if one is given."""
        card = card if length is None else card.cut(length)
        return cls(card.name, card.safe(), card, origin)

    @property
    def warning(self) -> str | None:
        """What must be known where the card's fit has identified nothing, or None."""
        if self.card is None:
            return None
        made = self.card.provenance
        return unidentified(self.name, made.verdict, made.reasons)

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
    def errors(self) -> TableErrors:
        """How far the table is from the model."""
        return table_errors(self.muscle, self.pull)

    @functools.cached_property
    def about(self) -> list[str]:
        """What stands at the head of every file: muscle, origin, region."""
        L, P = (np.asarray(getattr(self.muscle.region, of)) for of in ("length", "pressure"))
        lines = [
            f"{self.name}, exported by famjax {__version__} with jax "
            f"{importlib.metadata.version('jax')}",
            *self.origin,
            f"the model's own from {L[0]:.6g} to {L[1]:.6g} m and {P[0]:.6g} to {P[1]:.6g} Pa, "
            "continued beyond",
        ]
        if self.muscle.hysteresis is not None:
            lines.append("the static map: the card's hysteresis is left out")
        notes = () if self.card is None else self.card.provenance.notes
        if self.warning is not None:
            lines.append(f"WARNING: {self.warning}")
        return [*lines, *self.muscle.notes, *notes]

    @property
    def about_table(self) -> list[str]:
        """The head of a file that holds the table: also how far it is from the model."""
        off = self.errors
        return [
            *self.about,
            f"largest difference from the model at {2 * off.states} random states, in parts of the "
            f"largest force {off.largest_force:.6g} N:",
            f"  {off.force:.1e} in that region, {off.force_beyond:.1e} up to twice its lengths and "
            "pressures,",
            f"  {off.pressure:.2g} Pa by the inverse; the target's own rounding comes on top",
        ]


def read_subject(
    source: str | Path, *, length: float | None = None, origin: Origin | None = None
) -> Subject:
    """The muscle of a card's file, or a bundled one by its name.

    Args:
        source: a file that `famjax card` has written, or the name of a bundled muscle.
        length: rest length [m] to which it is cut; its own unless given.
        origin: of the files that will be written.

    Raises:
        InputError: no such file, no card, or the muscle cannot be cut.
    """
    path = Path(source)
    name = None if path.exists() else bundled_name(str(source))
    if name is not None:
        text, card = bundled_text(name), bundled_card(name)
        origins = made_of(f"the bundled card {name}", text, origin)
    else:
        card = read_card(path)
        origins = made_of(path.name, path.read_bytes(), origin)
    return Subject.of_card(card, length=length, origin=origins)


def made_of(name: str, content: bytes, origin: Origin | None = None) -> tuple[str, ...]:
    """Lines on the file that a muscle comes from, and on the command that exports it."""
    lines = [f"of {name}, sha256 {hashlib.sha256(content).hexdigest()}"]
    return tuple(lines if origin is None else [*lines, f"by `{origin.command}` on {origin.date}"])
