"""Interpret column names: quantity, unit or other meaning. The vocabulary is in data/tables.toml."""

import functools
import importlib.resources
import math
import re
import tomllib
import unicodedata
from typing import NamedTuple

from .boundary.units import UNITS

KINDS = {
    "time": "time", "displacement": "length", "force": "force", "pressure": "pressure",
    "length": "length", "contraction": "contraction", "valve_state": "state",
}  # fmt: skip
"""Kind of unit for each quantity in a table; `force_std` has the same kind as `force`."""
_LONGEST = 40  # characters of a cell shown in a message
_WORDS = tomllib.loads(
    (importlib.resources.files("famjax") / "data" / "tables.toml").read_text(encoding="utf-8")
)
SIZES = {kind: {**UNITS.get(kind, {}), **more} for kind, more in _WORDS["units"].items()}
for _sizes in SIZES.values():
    for _unit, _same in _WORDS["same"].items():
        if _unit in _sizes:
            _sizes.update(dict.fromkeys(_same.split(), _sizes[_unit]))


_HEADS = {word: name for name, words in _WORDS["quantities"].items() for word in words.split()}
_REASONS = {word: why for why, words in _WORDS["no measurement"].items() for word in words.split()}
_PLAIN = frozenset(_WORDS["plain"]["words"].split())
_JOINED = _WORDS["plain"]["joined"].split()
OTHER_UNITS = frozenset(_WORDS["others"]["units"].split())
SUMMARIES = frozenset(_WORDS["summaries"]["words"].split())
_KNOWN = _PLAIN | _REASONS.keys()
_STD = {"std", "sd", "stdev"}
CLOCK_UNIT = re.compile(r"(h+|m+):(m+|s+)(:s+)?(?:[.,:]\w+)?", re.IGNORECASE)
MODE = re.compile(r"(?i)(?<![^\W_])(?:(abs|absolute?)|gauge|gage|rel|relative?)(?![^\W_])\.?")
_MODE_BESIDE = re.compile(
    r"(?i)(?<![^\W_])([kmh]?pa|m?bar|psi|at|cm2|hg)(?:\s*\(([agü])\)|\s+([agü]))(?![^\W_])"
)
_BRACKETS = [
    re.compile(form)
    for form in (r"\[([^\[\]]*)\]", r"\(((?:[^()]|\([^()]*\))*)\)", r"\{([^{}]*)\}", r"<([^<>]*)>")
]
_BESIDE = re.compile(r"\s*/\s*|\s+in\s+|\s*[,;:.]\s*|_|\s+")
_FORMULA = re.compile(r"[*^|=+\u00d7\u221a]|/\s*\d|^\s*[-\d]|\d[.,:]\d|,\s*\d")
_MULTIPLE = re.compile(r"[x\u00d7]?\s*\d[\d.,]*\s*[x\u00d7*]?\s*(.+)")


class Column(NamedTuple):
    """Meaning of a table column, inferred from its name and unit.

    Attributes:
        name: name in the table.
        title: name without the unit.
        unit: unit as written in the table, "" if there is none.
        quantity: measured quantity, a key of `KINDS` with or without the suffix `_std`; None if unknown.
        reason: what the column contains if it is not a measurement of the muscle; otherwise "".
        plain: True if every word in the name is known and the name is not a formula.
        absolute: True for absolute pressure, False for gauge pressure, None if unspecified.
        place: column index, counted from 0.
        size: factor that converts the unit to SI.
        named: True if the user assigned the column to its quantity.
        first: value of the first reading, in the column's unit.
    """

    name: str
    title: str
    unit: str
    quantity: str | None
    reason: str
    plain: bool
    absolute: bool | None
    place: int = 0
    size: float = 1.0
    named: bool = False
    first: float = math.nan

    def __str__(self) -> str:
        return f"column {shortened(self.name)}"


def shortened(text: str) -> str:
    """Quote text for use in a message; truncate it if it is long."""
    return repr(text if len(text) <= _LONGEST else text[:_LONGEST] + "...")


def kind_of(quantity: str) -> str:
    """Return the kind of unit in which a quantity is measured."""
    return KINDS[quantity.removesuffix("_std")]


def unit_size(unit: str, kind: str) -> tuple[float, bool | None] | None:
    """Return the factor that converts a unit, in any manufacturer's spelling, to SI; None if unknown.

    Returns:
        The factor and, for a pressure, True (absolute), False (gauge) or None (unspecified).

    >>> unit_size("mbar", "pressure"), unit_size("kgf/cm^2", "pressure"), unit_size("psia", "pressure")[1]
    ((100.0, None), (98066.5, None), True)
    """
    text = re.sub(r"[\s^*\u00b7()]", "", unicodedata.normalize("NFKC", unit)).rstrip(".")
    known, lower = SIZES[kind], text.casefold()
    same = [name for name in known if name.casefold() == lower]
    if lower in {"mn", "mpa"}:  # milli or mega: only the case decides
        same = [name for name in same if name == "MPa" and text[0] == "M"]
    elif text[:1] == "M" and not text.isupper():
        same = [name for name in same if name[0] == "M"]
    if text in known:
        return known[text], None
    if len({known[name] for name in same}) == 1:
        return known[same[0]], None
    if kind == "pressure" and len(text) > 2 and lower[-1] in "agü":
        found = unit_size(text[:-1], kind)
        return found and (found[0], lower[-1] == "a")
    return None


