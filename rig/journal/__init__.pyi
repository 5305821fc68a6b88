from .law_audit import Audit as Audit, audit as audit
from .reader import (
    Missing as Missing,
    Record as Record,
    read_journal as read_journal,
    stored_calibration as stored_calibration,
)
from .writer import Journal as Journal
