from . import (
    calibration as calibration,
    channels as channels,
    control as control,
    controller as controller,
    device as device,
    errors as errors,
    execution as execution,
    journal as journal,
    link as link,
    plan as plan,
    protocol as protocol,
    simulation as simulation,
)
from .calibration import Calibration as Calibration, read_calibration as read_calibration
from .control import Rig as Rig
from .errors import RigError as RigError, RigFault as RigFault
from .execution import run as run
from .journal import Journal as Journal, audit as audit, read_journal as read_journal
from .link import Link as Link
from .plan import read_plan as read_plan

__famjax__: str