def any_unit(text: str) -> bool:
    """Return True if the text is a unit of any kind."""
    return bool(text.strip("- ")) and (
        bool(CLOCK_UNIT.fullmatch(text))
        or any(unit_size(MODE.sub("", text), kind) is not None for kind in SIZES)
    )


def tokens_of(text: str) -> list[str]:
    """Split a name into words, and compound words into their parts."""
    apart = re.sub("(?<=[a-zäöüß])(?=[A-ZÄÖÜ])", " ", text)
    words = re.findall(r"[^\W\d_]+", apart.casefold())
    return [part for word in words for part in _parts(word)]


@functools.lru_cache(4096)
def _parts(word: str) -> tuple[str, ...]:
    if word in _HEADS or word in _KNOWN:
        return (word,)
    for head in sorted(_HEADS, key=len, reverse=True):
        for rest in {word.removeprefix(head), word.removesuffix(head)} - {word, ""}:
            rest = rest if rest in _KNOWN or len(head) == 1 else rest.removesuffix("s")  # noqa: PLW2901
            if rest in _KNOWN or (head in _JOINED and len(rest) > 1):
                return head, rest
    return (word,)


def _strange(text: str) -> bool:
    """Return True if the text contains no known word, so that it may be an unknown unit."""
    return not any(word in _KNOWN or word in _HEADS for word in tokens_of(text))


def split_unit(text: str) -> tuple[str, str]:
    """Split `Load (N)`, `Weg / mm`, `time_s` or `Force, N` into name and unit; the unit may be ""."""
    unknown: list[tuple[str, str]] = []
    for pattern in _BRACKETS:
        for match in reversed(list(pattern.finditer(text))):
            inner, rest = match[1].strip(), f"{text[: match.start()]} {text[match.end() :]}".strip()
            multiple = _MULTIPLE.fullmatch(inner)
            if inner and (
                (multiple and any_unit(multiple[1]))
                or any_unit(inner)
                or inner.casefold() in OTHER_UNITS
            ):
                return rest, inner
            if inner and rest and _strange(inner):
                unknown.append((rest, inner))
    for match in _BESIDE.finditer(text):
        stem, tail = text[: match.start()], text[match.end() :]
        words = tokens_of(stem)
        heads = {_HEADS[word] for word in words if word in _HEADS}
        if any(unit_size(tail, KINDS[head]) for head in heads):
            return stem, tail
        alone = heads and all(word in _HEADS or word in _STD for word in words) and match[0].strip()
        if alone and not tail.isdecimal() and _strange(tail):
            unknown.append((stem, tail))
    return unknown[0] if unknown else (text, "")


def joined_mode(text: str) -> str:
    """Attach a separate `(a)` or `g`, for absolute or gauge pressure, to the pressure unit."""
    return _MODE_BESIDE.sub(lambda m: f"{m[1]}{m[2] or m[3]}", unicodedata.normalize("NFKC", text))


@functools.lru_cache(4096)
def judge(name: str, below: str = "") -> Column:
    """Interpret a column name.

    Args:
        name: name in the table.
        below: unit from a separate row of units.

    >>> judge("Pressure setpoint (psi)").reason, judge("Kraft [kN]").unit, judge("p abs. / mbar").absolute
    ('a set point or command', 'kN', True)
    """
    text, below = joined_mode(name).strip(" '\"#"), joined_mode(below)
    said = [bool(match[1]) for match in MODE.finditer(f"{text} {below}")]
    text = re.sub(r"[(\[{]\s*[)\]}]", "", MODE.sub(" ", text)).replace("__", "_")
    text = text.strip(" _,").rstrip("-")
    title, unit = split_unit(text)
    below = MODE.sub("", below).strip(" ,()[]")
    words = tokens_of(title)
    heads = {_HEADS[word] for word in words if word in _HEADS}
    quantity = heads.pop() if len(heads) == 1 else None
    reasons = [_REASONS[word] for word in words if word in _REASONS]
    if (quantity == "length" and said) or re.search(r"(?<![^\W_])[A-Za-z]_?0(?![^\W_])", title):
        reasons.append("an offset or setting")
    if quantity == "valve_state" and set(words) <= {"valve", "ventil", "state", "status"}:
        reasons = []
    absolute = True if {"abs", "absolut", "absolute"} & set(words) else said[0] if said else None
    return Column(
        name, title, below if below and not any_unit(unit) else unit,
        f"{quantity}_std" if quantity and _STD & set(words) else quantity,
        reasons[0] if reasons else "",
        _KNOWN | _HEADS.keys() >= set(words) and not _FORMULA.search(title),
        absolute,
    )  # fmt: skip


def remedy_for(quantity: str, name: str) -> str:
    return f"--column {quantity}=\"{name}\" (columns={{'{quantity}': '{name}'}} in Python)"
