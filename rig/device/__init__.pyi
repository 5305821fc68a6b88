from .core import BAUD_RATES as BAUD_RATES, Device as Device
from .native import (
    NativeDevice as NativeDevice,
    build_native as build_native,
    firmware_folder as firmware_folder,
)
