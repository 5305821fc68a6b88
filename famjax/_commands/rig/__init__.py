"""`famjax rig`: with a device, simulated, and on what was recorded."""

from . import characterise, device, recorded, simulate

__all__ = ["characterise", "device", "recorded", "simulate"]
