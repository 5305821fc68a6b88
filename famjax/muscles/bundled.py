"""Load the bundled muscles from their cards."""

import importlib.resources
from importlib.resources.abc import Traversable
from pathlib import Path

from ..boundary.errors import InputError, Own
from ..cards import MuscleCard, read_card
from ..continuation import SafeMuscle

NAMES = ("DMSP-10", "DMSP-20")
"""Names of the muscles with a bundled card."""

_MAPS = ("DMSP-10-250", "DMSP-20-300")
"""Names of the corresponding force maps in `fitting`, in the same order."""


def bundled_name(name: str) -> str | None:
    """Return the name in `NAMES` of a bundled muscle spelled in any common way, or None.

    Accepts upper and lower case, hyphens and underscores, and the name of the muscle's force map.

    >>> [bundled_name(one) for one in ("dmsp_20", "DMSP-20-300", "dmsp-20-500", "card.json")]
    ['DMSP-20', 'DMSP-20', None, None]
    """
    asked = name.upper().replace("_", "-")
    known: dict[str, str] = dict(zip((*NAMES, *_MAPS), (*NAMES, *NAMES), strict=True))
    return known.get(asked)


def bundled_card(name: str) -> MuscleCard:
    """Return the card of a bundled muscle at the rest length that was measured.

    Args:
        name: DMSP-10 or DMSP-20, in any spelling accepted by `bundled_name`.

    Raises:
        InputError: no bundled muscle has this name.

    >>> bundled_card("DMSP-20")
    MuscleCard(DMSP-20: 222 to 296 mm, 35 to 675 kPa)
    """
    return read_card(_bundled_file(name))


def open_card(source: str | Path, *, own: Own = ()) -> MuscleCard:
    """Read a card from a file, or the card of a bundled muscle.

    Args:
        source: file written by `famjax card`, or name of a bundled muscle.
        own: trusted modules and classes; see `famjax.cards.read_card`.

    Raises:
        InputError: see `read_card`.
    """
    return read_card(card_file(source), own=own)


def card_file(source: str | Path) -> Path | Traversable:
    """Return the file that contains a card, or the card of the bundled muscle with this name.

    Raises:
        InputError: there is no such file or muscle.
    """
    path = Path(source)
    return path if path.exists() else _bundled_file(str(source))


def _bundled_file(name: str) -> Traversable:
    known = bundled_name(name)
    if known is None:
        raise InputError(f"no such file: {name}; the bundled muscles are {' and '.join(NAMES)}")
    return importlib.resources.files(__name__.rpartition(".")[0]) / f"{known.lower()}.json"


def dmsp_10(length: float | None = None) -> SafeMuscle:
    """Return a Festo DMSP-10 cut to a given length, which can be evaluated safely in any state.

    The model was selected by its held-out error and fitted to 85 readings from a 250 mm muscle, up to
    650 kPa and 21 % contraction. The RMSE is 1.2 N, and the largest force is 542 N. `famjax.SafeMuscle`
    describes how the model is continued beyond the data. Enable float64 in JAX for full precision.

    Args:
        length: rest length [m] of the rubber between the end-fittings. If omitted, the length of the
            measured muscle is used. Other lengths assume the same braid and rubber, and are not
            validated by measurements.

    Returns:
        The muscle, with `force(length, pressure)` in m, Pa (gauge) and N.

    Raises:
        InputError: the muscle cannot be cut to this length.

    References:
        Martens & Boblan 2017, Actuators 6(4), table A2 (readings).
    """
    return _cut("DMSP-10", length)


def dmsp_20(length: float | None = None) -> SafeMuscle:
    """Return a Festo DMSP-20 cut to a given length, which can be evaluated safely in any state.

    See `dmsp_10`. The model was fitted to 126 readings from a 296 mm muscle, up to 675 kPa and 25 %
    contraction. The RMSE is 3.2 N, and the largest force is 1654 N.

    Args:
        length: rest length [m] of the rubber between the end-fittings; 296 mm if omitted.

    Returns:
        The muscle.

    Raises:
        InputError: the muscle cannot be cut to this length.

    References:
        Martens & Boblan 2017, Actuators 6(4), table A1 (readings).

    >>> muscle = dmsp_20(length=0.3)
    >>> print(f"{muscle.blocked_force(5e5):.0f} N, {100 * muscle.free_contraction(5e5):.0f} %")
    1196 N, 22 %
    """
    return _cut("DMSP-20", length)


def _cut(name: str, length: float | None) -> SafeMuscle:
    card = bundled_card(name)
    return card.safe() if length is None else card.cut(length).safe()
