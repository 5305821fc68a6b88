from .feed_forward import FeedForward as FeedForward, fit_feed_forward as fit_feed_forward
from .sensor import READINGS as READINGS, Sensor as Sensor, fit_sensor as fit_sensor
from .whole_rig import (
    Calibration as Calibration,
    calibration_as_dict as calibration_as_dict,
    calibration_from_dict as calibration_from_dict,
    read_calibration as read_calibration,
    update_calibration as update_calibration,
    write_calibration as write_calibration,
)
