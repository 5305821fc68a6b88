"""Convert time stamps (times of day, minutes or dates) to seconds, even if a test runs past midnight."""

import datetime
import math
import re
from collections.abc import Sequence

import numpy as np

from ._headers import CLOCK_UNIT, Column, remedy_for
from .boundary.errors import InputError

REPEATED = 0.1  # fraction of rows that may repeat a time before the stamps count as too coarse
_DAY = 86400.0
STAMP = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}"
    r"|\d{1,2}[- ][A-Za-z]{3}[- ]\d{2,4})[T ,]+)?(?P<a>\d{1,4}):(?P<b>\d{2})(?::(?P<c>\d{1,2}))?"
    r"(?:(?:[.,]|:(?=\d{3}\b))(?P<f>\d+))?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
_DATES = ("%Y-%m-%d", "%d-%m-%Y", "%m-%d-%Y", "%d-%b-%Y", "%d-%m-%y", "%m-%d-%y", "%d-%b-%y")


def clock_seconds(cells: Sequence[str], one: Column) -> np.ndarray:
    """Convert time stamps to seconds, even across midnight or several days; a missing stamp becomes nan."""
    stamps = [STAMP.fullmatch(cell) for cell in cells]
    good = [stamp for stamp in stamps if stamp is not None]
    if not good:
        return np.full(len(cells), np.nan)
    minutes, days = _minutes_first(good, one), _days([stamp["date"] or "" for stamp in good], one)
    seconds = []
    for stamp in good:
        a, b, c = (int(stamp[part] or 0) for part in "abc")
        if minutes and stamp["c"] is None:
            a, b, c = a // 60, a % 60, b
        if stamp["half"]:
            a = a % 12 + 12 * (stamp["half"][0] in "pP")
        zone = re.sub("Z|UTC|:", "", stamp["zone"] or "") or "+0000"
        shift = 3600 * int(zone[:3]) + 60 * int(zone[0] + zone[3:])
        whole = 3600 * a + 60 * b + c + float(f"0.{stamp['f'] or 0}") - shift
        seconds.append(whole if b < 60 and c < 60 else math.nan)
    known = np.array(seconds) + days * _DAY
    if not days.any():
        wrap = 3600.0 if minutes else _DAY
        with np.errstate(invalid="ignore"):
            back = np.diff(known) < -wrap / 2
        known[1:] += wrap * np.cumsum(back)
    found = np.full(len(cells), np.nan)
    found[[stamp is not None for stamp in stamps]] = known
    return found


def _minutes_first(stamps: Sequence[re.Match[str]], one: Column) -> bool:
    """Return True if two-part stamps are minutes and seconds; raise an error if they are ambiguous.

    A decimal fraction, a first part above 23 or a wrap at the full hour indicates minutes and seconds. A
    wrap at midnight indicates hours and minutes. The unit of the column takes precedence.
    """
    said = CLOCK_UNIT.fullmatch(one.unit.strip())
    if said:
        if said[1][0] in "mM" and (said[3] or said[2][0] not in "sS"):
            raise InputError(f"unknown time format {one.unit!r}: use hh:mm:ss, hh:mm or mm:ss")
        return said[1][0] in "mM"
    if any(stamp["c"] or stamp["half"] or stamp["date"] for stamp in stamps):
        return False
    first = np.array([int(stamp["a"]) for stamp in stamps])
    whole = first * 60 + np.array([int(stamp["b"]) for stamp in stamps])
    if any(stamp["f"] for stamp in stamps):
        return True
    if np.mean(np.diff(whole) == 0) > REPEATED:
        raise InputError(
            f"the time in {one} does not advance, perhaps because it lacks seconds: export it with seconds"
        )
    back = np.flatnonzero(np.diff(whole) < 0)
    if first.max() > 23 or (back.size and first[back].min() >= 59):
        return True
    if back.size and np.all(first[back] == 23) and np.all(first[back + 1] == 0):
        return False
    raise InputError(
        f"the time in {one}, {stamps[0][0]!r}, may be minutes and seconds or hours and minutes: specify "
        f"the format with {remedy_for('time', f'{one.title} [mm:ss]')} or [hh:mm]"
    )


def _days(dates: Sequence[str], one: Column) -> np.ndarray:
    """Return the days since the first date; raise an error if the dates are ambiguous or decrease."""
    distinct = list(dict.fromkeys(dates))
    if len(distinct) == 1:
        return np.zeros(len(dates))
    readings = set()
    for form in _DATES:
        try:
            plain = [re.sub("[./ ]", "-", date) for date in distinct]
            days = [datetime.datetime.strptime(date, form).toordinal() for date in plain]
        except ValueError:
            continue
        if all(np.diff(days) > 0):
            readings.add(tuple(day - days[0] for day in days))
    best = sorted(readings, key=lambda days: days[-1])
    if not best or (len(best) > 1 and best[0][-1] > 2 * len(distinct)):
        raise InputError(
            f"the dates in {one}, such as {distinct[0]!r}, are ambiguous or decrease: write them as "
            "2021-03-04 (year-month-day)"
        )
    number = dict(zip(distinct, best[0], strict=True))
    return np.array([number[date] for date in dates], float)
