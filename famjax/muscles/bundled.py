"""The two muscles of the bundled force maps, from their cards."""

import importlib.resources
from importlib.resources.abc import Traversable
from pathlib import Path

from ..boundary.errors import InputError, Own
from ..cards import MuscleCard, read_card
from ..continuation import SafeMuscle

NAMES = ("DMSP-10", "DMSP-20")
"""Muscles of which there is a card."""

_MAPS = ("DMSP-10-250", "DMSP-20-300")
"""Names of their force maps in `fitting`, in the same order."""


def bundled_name(name: str) -> str | None:
    """The name in `NAMES` of a bundled muscle in any common spelling, or None.

    In any case, with hyphens or underscores, and with or without the length of the muscle that was
    measured, which the name of its force map has.

    >>> [bundled_name(one) for one in ("dmsp_20", "DMSP-20-300", "dmsp-20-500", "card.json")]
    ['DMSP-20', 'DMSP-20', None, None]
    """
    asked = name.upper().replace("_", "-")
    known: dict[str, str] = dict(zip((*NAMES, *_MAPS), (*NAMES, *NAMES), strict=True))
    return known.get(asked)


def bundled_card(name: str) -> MuscleCard:
    """The card of a bundled muscle, at the measured rest length.

    Args:
        name: DMSP-10 or DMSP-20, or one that `bundled_name` takes.

    Raises:
        InputError: there is no such card.

    >>> bundled_card("DMSP-20")
    MuscleCard(DMSP-20: 222 to 296 mm, 35 to 675 kPa)
    """
    return read_card(_file(name))


def open_card(source: str | Path, *, own: Own = ()) -> MuscleCard:
    """The card in a file, or a bundled one by its name.

    Args:
        source: a file that `famjax card` has written, or the name of a bundled muscle.
        own: modules and classes that are trusted, as for `famjax.cards.read_card`.

    Raises:
        InputError: as of `read_card`.
    """
    if not Path(source).exists():
        if bundled_name(str(source)):
            return bundled_card(str(source))
        known = " and ".join(NAMES)
        raise InputError(f"no such file: {source}; the bundled muscles are {known}")
    return read_card(source, own=own)


def bundled_text(name: str) -> bytes:
    """The file of a bundled card, whose digest identifies the card of a result."""
    return _file(name).read_bytes()


def _file(name: str) -> Traversable:
    known = bundled_name(name)
    if known is None:
        raise InputError(
            f"no card of a muscle {name!r} is bundled; there are {', '.join(NAMES)}, also named "
            f"{', '.join(_MAPS)} after their force maps"
        )
    return importlib.resources.files(__name__.rpartition(".")[0]) / f"{known.lower()}.json"


def dmsp_10(length: float | None = None) -> SafeMuscle:
    """A Festo DMSP-10 cut to a length, safe at any state.

    Its model was chosen by what it predicts, and fitted to 85 readings of a muscle of 250 mm at up
    to 650 kPa and 21 % of contraction; RMSE 1.2 N of 542 N. Beyond them it is continued, see
    `famjax.SafeMuscle`. Enable float64 in JAX for every digit.

    Args:
        length: rest length [m] of the rubber between the fittings; that of the measured muscle
            unless given. Other lengths are computed from the same braid and rubber: no measurement
            has tested them.

    Returns:
        The muscle: `force(length, pressure)` in m, Pa (gauge) and N, and all that follows from it.

    Raises:
        InputError: no such length.

    References:
        Martens & Boblan 2017, Actuators 6(4), table A2, the readings.
    """
    return _cut("DMSP-10", length)


def dmsp_20(length: float | None = None) -> SafeMuscle:
    """A Festo DMSP-20 cut to a length, safe at any state.

    As `dmsp_10`: 126 readings of a muscle of 296 mm at up to 675 kPa and 25 % of contraction; RMSE
    3.2 N of 1654 N.

    Args:
        length: rest length [m] of the rubber between the fittings; 296 mm unless given.

    Returns:
        The muscle.

    Raises:
        InputError: no such length.

    References:
        Martens & Boblan 2017, Actuators 6(4), table A1, the readings.

    >>> muscle = dmsp_20(length=0.3)
    >>> print(f"{muscle.blocked_force(5e5):.0f} N, {100 * muscle.free_contraction(5e5):.0f} %")
    1196 N, 22 %
    """
    return _cut("DMSP-20", length)


def _cut(name: str, length: float | None) -> SafeMuscle:
    card = bundled_card(name)
    return card.safe() if length is None else card.cut(length).safe()
