"""Names and units of a log's columns, in the words of several makers and languages."""

import re
from collections.abc import Collection, Mapping

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS

from .log_text import LogText

KINDS = {"time": "time", "displacement": "length", "force": "force", "pressure": "pressure"}
"""The columns of a machine log and the kind of unit of each."""

_WORDS = {
    "time": "time zeit prüfzeit pruefzeit testzeit laufzeit temps elapsed",
    "displacement": "displacement disp crosshead extension position stroke travel weg traversenweg "
    "standardweg maschinenweg kolbenweg prüfweg traverse déplacement",
    "force": "force load kraft standardkraft prüfkraft pruefkraft last kraftsensor charge",
    "pressure": "pressure druck pression",
}
NAMES = {quantity: frozenset(words.split()) for quantity, words in _WORDS.items()}
"""Words by which a column's name is known, in lower case."""

_ALIASES = {
    "time": {"sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "sekunden": "s",
             "msec": "ms", "minute": "min", "minutes": "min", "minuten": "min"},
    "length": {"inch": "in", "inches": "in", '"': "in", "millimeter": "mm", "meter": "m"},
    "force": {"newton": "N", "newtons": "N", "lb": "lbf", "lbs": "lbf", "pound": "lbf",
              "pounds": "lbf", "kilonewton": "kN", "kp": "kgf"},
    "pressure": {"pascal": "Pa"},
}  # fmt: skip
_MORE = {
    "time": {"h": 3600.0, "us": 1e-6, "\u00b5s": 1e-6, "\u03bcs": 1e-6},
    "length": {"um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6},
    "force": {"mN": 1e-3, "MN": 1e6, "daN": 10.0, "kip": 4448.2216152605, "gf": 9.80665e-3},
    "pressure": {"mbar": 100.0},
}  # fmt: skip
_LOOK = 200  # rows in which a decimal point is sought
_BRACKETS = re.compile(r"^(.*?)[\s_,]*[(\[{<]\s*([^()\[\]{}<>]*)\s*[)\]}>]$")
_BESIDE = re.compile(r"^(.*\S)(?:\s*/\s*|\s+in\s+|\s*,\s*|_|\s+)(\S+)$")


def unit_factor(unit: str, kind: str) -> float | None:
    """The multiplier that takes a unit, in any maker's spelling, to SI; None where it is not known.

    >>> unit_factor("Sec", "time"), unit_factor("kN", "force"), unit_factor("furlong", "length")
    (1.0, 1000.0, None)
    """
    unit = unit.strip().strip(".")
    known = UNITS[kind] | _MORE[kind]
    if unit in known:
        return known[unit]
    lower = unit.casefold()
    if lower in _ALIASES[kind]:
        return known[_ALIASES[kind][lower]]
    # mN and MN differ in case alone; any other unit may be written in either.
    same = [value for name, value in known.items() if name.casefold() == lower]
    return same[0] if len(same) == 1 else None


def columns(
    text: LogText,
    chosen: Mapping[str, str],
    units: Mapping[str, str],
    needed: Collection[str],
    welcome: Collection[str] = (),
) -> tuple[dict[str, tuple[int, float]], list[str]]:
    """Index and multiplier to SI of each quantity, and every column's full name.

    Args:
        text: the cells.
        chosen: name or number (from 1) of a column for a quantity, where the names do not tell.
        units: unit of a quantity, where the log has none.
        needed: quantities that the log must hold, of `KINDS`.
        welcome: those that it may hold.

    Raises:
        InputError: a quantity has no column or several, or a unit that is missing or not known.
    """
    names, below = _header(text)
    parsed = [_name_and_unit(name) for name in names]
    quantities = [_quantity(name) for name, _ in parsed]
    found = {}
    for quantity in (*needed, *welcome):
        if quantity in welcome and quantity not in chosen and quantity not in quantities:
            continue
        kind = KINDS[quantity]
        known = [
            unit_factor(u or b, kind) is not None for (_, u), b in zip(parsed, below, strict=True)
        ]
        k = _column(quantity, parsed, names, chosen, known)
        unit = units.get(quantity) or parsed[k][1] or below[k]
        if not unit:
            raise InputError(
                f"column {names[k]!r} has no unit, in its name or in a row below: give it, "
                f'units={{"{quantity}": "{next(iter(UNITS[kind]))}"}} or '
                f"--log-units {quantity}={next(iter(UNITS[kind]))}"
            )
        factor = unit_factor(unit, kind)
        if factor is None:
            raise InputError(
                f"column {names[k]!r} has the unknown unit {unit!r}; known units of {kind} are "
                f"{', '.join(UNITS[kind] | _MORE[kind])}"
            )
        found[quantity] = (k, factor)
    full = [
        name if not unit else f"{name} ({unit})" for name, unit in zip(names, below, strict=True)
    ]
    return found, full


def _header(text: LogText) -> tuple[list[str], list[str]]:
    """Names of the columns, and the units in a row of their own below ("" where there is none)."""
    n = text.n_columns
    above = []
    for _, cells in reversed(text.rows[: text.first]):
        above.append([*cells, *[""] * n][:n])
        if len(above) == 4:
            break
    scores = [sum(_quantity(_name_and_unit(c)[0]) is not None for c in row) for row in above]
    if not scores or max(scores) == 0:
        return [f"column {k + 1}" for k in range(n)], [""] * n
    at = scores.index(max(scores))  # the nearest to the numbers
    _check_commas(text, above[at])
    units = [""] * n
    for row in above[:at]:
        bare = [_strip_brackets(cell) for cell in row]
        if any(unit_factor(c, kind) is not None for c in bare for kind in KINDS.values()) or any(
            cell != c for cell, c in zip(row, bare, strict=True)
        ):
            units = bare
            break
    return above[at], units


def _check_commas(text: LogText, header: list[str]) -> None:
    """Refuse numbers with decimal commas between commas: more cells than names, and no point in any."""
    line, cells = text.rows[text.first]
    values, names = (len([cell for cell in row if cell]) for row in (cells, header))
    block = text.rows[text.first : text.first + _LOOK]
    if text.delimiter != "," or values <= names or any("." in c for _, row in block for c in row):
        return
    raise InputError(
        f"line {line} has {values} numbers under {names} names ({', '.join(filter(None, header))}), all "
        "separated by commas and none with a decimal point: are they decimal commas? Export the log "
        "with semicolons or tabs between the columns, or with decimal points, or name every column"
    )


def _strip_brackets(cell: str) -> str:
    match = _BRACKETS.match(cell.strip())
    return match.group(2).strip() if match and not match.group(1) else cell.strip()


def _name_and_unit(name: str) -> tuple[str, str]:
    """`Load (N)`, `Kraft [N]`, `Weg / mm`, `time_s`: the name and the unit, or "" for none."""
    match = _BRACKETS.match(name.strip())
    if match and match.group(1):
        return match.group(1).strip(), match.group(2).strip()
    match = _BESIDE.match(name.strip())
    if match:
        known = any(unit_factor(match.group(2), kind) is not None for kind in KINDS.values())
        if known or "/" in name or "_" in name:
            return match.group(1).strip(), match.group(2)
    return name.strip(), ""


def _quantity(name: str) -> str | None:
    words = set(re.findall(r"[^\W\d_]+", name.casefold()))
    for quantity, known in NAMES.items():
        if words & known:
            return quantity
    return None


def _column(
    quantity: str,
    parsed: list[tuple[str, str]],
    names: list[str],
    chosen: Mapping[str, str],
    fitting_unit: list[bool],
) -> int:
    if quantity in chosen:
        wanted = chosen[quantity]
        matches = [k for k, name in enumerate(names) if wanted in (name, parsed[k][0])]
        if not matches and wanted.isdecimal() and 1 <= int(wanted) <= len(names):
            matches = [int(wanted) - 1]
    else:
        matches = [k for k, (name, _) in enumerate(parsed) if _quantity(name) == quantity]
        # Load and load rate: the unit tells. Time and cycle time: the plainer name does, but a second
        # load is of the same kind, whatever it is called.
        fitting = [k for k in matches if fitting_unit[k]]
        plain = [k for k in fitting or matches if parsed[k][0].casefold() in NAMES[quantity]]
        matches = fitting or matches
        if len(plain) == 1 and (quantity == "time" or not fitting):
            matches = plain
    if len(matches) != 1:
        what = "no column" if not matches else f"{len(matches)} columns"
        which = f" ({', '.join(names[k] for k in matches)})" if matches else ""
        raise InputError(
            f"{what} for {quantity}{which}; the log has {', '.join(names)}: choose one by its name, "
            f'columns={{"{quantity}": "..."}} or --log-columns {quantity}=..., or by its number from 1'
        )
    return matches[0]
