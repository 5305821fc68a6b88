from .calibration import (
    Calibration as Calibration,
    calibration_as_dict as calibration_as_dict,
    calibration_from_dict as calibration_from_dict,
    read_calibration as read_calibration,
    write_calibration as write_calibration,
)
from .feed_forward import FeedForward as FeedForward, fit_feed_forward as fit_feed_forward
from .monitor import Monitor as Monitor
from .operator import (
    convert as convert,
    need_port as need_port,
    ports as ports,
    quantity as quantity,
    run_test as run_test,
    specimen_entries as specimen_entries,
)
from .plan import (
    Isobaric as Isobaric,
    Plan as Plan,
    Step as Step,
    describe as describe,
    duration as duration,
    highest_pressure as highest_pressure,
    isobaric_from_dict as isobaric_from_dict,
    next_block as next_block,
)
from .plan_file import PRECONDITIONS as PRECONDITIONS, PlanFile as PlanFile, read_plan as read_plan
from .plan_run import (
    Machine as Machine,
    calibrate_feed_forward as calibrate_feed_forward,
    run as run,
)
from .rig import Rig as Rig
from .sensor import Sensor as Sensor, fit_sensor as fit_sensor
from .settings import Control as Control
