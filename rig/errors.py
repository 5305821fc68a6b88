"""Errors of the rig: input that cannot be used, and faults that stop a test."""

from famjax.boundary.errors import InputError


class RigError(InputError):
    """Bad input: what must hold, what was given, what to do; commands print no traceback."""


class RigFault(RuntimeError):  # noqa: N818 -- what the device calls one
    """A fault of the device, the link or the recorder; the rig has vented, or vents within a second."""
