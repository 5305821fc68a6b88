from . import (
    calibration as calibration,
    control as control,
    device as device,
    errors as errors,
    journal as journal,
    link as link,
    protocol as protocol,
    simulation as simulation,
)
from .calibration.whole_rig import Calibration as Calibration, read_calibration as read_calibration
from .control.plan_file import read_plan as read_plan
from .control.plan_run import run as run
from .control.rig import Rig as Rig
from .errors import RigError as RigError
from .fault import RigFault as RigFault
from .journal.law_audit import audit as audit
from .journal.reader import read_journal as read_journal
from .journal.writer import Journal as Journal
from .link.serial_link import Link as Link

__famjax__: str
