"""Whether a test may go on in a journal: the same plan, limits, gains and calibration."""

import json
import re
from collections.abc import Mapping
from typing import Any

from ..calibration.whole_rig import Calibration
from ..errors import RigError
from ..journal.reader import Record
from .plan import next_block
from .plan_file import PlanFile

_FIELD = re.compile(r"(\w+)=(.*?)(?=, \w+=|\)$)")


def resumed_block(record: Record, test: PlanFile, calibration: Calibration) -> int:
    """The block with which a test goes on in the journal that it began.

    Raises:
        RigError: what differs from the test that the journal holds, or it is complete.
    """
    apart = _plan_differences(record, repr(test.plan))
    for note in record.notes_of("rig")[-1:]:
        apart += _differences(note, json.loads(json.dumps(test.settings.as_note(calibration))))
    if apart:
        raise RigError(
            f"{record.path} cannot be resumed with another test: {'; '.join(apart)}. Restore what it "
            "was begun with, or record into another folder"
        )
    block = next_block(record.notes)
    if block >= len(test.plan.pressures):
        raise RigError(f"{record.path} is complete: nothing is left to resume")
    return block


def _plan_differences(record: Record, plan: str) -> list[str]:
    for note in record.notes_of("plan")[-1:]:
        if note["plan"] != plan:
            before, after = (dict(_FIELD.findall(text)) for text in (note["plan"], plan))
            return _differences(before, after) or [f"the plan was {note['plan']}, is {plan}"]
    return []


def _differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """What has another value, a name and both values each; of tables the entries that have."""
    found = []
    for name, value in after.items():
        old = before.get(name)
        if isinstance(value, dict) and isinstance(old, dict):
            found += [f"{name}: {one}" for one in _differences(old, value)]
        elif old != value:
            found.append(f"{name} was {old}, is {value}")
    return found
