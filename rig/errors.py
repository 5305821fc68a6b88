"""What the code of a rig raises: something that cannot be used, and what stops a test."""

from famjax.boundary.errors import InputError


class RigError(InputError):
    """What must hold, what came, and what to do; the command line prints it without a traceback."""


class RigFault(RuntimeError):  # noqa: N818 -- what the device calls one
    """A fault of the device, the link or the recorder; the rig is vented, or vents within a second."""
