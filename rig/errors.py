"""Exceptions raised by the rig: invalid input, and faults that stop a test."""

from famjax.boundary.errors import InputError


class RigError(InputError):
    """Invalid input; commands print the message without a traceback."""


class RigFault(RuntimeError):  # noqa: N818 -- the device's own term
    """Fault in the device, the link or the recorder; the rig vents within a second."""
